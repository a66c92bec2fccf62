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
from ..solver import Choice, Domain, Forward, Resolution, Solver, relative_errors
from .diffusion_error import known_error
from .discrete_ordinates import DiscreteOrdinates
from .layered_diffusion import LayeredDiffusion
from .upper_layers import visible_layers

TOLERANCE = 0.01
_UNSEEN = 0.1  # share of the error allowed that layers may have which are left out


class Candidate(NamedTuple):
    """A rung of the ladder tried on a scene.

    errors : relative error of all values one after another, infinite where unknown. values : None where not run. seconds : of a warm prediction.
    checked : the solver whose values gave the errors, where they are not its own statement.
    """

    solver: Solver
    errors: np.ndarray
    values: np.ndarray | None = None
    seconds: float | None = None
    checked: Solver | None = None

    def excess(self, allowed: np.ndarray | float) -> float:
        """Largest error in units of what is allowed."""
        return float(np.max(self.errors / allowed))


class Auto(Solver):
    """The cheapest solver whose error is small enough: diffusion where it is known to hold, else discrete ordinates, coarse before fine.

    A solver is good enough by its own statement, or where the next finer one, which is off itself, differs by no more than leaves room for that. In a
    fit the data say how much is allowed, value by value; the choice is made at the start and looked at again at the result.

    Arguments
    ---------
    tolerance : largest relative error of any value [1]. Left out: a third of each value's sd, 1 % without data.

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

    def choose(self, stack: Stack, geometries: Sequence[Geometry], resolution: Resolution | None = None, domain: Domain | None = None) -> Choice:
        for geometry in geometries:
            self.check(stack, geometry)
        found = self._from(0, stack, geometries, self.allowed(resolution))
        if found is None:
            reasons = dict.fromkeys(solver.refusal(stack, geometries) for solver in self.ladder())
            raise InputError(f"no solver can predict all measurements together: {'; '.join(filter(None, reasons))}; lf.FirstAble takes one for each")
        return found if domain is None else _without_the_unseen(found, domain, geometries, self.allowed(resolution))

    def choose_again(self, before: Choice, stack: Stack, geometries: Sequence[Geometry], resolution: Resolution | None = None) -> Choice | None:
        allowed = self.allowed(resolution)
        if candidate(before.solver, stack, geometries).excess(allowed) <= 1.0:
            return None
        found = self._from(before.rung, stack, geometries, allowed)
        if found is None or found.rung <= before.rung:
            return None
        kept = before.solver.layers if isinstance(before.solver, DiscreteOrdinates) else None
        return found._replace(solver=found.solver.with_layers(kept)) if isinstance(found.solver, DiscreteOrdinates) else found

    def allowed(self, resolution: Resolution | None) -> np.ndarray | float:
        """Largest relative error that may remain in each value."""
        if self.tolerance is not None or resolution is None:
            return self.tolerance or TOLERANCE
        return np.maximum(np.concatenate(resolution) / 3.0, 1e-300)

    def _from(self, lowest: int, stack: Stack, geometries: Sequence[Geometry], allowed: np.ndarray | float) -> Choice | None:
        """The first rung from ``lowest`` on that will do, else the best there is; None where no such rung can do the scene.

        A rung will do by its own statement, or where the next one shows that it is good enough.
        """
        tried: list[tuple[int, Candidate]] = []
        refused = ""
        for rung, solver in list(enumerate(self.ladder()))[lowest:]:
            refusal = solver.refusal(stack, geometries)
            if refusal is not None:
                refused = refusal
                continue
            tried.append((rung, candidate(solver, stack, geometries)))
            if len(tried) > 1 and (shown := _shown(tried[-2][1], tried[-1][1])).excess(allowed) <= 1.0:
                tried = [*tried[:-2], (tried[-2][0], shown)]
            if tried[-1][1].excess(allowed) <= 1.0:
                break
        if not tried:
            return None
        rung, taken = tried[-1] if tried[-1][1].excess(allowed) <= 1.0 else min(tried, key=lambda pair: float(np.median(pair[1].errors)))
        return Choice(taken.solver, (_why(taken, [one for _, one in tried if one is not taken], allowed, refused),), rung)

    def forward(self, domain: Domain, geometries: Sequence[Geometry], shifts: Sequence[tuple[float, float]]) -> Forward:
        return self.choose(domain.stack, geometries).solver.forward(domain, geometries, shifts)


def _without_the_unseen(choice: Choice, domain: Domain, geometries: Sequence[Geometry], allowed: np.ndarray | float) -> Choice:
    """The same without layers that no value depends on, in any stack of the domain. Diffusion is quick with them."""
    if not isinstance(choice.solver, DiscreteOrdinates):
        return choice
    count = visible_layers(domain, geometries, _UNSEEN * allowed)
    if count == len(domain.stack.layers):
        return choice
    names = [f"'{layer.name}'" for layer in domain.stack.layers]
    below = f"{', '.join(names[count:])} {'is' if count == len(names) - 1 else 'are'}"
    said = f"{below} not seen (less than a tenth of the error allowed in any value) and taken as more of {names[count - 1]}"
    return Choice(choice.solver.with_layers(count), (*choice.notes, said), choice.rung)


def candidate(solver: Solver, stack: Stack, geometries: Sequence[Geometry]) -> Candidate:
    """A solver tried on a scene: diffusion by what is known of it, others by running them."""
    columns = to_columns(stack)
    if isinstance(solver, LayeredDiffusion):
        known = np.concatenate([known_error(columns, geometry) for geometry in geometries])
        return Candidate(solver, np.nan_to_num(known, nan=np.inf, posinf=np.inf))
    forward = solver.forward(Domain(stack, columns, columns), geometries, [(0.0, 0.0)] * len(geometries))
    found = forward.evaluate(columns)
    values = np.concatenate(found.values)
    errors = np.concatenate([np.full(v.size, np.inf) if e is None else e for v, e in zip(found.values, found.errors, strict=True)])
    start = time.perf_counter()
    jax.block_until_ready(forward.run(columns))
    return Candidate(solver, relative_errors(errors, values), values, time.perf_counter() - start)


def _shown(rung: Candidate, better: Candidate) -> Candidate:
    """A rung with its errors as the next one shows them: the difference, and what that one is off by its own statement, at most as much again."""
    if rung.values is None or better.values is None:
        return rung
    apart = relative_errors(rung.values - better.values, better.values)
    return rung._replace(errors=apart + np.minimum(apart, better.errors), checked=better.solver)


def _why(taken: Candidate, passed_over: list[Candidate], allowed: np.ndarray | float, refused: str) -> str:
    """The choice in words."""
    cost = "" if taken.seconds is None else f", {1e3 * taken.seconds:.2g} ms a prediction"
    limit = "at most a third of the data's sd" if isinstance(allowed, np.ndarray) else f"{100 * allowed:.2g} %"
    at = int(np.argmax(taken.errors / allowed))
    source = "stated error" if taken.checked is None else f"error against {taken.checked.label}"
    said = f"solver auto took {taken.solver.label}: {source} at most {100 * taken.errors[at]:.2g} %, {limit} allowed{cost}"
    said += "".join(f"; {one.solver.label} is off by {100 * np.max(one.errors):.2g} %" for one in passed_over[:1])
    if not taken.excess(allowed) <= 1.0:
        said += f"; median {100 * np.median(taken.errors):.2g} %; nothing better is there than this" + (f" ({refused})" if refused else "")
    return said
