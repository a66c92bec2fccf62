"""How far one number can go while all others follow: the profile likelihood of a fit."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import equinox as eqx
import numpy as np
from jaxtyping import Float
from scipy.special import chdtri

from ..errors import InputError
from .batch import Batch, edge_shares
from .fit import linearised
from .parameters import FreeParameter, shares, unbounded
from .result import Fit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BEYOND = 1.25  # how far over the highest level a profile goes
_GRID = (0.35, 0.7, 1.0, 1.4, 1.8, 2.2, 2.7)  # first points, in standard errors
_ROUNDS = 8
_SHARPER = 4  # secant steps towards each crossing
_UNKNOWN = 0.1  # first guess of the sd, in shares of the interval, where the fit has none
_BETTER = 0.01  # gain in chi-square from which a better minimum is reported


class Interval(eqx.Module):
    """Where the profile stays below a level. low, high : ends in physical units; where open, the bound that was met first."""

    low: float = eqx.field(static=True)
    high: float = eqx.field(static=True)
    low_open: bool = eqx.field(static=True)
    high_open: bool = eqx.field(static=True)


class ProfileLikelihood(eqx.Module):
    """The result of `profile_likelihood`.

    Attributes
    ----------
    name, unit : of the number. values : at which it was held, rising (k,). delta : what chi-square rises by with all others free (k,); for estimated
        noise n log of the ratio of the sums of squares. x : all numbers at each (k, p), physical units.
    intervals : by level, 0.68 and 0.95. warnings : a side that is open, a better minimum.
    """

    fit: Fit
    name: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    values: np.ndarray
    delta: np.ndarray
    x: np.ndarray
    intervals: dict[float, Interval]
    warnings: tuple[str, ...] = eqx.field(static=True)

    def plot(self) -> "Figure":
        """The profile beside the parabola of the standard error, and how the other numbers follow."""
        from ..report.profile_plot import plot_profile

        return plot_profile(self)

    def summary(self) -> str:
        """The intervals as plain text."""
        from ..report.profile_table import profile_text

        return profile_text(self)

    def __repr__(self) -> str:
        return self.summary()


def profile_likelihood(fit: Fit, name: str, *, levels: Sequence[float] = (0.68, 0.95)) -> ProfileLikelihood:
    """Chi-square against one number, minimised over all others, in both directions until it passes the highest level or a bound is met.

    An interval from it needs no straight model: where the standard error is wrong, it is not.

    Arguments
    ---------
    fit : from `fit`. name : of a free number. levels : confidence of the intervals, each between 0 and 1.

    Raises InputError for a name that is not free, a level outside, a problem that is no least squares, or a fit that did not end in finite residuals.

    References
    ----------
    D. J. Venzon, S. H. Moolgavkar, J. R. Stat. Soc. C 37, 87 (1988).

    >>> import layerfit as lf
    >>> skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.02, sigma_s_prime=2, n=1.4)])
    >>> data = lf.Dataset(lf.RadialReflectance(r=[1, 2, 4, 8]), [0.0215, 0.00929, 0.00231, 0.000347], noise=lf.Noise(relative=0.02))
    >>> free = {"skin.sigma_a": (1e-3, 1), "skin.sigma_s_prime": (0.1, 10)}
    >>> found = lf.profile_likelihood(lf.fit(lf.Problem(skin, data, free=free, solver=lf.LayeredDiffusion())), "skin.sigma_a")
    >>> [round(end, 4) for end in (found.intervals[0.68].low, found.intervals[0.68].high)]
    [0.0103, 0.0112]
    """
    problem = fit.problem
    if name not in problem.names:
        raise InputError(f"profile: '{name}' is not free in this fit; allowed: {', '.join(problem.names)}")
    for level in levels:
        if isinstance(level, bool) or not isinstance(level, int | float) or not 0 < level < 1:
            raise InputError(f"profile: level = {level!r}; allowed are numbers between 0 and 1")
    if not math.isfinite(fit.chi2):
        raise InputError("profile: the fit has no finite chi-square, so there is nothing to compare with")
    rises = {float(level): float(chdtri(1, 1.0 - level)) for level in levels}
    search = _Search(fit, problem.names.index(name))
    search.go(_BEYOND * max(rises.values()))
    search.sharpen(list(rises.values()))
    parameter = problem.parameters[search.index]
    share, delta, x = search.profile()
    intervals = {level: _interval(parameter, share, delta, rise) for level, rise in rises.items()}
    warnings = []
    for side, is_open in (("below", [i.low_open for i in intervals.values()]), ("above", [i.high_open for i in intervals.values()])):
        beyond = [f"{100 * level:g} %" for level, one in zip(intervals, is_open, strict=True) if one]
        if beyond:
            bound = parameter.low if side == "below" else parameter.high
            warnings.append(f"{name} is open {side} at {' and '.join(beyond)}: its bound {bound:g} {parameter.unit} was met first")
    split = [f"{100 * level:g} %" for level, rise in rises.items() if _pieces(delta, rise) > 1]
    if split:
        warnings.append(f"the profile of {name} has several minima: between the ends of the interval at {' and '.join(split)} lie values outside it")
    if search.gain > _BETTER:
        warnings.append(f"a better minimum than the fit's was met: chi-square lower by {search.gain:.3g}; fit again with more starts")
    return ProfileLikelihood(fit, name, parameter.unit, np.array([parameter.at(s) for s in share.tolist()]), delta, x, intervals, tuple(warnings))


class _Search:
    """Points of a profile, found by rounds; positions are shares between the bounds."""

    def __init__(self, fit: Fit, index: int):
        self.fit, self.index = fit, index
        problem = fit.problem
        self.batch = Batch(problem, "a profile likelihood")
        self.values = np.concatenate([d.values for d in problem.data])
        self.sd = np.concatenate([np.asarray(s) for s in problem.model.sd])
        self.center = shares(problem.parameters, fit.x)
        covariance = _in_shares(fit)
        variance = covariance[index, index]
        self.sd_share = math.sqrt(variance) if 0 < variance < 1 else _UNKNOWN
        self.slope = covariance[:, index] / variance if variance > 0 else np.eye(len(self.center))[index]
        self.best = float(np.sum(linearised(problem, self.center[None])[0] ** 2))  # priors among the residuals
        self.found: dict[float, tuple[float, np.ndarray]] = {float(self.center[index]): (self.best, self.center)}

    @property
    def gain(self) -> float:
        """What the best point found is better than the fit."""
        return max(0.0, -self._rise(min(chi2 for chi2, _ in self.found.values()), self.best))

    def _rise(self, chi2: float, lowest: float) -> float:
        if not self.fit.problem.estimates_noise:
            return chi2 - lowest
        return self.values.size * math.log(max(chi2, 1e-300) / max(lowest, 1e-300))

    def profile(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Shares, rises above the lowest point, all numbers in physical units."""
        lowest = min(chi2 for chi2, _ in self.found.values())
        share = np.array(sorted(self.found))
        rise = np.array([self._rise(self.found[s][0], lowest) for s in share.tolist()])
        x = np.array([[p.at(v) for p, v in zip(self.fit.problem.parameters, self.found[s][1].tolist(), strict=True)] for s in share.tolist()])
        return share, rise, x

    def go(self, target: float) -> None:
        """Points on both sides until the rise passes the target or a bound is met; then every point tried from its neighbours' ends too."""
        middle = float(self.center[self.index])
        points = [middle + sign * step * self.sd_share for step in _GRID for sign in (-1.0, 1.0)]
        for _ in range(_ROUNDS):
            self._add([min(max(s, 0.0), 1.0) for s in points])
            share, rise, _x = self.profile()
            points = []
            if rise[0] < target and share[0] > 0.0:
                points += [middle - (middle - share[0]) * factor for factor in (1.4, 2.0)]
            if rise[-1] < target and share[-1] < 1.0:
                points += [middle + (share[-1] - middle) * factor for factor in (1.4, 2.0)]
            if not points:
                break
        else:
            self._add([0.0] if share[0] > 0.0 and rise[0] < target else [])
            self._add([1.0] if share[-1] < 1.0 and rise[-1] < target else [])
        for _ in range(2):
            self._from_neighbours()

    def sharpen(self, rises: Sequence[float]) -> None:
        """Points where the profile crosses each level."""
        for _ in range(_SHARPER):
            share, rise, _x = self.profile()
            self._add([where for level in rises for where in _crossings(share, rise, level) if where is not None])

    def _add(self, points: Sequence[float]) -> None:
        """New points, each started from the nearest known end, moved along the fit's own slope."""
        new = sorted({s for s in points if all(abs(s - known) > 1e-7 for known in self.found)})
        if new:
            known = sorted(self.found)
            starts = []
            for s in new:
                near = min(known, key=lambda other: abs(other - s))
                starts.append(self.found[near][1] + self.slope * (s - near))
            self._run(np.array(new), np.array(starts))

    def _from_neighbours(self) -> None:
        share = sorted(self.found)
        pairs = [*pairwise(share), *pairwise(share[::-1])]
        self._run(np.array([s for s, _ in pairs]), np.array([self.found[t][1] for _, t in pairs]))

    def _run(self, points: Float[np.ndarray, "k"], starts: Float[np.ndarray, "k p"]) -> None:
        held = np.zeros(starts.shape, bool)
        held[:, self.index] = True
        u = unbounded(starts)
        u[:, self.index] = edge_shares(points)
        rows = np.ones((len(points), 1))
        end = self.batch.fit(u, rows * self.values, rows * self.sd, held=held, logarithms=False)
        chi2 = np.sum(np.asarray(end.residual) ** 2, axis=1)
        ends = shares(self.fit.problem.parameters, np.asarray(end.x))
        for s, value, where in zip(points.tolist(), chi2.tolist(), ends, strict=True):
            if math.isfinite(value) and value < self.found.get(s, (math.inf, where))[0]:
                self.found[s] = (value, where)


def _in_shares(fit: Fit) -> np.ndarray:
    """The covariance in shares between the bounds."""
    scale = np.array([(v if p.log else 1.0) * (p.ends[1] - p.ends[0]) for p, v in zip(fit.problem.parameters, fit.x.tolist(), strict=True)])
    return fit.covariance / np.outer(scale, scale)


def _crossings(share: np.ndarray, rise: np.ndarray, level: float) -> tuple[float | None, float | None]:
    """The outermost places below a level, None at an end where it never passes the level. Interpolated in the root of the rise."""
    below = np.flatnonzero(rise < level)

    def between(inside: int, outside: int) -> float:
        a, b = math.sqrt(max(float(rise[inside]), 0.0)), math.sqrt(float(rise[outside]))
        return float(share[inside] + (share[outside] - share[inside]) * (math.sqrt(level) - a) / (b - a))

    first, last = int(below[0]), int(below[-1])
    return (between(first, first - 1) if first > 0 else None, between(last, last + 1) if last < len(share) - 1 else None)


def _pieces(rise: np.ndarray, level: float) -> int:
    """How many separate regions lie below a level."""
    return int(np.sum(np.diff(np.concatenate([[False], rise < level]).astype(int)) == 1))


def _interval(parameter: FreeParameter, share: np.ndarray, rise: np.ndarray, level: float) -> Interval:
    low, high = _crossings(share, rise, level)
    return Interval(
        low=parameter.low if low is None else parameter.at(low),
        high=parameter.high if high is None else parameter.at(high),
        low_open=low is None,
        high_open=high is None,
    )
