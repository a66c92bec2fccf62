"""Choosing a solver."""

from collections.abc import Sequence
from typing import ClassVar

from ..measurement.geometry import Geometry
from ..scene.stack import Stack
from ..solver import Domain, Forward, Solver
from .layered_diffusion import LayeredDiffusion


class Auto(Solver):
    """The cheapest solver whose error is small enough. In this version it knows one rung, LayeredDiffusion, and says so."""

    name: ClassVar[str] = "auto"

    def resolve(self, stack: Stack, geometries: Sequence[Geometry]) -> Solver:
        return LayeredDiffusion()

    def check(self, stack: Stack, geometry: Geometry) -> None:
        self.resolve(stack, [geometry]).check(stack, geometry)

    def notes(self, stack: Stack, geometry: Geometry) -> tuple[str, ...]:
        said = "solver auto: layered-diffusion was taken; this version does not choose among solvers yet"
        return (said, *self.resolve(stack, [geometry]).notes(stack, geometry))

    def forward(self, domain: Domain, geometries: Sequence[Geometry], shifts: Sequence[tuple[float, float]]) -> Forward:
        return self.resolve(domain.stack, geometries).forward(domain, geometries, shifts)
