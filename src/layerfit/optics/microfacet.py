"""Hemispherical reflection at a rough face: Fresnel reflection averaged over the facets that the light meets.

The face has Gaussian slopes of standard deviation ``roughness`` along each axis (sigma of Stam 2001, eq 17). Light from direction (theta, 0)
meets a facet of slopes sigma (xi, eta) in proportion to the facet's projected area, which is max(0, mu + sin(theta) sigma xi) per unit
horizontal area: written in slopes there is no 1/cos factor to forget, and the shadowing of Smith is the normalisation. What a facet reflects
counts as reflected, what it transmits as transmitted (further bounces only redistribute directions), so that no energy is lost:
rho_d + rho_dt = 1. This is the rho_d of Donner & Jensen 2005, eqs 23 to 26, without the loss of theirs at large roughness.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from .fresnel import reflectance

_REACH = 6.0  # standard deviations of slope that count
_FIXED_CUTS = np.array([-_REACH, -1.6, 1.6, _REACH])  # panels narrow enough for the Gaussian


def _gauss(n: int, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    x, w = np.polynomial.legendre.leggauss(n)
    return 0.5 * (high + low) + 0.5 * (high - low) * x, 0.5 * (high - low) * w


def _crowding(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes on (0, 1), dense at both ends: exact for square roots there."""
    angle, w = _gauss(n, 0.0, np.pi)
    return 0.5 * (1.0 - np.cos(angle)), 0.5 * np.sin(angle) * w


_U, _W_U = _gauss(24, 0.0, 1.0)


class Facets(NamedTuple):
    """Facets that light from one direction meets, as a quadrature: axes (direction, eta, xi).

    x, y : slopes of the facet along the light's way and across it (one half of the y, the other is its mirror image). weight : share of the light
    that meets it, sum 1. cosine : of incidence on the facet.
    """

    x: Float[Array, "*m e x"]
    y: Float[Array, "*m e x"]
    weight: Float[Array, "*m e x"]
    cosine: Float[Array, "*m e x"]


def facets(mu: Float[Array, "*m"], n: Float[Array, ""], roughness: Float[Array, ""], nodes: tuple[int, int] = (10, 12)) -> Facets:
    """The facets of a Gaussian face met by light at incidence cosine mu; n as for `rough_reflectance`. nodes : in a panel of xi, of eta.

    The light travels towards positive x; a facet of slopes (x, y) has the normal (-x, -y, 1)/sqrt(1 + x^2 + y^2).
    """
    mu = jnp.asarray(mu)[..., None]
    slope = jnp.sqrt(jnp.maximum(1.0 - mu**2, 1e-30)) * roughness  # of the projected area, per xi
    # critical facets lie on a conic: a xi^2 + 2 mu slope xi + c(eta) = 0. Panels end on it (and where facets turn away, area 0), so that
    # square roots occur at panel ends only: first eta where the conic ends, then for each eta the two roots in xi.
    critical2 = jnp.maximum(1.0 - 1.0 / n**2, 0.0)
    a = slope**2 - critical2 * roughness**2
    apex = (mu**2 - critical2 - (mu * slope) ** 2 / _away(a)) / _away(critical2 * roughness**2)
    apex = jnp.sqrt(jnp.where(critical2 > 0.0, jnp.clip(apex, 1e-12, _REACH**2), _REACH**2))
    eta, w_eta = _panels(jnp.concatenate([jnp.zeros_like(apex), apex, jnp.full_like(apex, _REACH)], axis=-1), _crowding(nodes[1]))
    w_eta = w_eta * jnp.exp(-0.5 * eta**2)  # one half of the range: eta enters squared

    c = mu**2 - critical2 * (1.0 + (roughness * eta) ** 2)
    square = (mu * slope) ** 2
    apart = square - a * c > 1e-10 * square  # else one root, of which rounding would make two with any slope
    q = mu * slope + jnp.where(apart, jnp.sqrt(jnp.where(apart, square - a * c, 1.0)), 1e-15)
    moving = jnp.stack([-q / _away(a), -c / q, jnp.broadcast_to(-mu / _away(slope), c.shape)], axis=-1)
    fixed = jnp.broadcast_to(jnp.asarray(_FIXED_CUTS), (*c.shape, len(_FIXED_CUTS)))
    cuts = jnp.sort(jnp.concatenate([jnp.clip(moving, -_REACH, _REACH), fixed], axis=-1))
    xi, weight = _panels(cuts, _crowding(nodes[0]))
    area = jnp.maximum(mu[..., None] + slope[..., None] * xi, 0.0)
    weight = weight * w_eta[..., None] * jnp.exp(-0.5 * xi**2) * area
    tilt = 1.0 + roughness**2 * (xi**2 + eta[..., None] ** 2)
    local = jnp.clip(area / jnp.sqrt(tilt), 1e-12, 1.0)
    shape = local.shape
    weight = weight / jnp.sum(weight, axis=(-2, -1), keepdims=True)
    return Facets(*(jnp.broadcast_to(v, shape) for v in (roughness * xi, roughness * eta[..., None], weight, local)))


def rough_reflectance(mu: Float[Array, "*m"], n: Float[Array, ""], roughness: Float[Array, ""]) -> Float[Array, "*m"]:
    """rho_d: share of light at incidence cosine mu that a rough face sends back [1].

    n : index of the medium of the light over the one beyond. The limit of zero roughness is the Fresnel reflectance.
    """
    met = facets(mu, n, roughness)
    return jnp.sum(met.weight * reflectance(met.cosine, n), axis=(-2, -1))


def _panels(ends: Float[Array, "*s e"], rule: tuple[np.ndarray, np.ndarray]) -> tuple[Float[Array, "*s q"], Float[Array, "*s q"]]:
    """Nodes and weights of a rule on (0, 1) repeated between successive ends."""
    left, width = ends[..., :-1, None], jnp.diff(ends, axis=-1)[..., None]
    flat = (*ends.shape[:-1], -1)
    return (left + width * rule[0]).reshape(flat), (width * rule[1]).reshape(flat)


def _away(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """x kept off 0, sign preserved."""
    return jnp.where(x < 0, jnp.minimum(x, -1e-30), jnp.maximum(x, 1e-30))


@jax.jit
def rough_moments(n: Float[Array, ""], roughness: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """R1 and R2 of `fresnel.diffuse_moments` for a rough face, by quadrature (about 1e-5)."""
    # two panels that meet at the critical angle, nodes crowding towards it
    critical = jnp.sqrt(jnp.maximum(1.0 - 1.0 / n**2, 1e-12))
    near = (1.0 - _U) ** 2
    mu = jnp.concatenate([critical * (1.0 - near), critical + (1.0 - critical) * _U**2])
    weight = jnp.concatenate([critical * 2.0 * (1.0 - _U) * _W_U, (1.0 - critical) * 2.0 * _U * _W_U])
    rho = rough_reflectance(mu, n, roughness)
    return 2.0 * jnp.sum(weight * rho * mu), 3.0 * jnp.sum(weight * rho * mu**2)
