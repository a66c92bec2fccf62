"""Several solvers for the measurements of one sample."""

from collections.abc import Sequence
from typing import Any, ClassVar, TypeVar

import equinox as eqx
import numpy as np
from jax import Array
from jaxtyping import Float

from ..errors import InputError
from ..measurement.geometry import Geometry
from ..scene.columns import Columns
from ..scene.stack import Stack
from ..solver import Domain, Evaluation, Forward, Solver

T = TypeVar("T")


class FirstAble(Solver):
    """Each measurement by the first of several solvers that can predict it: totals by transport theory beside R(r) by diffusion, in one fit.

    What solvers do not share - a bias of diffusion near the source, say - pulls a joint fit like any other disagreement among data: look at the
    residuals of each measurement.

    Arguments
    ---------
    solvers : in the order in which they are asked.

    Raises InputError without solvers, and where none can predict a measurement, with the reason of each.

    >>> import layerfit as lf
    >>> skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.01, sigma_s_prime=1, g=0.8, n=1.4)])
    >>> both = [lf.TotalReflectance(), lf.RadialReflectance(r=[2.0, 5.0])]
    >>> total, radial = lf.predict(skin, both, solver=lf.FirstAble(lf.DiscreteOrdinates(), lf.LayeredDiffusion()))
    >>> total.values.round(4), radial.values.round(5), total.notes, radial.notes
    (array([0.6039]), array([0.00915, 0.00137]), ('predicted by discrete-ordinates',), ('predicted by layered-diffusion',))
    """

    name: ClassVar[str] = "first-able"
    solvers: tuple[Solver, ...]

    def __init__(self, *solvers: Any):
        if not solvers or not all(isinstance(solver, Solver) for solver in solvers):
            raise InputError(f"FirstAble: {solvers!r} were given; allowed is one solver or more")
        self.solvers = solvers

    @property
    def references(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Of all solvers."""
        return tuple(dict.fromkeys(reference for solver in self.solvers for reference in solver.references))

    def __repr__(self) -> str:
        return f"FirstAble({', '.join(map(repr, self.solvers))})"

    def resolve(self, stack: Stack, geometries: Sequence[Geometry]) -> Solver:
        return FirstAble(*(solver.resolve(stack, geometries) for solver in self.solvers))

    def taken(self, stack: Stack, geometry: Geometry) -> Solver:
        """The solver that predicts a measurement."""
        reasons = []
        for solver in self.solvers:
            try:
                solver.check(stack, geometry)
            except InputError as error:
                reasons.append(str(error))
            else:
                return solver
        raise InputError("; ".join(dict.fromkeys(reasons)))

    def check(self, stack: Stack, geometry: Geometry) -> None:
        self.taken(stack, geometry)

    def notes(self, stack: Stack, geometry: Geometry) -> tuple[str, ...]:
        solver = self.taken(stack, geometry)
        return (f"predicted by {solver.name}", *solver.notes(stack, geometry))

    def forward(self, domain: Domain, geometries: Sequence[Geometry], shifts: Sequence[tuple[float, float]]) -> Forward:
        taken = [self.solvers.index(self.taken(domain.stack, geometry)) for geometry in geometries]
        parts, places = [], []
        for i in sorted(set(taken)):
            mine = tuple(j for j, solver in enumerate(taken) if solver == i)
            parts.append(self.solvers[i].forward(domain, [geometries[j] for j in mine], [shifts[j] for j in mine]))
            places.append(mine)
        return JointForward(tuple(parts), tuple(places))


class JointForward(Forward):
    """See `Forward`. places : which geometries each part predicts."""

    parts: tuple[Forward, ...]
    places: tuple[tuple[int, ...], ...] = eqx.field(static=True)

    @property
    def differentiable(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether all parts are."""
        return all(part.differentiable for part in self.parts)

    def __call__(self, columns: Columns, shifts: Sequence[Float[Array, ""] | None] | None = None) -> tuple[Array, ...]:
        return self._ordered([part(columns, shifts and [shifts[j] for j in mine]) for part, mine in zip(self.parts, self.places, strict=True)])

    def error(self, columns: Columns) -> tuple[np.ndarray | None, ...]:
        return self.evaluate(columns).errors

    def evaluate(self, columns: Columns) -> Evaluation:
        done = [part.evaluate(columns) for part in self.parts]
        notes = tuple(note for one in done for note in one.notes)
        return Evaluation(self._ordered([one.values for one in done]), self._ordered([one.errors for one in done]), notes)

    def _ordered(self, rows: Sequence[Sequence[T]]) -> tuple[T, ...]:
        """What each part gives for its geometries, in the order of all."""
        found = {j: value for mine, row in zip(self.places, rows, strict=True) for j, value in zip(mine, row, strict=True)}
        return tuple(found[j] for j in range(len(found)))
