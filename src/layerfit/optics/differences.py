"""Divided differences of tanh(sqrt x)/sqrt x and sech^2(sqrt x) between three and four points, whether they coincide or not.

They are what a matrix function needs where its argument is block triangular, and what its derivative needs. All take x >= 0 in any order.

Small arguments: tanh(sqrt x)/sqrt x = sum of 2/(x + a_n), a_n = ((n + 1/2) pi)^2, whose divided differences are sums of products, all of one
sign. Larger ones: the recursion over the outermost points, or, where these nearly coincide, the derivative at their mean.
"""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from .special import divided_differences, tanhc

_POLES = ((np.arange(24) + 0.5) * np.pi) ** 2
_TAIL = 24.0 * np.pi  # the poles beyond these are replaced by an integral
_SERIES_UP_TO = 9.0
_CLOSE2, _CLOSE3 = 1e-5, 1e-3  # relative gap below which three, four points count as one


def second_differences(a: Float[Array, "*#s"], b: Float[Array, "*#s"], c: Float[Array, "*#s"]) -> tuple[Float[Array, "*s"], Float[Array, "*s"]]:
    """f[a, b, c] for f = tanh(sqrt x)/sqrt x and for sech^2(sqrt x)."""
    low, middle, high = _sorted(a, b, c)
    small = high < _SERIES_UP_TO
    inverse = [1.0 / (jnp.where(small, x, 0.0)[..., None] + _POLES) for x in (low, middle, high)]
    product = inverse[0] * inverse[1] * inverse[2]
    tail = 1.0 / (5.0 * np.pi * _TAIL**5)
    tanh_series = 2.0 * (jnp.sum(product, axis=-1) + tail)
    sech_series = jnp.sum(product * (4.0 * _POLES * (inverse[0] + inverse[1] + inverse[2]) - 2.0), axis=-1) + 10.0 * tail

    low, middle, high = (jnp.where(small, 16.0 + i, x) for i, x in enumerate((low, middle, high)))
    close = high - low < _CLOSE2 * high
    gap = jnp.where(close, 1.0, high - low)
    upper, lower = divided_differences(middle, high), divided_differences(low, middle)
    _, tanh2, _, sech2 = _derivatives((low + middle + high) / 3.0)
    tanh, sech = (jnp.where(close, 0.5 * d, (u - v) / gap) for d, u, v in zip((tanh2, sech2), upper, lower, strict=True))
    return jnp.where(small, tanh_series, tanh), jnp.where(small, sech_series, sech)


def third_difference(a: Float[Array, "*#s"], b: Float[Array, "*#s"], c: Float[Array, "*#s"], d: Float[Array, "*#s"]) -> Float[Array, "*s"]:
    """f[a, b, c, d] for f = tanh(sqrt x)/sqrt x, to about 1e-7 of its size where the four nearly coincide."""
    points = _sorted(a, b, c, d)
    small = points[-1] < _SERIES_UP_TO
    product = jnp.ones(())
    for x in points:
        product = product / (jnp.where(small, x, 0.0)[..., None] + _POLES)
    series = -2.0 * (jnp.sum(product, axis=-1) + 1.0 / (7.0 * np.pi * _TAIL**7))

    low, p, q, high = (jnp.where(small, 16.0 + i, x) for i, x in enumerate(points))
    close = high - low < _CLOSE3 * high
    recursion = (second_differences(p, q, high)[0] - second_differences(low, p, q)[0]) / jnp.where(close, 1.0, high - low)
    _, _, third, _ = _derivatives((low + p + q + high) / 4.0)
    return jnp.where(small, series, jnp.where(close, third / 6.0, recursion))


def _sorted(*points: Float[Array, "..."]) -> list[Float[Array, "..."]]:
    row = list(jnp.broadcast_arrays(*points))
    for end in range(len(row) - 1, 0, -1):
        for i in range(end):
            row[i], row[i + 1] = jnp.minimum(row[i], row[i + 1]), jnp.maximum(row[i], row[i + 1])
    return row


def _derivatives(x: Float[Array, "*s"]) -> tuple[Float[Array, "*s"], Float[Array, "*s"], Float[Array, "*s"], Float[Array, "*s"]]:
    """First three derivatives of t = tanh(sqrt x)/sqrt x and the second of s = sech^2(sqrt x), not for small x.

    From 2 x t' = s - t and s' = -t s.
    """
    t = tanhc(x)
    decay = jnp.exp(-2.0 * jnp.sqrt(x))
    s = 4.0 * decay / (1.0 + decay) ** 2
    t1 = (s - t) / (2.0 * x)
    t2 = (-t * s - 3.0 * t1) / (2.0 * x)
    s2 = s * (t**2 - t1)
    return t1, t2, (s2 - 5.0 * t2) / (2.0 * x), s2
