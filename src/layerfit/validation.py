"""A solver held against the Monte Carlo, value by value."""

import enum
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np

from . import montecarlo as mc
from .errors import InputError
from .measurement.geometry import Geometry
from .montecarlo_solver import PHOTONS, MonteCarlo, estimates
from .predict import predict
from .scene.columns import to_columns
from .scene.stack import Stack
from .solver import Solver
from .transport.auto import Auto

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

LEVEL = 0.01
CAREFUL, TIMES = 0.05, 10.0  # a stated error above 5 % of the value and 10 times the true one is overstated
_LIMIT, _POWER = 0.05, 0.95


class Verdict(enum.Enum):
    """How a validation ended."""

    AGREE = "agree"
    DISAGREE = "disagree"
    OVERSTATED = "overstated error"
    UNDECIDED = "undecided"


class Check(eqx.Module):
    """One measurement: a solver's values beside those of the Monte Carlo. Arrays have one entry a value.

    values, stated_error : of the solver; the error is None where it states none.
    reference, standard_error : of the Monte Carlo. allowed : the difference that chance may make, at the level of one value.
    z : (values - reference)/standard_error. p : two-sided probability of so large a difference beyond the stated error; nan if not judged.
    noticeable : relative deviation beyond the stated error that would have been noticed with 95 % probability; nan if not judged.
    beyond : differs by more than the stated error. overstated : the stated error is above 5 % and ten times the true one.
    judged : whether enough photons were counted.
    """

    name: str
    geometry: Geometry
    values: np.ndarray
    stated_error: np.ndarray | None
    reference: np.ndarray
    standard_error: np.ndarray
    allowed: np.ndarray
    z: np.ndarray
    p: np.ndarray
    noticeable: np.ndarray
    judged: np.ndarray
    beyond: np.ndarray
    overstated: np.ndarray

    @property
    def ratio(self) -> np.ndarray:
        """values/reference; nan where the reference is 0."""
        return self.values / np.where(self.reference != 0.0, self.reference, np.nan)


class Validation(eqx.Module):
    """A solver against the Monte Carlo on some measurements of one stack; from `validate`.

    checks : one a measurement. solver, judge : the two. level : probability that anything is called a difference if there is none.
    notes : what to keep in mind.
    """

    stack: Stack
    solver: Solver
    judge: MonteCarlo
    checks: tuple[Check, ...]
    level: float
    notes: tuple[str, ...] = eqx.field(static=True)

    @property
    def noticeable(self) -> float:
        """Median over all judged values of the relative deviation that would have been noticed; inf if none was judged."""
        judged = np.concatenate([check.noticeable[check.judged] for check in self.checks])
        return float(np.median(judged)) if judged.size else float("inf")

    @property
    def verdict(self) -> Verdict:
        """Disagreement before an overstated error, and both before too few photons to notice 5 %."""
        if any(np.any(check.beyond) for check in self.checks):
            return Verdict.DISAGREE
        if any(np.any(check.overstated) for check in self.checks):
            return Verdict.OVERSTATED
        return Verdict.AGREE if self.noticeable <= _LIMIT else Verdict.UNDECIDED

    def table(self) -> list[dict[str, Any]]:
        """One row a value: where, both values, both errors, relative deviation, z-score and what is wrong."""
        from .report.validation_table import validation_rows

        return validation_rows(self)

    def summary(self) -> str:
        """The result as plain text."""
        from .report.validation_table import validation_text

        return validation_text(self)

    def plot(self) -> "Figure":
        """Ratio of the solver to the Monte Carlo with error bands, as a matplotlib figure."""
        from .report.validation_plot import plot_validation

        return plot_validation(self)

    def save(self, folder: Any) -> "dict[str, Path]":
        """Write validation.json, validation.txt and validation.svg into a folder; returns their paths by name."""
        from .report.validation_archive import save_validation

        return save_validation(self, folder)

    def __repr__(self) -> str:
        return self.summary()


def validate(
    stack: Stack,
    geometries: Geometry | Sequence[Geometry],
    *,
    solver: Solver | None = None,
    photons: int = PHOTONS,
    seed: int = 0,
    threads: int | None = None,
    level: float = LEVEL,
    names: Sequence[str] | None = None,
    progress: bool = False,
) -> Validation:
    """Hold a solver against the Monte Carlo.

    A value disagrees where it differs from the Monte Carlo by more than the solver's stated error, and that difference is more than chance
    gives: Student's t, with `level` shared out among all values (Sidak). A solver that states no error is taken at its word: any difference
    beyond chance counts. The stated error is overstated where it is above 5 % of the value and 10 times the true one; the true one is the
    largest at the value and its neighbours, because a deviation that changes sign is small by chance somewhere, with what the Monte Carlo
    cannot resolve added.

    Arguments
    ---------
    stack : the sample; every layer that scatters needs its g. geometries : what is measured.
    solver : by default Auto. photons, seed, threads, progress : of the Monte Carlo, see `MonteCarlo`.
    level : probability of a false "disagree" for the whole validation.
    names : of the measurements, for table and figure.

    Raises InputError where the solver or the Monte Carlo cannot do the scene, or where the solver is the Monte Carlo itself.

    >>> import layerfit as lf
    >>> slab = lf.Stack([lf.Layer("slab", sigma_a=0.01, sigma_s_prime=1, g=0.5, n=1.4, thickness=5)])
    >>> found = lf.validate(slab, lf.TotalTransmittance(), solver=lf.LayeredDiffusion(), photons=10_000, threads=1)
    >>> found.checks[0].ratio.round(1)
    array([1.])
    """
    geometries = [geometries] if isinstance(geometries, Geometry) else list(geometries)
    if not 0.0 < level < 1.0:
        raise InputError(f"validate: level = {level!r}; allowed is a number between 0 and 1")
    names = _default_names(geometries) if names is None else list(names)
    if len(names) != len(geometries):
        raise InputError(f"validate: {len(names)} names for {len(geometries)} geometries; allowed is one each")
    judge = MonteCarlo(photons, seed, threads, progress)
    solver = Auto() if solver is None else solver
    check(stack, geometries, solver)
    predictions = predict(stack, geometries, solver=solver)
    found, note = estimates(judge, to_columns(stack), geometries)
    count = sum(geometry.size for geometry in geometries)
    bin_level = float(-np.expm1(np.log1p(-level) / count))
    checks = tuple(
        _check(name, predicted.geometry, predicted.values, predicted.estimated_error, estimate, bin_level)
        for name, predicted, estimate in zip(names, predictions, found, strict=True)
    )
    chosen = predictions[0].solver
    notes = [note, *(said for p in predictions for said in p.notes)]
    if any(p.estimated_error is None for p in predictions):
        notes.append(f"solver {chosen.name} states no error here: any difference beyond chance counts as disagreement")
    return Validation(stack, chosen, judge, checks, level, tuple(dict.fromkeys(notes)))


def check(stack: Stack, geometries: Sequence[Geometry], solver: Solver) -> None:
    """Raise InputError where the solver or the Monte Carlo cannot do the scene, or where they are one."""
    if isinstance(solver, MonteCarlo):
        raise InputError("validate: solver monte-carlo is the judge and cannot judge itself; allowed are the other solvers")
    for geometry in geometries:
        MonteCarlo().check(stack, geometry)
        solver.check(stack, geometry)


def _default_names(geometries: Sequence[Geometry]) -> list[str]:
    kinds = [geometry.kind for geometry in geometries]
    return [kind if kinds.count(kind) == 1 else f"{kind} {kinds[: i + 1].count(kind)}" for i, kind in enumerate(kinds)]


def _check(name: str, geometry: Geometry, values: np.ndarray, stated: np.ndarray | None, estimate: mc.Estimate, level: float) -> Check:
    """One measurement, each value at `level`."""
    reference, error = np.asarray(estimate.value), np.asarray(estimate.standard_error)
    granted = np.zeros_like(values) if stated is None else np.where(stated >= 0.0, stated, 0.0)  # an error that is no number grants nothing
    deviation = values - reference
    excess = np.sign(deviation) * np.maximum(np.abs(deviation) - granted, 0.0)
    compared = mc.compare(estimate, reference + excess, level=level, power=_POWER)
    p = np.where(compared.judged, compared.p, np.nan)
    beyond = compared.judged & ~(p >= level)  # so that NaN does not pass
    beyond[compared.mismatched] = True
    margin = _quantile(estimate.dof, level) * error
    largest = _with_neighbours(np.abs(deviation) + margin)
    overstated = compared.judged & (granted > CAREFUL * np.abs(values)) & (granted > TIMES * largest)
    z = np.divide(deviation, error, out=np.zeros_like(deviation), where=error > 0.0)
    noticeable = np.where(compared.judged, _noticeable(estimate, reference, level), np.nan)
    return Check(name, geometry, values, stated, reference, error, margin, z, p, noticeable, compared.judged, beyond, overstated & ~beyond)


def _quantile(dof: float, level: float) -> float:
    """Student's t that is exceeded, in absolute value, with probability `level`."""
    from scipy import special

    return float(-special.stdtrit(dof, 0.5 * level))


def _noticeable(estimate: mc.Estimate, reference: np.ndarray, level: float) -> np.ndarray:
    """Relative deviation of a value that would have been noticed with probability `_POWER`."""
    from scipy import special

    steps = _quantile(estimate.dof, level) + float(special.stdtrit(estimate.dof, _POWER))
    return steps * estimate.standard_error / np.where(reference != 0.0, np.abs(reference), np.nan)


def _with_neighbours(error: np.ndarray) -> np.ndarray:
    """The largest of each value and the ones beside it."""
    padded = np.pad(error, 1, mode="edge")
    return np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
