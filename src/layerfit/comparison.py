"""All solvers on one scene: how long each takes, and how wrong each is."""

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from .measurement.geometry import Geometry
from .montecarlo_solver import MonteCarlo
from .scene.columns import to_columns
from .scene.stack import Stack
from .solver import Domain, Solver
from .transport.auto import Auto
from .transport.multipole import Dipole, Multipole

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

_REPEATS = 5


class Row(eqx.Module):
    """One solver.

    first, warm : seconds of the first prediction with compilation and stated error, and of a later one without. errors : relative to the reference,
    all values after one another. stated : those that it states itself, None where it states none. refused : why it cannot do the scene, else None.
    """

    solver: Solver
    first: float | None
    warm: float | None
    errors: np.ndarray | None
    stated: np.ndarray | None
    refused: str | None = eqx.field(static=True)

    @property
    def label(self) -> str:
        """See `Solver`."""
        return self.solver.label


class Comparison(eqx.Module):
    """Solvers side by side; from `compare`.

    reference : the solver that the errors are taken against, with its relative error (one standard error of a Monte Carlo). chosen : number of the
    row that Auto takes, None where it is not among them. why : its reasons.
    """

    stack: Stack
    rows: tuple[Row, ...]
    reference: str = eqx.field(static=True)
    reference_error: np.ndarray
    chosen: int | None = eqx.field(static=True)
    why: tuple[str, ...] = eqx.field(static=True)

    def table(self) -> list[dict[str, Any]]:
        """One row a solver, plain numbers, null where there is none."""
        from .report.comparison_table import comparison_rows

        return comparison_rows(self)

    def summary(self) -> str:
        """The comparison as plain text."""
        from .report.comparison_table import comparison_text

        return comparison_text(self)

    def plot(self) -> "Figure":
        """Time against error, as a matplotlib figure."""
        from .report.comparison_plot import plot_comparison

        return plot_comparison(self)

    def save(self, folder: Any) -> "dict[str, Path]":
        """Write comparison.json, comparison.txt and comparison.svg into a folder; returns their paths by name."""
        from .report.comparison_archive import save_comparison

        return save_comparison(self, folder)

    def __repr__(self) -> str:
        return self.summary()


def compare(
    stack: Stack,
    geometries: Geometry | Sequence[Geometry],
    *,
    tolerance: float | None = None,
    photons: int | None = None,
    seed: int = 0,
    progress: bool = False,
) -> Comparison:
    """Every solver on one scene: time, and error against the best of them, or against a Monte Carlo.

    Arguments
    ---------
    tolerance : of Auto. photons, seed, progress : of the Monte Carlo; without photons the highest rung of Auto's ladder is the reference.

    Raises InputError where no solver can do the scene.

    >>> import layerfit as lf
    >>> slab = lf.Stack([lf.Layer("slab", sigma_a=0.01, sigma_s_prime=1, n=1.4, thickness=5)])
    >>> found = lf.compare(slab, lf.TotalTransmittance())
    >>> [row.label for row in found.rows if row.refused is None], found.reference
    (['multipole', 'layered-diffusion'], 'layered-diffusion')
    """
    geometries = [geometries] if isinstance(geometries, Geometry) else list(geometries)
    auto, solvers = Auto(tolerance), (Dipole(), Multipole(), *Auto.ladder())
    for geometry in geometries:
        auto.check(stack, geometry)
    tried = [_tried(solver, stack, geometries) for solver in solvers]
    best, name = next((one, solver.label) for solver, one in zip(reversed(solvers), reversed(tried), strict=True) if isinstance(one, Run))
    if photons is not None:
        judge = MonteCarlo(photons, seed, None, progress)
        for geometry in geometries:
            judge.check(stack, geometry)
        best, name = timed_run(judge, stack, geometries, repeats=0), judge.name
    size = np.maximum(np.abs(best.values), 1e-300)
    choice = auto.choose(stack, geometries)
    rows = []
    for solver, one in zip(solvers, tried, strict=True):
        if isinstance(one, str):
            rows.append(Row(solver, None, None, None, None, one))
        else:
            stated = None if one.stated is None else one.stated / size
            rows.append(Row(solver, one.first, one.warm, np.abs(one.values - best.values) / size, stated, None))
    chosen = next((i for i, row in enumerate(rows) if repr(row.solver) == repr(choice.solver)), None)
    error = np.full(size.size, np.nan) if best.stated is None else best.stated / size
    return Comparison(stack, tuple(rows), name, error, chosen, choice.notes)


class Run(NamedTuple):
    """Values and absolute errors (None: not stated) of all geometries one after another, and seconds: the first call with its error, a later one."""

    values: np.ndarray
    stated: np.ndarray | None
    first: float
    warm: float


def _tried(solver: Solver, stack: Stack, geometries: Sequence[Geometry]) -> Run | str:
    """A solver's values and times, or why it refuses."""
    return solver.refusal(stack, geometries) or timed_run(solver, stack, geometries)


def timed_run(solver: Solver, stack: Stack, geometries: Sequence[Geometry], *, repeats: int = _REPEATS) -> Run:
    """A solver's values and times on a scene that it can do."""
    columns = to_columns(stack)
    start = time.perf_counter()
    forward = solver.forward(Domain(stack, columns, columns), geometries, [(0.0, 0.0)] * len(geometries))
    found = forward.evaluate(columns)
    first = warm = time.perf_counter() - start
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(forward.run(columns))
        times.append(time.perf_counter() - start)
    if times:
        warm = float(np.median(times))
    errors = [error for error in found.errors if error is not None]
    stated = np.concatenate(errors) if len(errors) == len(found.errors) else None
    return Run(np.concatenate(found.values), stated, first, warm)
