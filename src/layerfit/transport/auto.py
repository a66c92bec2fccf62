"""Choosing a solver."""

import time
from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import numpy as np

from ..errors import InputError
from ..measurement.geometry import Geometry
from ..scene.columns import to_columns
from ..scene.stack import Stack
from ..solver import Choice, Domain, Forward, Solver
from .diffusion_error import known_error
from .discrete_ordinates import DiscreteOrdinates
from .layered_diffusion import LayeredDiffusion

TOLERANCE = 0.01


class Candidate(NamedTuple):
    """A rung of the ladder tried on a scene. error : largest stated relative error of all values. seconds : of a warm prediction, None if not run."""

    solver: Solver
    error: float
    seconds: float | None


class Auto(Solver):
    """The cheapest solver whose stated error is small enough: diffusion where it is known to hold, else discrete ordinates, coarse before fine.

    In a fit the data say how small; the choice is made at the start and looked at again at the result.

    Arguments
    ---------
    tolerance : largest relative error of any value [1]. Left out: a third of what the data resolve, 1 % without data.

    Raises InputError for a tolerance that is not above 0.

    >>> import layerfit as lf
    >>> deep = lf.Stack([lf.HalfSpace("deep", sigma_a=0.01, sigma_s_prime=1, g=0.8, n=1.4)])
    >>> lf.predict(deep, lf.RadialReflectance(r=[10.0]), solver=lf.Auto(tolerance=0.1))[0].solver.name
    'layered-diffusion'
    """

    name: ClassVar[str] = "auto"
    tolerance: float | None = eqx.field(default=None, static=True)

    def __check_init__(self):
        if self.tolerance is not None and not (isinstance(self.tolerance, int | float) and 0.0 < self.tolerance < np.inf):
            raise InputError(f"Auto: tolerance = {self.tolerance!r}; allowed is a number above 0")

    @staticmethod
    def ladder() -> tuple[Solver, ...]:
        """Solvers from the cheapest to the best."""
        return (
            LayeredDiffusion(),
            DiscreteOrdinates(streams=12, orders=4, frequencies=16),
            DiscreteOrdinates(),
            DiscreteOrdinates(streams=40, orders=7, frequencies=64),
        )

    def check(self, stack: Stack, geometry: Geometry) -> None:
        refusals = [solver.refusal(stack, [geometry]) for solver in (DiscreteOrdinates(), LayeredDiffusion())]
        if None not in refusals:
            raise InputError("; ".join(dict.fromkeys(filter(None, refusals))))

    def choose(self, stack: Stack, geometries: Sequence[Geometry], resolution: float | None = None) -> Choice:
        for geometry in geometries:
            self.check(stack, geometry)
        found = self._from(0, stack, geometries, self.allowed(resolution))
        if found is None:
            reasons = dict.fromkeys(solver.refusal(stack, geometries) for solver in self.ladder())
            raise InputError(f"no solver can predict all measurements together: {'; '.join(filter(None, reasons))}; lf.FirstAble takes one for each")
        return found

    def choose_again(self, before: Choice, stack: Stack, geometries: Sequence[Geometry], resolution: float | None = None) -> Choice | None:
        if candidate(before.solver, stack, geometries).error <= self.allowed(resolution):
            return None
        return self._from(before.rung + 1, stack, geometries, self.allowed(resolution))

    def allowed(self, resolution: float | None) -> float:
        """Largest relative error that may remain."""
        return self.tolerance or (TOLERANCE if resolution is None else resolution / 3.0)

    def _from(self, lowest: int, stack: Stack, geometries: Sequence[Geometry], allowed: float) -> Choice | None:
        """The first rung from ``lowest`` on that will do, else the best there is; None where no such rung can do the scene."""
        tried: list[tuple[int, Candidate]] = []
        refused = ""
        for rung, solver in list(enumerate(self.ladder()))[lowest:]:
            refusal = solver.refusal(stack, geometries)
            if refusal is not None:
                refused = refusal
                continue
            tried.append((rung, candidate(solver, stack, geometries)))
            if tried[-1][1].error <= allowed:
                break
        if not tried:
            return None
        rung, taken = min(tried, key=lambda pair: pair[1].error) if not tried[-1][1].error <= allowed else tried[-1]
        return Choice(taken.solver, (_why(taken, [one for _, one in tried if one is not taken], allowed, refused),), rung)

    def forward(self, domain: Domain, geometries: Sequence[Geometry], shifts: Sequence[tuple[float, float]]) -> Forward:
        return self.choose(domain.stack, geometries).solver.forward(domain, geometries, shifts)


def candidate(solver: Solver, stack: Stack, geometries: Sequence[Geometry]) -> Candidate:
    """A solver tried on a scene: diffusion by what is known of it, others by running them."""
    columns = to_columns(stack)
    if isinstance(solver, LayeredDiffusion):
        return Candidate(solver, _largest([known_error(columns, geometry) for geometry in geometries]), None)
    forward = solver.forward(Domain(stack, columns, columns), geometries, [(0.0, 0.0)] * len(geometries))
    found = forward.evaluate(columns)
    pairs = zip(found.values, found.errors, strict=True)
    shares = [np.full(v.size, np.inf) if e is None else np.abs(e) / np.maximum(np.abs(v), 1e-300) for v, e in pairs]
    start = time.perf_counter()
    jax.block_until_ready(forward.run(columns))
    return Candidate(solver, _largest(shares), time.perf_counter() - start)


def _largest(shares: Sequence[np.ndarray]) -> float:
    """The largest relative error; one that is no number counts as infinite."""
    return float(np.max(np.nan_to_num(np.concatenate(shares), nan=np.inf, posinf=np.inf)))


def _why(taken: Candidate, passed_over: list[Candidate], allowed: float, refused: str) -> str:
    """The choice in words."""
    cost = "" if taken.seconds is None else f", {1e3 * taken.seconds:.2g} ms a prediction"
    said = f"solver auto took {taken.solver.label}: stated error at most {100 * taken.error:.2g} %, {100 * allowed:.2g} % allowed{cost}"
    said += "".join(f"; {one.solver.label} is off by {100 * one.error:.2g} %" for one in passed_over[:1])
    if not taken.error <= allowed:
        said += "; nothing better is there than this" + (f" ({refused})" if refused else "")
    return said
