"""Least squares from several starts, and what comes of it."""

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import numpy as np

from ..errors import InputError
from ..scene.stack import Stack
from .least_squares import Descent, descend
from .parameters import shares, spread_shares, unbounded
from .parts import Parts, parts
from .problem import Problem
from .remarks import on_numbers, on_quality, on_solver, on_starts, rivals
from .result import Fit, Minimum, Outcome, Start
from .uncertainty import Uncertainty, uncertainty

_MAX_STEPS = 200
SAME = 0.1  # two ends are one minimum if their chi-squares differ by less than this,
MOVED = 1.0  # and their residuals, by the slopes at the better one, by less than this (sum of squares)
_CLIMBS = 3  # different minima of least squares from which a maximum of the posterior density is looked for
_ENOUGH = 3  # starts that reach the best minimum, after which no more are made
_LEAST_NOISE = 1e-7  # relative noise below which an estimated one is rounding


def fit(
    problem: Problem,
    *,
    starts: int = 8,
    seed: int = 0,
    on_start: Callable[[int, int], None] | None = None,
) -> Fit:
    """Fit a problem: least squares, normal priors among the residuals.

    The first run starts at the parameters' init, further ones at points of a scrambled Sobol sequence between the bounds. Each goes first for the
    logarithms of the data, then for the data. Once three runs have met in the best minimum no more are made. A solver that was chosen for the init
    and is not good enough at the result gives way to a better one, which goes on from there. A model error is taken as stated at the result, once.

    What is no sum of squares (Student's t, counts, hierarchies, a free scale of the model error) goes on from the least-squares minima to the maximum
    of its posterior density, and takes its covariance from the Hessian there. In a hierarchy the maximum is no summary of the whole: sample it.

    Arguments
    ---------
    starts : largest number of runs. seed : of the scrambling. on_start : called with (runs done, largest number) after each.

    Returns a Fit also where it failed: look at ``outcome`` and ``warnings``.

    >>> import layerfit as lf
    >>> skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.02, sigma_s_prime=2, n=1.4)])
    >>> data = lf.Dataset(lf.RadialReflectance(r=[1, 2, 4, 8]), [0.0215, 0.00929, 0.00231, 0.000347], noise=lf.Noise(relative=0.02))
    >>> result = lf.fit(lf.Problem(skin, data, free={"skin.sigma_a": (1e-3, 1), "skin.sigma_s_prime": (0.1, 10)}))
    >>> {name: (float(f"{p.value:.3g}"), float(f"{p.stderr:.1g}")) for name, p in result.parameters.items()}
    {'skin.sigma_a': (0.0107, 0.0004), 'skin.sigma_s_prime': (0.974, 0.01)}
    """
    if not isinstance(starts, int) or starts < 1:
        raise InputError(f"starts = {starts!r}; allowed is a whole number, at least 1")
    began = time.perf_counter()
    points = _starting_points(problem, starts, seed)
    result = _assemble(problem, _search(problem, points, on_start), time.perf_counter() - began)
    while (better := result.problem.again(result.stack, result.x)) is not None:
        runs = _search(better, _starting_points(better, 1, seed), on_start)
        result = _assemble(better, runs, time.perf_counter() - began)
    if problem.model_error != "off" and np.all(np.isfinite(result.x)):
        again = result.problem.with_errors_at(result.x, result.predictions)
        result = _assemble(again, _search(again, shares(again.parameters, result.x[None]), None), time.perf_counter() - began)
    return result


def _search(problem: Problem, points: np.ndarray, on_start: Callable[[int, int], None] | None) -> "list[_Run]":
    """Runs from all points, best first."""
    runs = _run_all(problem, points, on_start)
    return runs if problem.least_squares else _climb(problem, runs)


def _climb(problem: Problem, runs: "list[_Run]") -> "list[_Run]":
    """From the minima of least squares to the maxima of the posterior density; the square of the Hessian's root is in place of the Jacobian's."""
    from .maximum import maximise, root_of_hessian  # jaxopt is slow to import

    ended: list[_Run] = []
    for run in runs:
        if any(_same_minimum(problem, other, run) for other in ended) or len(ended) == _CLIMBS:
            continue
        ended.append(run)
    out = []
    for run in ended:
        there = maximise(problem, shares(problem.parameters, run.start.last[None])[0], _MAX_STEPS)
        x = np.asarray(problem.model.coordinates.between(there.share))
        outcome = Outcome.NOT_FINITE if not math.isfinite(there.value) else Outcome.CONVERGED if there.converged else Outcome.MAX_STEPS
        start = Start(run.start.first, x, there.value, run.start.steps + there.steps, outcome)
        out.append((start, there.share))
    out.sort(key=lambda pair: pair[0].chi2)
    root = root_of_hessian(problem, out[0][1])
    climbed = []
    for start, share in out:
        u = unbounded(share)
        slope = np.asarray(jax.jvp(problem.model.coordinates.physical, (u,), (np.ones_like(u),))[1])
        climbed.append(_Run(start, _End(u, slope, np.zeros(len(root)), root * slope)))
    return climbed


def _starting_points(problem: Problem, count: int, seed: int) -> np.ndarray:
    """Shares between the bounds, (count, p): the init first, then a low-discrepancy sequence."""
    init = np.array([p.share(p.init) for p in problem.parameters])
    return np.concatenate([init[None], spread_shares(len(init), count - 1, seed)])


class _End(NamedTuple):
    """The end of one run: coordinates, dx/du, weighted residuals and their slopes in u (see `Descent`)."""

    u: np.ndarray
    slope: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray


class _Run(NamedTuple):
    start: Start
    end: _End


def _rows(problem: Problem, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates at places (shares) between the bounds, filled up to the one number of rows that is compiled; and how many count."""
    u = np.zeros((2 * len(problem.parameters), len(problem.parameters)))  # as many as the cubature rule has points
    u[: len(places)] = unbounded(places)
    return u, np.array(len(places))


def _run_one(problem: Problem, share: np.ndarray) -> _Run:
    end: Descent = jax.tree.map(lambda rows: np.asarray(rows)[0], descend(problem.model, *_rows(problem, share[None]), np.array(False), _MAX_STEPS))
    value = float(np.sum(end.residual**2))
    outcome = Outcome.CONVERGED if end.converged else Outcome.MAX_STEPS
    if not math.isfinite(value):
        value, outcome = math.inf, Outcome.NOT_FINITE
    start = Start(np.asarray(end.first), np.asarray(end.x), value, int(end.steps), outcome)
    return _Run(start, _End(*(np.asarray(part) for part in (end.u, end.slope, end.residual, end.jacobian))))


def _run_all(problem: Problem, points: np.ndarray, on_start: Callable[[int, int], None] | None) -> list[_Run]:
    """Runs from all points, two at a time, best first; stops early when enough have met."""
    runs = [_run_one(problem, points[0])]  # alone, so that it compiles once
    if on_start:
        on_start(1, len(points))
    with ThreadPoolExecutor(2) as pool:
        for i in range(1, len(points), 2):
            runs += list(pool.map(lambda p: _run_one(problem, p), points[i : i + 2]))
            if on_start:
                on_start(len(runs), len(points))
            best = min(runs, key=lambda run: run.start.chi2)
            if sum(_same_minimum(problem, best, run) for run in runs) >= _ENOUGH:
                break
    return sorted(runs, key=lambda run: run.start.chi2)


def least_variance(problem: Problem, square: Any) -> Any:
    """Variance of a residual: 1 where sd are given (or the noise is part of the density), else from the least sum of squares; one or many."""
    if not (problem.estimates_noise and problem.least_squares):
        return np.ones(np.shape(square))[()]
    dof = max(sum(d.geometry.size for d in problem.data) - len(problem.parameters), 1)
    return np.maximum(square / dof, _LEAST_NOISE**2)


def _variance(problem: Problem, run: _Run) -> float:
    return float(least_variance(problem, run.start.chi2))


def _same_minimum(problem: Problem, best: _Run, other: _Run) -> bool:
    """Whether two runs ended in one minimum: nearly the same chi-square, and nearly the same residuals by the slopes at the best."""
    if not math.isfinite(other.start.chi2):
        return False
    variance = _variance(problem, best)
    moved = best.end.jacobian @ (other.end.u - best.end.u)
    return (other.start.chi2 - best.start.chi2) / variance <= SAME and float(np.sum(moved**2)) / variance <= MOVED


def _minima(problem: Problem, runs: Sequence[_Run]) -> list[tuple[_Run, int]]:
    """The best run of each distinct minimum and how many ended there, best first; runs without a finite chi-square are in none."""
    met: list[tuple[_Run, int]] = []
    for run in runs:
        known = next((i for i, (first, _) in enumerate(met) if _same_minimum(problem, first, run)), None)
        if known is not None:
            met[known] = (met[known][0], met[known][1] + 1)
        elif math.isfinite(run.start.chi2):
            met.append((run, 1))
    return met


def _physical(jacobian: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Jacobians of the weighted residuals in physical units (..., n, p)."""
    return jacobian / np.maximum(slope, 1e-300)[..., None, :]


def jacobians_at(problem: Problem, points: np.ndarray) -> np.ndarray:
    """The same at points in physical units (points, p), or the roots of Hessians that stand in their place."""
    places = shares(problem.parameters, points)
    if problem.least_squares:
        return linearised(problem, places)[1]
    from .maximum import root_of_hessian

    return np.array([root_of_hessian(problem, place) for place in places])


def linearised(problem: Problem, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weighted residuals (points, n) and their Jacobians in physical units (points, n, p) at shares between the bounds."""
    there = descend(problem.model, *_rows(problem, places), np.array(True), _MAX_STEPS)
    rows = slice(len(places))
    return np.asarray(there.residual)[rows], _physical(np.asarray(there.jacobian), np.asarray(there.slope))[rows]


def _assemble(problem: Problem, runs: Sequence[_Run], seconds: float) -> Fit:
    best = runs[0]
    x = best.start.last
    variance = _variance(problem, best)
    jacobian = _physical(np.asarray(best.end.jacobian), np.asarray(best.end.slope))
    known = uncertainty(problem.parameters, x, lambda points: jacobians_at(problem, points), jacobian, np.asarray(best.end.residual), variance)
    residuals, slopes = np.asarray(best.end.residual), jacobian
    if not problem.least_squares:
        residuals, slopes = (found[0] for found in linearised(problem, shares(problem.parameters, x[None])))
    scatter, count = problem.model.scatter, sum(d.geometry.size for d in problem.data)
    ends = np.cumsum([d.geometry.size for d in problem.data])
    flat = np.split(residuals[:count], ends[:-1])
    predictions = [d.values + np.asarray(one.unweighted(r)) for d, one, r in zip(problem.data, scatter, flat, strict=True)]
    dof = count - x.size
    scale = 1.0 if problem.model.error_scale is None else float(x[problem.model.error_scale])
    chi2 = sum(float(one.misfit(predicted, scale)) for one, predicted in zip(scatter, predictions, strict=True))
    noise = None
    if problem.estimates_noise:
        noise = math.sqrt(max(chi2 / max(dof, 1), _LEAST_NOISE**2))
        chi2 /= noise**2
    size = 1.0 if noise is None else noise
    weighted = [
        (predicted - d.values) / (size * np.asarray(one.spread)) for d, one, predicted in zip(problem.data, scatter, predictions, strict=True)
    ]
    split: Sequence[Parts | None] = (None,) * x.size
    if problem.model_error != "off" and np.all(np.isfinite(slopes)) and np.all(np.isfinite(jacobian)):
        inside = np.flatnonzero(~np.array(known.at_bound))
        split = parts(scatter, slopes[:count], jacobian.T @ jacobian, inside, known.stderr, scale)
    minima = tuple(
        Minimum(run.start.last, chi2 + (run.start.chi2 - best.start.chi2) / (variance if problem.least_squares else 1.0), met)
        for run, met in _minima(problem, runs)
    )
    starts = [run.start for run in runs]
    if not problem.least_squares:  # on the scale of the data's
        starts = [Start(s.first, s.last, (s.chi2 - best.start.chi2 + chi2) * size**2, s.steps, s.outcome) for s in starts]
    values = {p.name: float(v) for p, v in zip(problem.parameters, x, strict=True)}
    stack = problem.stack.set({name: v for name, v in values.items() if name in problem.stack.names})
    stack = stack.set({tie.name: float(tie.value(stack)) for tie in problem.model.scene.ties})
    return Fit(
        problem=problem,
        stack=stack,
        x=x,
        uncertainty=known,
        residuals=tuple(weighted),
        predictions=tuple(predictions),
        chi2=chi2,
        dof=dof,
        noise=noise,
        outcome=best.start.outcome,
        warnings=tuple(_remarks(problem, runs, minima, known, stack, chi2, dof, noise)),
        starts=tuple(starts),
        minima=minima,
        seconds=seconds,
        parts=tuple(split),
    )


def _remarks(
    problem: Problem, runs: Sequence[_Run], minima: Sequence[Minimum], known: Uncertainty, stack: Stack, chi2: float, dof: int, noise: float | None
) -> list[str]:
    """All that is to be said beside the numbers."""
    best, variance = runs[0], _variance(problem, runs[0])
    said = [] if best.start.outcome is Outcome.CONVERGED else [f"the fit did not converge: {best.start.outcome.value}"]
    others = [run.start.chi2 / variance for run in runs if not _same_minimum(problem, best, run)]
    said += on_starts(best.start.chi2 / variance, others, len(runs))
    near = rivals(problem.parameters, minima, known)
    said += [*near, *on_numbers(problem.parameters, best.start.last, known, rivalled=bool(near))]
    said += on_quality(problem, chi2, dof, noise)
    return list(dict.fromkeys([*said, *on_solver(problem, stack)]))
