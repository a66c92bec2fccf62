"""What a fit knows about its numbers: covariance, bounds reached, and directions the data leave open."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np

from .parameters import FreeParameter

UNDETERMINED = 0.3  # sd of the logarithm (or of the number in units of its interval) above which a number counts as not determined
_AT_BOUND = 1e-3  # share of the interval


class Uncertainty(eqx.Module):
    """Gaussian uncertainty at a minimum, in physical units.

    covariance : (p, p); rows and columns of numbers at a bound are 0, those numbers being held there. stderr : None at a bound, and for a number
    that the data do not depend on at all. at_bound, undetermined : one flag a number. directions : sentences about combinations left open.
    """

    covariance: np.ndarray
    stderr: tuple[float | None, ...] = eqx.field(static=True)
    at_bound: tuple[bool, ...] = eqx.field(static=True)
    undetermined: tuple[bool, ...] = eqx.field(static=True)
    directions: tuple[str, ...] = eqx.field(static=True)


def natural_scale(parameter: FreeParameter, x: float) -> float:
    """The change of a number that counts as 1: itself for a positive number (so that its logarithm changes by 1), else its interval."""
    if parameter.low >= 0 and parameter.name.rsplit(".", 1)[1] not in ("g", "background", "offset"):
        return max(abs(x), 1e-12 * (parameter.high - parameter.low))
    return parameter.high - parameter.low


def uncertainty(parameters: Sequence[FreeParameter], x: np.ndarray, share: np.ndarray, jacobian: np.ndarray, variance: float) -> Uncertainty:
    """From the Jacobian of the weighted residuals in physical units (n, p) and the variance of a residual (1 where the sd are known)."""
    at_bound = tuple(bool(s < _AT_BOUND or s > 1.0 - _AT_BOUND) for s in share)
    scale = np.array([natural_scale(p, v) for p, v in zip(parameters, x, strict=True)])
    free = np.flatnonzero(~np.array(at_bound))
    covariance = np.zeros((len(x), len(x)))
    if not np.all(np.isfinite(jacobian)):  # of a fit that failed: nothing is known
        return Uncertainty(covariance, (None,) * len(x), at_bound, (True,) * len(x), ())
    stderr: list[float | None] = [None] * len(x)
    undetermined = [False] * len(x)
    directions: list[str] = []
    if free.size:
        scaled = jacobian[:, free] * scale[free]
        _, singular, rows = np.linalg.svd(scaled, full_matrices=False)
        rank_floor = singular[0] * 1e-13 if singular[0] > 0 else 1.0
        spread = np.sqrt(variance) / np.maximum(singular, rank_floor)
        inner = (rows.T * spread**2) @ rows
        covariance[np.ix_(free, free)] = inner * np.outer(scale[free], scale[free])
        for position, index in enumerate(free.tolist()):
            blind = not np.any(scaled[:, position])
            sd = np.sqrt(inner[position, position])
            stderr[index] = None if blind else float(sd * scale[index])
            undetermined[index] = bool(blind or not sd <= UNDETERMINED)
        inside = [parameters[i] for i in free.tolist()]
        directions = [_sentence(inside, row, sd) for row, sd in zip(rows, spread, strict=True) if not sd <= UNDETERMINED]
    return Uncertainty(covariance, tuple(stderr), at_bound, tuple(undetermined), tuple(directions))


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
