"""Phase functions: their Legendre moments, the delta-M scaling, and the Legendre functions that expand them over directions.

A phase function p(cos Theta) has mean 1 over the sphere: p = sum over l of (2 l + 1) chi_l P_l(cos Theta), chi_0 = 1, chi_1 = g.
"""

from functools import cache

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..arrays import AnyArray


def henyey_greenstein(cosine: Float[Array, "*s"], g: Float[Array, ""]) -> Float[Array, "*s"]:
    """Henyey-Greenstein phase function at the cosine of the scattering angle [1].

    >>> float(henyey_greenstein(jnp.asarray(1.0), jnp.asarray(0.5)))
    6.0

    References
    ----------
    L. G. Henyey, J. L. Greenstein, Astrophys. J. 93, 70 (1941), eq 2.
    """
    return (1.0 - g**2) / (1.0 + g**2 - 2.0 * g * cosine) ** 1.5


def henyey_greenstein_moments(g: Float[Array, ""], count: int) -> Float[Array, "count"]:
    """Moments chi_l = g^l for l below count."""
    return jnp.cumprod(jnp.concatenate([jnp.ones(1), jnp.full(count - 1, g)]))


def legendre_series(cosine: Float[Array, "*s"], moments: Float[AnyArray, "l"]) -> Float[Array, "*s"]:
    """Phase function from its moments, at the cosine of the scattering angle [1]."""
    previous, current = jnp.zeros_like(cosine), jnp.ones_like(cosine)
    total = moments[0] * current
    for l in range(1, moments.shape[0]):
        previous, current = current, ((2 * l - 1) * cosine * current - (l - 1) * previous) / l
        total = total + (2 * l + 1) * moments[l] * current
    return total


def delta_m(
    albedo: Float[Array, ""], moments: Float[Array, "l"], forward: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, "l"]]:
    """The share ``forward`` of what is scattered counted as not scattered at all (delta-M).

    forward : the first moment that is left out, chi_L. Returns what is left of the extinction, 1 - albedo forward, the albedo and the moments of
    the rest.

    References
    ----------
    W. J. Wiscombe, J. Atmos. Sci. 34, 1408 (1977), eqs 10 and 11.
    """
    left = 1.0 - albedo * forward
    return left, albedo * (1.0 - forward) / left, (moments - forward) / (1.0 - forward)


def legendre_functions(mu: Float[Array, "*c"], count: int, orders: int) -> Float[Array, "orders count *c"]:
    """Associated Legendre functions sqrt((l - m)!/(l + m)!) P_l^m(mu), l below count, m below orders; 0 for l < m.

    With this normalisation P_l(cos Theta) = sum over m of (2 - delta_m0) Lambda_l^m(mu) Lambda_l^m(mu') cos m(phi - phi').

    >>> legendre_functions(jnp.asarray(0.5), 3, 2)[:, 2].round(4).tolist()
    [-0.125, 0.5303]
    """
    start, up, down = _recursion(count, orders)
    shape = (orders,) + (1,) * jnp.ndim(mu)
    sine = jnp.sqrt(jnp.maximum(1.0 - mu**2, 1e-300))
    powers = jnp.cumprod(jnp.stack([jnp.ones_like(mu)] + [sine] * (orders - 1)), axis=0)
    first = start.reshape(shape) * powers
    previous, current = jnp.zeros_like(first), jnp.zeros_like(first)
    rows = []
    for l in range(count):
        following = up[l].reshape(shape) * mu * current - down[l].reshape(shape) * previous
        begins = (np.arange(orders) == l).reshape(shape)
        previous, current = current, jnp.where(begins, first, following) if l < orders else following
        rows.append(current)
    return jnp.stack(rows, axis=1)


@cache
def _recursion(count: int, orders: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Value of Lambda_m^m over sin^m, and Lambda_l = up mu Lambda_(l-1) - down Lambda_(l-2) for l > m (0 elsewhere)."""
    m = np.arange(orders)
    start = np.cumprod(np.concatenate([[1.0], np.sqrt((2.0 * m[1:] - 1.0) / (2.0 * m[1:]))]))
    l = np.arange(count)[:, None]
    root = np.sqrt(np.where(l > m, l**2 - m**2, 1))
    up = np.where(l > m, (2 * l - 1) / root, 0.0)
    down = np.where(l > m + 1, np.sqrt(np.maximum((l - 1) ** 2 - m**2, 0)) / root, 0.0)
    return start, up, down
