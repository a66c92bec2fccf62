"""Evenly lit samples in discrete ordinates: totals, and radiances at any angle."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..compilation import compiled
from ..measurement.geometry import Angular, Geometry, Total, TotalReflectance
from ..scene.columns import Columns
from ..solver import Domain, Evaluation, Forward
from .joint import joined
from .matrix import Matrix
from .ordinate_stack import Grid, Layout, coarsened, make_faces, make_grid, medium, pieces
from .response import Response, compose_all, reflection
from .single_scattering import missing_radiances

_ROUNDING = 1e-12
_CAUTION = 2.0  # the coarser rule may by chance lie closer than the error of the finer one
_AZIMUTHS = 128  # for the average over azimuth


class _Task(NamedTuple):
    """One geometry of a plan. above : of the sample or below; total : or radiances; net : first-surface reflection left out; beam : which of the
    plan's (None: diffuse light); averaged : over azimuth."""

    above: bool
    total: bool
    net: bool
    beam: int | None
    averaged: bool


class _Plan(eqx.Module):
    """Geometries that share directions, with all that does not depend on the free numbers of the stack.

    incidence, sights : sines of the beams and of the lines of sight. azimuths : one a geometry, 0 where it has none [rad]. optics : where it is the
    same for all stacks.
    """

    layout: Layout
    tasks: tuple[_Task, ...] = eqx.field(static=True)
    incidence: np.ndarray
    sights: np.ndarray
    azimuths: np.ndarray
    optics: tuple[Grid, tuple[Response[Matrix], ...]] | None

    @property
    def beams(self) -> int:
        return self.incidence.size


def evenly_lit_forward(domain: Domain, geometries: Sequence[Geometry], layouts: Sequence[Layout]) -> Forward:
    """Forward model of totals and angles, each with a layout of its own.

    Geometries with the same rule and the same lines of sight are solved together, those of all beams and those of diffuse light.
    """
    keys = [(layout, _directions(geometry)) for geometry, layout in zip(geometries, layouts, strict=True)]
    distinct = list(dict.fromkeys(keys))

    def make(i: int, places: tuple[int, ...]) -> Forward:
        layout = distinct[i][0]
        mine = [geometries[j] for j in places]
        return EvenlyLitForward(_plan(domain, mine, layout), _plan(domain, mine, coarsened(domain, layout)))

    return joined([distinct.index(key) for key in keys], make)


def _directions(geometry: Geometry) -> tuple[bool, tuple[str, bytes] | None]:
    """The same for geometries that are solved together: whether the light is diffuse; side and angles of the lines of sight."""
    assert isinstance(geometry, Total | Angular)
    sights = (geometry.side, np.asarray(geometry.angle).tobytes()) if isinstance(geometry, Angular) else None
    return geometry.incidence == "diffuse", sights


def _plan(domain: Domain, geometries: Sequence[Geometry], layout: Layout) -> _Plan:
    beams: dict[float, int] = {}  # by cosine of incidence
    tasks, azimuths, sights = [], [], np.zeros(0)
    for geometry in geometries:
        assert isinstance(geometry, Total | Angular)
        beam = None if geometry.incidence == "diffuse" else beams.setdefault(float(geometry.cosines()[0][0]), len(beams))
        azimuth = geometry.azimuth if isinstance(geometry, Angular) else None
        net = not (isinstance(geometry, TotalReflectance) and geometry.specular == "included")
        tasks.append(_Task(geometry.side == "above", isinstance(geometry, Total), net, beam, azimuth is None))
        azimuths.append(np.radians(azimuth or 0.0))
        if isinstance(geometry, Angular):
            sights = np.sin(np.radians(geometry.angle))
    plan = _Plan(layout, tuple(tasks), np.sqrt(1.0 - np.array(list(beams)) ** 2), sights, np.array(azimuths), None)
    return replace(plan, optics=_optics(plan, domain.low)) if domain.fixed_optics else plan


@compiled
def _optics(plan: _Plan, columns: Columns) -> tuple[Grid, tuple[Response[Matrix], ...]]:
    """Directions and interfaces."""
    n_out = columns.n_above if plan.tasks[0].above else columns.n_below
    grid = make_grid(plan.layout, columns, n_out * plan.sights, columns.n_above * plan.incidence)
    return grid, make_faces(columns, grid, plan.layout, plan.beams)


class EvenlyLitForward(Forward):
    """See `Forward`."""

    plan: _Plan
    coarser: _Plan

    def __call__(self, columns: Columns, shifts: Sequence[Float[Array, ""] | None] | None = None) -> tuple[Array, ...]:
        return _values(self.plan, columns)

    def run(self, columns: Columns) -> tuple[Array, ...]:
        return self(columns)

    def error(self, columns: Columns) -> tuple[np.ndarray | None, ...] | None:
        """Twice the difference to a rule of two thirds of the directions, and rounding."""
        return self.evaluate(columns).errors

    def evaluate(self, columns: Columns) -> Evaluation:
        fine, coarse = ([np.asarray(v) for v in _values(plan, columns)] for plan in (self.plan, self.coarser))
        return Evaluation(tuple(fine), tuple(_CAUTION * np.abs(a - b) + _ROUNDING for a, b in zip(fine, coarse, strict=True)))


@compiled
def _values(plan: _Plan, columns: Columns) -> tuple[Array, ...]:
    """One array a geometry."""
    grid, faces = _optics(plan, columns) if plan.optics is None else plan.optics
    parts = pieces(plan.layout, columns, medium(plan.layout, columns), grid, faces, plan.beams)
    sides = {task.above for task in plan.tasks}
    seen = {above: (reflection(parts) if above else compose_all(parts).T_down).value for above in sides}
    values = [_read(plan, task, azimuth, grid, seen[task.above], parts[0]) for task, azimuth in zip(plan.tasks, plan.azimuths, strict=True)]
    for averaged in (False, True):
        mine = tuple(i for i, task in enumerate(plan.tasks) if not task.total and task.beam is not None and task.averaged == averaged)
        if mine:
            lacking = _lacking(plan, columns, grid, faces, mine, averaged)
            for i, row in zip(mine, lacking.T, strict=True):
                values[i] = values[i] + row
    return tuple(values)


def _lacking(
    plan: _Plan, columns: Columns, grid: Grid, faces: tuple[Response[Matrix], ...], which: tuple[int, ...], averaged: bool
) -> Float[Array, "v t"]:
    """What the radiances of these geometries lack of light scattered once."""
    round_ = 2.0 * np.pi * (np.arange(_AZIMUTHS) + 0.5) / _AZIMUTHS
    azimuths = np.repeat(round_[:, None], len(which), axis=1) if averaged else plan.azimuths[None, list(which)]
    beams = tuple(beam for i in which if (beam := plan.tasks[i].beam) is not None)
    parts = missing_radiances(plan.layout, columns, medium(plan.layout, columns), grid, faces, plan.sights.size, beams, azimuths)
    above = plan.tasks[0].above
    operator = reflection(parts) if above else compose_all(parts).T_down
    return grid.rule.n[0 if above else -1] ** 2 * operator.source


def _read(plan: _Plan, task: _Task, azimuth: Array, grid: Grid, seen: Float[Array, "m c c"], top: Response[Matrix]) -> Float[Array, "values"]:
    """The values of one geometry from the operator of its side."""
    if task.above and task.net:
        seen = seen - top.R_above.value
    views, n = plan.sights.size, grid.root.shape[1]
    ordinates = slice(views, views + n)
    into, out = grid.root[0], grid.root[0 if task.above else -1]
    index = grid.rule.n[0 if task.above else -1]
    if task.beam is None:
        uniform = into / jnp.sum(into**2)  # of diffuse light of power 1; radiances have another 2 pi
        if task.total:
            return (out @ seen[0, ordinates, ordinates] @ uniform)[None]
        return index**2 / (2.0 * np.pi) * (seen[0, :views, ordinates] @ uniform + jnp.diagonal(seen[0, :views, :views]) / jnp.sum(into**2))
    beam = views + n + task.beam
    if task.total:
        return (out @ seen[0, ordinates, beam] + seen[0, beam, beam])[None]
    order = np.arange(seen.shape[0])
    if task.averaged:
        return index**2 / (2.0 * np.pi) * seen[0, :views, beam]
    factor = np.where(order == 0, 1.0, 2.0) * jnp.cos(order * azimuth) / (2.0 * np.pi)  # a beam of power 1 is the amplitude (2 - delta_m0)/(2 pi)
    return index**2 * jnp.tensordot(factor, seen[:, :views, beam], 1)
