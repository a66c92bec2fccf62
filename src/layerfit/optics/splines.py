"""B-splines on fixed knots, as dense vectors of basis functions."""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..arrays import AnyArray


def clamped_knots(breaks: np.ndarray, degree: int = 3) -> np.ndarray:
    """Knots of a spline between the first and the last of its breaks; it has len(breaks) + degree - 1 coefficients."""
    return np.concatenate([np.repeat(breaks[0], degree), breaks, np.repeat(breaks[-1], degree)])


def interpolating_knots(points: np.ndarray) -> np.ndarray:
    """Knots of the spline through values at points, one coefficient a point: cubic (not-a-knot), quadratic for 3 points, linear for 2."""
    degree = min(3, len(points) - 1)
    skipped = (degree + 1) // 2
    inner = points[skipped : len(points) - skipped] if degree != 2 else points[:0]
    return clamped_knots(np.concatenate([points[:1], inner, points[-1:]]), degree)


def basis(x: Float[AnyArray, "*s"], knots: Float[AnyArray, "k"], degree: int) -> Float[Array, "*s count"]:
    """All basis functions at x; beyond the ends the first and last polynomials go on. Their sum is 1.

    >>> basis(jnp.array(0.25), clamped_knots(np.array([0.0, 1.0])), 3).tolist()
    [0.421875, 0.421875, 0.140625, 0.015625]

    References
    ----------
    C. de Boor, A Practical Guide to Splines (1978), chapter X, eqs 4 and 5.
    """
    x = jnp.asarray(x)[..., None]
    count = knots.shape[0] - degree - 1
    place = jnp.clip(jnp.sum(x >= knots[1:], axis=-1, keepdims=True), degree, count - 1)  # of the interval's left knot
    rows = (jnp.arange(knots.shape[0] - 1) == place).astype(float)
    for d in range(1, degree + 1):
        width = knots[d:-1] - knots[: -d - 1], knots[d + 1 :] - knots[1:-d]
        slope = [jnp.where(w > 0.0, 1.0 / jnp.where(w > 0.0, w, 1.0), 0.0) for w in width]
        rows = (x - knots[: -d - 1]) * slope[0] * rows[..., :-1] + (knots[d + 1 :] - x) * slope[1] * rows[..., 1:]
    return rows
