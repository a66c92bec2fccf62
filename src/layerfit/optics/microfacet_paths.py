"""Where the facets of a Gaussian face send light, and how much of it gets away without meeting another facet (Smith's model).

Directions are unit vectors of travel (x along the incident light, z up). Heights are uncorrelated; see `microfacet` for the facets themselves.

References
----------
J. Stam, Proc. Eurographics Workshop on Rendering 2001, section 4. Two corrections: power on a facet needs its area per horizontal area (1/cos of its
tilt) beside the density of normals of eq 17, which `microfacet.facets` has by working in slopes; and mu_t = sqrt(cos^2 + eta^2 - 1), where the
square is missing in print. B. Walter et al., EGSR 2007, eqs 20 to 22; E. Heitz et al., ACM Trans. Graph. 35, 58 (2016), eqs 17 and 30 (shadowing).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array
from jax.scipy.special import betaln, erfc
from jaxtyping import Float

from .fresnel import reflectance
from .microfacet import Facets


class Paths(NamedTuple):
    """Light after one facet.

    share : of the incident power, without what is caught by another facet. cosine : with the mean normal, away from the face (0 where it heads into
    it). azimuth : cosine of the azimuth from the incident light's. caught : power that meets another facet.
    """

    share: Float[Array, "*q"]
    cosine: Float[Array, "*q"]
    azimuth: Float[Array, "*q"]
    caught: Float[Array, "*q"]


def smith_lambda(mu: Float[Array, "*s"], roughness: Float[Array, "*#s"]) -> Float[Array, "*s"]:
    """Smith's Lambda of a Gaussian face of RMS slope ``roughness`` per axis, for cosine mu > 0 [1].

    B. Smith, IEEE Trans. Antennas Propag. 15, 668 (1967), eq 24.
    """
    sine = jnp.sqrt(jnp.maximum(1.0 - mu**2, 1e-30))
    a = mu / (jnp.sqrt(2.0) * jnp.maximum(roughness, 1e-30) * sine)
    near = a < 10.0
    safe = jnp.where(near, jnp.maximum(a, 1e-12), 1.0)
    return jnp.where(near, 0.5 * (jnp.exp(-(safe**2)) / (safe * jnp.sqrt(jnp.pi)) - erfc(safe)), 0.0)


def escape_reflected(lambda_in: Float[Array, "*#s"], lambda_out: Float[Array, "*#s"]) -> Float[Array, "*s"]:
    """Chance to leave on the side of arrival after one facet: G2/G1."""
    return (1.0 + lambda_in) / (1.0 + lambda_in + lambda_out)


def escape_refracted(lambda_in: Float[Array, "*#s"], lambda_out: Float[Array, "*#s"]) -> Float[Array, "*s"]:
    """Chance to leave on the far side after one facet: (1 + Lambda_in) B(1 + Lambda_in, 1 + Lambda_out)."""
    a, b = jnp.minimum(lambda_in, 1e12), jnp.minimum(lambda_out, 1e12)
    return jnp.exp(jnp.log1p(a) + betaln(1.0 + a, 1.0 + b))


def paths(met: Facets, mu: Float[Array, "*m"], n: Float[Array, ""], roughness: Float[Array, ""]) -> tuple[Paths, Paths]:
    """Reflected and refracted light. mu : cosine of incidence on the mean plane; n : index of the light's medium over the one beyond."""
    mu = mu[..., None, None]
    sine = jnp.sqrt(jnp.maximum(1.0 - mu**2, 1e-30))
    normal = 1.0 / jnp.sqrt(1.0 + met.x**2 + met.y**2)
    back = reflectance(met.cosine, n)
    lambda_in = smith_lambda(mu, roughness)

    along = 2.0 * met.cosine * normal
    reflected = _paths(met.weight * back, sine - along * met.x, -along * met.y, along - mu, lambda_in, roughness, escape_reflected)
    inside = 1.0 - n**2 * (1.0 - met.cosine**2)
    cosine = jnp.sqrt(jnp.where(inside > 0.0, inside, 1.0)) * (inside > 0.0)
    bend = (n * met.cosine - cosine) * normal
    refracted = _paths(met.weight * (1.0 - back), n * sine - bend * met.x, -bend * met.y, n * mu - bend, lambda_in, roughness, escape_refracted)
    return reflected, refracted


def _paths(
    power: Float[Array, "*#q"],
    x: Float[Array, "*#q"],
    y: Float[Array, "*#q"],
    z: Float[Array, "*#q"],
    lambda_in: Float[Array, "*#q"],
    roughness: Float[Array, ""],
    escape: Callable[..., Array],
) -> Paths:
    horizontal = jnp.sqrt(x**2 + y**2 + 1e-30)
    away = z > 0.0
    cosine = jnp.where(away, jnp.minimum(z, 1.0), 1.0)
    share = power * jnp.where(away, escape(lambda_in, smith_lambda(cosine, roughness)), 0.0)
    return Paths(share, jnp.where(away, cosine, 0.0), x / horizontal, power - share)


def brdf(
    mu_in: Float[Array, "*#s"], mu_out: Float[Array, "*#s"], azimuth: Float[Array, "*#s"], n: Float[Array, ""], roughness: Float[Array, ""]
) -> Float[Array, "*s"]:
    """Reflected radiance per irradiance after one facet [1/sr]. azimuth : between the two ways of travel [rad], 0 in the mirror's plane."""
    sin_in, sin_out = jnp.sqrt(1.0 - mu_in**2), jnp.sqrt(1.0 - mu_out**2)
    x, y, z = sin_out * jnp.cos(azimuth) - sin_in, sin_out * jnp.sin(azimuth), mu_in + mu_out
    length = jnp.sqrt(x**2 + y**2 + z**2)
    cosine = 0.5 * length
    masking = 1.0 / (1.0 + smith_lambda(mu_in, roughness) + smith_lambda(mu_out, roughness))
    return reflectance(cosine, n) * _density(x / z, y / z, roughness) / (z / length) ** 4 * masking / (4.0 * mu_in * mu_out)


def btdf(
    mu_in: Float[Array, "*#s"], mu_out: Float[Array, "*#s"], azimuth: Float[Array, "*#s"], n: Float[Array, ""], roughness: Float[Array, ""]
) -> Float[Array, "*s"]:
    """Refracted radiance over the square of its medium's index (in units of the incident medium's), per irradiance, after one facet [1/sr]."""
    m = 1.0 / n  # index beyond over index of the light
    sin_in, sin_out = jnp.sqrt(1.0 - mu_in**2), jnp.sqrt(1.0 - mu_out**2)
    # the normal is along incident direction (reversed) minus m times the refracted one, whichever way round the indices are
    x, y, z = m * sin_out * jnp.cos(azimuth) - sin_in, m * sin_out * jnp.sin(azimuth), mu_in - m * mu_out
    sign = jnp.where(z < 0.0, -1.0, 1.0)
    x, y, z = sign * x, sign * y, jnp.maximum(sign * z, 1e-12)
    length = jnp.sqrt(x**2 + y**2 + z**2)
    cos_in = (mu_in * z - sin_in * x) / length
    cos_out = (mu_out * z - sin_out * (x * jnp.cos(azimuth) + y * jnp.sin(azimuth))) / length
    possible = (cos_in > 0.0) & (cos_out > 0.0)
    a, b = smith_lambda(mu_in, roughness), smith_lambda(mu_out, roughness)
    masking = jnp.exp(betaln(1.0 + jnp.minimum(a, 1e12), 1.0 + jnp.minimum(b, 1e12)))
    density = _density(x / z, y / z, roughness) / (z / length) ** 4
    through = 1.0 - reflectance(jnp.clip(cos_in, 1e-12, 1.0), n)
    return jnp.where(possible, cos_in * cos_out * through * masking * density / (mu_in * mu_out * length**2), 0.0)


def _density(x: Float[Array, "*s"], y: Float[Array, "*s"], roughness: Float[Array, ""]) -> Float[Array, "*s"]:
    """Gaussian density of slopes; over cos^4 of the tilt it is the density of normals D of eq 17 (with the facet's area)."""
    return jnp.exp(-0.5 * (x**2 + y**2) / roughness**2) / (2.0 * jnp.pi * roughness**2)
