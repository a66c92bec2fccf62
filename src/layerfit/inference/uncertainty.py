"""What a fit knows about its numbers: covariance, bounds reached, and directions the data leave open."""

import math
from collections.abc import Callable, Sequence

import equinox as eqx
import numpy as np

from .parameters import FreeParameter

UNDETERMINED = 0.3  # sd of the logarithm (or of the number in units of its interval) above which a number counts as not determined
POOR = 0.15  # the same, above which it counts as poorly determined
_AT_BOUND = 1e-3  # share of the interval
_FURTHEST = 0.5


class Uncertainty(eqx.Module):
    """Gaussian uncertainty at a minimum, in physical units.

    covariance : (p, p); rows and columns of numbers at a bound are 0, those numbers being held there. stderr : None at a bound, and for a number
    that the data do not depend on at all. at_bound : one flag a number. relative : sd of the logarithm (or of the number in units of its interval),
    infinite where the data say nothing, 0 at a bound. directions : sentences about combinations left open.
    """

    covariance: np.ndarray
    stderr: tuple[float | None, ...] = eqx.field(static=True)
    at_bound: tuple[bool, ...] = eqx.field(static=True)
    relative: tuple[float, ...] = eqx.field(static=True)
    directions: tuple[str, ...] = eqx.field(static=True)


def is_positive(parameter: FreeParameter) -> bool:
    """Whether a number is positive by nature, so that what counts is its relative change."""
    return parameter.low >= 0 and parameter.name.rsplit(".", 1)[1] not in ("g", "background", "offset")


def natural_scale(parameter: FreeParameter, x: float) -> float:
    """The change of a number that counts as 1: itself for a positive number (so that its logarithm changes by 1), else its interval."""
    if is_positive(parameter):
        return max(abs(x), 1e-12 * (parameter.high - parameter.low))
    return parameter.high - parameter.low


def uncertainty(
    parameters: Sequence[FreeParameter], x: np.ndarray, jacobians_at: Callable[[np.ndarray], np.ndarray], jacobian: np.ndarray, variance: float
) -> Uncertainty:
    """Uncertainty at the minimum x.

    jacobian : of the weighted residuals at x, in physical units (n, p). jacobians_at : the same at other points, (m, p) to (m, n, p).
    variance : of a residual, 1 where the sd are known.

    The covariance is the mean of that of the linearised model over the Gaussian which it describes, by the cubature rule of degree 3: points at
    +-sqrt(p) standard deviations along its p principal axes (Arasaratnam and Haykin, IEEE Trans. Autom. Control 54, 1254 (2009), eq 32). For a
    linear model it is the usual one; where the slopes change within the range that the data allow, the value at the minimum alone is too small.
    """
    share = np.array([p.share(float(v)) for p, v in zip(parameters, x, strict=True)])
    at_bound = tuple(bool(s < _AT_BOUND or s > 1.0 - _AT_BOUND) for s in share)
    scale = np.array([natural_scale(p, v) for p, v in zip(parameters, x, strict=True)])
    free = np.flatnonzero(~np.array(at_bound))
    covariance = np.zeros((len(x), len(x)))
    if not np.all(np.isfinite(jacobian)):  # of a fit that failed: nothing is known
        return Uncertainty(covariance, (None,) * len(x), at_bound, (math.inf,) * len(x), ())
    stderr: list[float | None] = [None] * len(x)
    relative = [0.0] * len(x)
    directions: list[str] = []
    if free.size:
        scaled = jacobian[:, free] * scale[free]
        inside = [parameters[i] for i in free.tolist()]
        points = np.tile(x, (2 * free.size, 1))
        for point, step in zip(points, _cubature(*_spread(scaled, variance)), strict=True):
            point[free] = [_moved(p, v, s) for p, v, s in zip(inside, x[free].tolist(), step.tolist(), strict=True)]
        around = []
        for point, found in zip(points, jacobians_at(points), strict=True):
            there = found[:, free] * [natural_scale(p, v) for p, v in zip(inside, point[free].tolist(), strict=True)]
            if np.all(np.isfinite(there)):
                around.append(_linear(*_spread(there, variance)))
        inner = np.mean(around, axis=0) if around else _linear(*_spread(scaled, variance))
        covariance[np.ix_(free, free)] = inner * np.outer(scale[free], scale[free])
        for position, index in enumerate(free.tolist()):
            blind = not np.any(scaled[:, position])
            sd = np.sqrt(inner[position, position])
            stderr[index] = None if blind else float(sd * scale[index])
            relative[index] = math.inf if blind else float(sd)
        values, axes = np.linalg.eigh(inner)
        spread = np.sqrt(np.maximum(values, 0.0))
        directions = [_sentence(inside, axis, sd) for axis, sd in zip(axes.T[::-1], spread[::-1], strict=True) if not sd <= UNDETERMINED]
    return Uncertainty(covariance, tuple(stderr), at_bound, tuple(relative), tuple(directions))


def _spread(scaled: np.ndarray, variance: float) -> tuple[np.ndarray, np.ndarray]:
    """Principal axes (rows) of the linearised model's Gaussian and the standard deviations along them."""
    _, singular, rows = np.linalg.svd(scaled, full_matrices=False)
    rank_floor = singular[0] * 1e-13 if singular[0] > 0 else 1.0
    return rows, np.sqrt(variance) / np.maximum(singular, rank_floor)


def _linear(rows: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """Covariance of the linearised model, in natural scales."""
    return (rows.T * spread**2) @ rows


def _cubature(rows: np.ndarray, spread: np.ndarray) -> list[np.ndarray]:
    """Steps to the cubature points, in natural scales; none further than _FURTHEST, where an open direction says nothing any more."""
    lengths = np.minimum(math.sqrt(len(spread)) * spread, _FURTHEST)
    return [sign * length * row for row, length in zip(rows, lengths, strict=True) for sign in (1.0, -1.0)]


def _moved(parameter: FreeParameter, x: float, step: float) -> float:
    """A number after a step in its natural scale, kept inside its bounds."""
    there = x * math.exp(step) if is_positive(parameter) else x + step * natural_scale(parameter, x)
    return min(max(there, parameter.at(_AT_BOUND)), parameter.at(1.0 - _AT_BOUND))


def _sentence(parameters: Sequence[FreeParameter], direction: np.ndarray, sd: float) -> str:
    """An open direction in words."""
    strongest = direction[np.argmax(np.abs(direction))]
    parts = [(p.name, float(c / strongest)) for p, c in zip(parameters, direction, strict=True) if abs(c / strongest) > 0.1]
    parts.sort(key=lambda part: -abs(part[1]))
    size = f"by a factor {np.exp(sd):.2g}" if sd < 5 else "by any factor"
    if len(parts) == 1:
        return f"the data leave {parts[0][0]} open {size} (1 sd)"
    together = ", ".join(f"{name} ({share:+.2f})" for name, share in parts)
    return f"the data leave one combination open {size} (1 sd): relative changes of {together} together"


def correlation(covariance: np.ndarray) -> np.ndarray:
    """Correlation matrix; 1 on the diagonal, 0 beside numbers without variance."""
    sd = np.sqrt(np.diag(covariance))
    safe = np.where(sd > 0, sd, 1.0)
    matrix = covariance / np.outer(safe, safe)
    np.fill_diagonal(matrix, 1.0)
    return matrix
