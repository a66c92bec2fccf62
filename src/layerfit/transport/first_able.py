"""Several solvers for the measurements of one sample."""

from collections.abc import Sequence
from typing import Any, ClassVar

from ..errors import InputError
from ..measurement.geometry import Geometry
from ..scene.stack import Stack
from ..solver import Choice, Domain, Forward, Resolution, Solver
from .auto import Auto
from .joint import joined


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
    >>> both = [lf.RadialReflectance(r=[2.0, 5.0]), lf.AngularReflectance([30.0])]
    >>> radial, angular = lf.predict(skin, both, solver=lf.FirstAble(lf.LayeredDiffusion(), lf.DiscreteOrdinates()))
    >>> radial.values.round(5), angular.values.round(3), radial.notes, angular.notes
    (array([0.00915, 0.00137]), array([0.201]), ('predicted by layered-diffusion',), ('predicted by discrete-ordinates',))
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

    def choose(self, stack: Stack, geometries: Sequence[Geometry], resolution: Resolution | None = None, domain: Domain | None = None) -> Choice:
        if not any(isinstance(solver, Auto) for solver in self.solvers):
            return Choice(self, ())
        taken = [self.solvers.index(self.taken(stack, geometry)) for geometry in geometries]
        choices = []
        for i, solver in enumerate(self.solvers):
            mine = [j for j, number in enumerate(taken) if number == i]
            resolved = None if resolution is None else [resolution[j] for j in mine]
            choices.append(solver.choose(stack, [geometries[j] for j in mine], resolved, domain) if mine else Choice(solver, ()))
        return Choice(FirstAble(*(choice.solver for choice in choices)), tuple(note for choice in choices for note in choice.notes))

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
        return joined(taken, lambda i, chosen: self.solvers[i].forward(domain, [geometries[j] for j in chosen], [shifts[j] for j in chosen]))
