"""The Monte Carlo behind the interface of the solvers: it predicts, with error bars, and cannot be fitted with."""

import math
from collections.abc import Sequence
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from . import montecarlo as mc
from .errors import InputError
from .measurement.geometry import Geometry
from .montecarlo_angles import lobe_width
from .montecarlo_reading import reading, runs
from .scene.columns import Columns, to_columns
from .scene.stack import Stack
from .solver import Domain, Evaluation, Forward, Solver

PHOTONS = 1_000_000
LEAST_PHOTONS = 100  # one a batch: with fewer batches the errors would not be known
_SECONDS_AFTER_INTERRUPTION = 2.0


class MonteCarlo(Solver):
    """Photons followed one by one (`layerfit.montecarlo`); the estimated error is one standard error.

    Arguments
    ---------
    photons : how many, at least 100, for each simulation: one for each kind of illumination among the measurements.
    seed : of the random numbers; the same seed gives the same values whatever the number of threads.
    threads : how many; by default the processors this process may use.
    progress : show a progress bar on standard error.

    Every layer that scatters needs its g. Sources: pencil, disk, gaussian. A distance without a ring or a detector radius is taken from two
    fibres of at most a tenth of the distance, and an angle from bins of a few degrees, so that the value is that at the point (see
    docs/monte-carlo.md). Where no photon was counted
    the error is what one photon would have added. Interrupted (Ctrl-C), it returns what is done, and says so. It has no derivatives: a fit
    with it is refused.

    Raises InputError for numbers out of range.

    >>> import layerfit as lf
    >>> slab = lf.Stack([lf.Layer("slab", sigma_a=0.1, sigma_s=0.9, g=0.75, n=1.0, thickness=2)])
    >>> total = lf.predict(slab, lf.TotalTransmittance(), solver=lf.MonteCarlo(photons=10_000, seed=1, threads=1))[0]
    >>> bool(abs(total.values[0] - 0.66096) <= 4 * total.estimated_error[0])
    True
    """

    name: ClassVar[str] = "monte-carlo"
    references: ClassVar[tuple[str, ...]] = (
        "Wang, Jacques and Zheng, Comput. Methods Programs Biomed. 47, 131 (1995)",
        "Heitz, Hanika, d'Eon and Dachsbacher, ACM Trans. Graph. 35, 58 (2016)",
    )
    photons: int = PHOTONS
    seed: int = 0
    threads: int | None = None
    progress: bool = False

    def __check_init__(self):
        _whole("photons", self.photons, LEAST_PHOTONS)
        _whole("seed", self.seed, 0)
        if self.seed >= 2**64:
            raise InputError(f"monte-carlo: seed = {self.seed!r}; allowed is a whole number below 2^64")
        if self.threads is not None:
            _whole("threads", self.threads, 1)

    def check(self, stack: Stack, geometry: Geometry) -> None:
        for layer in stack.layers:
            if layer.g is None and float(layer.sigma_s_prime) > 0.0:
                raise InputError(f"layer '{layer.name}' has no g, which solver monte-carlo needs; allowed is a g from -1 to below 1")
        medium(to_columns(stack))
        reading(geometry)

    def forward(self, domain: Domain, geometries: Sequence[Geometry], shifts: Sequence[tuple[float, float]]) -> Forward:
        return _Simulation(self, tuple(geometries))


class _Simulation(Forward):
    """Runs when it is called; the same seed each time."""

    differentiable: ClassVar[bool] = False
    solver: MonteCarlo
    geometries: tuple[Geometry, ...]

    def __call__(self, columns: Columns, shifts: Sequence[Float[Array, ""] | None] | None = None) -> tuple[Array, ...]:
        if shifts is not None and any(shift is not None for shift in shifts):
            raise InputError("monte-carlo: an offset of r is a free number of a fit, which this solver does not do")
        return tuple(jnp.asarray(v) for v in self.evaluate(columns).values)

    def error(self, columns: Columns) -> tuple[np.ndarray | None, ...] | None:
        return self.evaluate(columns).errors

    def evaluate(self, columns: Columns) -> Evaluation:
        found, note = estimates(self.solver, columns, self.geometries)
        return Evaluation(tuple(e.value for e in found), tuple(e.standard_error for e in found), (note,))


def estimates(solver: MonteCarlo, columns: Columns, geometries: Sequence[Geometry]) -> tuple[list[mc.Estimate], str]:
    """Every measurement with its errors and batches, and a sentence on the photons behind them.

    After an interruption what is left gets two seconds each, so that nothing is without a value.
    """
    sample = medium(columns)
    lobe = lobe_width(np.array([sample.n_above, *sample.n, sample.n_below])[: len(sample.roughness) + 1], np.array(sample.roughness))
    readings = [reading(geometry, lobe) for geometry in geometries]
    planned = runs(readings)
    found: dict[int, mc.Estimate] = {}
    interrupted, done = False, []
    for run in planned:
        result = mc.simulate(
            sample,
            run.light,
            run.tallies,
            photons=solver.photons,
            seed=int(solver.seed),
            threads=solver.threads,
            progress=solver.progress,
            max_seconds=_SECONDS_AFTER_INTERRUPTION if interrupted else None,
        )
        interrupted = interrupted or result.outcome == "interrupted"
        done.append(result.photons)
        found |= {i: readings[i].estimate(result) for i in run.members}
    counts = " and ".join(f"{count:,}" for count in dict.fromkeys(done))
    each = "" if len(planned) == 1 else f" for each of {len(planned)} simulations"
    if interrupted:
        note = f"monte-carlo was interrupted: {counts} of {int(solver.photons):,} photons{each}, seed {int(solver.seed)}"
    else:
        note = f"monte-carlo: {counts} photons{each}, seed {int(solver.seed)}; its error is one standard error"
    return [found[i] for i in range(len(readings))], note


def _whole(what: str, value: Any, least: int) -> None:
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not (number and math.isfinite(value) and value == int(value) and value >= least):
        raise InputError(f"monte-carlo: {what} = {value!r}; allowed is a whole number, at least {least}")


def medium(columns: Columns) -> mc.Medium:
    """A stack in the terms of the Monte Carlo. Raises InputError for what it does not simulate."""
    thickness = np.asarray(columns.thickness).tolist() + ([math.inf] if columns.half_space else [])
    g = np.asarray(columns.g)
    try:
        return mc.Medium(
            np.asarray(columns.n).tolist(),
            np.asarray(columns.sigma_a),
            np.asarray(columns.sigma_s_prime) / (1.0 - g),
            g,
            thickness,
            n_above=float(columns.n_above),
            n_below=float(columns.n_below),
            roughness=np.asarray(columns.roughness),
        )
    except ValueError as error:
        raise InputError(f"solver monte-carlo: {error}") from None


def with_run_settings(solver: Solver, *, photons: int | None, seed: int, progress: bool = False) -> Solver:
    """The solver with the settings of a command line. Raises InputError where photons are given to a solver that follows none."""
    if isinstance(solver, MonteCarlo):
        return MonteCarlo(solver.photons if photons is None else photons, seed, solver.threads, progress)
    if photons is not None:
        raise InputError(f"--photons has no meaning for solver {solver.name}; allowed with it is --solver monte-carlo")
    return solver
