"""What a fit knows about its numbers: covariance, bounds reached, and directions the data leave open."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from .parameters import FreeParameter, shares

UNDETERMINED = 0.3  # sd of the logarithm (or of the number in units of its interval) above which a number counts as not determined
POOR = 0.15  # the same, above which it counts as poorly determined
_AT_BOUND = 1e-3  # share of the interval
_FURTHEST = 0.5
_TELLS = 0.1  # share of a number in an open direction, against the strongest, from which it is named


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


class Covariances(NamedTuple):
    """The same of many minima, one a row, without words."""

    covariance: Float[np.ndarray, "m p p"]
    at_bound: Bool[np.ndarray, "m p"]
    relative: Float[np.ndarray, "m p"]


def is_positive(parameter: FreeParameter) -> bool:
    """Whether a number is positive by nature, so that what counts is its relative change."""
    return parameter.low >= 0 and parameter.name.rsplit(".", 1)[1] not in ("g", "background", "offset")


def natural_scales(parameters: Sequence[FreeParameter], x: Float[np.ndarray, "*m p"]) -> Float[np.ndarray, "*m p"]:
    """The change of each number that counts as 1: itself for a positive number (so that its logarithm changes by 1), else its interval."""
    interval = np.array([p.high - p.low for p in parameters])
    return np.where([is_positive(p) for p in parameters], np.maximum(np.abs(x), 1e-12 * interval), interval)


Jacobians = Callable[[np.ndarray, np.ndarray], np.ndarray]


def uncertainty(
    parameters: Sequence[FreeParameter],
    x: np.ndarray,
    jacobians_at: Callable[[np.ndarray], np.ndarray],
    jacobian: np.ndarray,
    residual: np.ndarray,
    variance: float,
) -> Uncertainty:
    """Uncertainty at the minimum x: `covariances` of one minimum, in words too. jacobians_at : (points, p) to (points, n, p)."""
    found = covariances(parameters, x[None], lambda points, _: jacobians_at(points), jacobian[None], residual[None], np.array([variance]))
    covariance, relative, at_bound = found.covariance[0], found.relative[0], found.at_bound[0]
    known = ~at_bound & np.isfinite(relative)
    stderr = tuple(float(sd) if known[i] else None for i, sd in enumerate(np.sqrt(np.diag(covariance)).tolist()))
    scale = natural_scales(parameters, x)
    free = np.flatnonzero(~at_bound)
    inner = (covariance / np.outer(scale, scale))[np.ix_(free, free)]
    words = tuple(open_directions([parameters[i] for i in free.tolist()], inner)) if np.all(np.isfinite(jacobian)) else ()
    return Uncertainty(covariance, stderr, tuple(at_bound.tolist()), tuple(relative.tolist()), words)


def covariances(
    parameters: Sequence[FreeParameter],
    x: Float[np.ndarray, "m p"],
    jacobians_at: Jacobians,
    jacobian: Float[np.ndarray, "m n p"],
    residual: Float[np.ndarray, "m n"],
    variance: Float[np.ndarray, "m"],
) -> Covariances:
    """Covariance at each of many minima x.

    residual, jacobian : the weighted residuals at x and their Jacobian in physical units. jacobians_at : the Jacobian at other points, (q, p) to
    (q, n, p), with the minimum that each belongs to (q,). variance : of a residual, 1 where the sd are known.

    The covariance is the mean of that of the linearised model over the Gaussian which it describes, by the cubature rule of degree 3: points at
    +-sqrt(p) standard deviations along its p principal axes (Arasaratnam and Haykin, IEEE Trans. Autom. Control 54, 1254 (2009), eq 32). For a
    linear model it is the usual one; where the slopes change within the range that the data allow, the value at the minimum alone is too small.
    A number at a bound has no variance, but it could lie inside: how far the others follow it until chi-square has risen by 1 is added to theirs.
    """
    share = shares(parameters, x)
    at_bound = (share < _AT_BOUND) | (share > 1.0 - _AT_BOUND)
    covariance = np.zeros((*x.shape, x.shape[1]))
    relative = np.where(at_bound, 0.0, math.inf)  # of a fit that failed nothing is known
    finite = np.all(np.isfinite(jacobian), axis=(1, 2))
    for pattern in np.unique(at_bound[finite], axis=0):
        free = np.flatnonzero(~pattern)
        rows = np.flatnonzero(finite & np.all(at_bound == pattern, axis=1))
        if free.size == 0:
            continue
        inner, blind = _averaged(parameters, x[rows], free, rows, jacobians_at, jacobian[rows], variance[rows])
        scale = natural_scales(parameters, x[rows])[:, free]
        for bound in np.flatnonzero(pattern).tolist():
            width = parameters[bound].high - parameters[bound].low
            inward = np.where(share[rows, bound] < 0.5, width, -width)[:, None] * jacobian[rows, :, bound]
            inner = inner + _following(jacobian[rows][:, :, free] * scale[:, None], inward, residual[rows], variance[rows])
        covariance[rows[:, None, None], free[:, None], free] = inner * scale[:, :, None] * scale[:, None, :]
        relative[rows[:, None], free] = np.where(blind, math.inf, np.sqrt(np.diagonal(inner, axis1=1, axis2=2)))
    return Covariances(covariance, at_bound, relative)


def _averaged(
    parameters: Sequence[FreeParameter],
    x: Float[np.ndarray, "m p"],
    free: Int[np.ndarray, "q"],
    rows: Int[np.ndarray, "m"],
    jacobians_at: Jacobians,
    jacobian: Float[np.ndarray, "m n p"],
    variance: Float[np.ndarray, "m"],
) -> tuple[Float[np.ndarray, "m q q"], Bool[np.ndarray, "m q"]]:
    """Covariance of the numbers inside their bounds, in natural scales, and which of them the data do not depend on at all."""
    scaled = (jacobian * natural_scales(parameters, x)[:, None])[:, :, free]
    axes, spread = _spread(scaled, variance)
    step = (np.minimum(math.sqrt(free.size) * spread, _FURTHEST)[..., None] * axes)[:, :, None] * np.array([1.0, -1.0])[:, None]
    steps = step.reshape(len(x), 2 * free.size, free.size)  # none further than _FURTHEST: there an open direction says nothing any more
    points = np.repeat(x[:, None], steps.shape[1], axis=1)
    points[:, :, free] = _moved(parameters, x, steps, free)
    flat = points.reshape(-1, x.shape[1])
    owner = np.repeat(rows, steps.shape[1])
    there = (jacobians_at(flat, owner) * natural_scales(parameters, flat)[:, None])[:, :, free]
    usable = np.all(np.isfinite(there), axis=(1, 2))
    around = np.zeros((len(there), free.size, free.size))
    around[usable] = linear_covariance(there[usable], np.repeat(variance, steps.shape[1])[usable])
    counts = usable.reshape(len(x), -1).sum(axis=1)[:, None, None]
    mean = around.reshape(len(x), -1, free.size, free.size).sum(axis=1) / np.maximum(counts, 1)
    return np.where(counts > 0, mean, linear_covariance(scaled, variance)), ~np.any(scaled != 0.0, axis=1)


def _following(
    scaled: Float[np.ndarray, "m n q"], inward: Float[np.ndarray, "m n"], residual: Float[np.ndarray, "m n"], variance: Float[np.ndarray, "m"]
) -> Float[np.ndarray, "m q q"]:
    """Square of how far the free numbers follow one that moves off its bound until chi-square has risen by 1, or all the way.

    inward : slopes of the weighted residuals along the way from bound to bound.
    """
    follow = -np.einsum("mpq,mnq,mn->mp", linear_covariance(scaled, np.ones(len(scaled))), scaled, inward)
    left = inward + np.einsum("mnp,mp->mn", scaled, follow)
    slope = np.maximum(np.sum(residual * left, axis=1), 0.0) / variance
    bend = np.maximum(np.sum(left**2, axis=1) / variance, 1e-300)
    way = np.minimum(1.0 / (slope + np.sqrt(slope**2 + bend)), 1.0)  # bend way^2 + 2 slope way = 1
    moved = follow * way[:, None]
    return moved[:, :, None] * moved[:, None, :]


def _spread(scaled: Float[np.ndarray, "m n q"], variance: Float[np.ndarray, "m"]) -> tuple[Float[np.ndarray, "m q q"], Float[np.ndarray, "m q"]]:
    """Principal axes (rows) of the linearised model's Gaussian and the standard deviations along them."""
    lacking = max(scaled.shape[2] - scaled.shape[1], 0)  # of rows: as many axes as numbers
    _, singular, axes = np.linalg.svd(np.pad(scaled, ((0, 0), (0, lacking), (0, 0))), full_matrices=False)
    floor = np.where(singular[:, :1] > 0, 1e-13 * singular[:, :1], 1.0)
    return axes, np.sqrt(variance)[:, None] / np.maximum(singular, floor)


def linear_covariance(scaled: Float[np.ndarray, "m n q"], variance: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m q q"]:
    """Covariance of linear models: the inverse of their Fisher information, in the units of the columns. Huge, not infinite, where that is 0."""
    axes, spread = _spread(scaled, variance)
    return (np.swapaxes(axes, 1, 2) * (spread**2)[:, None]) @ axes


def _moved(
    parameters: Sequence[FreeParameter], x: Float[np.ndarray, "m p"], steps: Float[np.ndarray, "m k q"], free: Int[np.ndarray, "q"]
) -> Float[np.ndarray, "m k q"]:
    """Numbers after steps in their natural scales, kept inside their bounds."""
    inside = [parameters[i] for i in free.tolist()]
    at = x[:, None, free]
    positive = np.array([is_positive(p) for p in inside])
    there = np.where(positive, at * np.exp(np.where(positive, steps, 0.0)), at + steps * natural_scales(parameters, x)[:, None, free])
    return np.clip(there, [p.at(_AT_BOUND) for p in inside], [p.at(1.0 - _AT_BOUND) for p in inside])


def verdicts(parameters: Sequence[FreeParameter], relative: Sequence[float]) -> list[str]:
    """A sentence for each number that is not, or poorly, determined. relative : as in `Uncertainty`."""
    said = []
    for parameter, sd in zip(parameters, relative, strict=True):
        if not sd <= UNDETERMINED:
            said.append(f"{parameter.name} is not determined by the data")
        elif sd > POOR:
            whole = "value" if is_positive(parameter) else "interval"
            said.append(f"{parameter.name} is poorly determined by the data: its standard error is {100 * sd:.0f} % of its {whole}")
    return said


def open_directions(parameters: Sequence[FreeParameter], inner: Float[np.ndarray, "q q"]) -> list[str]:
    """Sentences about the combinations that a covariance in natural scales leaves open, the most open first."""
    values, axes = np.linalg.eigh(inner)
    spread = np.sqrt(np.maximum(values, 0.0))
    return [_sentence(parameters, axis, sd) for axis, sd in zip(axes.T[::-1], spread[::-1], strict=True) if not sd <= UNDETERMINED]


def _sentence(parameters: Sequence[FreeParameter], direction: np.ndarray, sd: float) -> str:
    """An open direction in words: what changes together, and how far the number that changes most goes."""
    strongest = direction[np.argmax(np.abs(direction))]
    parts = [(p, float(c / strongest)) for p, c in zip(parameters, direction, strict=True) if abs(c / strongest) > _TELLS]
    parts.sort(key=lambda part: -abs(part[1]))
    names = [p.name for p, _ in parts]
    far = sd * abs(strongest)
    size = "all the way" if far >= 5 else f"by a factor {np.exp(far):.2g}" if is_positive(parts[0][0]) else f"by {far:.2g} of its interval"
    if len(parts) == 1:
        return f"the data leave {names[0]} open {size} (1 sd)"
    together = ", ".join(f"{p.name} ({share:+.2f})" for p, share in parts)
    listed = f"{', '.join(names[:-1])} and {names[-1]}"
    return f"{listed} trade off: the data leave {names[0]} open {size} (1 sd) along relative changes of {together}"


def correlation(covariance: np.ndarray) -> np.ndarray:
    """Correlation matrix; 1 on the diagonal, 0 beside numbers without variance."""
    sd = np.sqrt(np.diag(covariance))
    safe = np.where(sd > 0, sd, 1.0)
    matrix = covariance / np.outer(safe, safe)
    np.fill_diagonal(matrix, 1.0)
    return matrix
