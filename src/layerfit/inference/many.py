"""One problem, many sets of data: pixels, times, subjects."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .batch import Batch, physical
from .fit import MOVED, SAME, least_variance
from .least_squares import Descent
from .parameters import shares, spread_shares, unbounded
from .problem import Problem
from .result import Outcome
from .uncertainty import UNDETERMINED, covariances

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

_MET = 4  # runs of a set that end in its best minimum, after which no more are made
_SPREAD = -1  # a start between the bounds, in place of the end of a neighbour
_FARTHER = 4  # in place of a rank: the neighbour a quarter of all sets away, for what near ones have all missed
_ORDER = (0, _FARTHER, 1, 2, _SPREAD, 3, _SPREAD)  # starts after the init: the ends of which neighbours, the nearest has rank 0
_ORDER_OF_MAPS = (0, _SPREAD, _SPREAD, _FARTHER, _SPREAD, 1, _SPREAD)  # all of them are made: neighbours of neighbours can all miss the same minimum
_ODD_RUNS = 8  # more runs of a set whose chi-square stands out
_FAR = 5.0  # robust standard deviations above the median at which it does
_FEW = 8  # sets among which none stands out
_EDGE = 0.02  # share of the interval within which the start of a neighbour is moved in


class ManyFits(eqx.Module):
    """The result of `fit_many`: one row a set of data, columns in the order of problem.names.

    Attributes
    ----------
    x, stderr, covariance : numbers (m, p), their standard errors (m, p), NaN at a bound or where the data say nothing, and covariances
        (m, p, p), all in physical units.
    relative : sd of the logarithm, or of the number in units of its interval (m, p). at_bound, determined : flags (m, p).
    chi2, dof, noise : sums of squares (m,), values minus free numbers, and estimated relative noises (m,), None where sd were given.
    predictions : (m, n). outcome : how each ended (m,). met, runs : how many starts ended in the best minimum, of how many (m,).
    seconds : wall time.
    """

    problem: Problem
    x: np.ndarray
    stderr: np.ndarray
    covariance: np.ndarray
    relative: np.ndarray
    at_bound: np.ndarray
    determined: np.ndarray
    chi2: np.ndarray
    dof: int = eqx.field(static=True)
    noise: np.ndarray | None
    predictions: np.ndarray
    outcome: tuple[Outcome, ...] = eqx.field(static=True)
    met: np.ndarray
    runs: np.ndarray
    seconds: float = eqx.field(static=True)

    @property
    def converged(self) -> np.ndarray:
        """Flags (m,)."""
        return np.array([outcome is Outcome.CONVERGED for outcome in self.outcome])

    def to_xarray(self) -> "xr.Dataset":
        """Values and standard errors by name over the dimension "set", with units, and the covariance."""
        import xarray as xr

        columns: dict[str, Any] = {}
        for i, p in enumerate(self.problem.parameters):
            columns[p.name] = ("set", self.x[:, i], {"units": p.unit})
            columns[f"{p.name}.stderr"] = ("set", self.stderr[:, i], {"units": p.unit})
            columns[f"{p.name}.determined"] = ("set", self.determined[:, i])
            columns[f"{p.name}.at_bound"] = ("set", self.at_bound[:, i])
        columns |= {"chi2": ("set", self.chi2), "converged": ("set", self.converged)}
        columns["covariance"] = (("set", "number", "other"), self.covariance)
        names = list(self.problem.names)
        return xr.Dataset(columns, coords={"number": names, "other": names}, attrs={"degrees_of_freedom": self.dof})

    def to_pandas(self) -> "pd.DataFrame":
        """The same as a table, one row a set, without the covariances."""
        return self.to_xarray().drop_vars(["covariance", "number", "other"]).to_dataframe()

    def summary(self) -> str:
        """The result as plain text."""
        from ..report.many_table import many_text

        return many_text(self)

    def __repr__(self) -> str:
        return self.summary()


def fit_many(
    problem: Problem,
    values: Any,
    sd: Any = None,
    *,
    starts: int = 5,
    seed: int = 0,
    on_sets: Callable[[int, int], None] | None = None,
) -> ManyFits:
    """Fit many sets of data of one problem, batched.

    Each set is fitted from the problem's init, from where the sets most like it have ended, and from points spread between the bounds, until four
    runs have met in the best minimum or starts are used up. Sets whose chi-square stands out from the others' get eight spread points more (unless
    starts is 1). The covariance is that of `fit`.

    Arguments
    ---------
    problem : geometries, free numbers, bounds; its own values count only where sd is left out.
    values : (sets, n), one row a set: the values of all its datasets, one after the other.
    sd : (sets, n), or (n,) for all alike. Left out: that of the problem's data; where they have none, one relative noise is estimated for each set.
    starts : largest number of runs of a set that does not stand out: 5 find the best minimum about as often as the 8 of `fit` do, since neighbours
        help. seed : of the spread of starts.
    on_sets : called with (runs done, runs to do) before each round.

    Raises InputError for shapes that do not agree, values that are not finite, an sd that is not above 0, or errors that are not independent and
    normal. Returns a ManyFits also where sets failed: look at ``outcome``.

    >>> import layerfit as lf
    >>> skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.01, sigma_s_prime=1, n=1.4)])
    >>> data = lf.Dataset(lf.RadialReflectance(r=[1, 2, 4, 8]), [0.0215, 0.00929, 0.00231, 0.000347], noise=lf.Noise(relative=0.02))
    >>> problem = lf.Problem(skin, data, free={"skin.sigma_a": (1e-3, 1), "skin.sigma_s_prime": (0.1, 10)}, solver=lf.LayeredDiffusion())
    >>> result = lf.fit_many(problem, [data.values, 1.02 * data.values])
    >>> result.x.round(3).tolist()
    [[0.011, 0.974], [0.01, 0.99]]
    """
    began = time.perf_counter()
    if not isinstance(starts, int) or starts < 1:
        raise InputError(f"starts = {starts!r}; allowed is a whole number, at least 1")
    values, sd = _table(problem, values, sd)
    batch = Batch(problem, "fit_many", np.min(np.abs(values), axis=0))
    batch.require_independent()
    ends = _ends(batch, values, sd, starts, seed, on_sets)
    return _assemble(batch, values, sd, *ends, began)


def fit_rows(
    batch: Batch,
    values: Float[np.ndarray, "m n"],
    sd: Float[np.ndarray, "m n"],
    starts: int,
    seed: int,
    on_sets: Callable[[int, int], None] | None = None,
) -> ManyFits:
    """Sets as `fit_many` fits them, from arrays that were checked, each then followed to where its steps are nothing.

    on_sets : as for `fit_many`; what it raises ends the fits.
    """
    began = time.perf_counter()
    best, met, runs = _ends(batch, values, sd, starts, seed, on_sets, _ORDER_OF_MAPS, starts)
    fine = batch.fit(np.asarray(best.u), values, sd, logarithms=False, fine=True)
    worse = ~(_chi2(np.asarray(fine.residual)) <= _chi2(np.asarray(best.residual)))
    best = jax.tree.map(lambda new, old: np.where(worse.reshape(-1, *[1] * (np.ndim(new) - 1)), old, new), fine, best)
    return _assemble(batch, values, sd, best, met, runs, began)


def fit_refined(coarse: Problem, problem: Problem, values: Any, sd: Any, *, starts: int, seed: int = 0) -> ManyFits:
    """Sets as `fit_many` fits them by a coarse problem, then followed by a fine one, which has the last word.

    coarse : the same problem with a cheaper solver, whose minima lie near enough that a descent from there finds the fine one's.
    """
    began = time.perf_counter()
    values, sd = _table(problem, values, sd)
    least = np.min(np.abs(values), axis=0)
    first, batch = (Batch(one, "fit_refined", least) for one in (coarse, problem))
    batch.require_independent()
    best, met, runs = _ends(first, values, sd, starts, seed, None)
    return _assemble(batch, values, sd, batch.fit(np.asarray(best.u), values, sd, logarithms=False), met, runs, began)


def _table(problem: Problem, values: Any, sd: Any) -> tuple[Float[np.ndarray, "m n"], Float[np.ndarray, "m n"]]:
    """Values and sd as given, checked."""
    n = sum(d.geometry.size for d in problem.data)
    try:
        values = np.atleast_2d(np.asarray(values, dtype=float))
        sd = None if sd is None else np.asarray(sd, dtype=float)
    except (TypeError, ValueError):
        raise InputError("fit_many: values or sd hold something that is not a number, or rows of different lengths") from None
    if values.ndim != 2 or values.shape[1] != n or len(values) == 0:
        raise InputError(f"fit_many: values of shape {values.shape}; allowed is (sets, {n}), the values of all measurements of the problem a row")
    if not np.all(np.isfinite(values)):
        row, column = np.argwhere(~np.isfinite(values))[0].tolist()
        raise InputError(f"fit_many: value {column + 1} of set {row + 1} is {values[row, column]}; allowed are finite numbers", row=row)
    if sd is None and problem.estimates_noise:
        if np.any(values <= 0):
            row, column = np.argwhere(values <= 0)[0].tolist()
            given = f"value {column + 1} of set {row + 1} is {values[row, column]:g}"
            raise InputError(f"fit_many: {given} and has no sd; without sd allowed are values above 0", row=row)
        return values, values.copy()
    sd = np.concatenate([np.asarray(s) for s in problem.model.sd]) if sd is None else sd
    if sd.shape not in (values.shape, (n,)):
        raise InputError(f"fit_many: sd of shape {sd.shape} for values of shape {values.shape}; allowed is the same, or ({n},)")
    if not np.all((sd > 0) & np.isfinite(sd)):
        raise InputError("fit_many: an sd is not a finite number above 0")
    return values, np.broadcast_to(sd, values.shape).copy()


def _ends(
    batch: Batch,
    values: np.ndarray,
    sd: np.ndarray,
    starts: int,
    seed: int,
    on_sets: Callable[[int, int], None] | None,
    order: tuple[int, ...] = _ORDER,
    enough: int = _MET,
) -> tuple[Descent, np.ndarray, np.ndarray]:
    """The best end of each set, how many runs met in it, and how many were made; enough : runs that met, after which no more are made."""
    problem, sets = batch.problem, len(values)
    init = np.array([p.share(p.init) for p in problem.parameters])
    rounds = [sets // _FARTHER if place == _FARTHER else place for place in order]
    rounds = [place for place in rounds if place < sets - 1][: starts - 1]
    rounds += [_SPREAD] * (starts - 1 - len(rounds))
    ranks = sorted({place for place in rounds if place != _SPREAD})
    alike = dict(zip(ranks, _most_alike(values, sd, ranks).T, strict=True))
    spread = spread_shares(len(init), rounds.count(_SPREAD) + _ODD_RUNS, seed)
    taken = 0
    best = batch.fit(unbounded(np.tile(init, (sets, 1))), values, sd)
    met, runs = np.ones(sets, int), np.ones(sets, int)
    for number, place in enumerate([*rounds, *[_SPREAD] * _ODD_RUNS]):
        odd = _stand_out(_chi2(np.asarray(best.residual)))
        chosen = np.flatnonzero(odd if number >= len(rounds) else odd | (met < enough))
        if chosen.size == 0 or (number >= len(rounds) and starts == 1):
            continue
        if on_sets:
            on_sets(int(np.sum(runs)), int(np.sum(runs)) + chosen.size)
        if place == _SPREAD:
            share = np.tile(spread[taken], (chosen.size, 1))
            taken += 1
        else:
            ends = shares(problem.parameters, np.asarray(best.x))
            share = np.clip(ends[alike[place][chosen]], _EDGE, 1.0 - _EDGE)
        end = batch.fit(unbounded(share), values[chosen], sd[chosen], logarithms=place == _SPREAD)
        runs[chosen] += 1
        met, best = _merged(problem, met, best, chosen, end)
    return best, met, runs


def _stand_out(chi2: np.ndarray) -> np.ndarray:
    """Flags of sets whose sum of squares stands out from the others'."""
    if chi2.size < _FEW:
        return np.zeros(chi2.size, bool)
    middle = np.median(chi2)
    return chi2 > middle + _FAR * 1.4826 * np.median(np.abs(chi2 - middle))


def _most_alike(values: np.ndarray, sd: np.ndarray, ranks: list[int]) -> np.ndarray:
    """For each set others whose values are near in relative terms, weighted with its own noise (sets, ranks); rank 0 is the nearest."""
    positive = values > 0
    logs = np.log(np.where(positive, values, 1.0))
    weight = np.where(positive, values / sd, 0.0) ** 2
    nearest = np.empty((len(values), len(ranks)), int)
    for begin in range(0, len(values), 512) if ranks else ():
        w, own = weight[begin : begin + 512], logs[begin : begin + 512]
        far = w @ (logs**2).T - 2.0 * (w * own) @ logs.T
        rows = np.arange(len(own))
        far[rows, begin + rows] = np.inf
        nearest[begin : begin + 512] = np.argpartition(far, ranks, axis=1)[:, ranks]
    return nearest


def _merged(problem: Problem, met: np.ndarray, best: Descent, chosen: np.ndarray, end: Descent) -> tuple[np.ndarray, Descent]:
    """Runs counted that met in the best minimum of each set, and the best ends, after another run of those chosen."""
    parts = {name: np.array(getattr(best, name)) for name in ("u", "x", "first", "slope", "residual", "jacobian", "steps", "converged")}
    before, after = _chi2(parts["residual"][chosen]), _chi2(np.asarray(end.residual))
    variance = least_variance(problem, np.minimum(before, after))
    moved = np.einsum("mnp,mp->mn", parts["jacobian"][chosen], np.asarray(end.u) - parts["u"][chosen])
    gap = after - before
    same = (np.abs(gap) <= SAME * variance) & (np.sum(moved**2, axis=1) <= MOVED * variance)
    better = gap < 0
    met = met.copy()
    met[chosen] = np.where(same, met[chosen] + 1, np.where(better, 1, met[chosen]))
    for name, column in parts.items():
        column[chosen[better]] = np.asarray(getattr(end, name))[better]
    return met, Descent(**parts)


def _chi2(residual: np.ndarray) -> np.ndarray:
    chi2 = np.sum(residual**2, axis=-1)
    return np.where(np.isfinite(chi2), chi2, np.inf)


def _assemble(batch: Batch, values: np.ndarray, sd: np.ndarray, end: Descent, met: np.ndarray, runs: np.ndarray, began: float) -> ManyFits:
    problem = batch.problem
    variance = least_variance(problem, _chi2(np.asarray(end.residual)))
    chi2 = _chi2(np.asarray(end.residual)[:, : batch.count])
    jacobian = physical(np.asarray(end.jacobian), np.asarray(end.slope))

    def around(points: np.ndarray, owner: np.ndarray) -> np.ndarray:
        return batch.jacobians(points, values[owner], sd[owner])[1]

    known = covariances(problem.parameters, np.asarray(end.x), around, jacobian, np.asarray(end.residual), variance)
    lost = known.at_bound | ~np.isfinite(known.relative)
    outcome = np.where(np.isfinite(chi2), np.where(end.converged, Outcome.CONVERGED, Outcome.MAX_STEPS), Outcome.NOT_FINITE)
    return ManyFits(
        problem=problem,
        x=np.asarray(end.x),
        stderr=np.where(lost, np.nan, np.sqrt(np.diagonal(known.covariance, axis1=1, axis2=2))),
        covariance=known.covariance,
        relative=known.relative,
        at_bound=known.at_bound,
        determined=~known.at_bound & (known.relative <= UNDETERMINED),
        chi2=chi2 / variance,
        dof=values.shape[1] - len(problem.parameters),
        noise=np.sqrt(variance) if problem.estimates_noise else None,
        predictions=batch.predictions(np.asarray(end.residual), values, sd),
        outcome=tuple(Outcome(o) for o in outcome.tolist()),
        met=met,
        runs=runs,
        seconds=time.perf_counter() - began,
    )
