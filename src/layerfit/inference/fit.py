"""Least squares from several starts, and what comes of it."""

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from enum import StrEnum
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from scipy.special import chdtrc

from ..errors import InputError
from ..scene.stack import Stack
from .least_squares import Descent, descend
from .parameters import shares, spread_points, unbounded
from .problem import Problem
from .uncertainty import UNDETERMINED, Uncertainty, correlation, uncertainty, verdicts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .profile_likelihood import ProfileLikelihood

_MAX_STEPS = 200
SAME = 0.1  # two ends are one minimum if their chi-squares differ by less than this,
MOVED = 1.0  # and their residuals, by the slopes at the better one, by less than this (sum of squares)
_NEAR = 9.0  # chi-squares that differ by less are hard to tell apart
_APART = 2.0  # standard errors by which a number in another minimum must differ to be named
_ENOUGH = 3  # starts that reach the best minimum, after which no more are made
_LEAST_NOISE = 1e-7  # relative noise below which an estimated one is rounding


class Outcome(StrEnum):
    """How a fit, or one start of it, ended."""

    CONVERGED = "converged"
    MAX_STEPS = "stopped at the largest number of steps"
    NOT_FINITE = "residuals are not finite"


class Start(eqx.Module):
    """One run of the fit: where it began and ended (physical units), its chi-square, and how often it stepped."""

    first: np.ndarray
    last: np.ndarray
    chi2: float = eqx.field(static=True)
    steps: int = eqx.field(static=True)
    outcome: Outcome = eqx.field(static=True)


class Minimum(eqx.Module):
    """One minimum that runs ended in: its numbers (physical units), its chi-square, and how many runs."""

    x: np.ndarray
    chi2: float = eqx.field(static=True)
    starts: int = eqx.field(static=True)


class Estimate(eqx.Module):
    """One fitted number. stderr: 1 standard deviation, None at a bound or where the data do not depend on it."""

    value: float = eqx.field(static=True)
    stderr: float | None = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    at_bound: bool = eqx.field(static=True)


class Fit(eqx.Module):
    """The result of `fit`. Nothing of the problem was changed.

    Attributes
    ----------
    stack : the fitted stack, of the same structure as the guess.
    x, covariance : numbers in the order of problem.names and their covariance (p, p), physical units.
    residuals, predictions : for each dataset (prediction - value)/sd and the prediction.
    chi2, dof, chi2_reduced : sum of squares of all residuals, values minus free numbers, and their ratio.
    noise : the relative noise estimated from the fit, None where sd were given. The covariance uses it, and chi2_reduced is then 1.
    outcome, warnings : how it ended, and what to keep in mind.
    starts : all runs, best first. minima : the distinct ones that they ended in, best first, chi-square on the scale of chi2. seconds : wall time.
    """

    problem: Problem
    stack: Stack
    x: np.ndarray
    uncertainty: Uncertainty
    residuals: tuple[np.ndarray, ...]
    predictions: tuple[np.ndarray, ...]
    chi2: float = eqx.field(static=True)
    dof: int = eqx.field(static=True)
    noise: float | None = eqx.field(static=True)
    outcome: Outcome = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True)
    starts: tuple[Start, ...]
    minima: tuple[Minimum, ...]
    seconds: float = eqx.field(static=True)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance in physical units (p, p); 0 beside numbers at a bound."""
        return self.uncertainty.covariance

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix (p, p)."""
        return correlation(self.covariance)

    @property
    def chi2_reduced(self) -> float:
        """chi2/dof; NaN without degrees of freedom."""
        return self.chi2 / self.dof if self.dof > 0 else math.nan

    @property
    def parameters(self) -> dict[str, Estimate]:
        """Fitted numbers by name."""
        u = self.uncertainty
        rows = zip(self.problem.parameters, self.x, u.stderr, u.at_bound, strict=True)
        return {p.name: Estimate(float(x), stderr, p.unit, bound) for p, x, stderr, bound in rows}

    def plot(self) -> "Figure":
        """Data, fit and residuals as a matplotlib figure."""
        from ..report.plots import plot_fit

        return plot_fit(self)

    def profile(self, name: str) -> "ProfileLikelihood":
        """Chi-square against one number, minimised over all others: see `profile_likelihood`."""
        from .profile_likelihood import profile_likelihood

        return profile_likelihood(self, name)

    def plot_correlation(self) -> "Figure":
        """The correlation matrix as a matplotlib figure."""
        from ..report.plots import plot_correlation

        return plot_correlation(self)

    def summary(self) -> str:
        """The result as plain text."""
        from ..report.tables import fit_text

        return fit_text(self)

    def save(self, folder: Any) -> dict[str, Any]:
        """Write fit.json, the fitted curves as CSV, figures and report.html into a folder; returns their paths by name."""
        from ..report.archive import save_fit

        return save_fit(self, folder)

    def __repr__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        from ..report.html import fit_fragment

        return fit_fragment(self)


def fit(
    problem: Problem,
    *,
    starts: int = 8,
    seed: int = 0,
    on_start: Callable[[int, int], None] | None = None,
) -> Fit:
    """Fit a problem by least squares.

    The first run starts at the parameters' init, further ones at points of a scrambled Sobol sequence between the bounds. Each goes first for the
    logarithms of the data, then for the data. Once three runs have met in the best minimum no more are made. A solver that was chosen for the init
    and is not good enough at the result gives way to a better one, which goes on from there.

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
    result = _assemble(problem, _run_all(problem, points, on_start), time.perf_counter() - began)
    while (better := result.problem.again(result.stack, result.x)) is not None:
        runs = _run_all(better, _starting_points(better, 1, seed), on_start)
        result = _assemble(better, runs, time.perf_counter() - began)
    return result


def _starting_points(problem: Problem, count: int, seed: int) -> np.ndarray:
    """Shares between the bounds, (count, p): the init first, then a low-discrepancy sequence."""
    init = np.array([p.share(p.init) for p in problem.parameters])
    return np.concatenate([init[None], spread_points(len(init), count - 1, seed)])


class _Run(NamedTuple):
    start: Start
    end: Descent  # of this run alone, in NumPy


def _rows(problem: Problem, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates at shares between the bounds, filled up to the one number of rows that is compiled; and how many count."""
    u = np.zeros((2 * len(problem.parameters), len(problem.parameters)))  # as many as the cubature rule has points
    u[: len(shares)] = unbounded(shares)
    return u, np.array(len(shares))


def _run_one(problem: Problem, share: np.ndarray) -> _Run:
    end: Descent = jax.tree.map(lambda rows: np.asarray(rows)[0], descend(problem.model, *_rows(problem, share[None]), np.array(False), _MAX_STEPS))
    value = float(np.sum(end.residual**2))
    outcome = Outcome.CONVERGED if end.converged else Outcome.MAX_STEPS
    if not math.isfinite(value):
        value, outcome = math.inf, Outcome.NOT_FINITE
    return _Run(Start(np.asarray(end.first), np.asarray(end.x), value, int(end.steps), outcome), end)


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


def least_variance(problem: Problem, chi2: float) -> float:
    """Variance of a residual: 1 where sd are given, else estimated from the sum of squares at the best minimum."""
    if not problem.estimates_noise:
        return 1.0
    dof = max(sum(d.geometry.size for d in problem.data) - len(problem.parameters), 1)
    return max(chi2 / dof, _LEAST_NOISE**2)


def _same_minimum(problem: Problem, best: _Run, other: _Run) -> bool:
    """Whether two runs ended in one minimum: nearly the same chi-square, and nearly the same residuals by the slopes at the best."""
    if not math.isfinite(other.start.chi2):
        return False
    variance = least_variance(problem, best.start.chi2)
    moved = best.end.jacobian @ (other.end.u - best.end.u)
    return (other.start.chi2 - best.start.chi2) / variance <= SAME and float(np.sum(moved**2)) / variance <= MOVED


def _minima(problem: Problem, runs: Sequence[_Run], variance: float) -> tuple[Minimum, ...]:
    """Distinct minima, best first; runs that ended without a finite chi-square are in none."""
    met: list[tuple[_Run, int]] = []
    for run in runs:
        known = next((i for i, (first, _) in enumerate(met) if _same_minimum(problem, first, run)), None)
        if known is not None:
            met[known] = (met[known][0], met[known][1] + 1)
        elif math.isfinite(run.start.chi2):
            met.append((run, 1))
    return tuple(Minimum(run.start.last, run.start.chi2 / variance, count) for run, count in met)


def _physical(jacobian: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Jacobians of the weighted residuals in physical units (..., n, p)."""
    return jacobian / np.maximum(slope, 1e-300)[..., None, :]


def jacobians_at(problem: Problem, points: np.ndarray) -> np.ndarray:
    """Jacobians of the weighted residuals at points in physical units (points, p): (points, n, p)."""
    there = descend(problem.model, *_rows(problem, shares(problem.parameters, points)), np.array(True), _MAX_STEPS)
    return _physical(np.asarray(there.jacobian), np.asarray(there.slope))[: len(points)]


def _assemble(problem: Problem, runs: Sequence[_Run], seconds: float) -> Fit:
    best = runs[0]
    x = best.start.last
    variance = least_variance(problem, best.start.chi2)
    jacobian = _physical(np.asarray(best.end.jacobian), np.asarray(best.end.slope))
    known = uncertainty(problem.parameters, x, lambda points: jacobians_at(problem, points), jacobian, np.asarray(best.end.residual), variance)
    flat = np.asarray(best.end.residual)
    sizes = np.cumsum([d.geometry.size for d in problem.data])[:-1]
    weighted = np.split(flat / math.sqrt(variance), sizes)
    predictions = [d.values + r * np.asarray(sd) for d, r, sd in zip(problem.data, np.split(flat, sizes), problem.model.sd, strict=True)]
    dof = flat.size - x.size
    values = {p.name: float(v) for p, v in zip(problem.parameters, x, strict=True)}
    stack = problem.stack.set({name: v for name, v in values.items() if name in problem.stack.names})
    stack = stack.set({tie.name: tie.factor * stack.get(tie.source) for tie in problem.ties})
    noise = math.sqrt(variance) if problem.estimates_noise else None
    chi2 = float(np.sum(flat**2)) / variance
    minima = _minima(problem, runs, variance)
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
        warnings=tuple(_warnings(problem, runs, minima, known, stack, chi2, dof, noise)),
        starts=tuple(run.start for run in runs),
        minima=minima,
        seconds=seconds,
    )


def _rivals(problem: Problem, minima: Sequence[Minimum], known: Uncertainty) -> list[str]:
    """What other minima, nearly as good, say of the numbers, where it is beyond the standard error."""
    warnings = []
    for other in minima[1:]:
        if other.chi2 - minima[0].chi2 < _NEAR:
            rows = zip(problem.parameters, minima[0].x.tolist(), other.x.tolist(), known.stderr, strict=True)
            apart = [f"{p.name} = {there:.4g}" for p, x, there, sd in rows if sd is None or abs(there - x) > _APART * sd]
            if apart:
                more = other.chi2 - minima[0].chi2
                warnings.append(
                    f"another minimum, its chi-square higher by only {more:.2g}, has {', '.join(apart)}: beyond the standard errors given"
                )
    return warnings


def _warnings(
    problem: Problem, runs: Sequence[_Run], minima: Sequence[Minimum], known: Uncertainty, stack: Stack, chi2: float, dof: int, noise: float | None
) -> list[str]:
    warnings = []
    best = runs[0]
    if best.start.outcome is not Outcome.CONVERGED:
        warnings.append(f"the fit did not converge: {best.start.outcome.value}")
    met = sum(_same_minimum(problem, best, run) for run in runs)
    if len(runs) > 1 and met < len(runs):
        others = [run.start.chi2 / least_variance(problem, best.start.chi2) for run in runs if not _same_minimum(problem, best, run)]
        rival = min(others)
        near = rival - chi2 < _NEAR
        warnings.append(
            f"{met} of {len(runs)} starts reached the best minimum (chi-square {chi2:.4g}); the next one has {rival:.4g}"
            + (", which the data can hardly tell apart" if near else "")
        )
    rivals = _rivals(problem, minima, known)
    warnings.extend(rivals)
    for parameter, bound, x in zip(problem.parameters, known.at_bound, best.start.last, strict=True):
        if bound:
            side = "lower" if x - parameter.low < parameter.high - x else "upper"
            held = f"{parameter.name} is at its {side} bound ({x:.4g} {parameter.unit})"
            warnings.append(f"{held}; it has no standard error, and those of the others allow for its moving inside")
    beyond = [p.name for p, sd in zip(problem.parameters, known.relative, strict=True) if not sd <= UNDETERMINED]
    if (beyond or rivals) and any(name.endswith(".amplitude") for name in problem.names):
        warnings.append("ill-posed: these data are relative (the amplitude is free) and do not determine all numbers; rely on none of them alone")
    warnings.extend(verdicts(problem.parameters, known.relative))
    warnings.extend(known.directions)
    contradicted = False
    if noise is not None:
        warnings.append(f"the data have no sd: one relative noise was estimated from the fit, {noise:.2g}")
    elif chdtrc(max(dof, 1), chi2) < 1e-3:
        contradicted = True
        warnings.append(
            f"chi-square {chi2:.4g} for {dof} degrees of freedom: the model does not describe the data within their sd, or the sd are too small"
        )
    if dof <= 0 and not contradicted:
        warnings.append("as many free parameters as values: the quality of the fit cannot be judged")
    for dataset in problem.data:
        try:
            problem.chosen.check(stack, dataset.geometry)
        except InputError as error:
            warnings.append(f"at the fitted values: {error}")
        warnings.extend(problem.chosen.notes(stack, dataset.geometry))
    warnings.extend(problem.choice.notes)
    return list(dict.fromkeys(warnings))
