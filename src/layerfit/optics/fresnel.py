"""Reflection at a smooth face between two dielectrics, unpolarised light.

``n`` is always relative: the index of the medium the light is in, over the index of the medium beyond the face.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

_NODE, _WEIGHT = (a.astype(float) for a in np.polynomial.legendre.leggauss(40))
_U, _W = 0.5 * (_NODE + 1.0), 0.5 * _WEIGHT  # Gauss-Legendre on (0, 1)


@jax.jit
def reflectance(mu: Float[Array, "..."], n: Float[Array, "..."]) -> Float[Array, "..."]:
    """Fresnel reflectance at incidence cosine ``mu`` (0 to 1) [1]; 1 beyond the critical angle."""
    sin2 = (1.0 - mu**2) * n**2
    total = sin2 >= 1.0
    mu_t = jnp.sqrt(jnp.where(total, 1.0, 1.0 - sin2))
    return jnp.where(total, 1.0, matched_reflectance(mu, mu_t, n))


def matched_reflectance(mu: Float[Array, "*#s"], mu_beyond: Float[Array, "*#s"], n: Float[Array, "*#s"]) -> Float[Array, "*s"]:
    """Fresnel reflectance where the cosines on both sides are known to obey Snell's law [1]; the same from either side."""
    s = (n * mu - mu_beyond) / (n * mu + mu_beyond)
    p = (mu - n * mu_beyond) / (mu + n * mu_beyond)
    return 0.5 * (s**2 + p**2)


def normal_reflectance(n: Float[Array, "*s"]) -> Float[Array, "*s"]:
    """Fresnel reflectance at normal incidence [1]."""
    return ((n - 1.0) / (n + 1.0)) ** 2


@jax.jit
def diffuse_moments(n: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Exact moments of the reflectance seen by diffuse light inside a medium of relative index n.

    R1 = 2 int_0^1 R(mu) mu dmu is the reflected part of an isotropic fluence, R2 = 3 int_0^1 R(mu) mu^2 dmu that of a flux.

    With a^2 = 1 - 1/n^2 and mu = a cosh t the Fresnel amplitudes are rational in x = exp(-2t), which runs from (n-1)/(n+1) to 1:
    r_s = x and r_p = (x + rho)/(1 + rho x), rho = (1 - n^2)/(1 + n^2). The integrals are then elementary up to two with a smooth integrand,
    done by Gauss-Legendre quadrature; nothing is singular at n = 1. There both moments have a kink (R1 has slopes 7/3 to the right and -1/3
    to the left); the derivative returned at n = 1 exactly is the one to the right.
    """
    inside = n >= 1.0
    m = jnp.where(inside, n, 1.0 / n)  # the denser medium's index over the rarer one's
    a2, x0, rho = 1.0 - 1.0 / m**2, (m - 1.0) / (m + 1.0), (1.0 - m**2) / (1.0 + m**2)
    second_dense, second_rare = _partial_second(m, a2, x0, rho)
    r1_dense = a2 + 2.0 * _partial_first(m, a2, x0, rho)  # total internal reflection, then the rest
    r1_rare = 1.0 - m**2 * (1.0 - r1_dense)  # reciprocity
    return jnp.where(inside, r1_dense, r1_rare), jnp.where(inside, a2**1.5 + 3.0 * second_dense, 3.0 * m**3 * second_rare)


def _partial_first(m: Float[Array, ""], a2: Float[Array, ""], x0: Float[Array, ""], rho: Float[Array, ""]) -> Float[Array, ""]:
    """int R mu dmu over the partially reflected directions in the denser medium."""
    # (1 - x^2)(1 + h^2), h = r_p/r_s = rho/x + (1 - rho^2)/(1 + rho x)
    x = x0 + (1.0 - x0) * _U
    base, pole = (1.0 - x0) * _W * (1.0 - x**2), 1.0 / (1.0 + rho * x)
    k1, k2 = jnp.sum(base * pole), jnp.sum(base * pole**2)
    q = 1.0 - rho**2
    rho2_over_x0 = (m - 1.0) * (m + 1.0) ** 3 / (m**2 + 1.0) ** 2
    log_x0 = jnp.log(jnp.maximum(x0, 1e-300))  # enters as rho log x0, which is 0 at m = 1
    h2 = rho2_over_x0 * (1.0 - x0) ** 2 - 2.0 * rho * q * (log_x0 + 0.5 * (1.0 - x0**2) + rho * k1) + q**2 * k2
    return a2 / 16.0 * (2.0 / 3.0 - x0 + x0**3 / 3.0 + h2)


def _partial_second(m: Float[Array, ""], a2: Float[Array, ""], x0: Float[Array, ""], rho: Float[Array, ""]) -> Float[Array, "2"]:
    """int R mu^2 dmu over the partially reflected directions: mu in the denser medium (a cosh t), and in the rarer one (a sinh t, over m^3).

    In y = sqrt x the integrand is P(y)(1 + h^2) a^3/16, P = 1 + s y^2 - y^4 - s y^6 with s = 1 and -1 on the two sides. Powers of y0 = sqrt x0 and
    of a are paired by a = y0 (m + 1)/m, so that no square root with an infinite slope at m = 1 remains.
    """
    side = np.array([1.0, -1.0])
    ratio = (m + 1.0) / m
    a3 = a2**1.5
    e0 = ratio * a2  # a^3 y0^(2j - 1) for j = 0, 1, 2 ...
    e1, e2, e3, e4 = e0 * x0, e0 * x0**2, e0 * x0**3, e0 * x0**4
    plain = a3 * (4.0 / 5.0 + side * (4.0 / 21.0)) - (e1 + side * e2 / 3.0 - e3 / 5.0 - side * e4 / 7.0)
    over_y4 = ratio**3 / 3.0 + side * e0 + e1 + side * e2 / 3.0 - a3 * (1.0 + side) * 4.0 / 3.0
    over_y2 = e0 - side * e1 + e2 / 3.0 + side * e3 / 5.0 - a3 * (4.0 / 3.0 - side * 4.0 / 5.0)
    y2 = jnp.stack([jnp.asarray(_U**2), x0 * _U**2])  # the integral from y0 to 1 as one from 0 to 1 less one from 0 to y0
    base = _W * (1.0 - y2**2)[:, None] * (1.0 + side[:, None] * y2[:, None])
    pole = 1.0 / (1.0 + rho * y2)[:, None]
    share = jnp.stack([a3, -e1])[:, None]
    gauss1, gauss2 = (jnp.sum(share * jnp.sum(base * pole**power, axis=-1), axis=0) for power in (1, 2))
    q = 1.0 - rho**2
    h2 = rho**2 * over_y4 + 2.0 * rho * q * (over_y2 - rho * gauss1) + q**2 * gauss2
    return (plain + h2) / 16.0


def mismatch(r1: Float[Array, "*s"], r2: Float[Array, "*s"]) -> Float[Array, "*s"]:
    """A = (1 + R2)/(1 - R1): fluence over twice the outward flux at a diffusely lit face."""
    return (1.0 + r2) / (1.0 - r1)


def egan_hilgeman(n: Float[Array, "*s"]) -> Float[Array, "*s"]:
    """Polynomial fit to the diffuse Fresnel reflectance R1, with the rounded coefficients of Donner & Jensen 2005, eq 7.

    It is 0.0016 at n = 1, where the truth is 0; kept to reproduce published figures.
    """
    dense = -1.440 / n**2 + 0.710 / n + 0.668 + 0.0636 * n
    rare = -0.4399 + 0.7099 / n - 0.3319 / n**2 + 0.0636 / n**3
    return jnp.where(n >= 1.0, dense, rare)
