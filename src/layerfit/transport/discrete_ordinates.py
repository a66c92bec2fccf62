"""Discrete ordinates: radiative transport in any number of layers, exact in angle."""

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer
from jaxtyping import Float

from ..errors import InputError
from ..measurement.geometry import Angular, Geometry, Total, TotalReflectance
from ..scene.columns import Columns
from ..scene.stack import Stack
from ..solver import Domain, Evaluation, Forward, Solver
from .fineness import coarser, fineness
from .joint import joined
from .matrix import Matrix
from .ordinate_profiles import profiles_forward
from .ordinate_stack import Grid, Layout, beam_sines, coarsened, lay_out, make_faces, make_grid, media, medium, pieces
from .response import Response, compose_all, reflection
from .single_scattering import correction
from .upper_layers import UpperLayersForward, upper_domain


class DiscreteOrdinates(Solver):
    """Radiative transport by discrete ordinates: totals, angular distributions, and light that walks sideways, of any stack of layers.

    Exact at albedo 1 and for any thickness; layers may differ in index, be clear, thin or strongly forward scattering, faces may be rough. Every
    layer that scatters needs its g.

    Arguments
    ---------
    streams : directions in both hemispheres of the densest medium, even, at least 4 (as NSTR of DISORT; a panel of directions between two indices
        takes at least 8). Left out: 32 to 128, by g and the indices.
        For distances and spatial frequencies 16 to 32.
    orders : azimuthal orders of light that walks sideways, at least 2. Left out: 5. Totals and angles take what they need.
    frequencies : at which distances are computed, even, at least 8. Left out: 32.
    layers : how many are modelled, from the top, the last of them as if it were endless. Left out: all.
    phase : tabulated Legendre moments (1, g, ...) of the phase functions of layers, by layer name, in place of Henyey and Greenstein's.

    Raises InputError for numbers outside these.

    >>> import layerfit as lf
    >>> slab = lf.Stack([lf.Layer("slab", sigma_a=1, sigma_s=9, g=0.75, n=1, thickness=0.2)])
    >>> R, T = lf.predict(slab, [lf.TotalReflectance(), lf.TotalTransmittance()], solver=lf.DiscreteOrdinates())
    >>> R.values.round(5), T.values.round(5)
    (array([0.09739]), array([0.66096]))
    """

    name: ClassVar[str] = "discrete-ordinates"
    references: ClassVar[tuple[str, ...]] = (
        "K. Stamnes, S.-C. Tsay, W. Wiscombe, K. Jayaweera, Appl. Opt. 27, 2502 (1988)",
        "J. Stam, Proc. Eurographics Workshop on Rendering, 39 (2001)",
        "T. Nakajima, M. Tanaka, J. Quant. Spectrosc. Radiat. Transfer 40, 51 (1988)",
    )
    streams: int | None = eqx.field(static=True)
    orders: int | None = eqx.field(static=True)
    frequencies: int | None = eqx.field(static=True)
    layers: int | None = eqx.field(static=True)
    phase: tuple[tuple[str, tuple[float, ...]], ...] = eqx.field(static=True)

    def __init__(
        self,
        *,
        streams: int | None = None,
        orders: int | None = None,
        frequencies: int | None = None,
        layers: int | None = None,
        phase: dict[str, Sequence[float]] | None = None,
    ):
        self.streams = _count(streams, "streams", 4, even=True)
        self.orders = _count(orders, "orders", 2, even=False)
        self.frequencies = _count(frequencies, "frequencies", 8, even=True)
        self.layers = _count(layers, "layers", 1, even=False)
        self.phase = tuple((name, tuple(float(chi) for chi in table)) for name, table in (phase or {}).items())
        for name, table in self.phase:
            if len(table) < 1 or table[0] != 1.0 or not np.all(np.abs(table[1:]) < 1.0):
                raise InputError(
                    f"DiscreteOrdinates: phase of '{name}' = {table}; allowed: Legendre moments, the first 1, the others between -1 and 1"
                )

    def with_layers(self, count: int | None) -> "DiscreteOrdinates":
        """The same with another number of layers that are modelled."""
        return DiscreteOrdinates(streams=self.streams, orders=self.orders, frequencies=self.frequencies, layers=count, phase=dict(self.phase))

    def check(self, stack: Stack, geometry: Geometry) -> None:
        names = [layer.name for layer in stack.layers]
        for name, _ in self.phase:
            if name not in names:
                raise InputError(f"DiscreteOrdinates: phase names a layer '{name}'; layers of the stack: {', '.join(names)}")
        for layer in stack.layers:
            clear = not isinstance(layer.sigma_s_prime, Tracer) and float(layer.sigma_s_prime) == 0.0
            if layer.g is None and not clear and layer.name not in dict(self.phase):
                raise InputError(f"layer '{layer.name}': solver {self.name} needs g; allowed is g beside sigma_s_prime, or sigma_s with g")
        if geometry.side == "below" and self.layers is not None:
            raise InputError(f"{geometry.kind}: layers = {self.layers} leaves nothing to come out below; allowed is all layers")
        if geometry.side == "below" and stack.half_space:
            raise InputError(f"{geometry.kind}: the stack ends in a half space, nothing comes out below; allowed is a last layer with a thickness")

    def layouts(self, domain: Domain, geometries: Sequence[Geometry], rows: Sequence[int]) -> list[Layout]:
        """Directions and azimuthal orders for each geometry. rows : which layer of the domain's stack each row of its columns is."""
        tables = tuple(tables_of(self, domain.stack)[i] for i in rows)
        streams = self.streams or enough_streams(domain, any(isinstance(geometry, Angular) for geometry in geometries))
        layout = lay_out(domain, streams, 1, tables)
        tabulated = any(table is not None for table in tables)
        return [replace(layout, orders=_orders(geometry, domain, layout.terms, tabulated)) for geometry in geometries]

    def forward(self, domain: Domain, geometries: Sequence[Geometry], shifts: Sequence[tuple[float, float]]) -> Forward:
        if self.layers is not None and self.layers < len(domain.stack.layers):
            upper = self.with_layers(None).forward(upper_domain(domain, self.layers), geometries, shifts)
            return UpperLayersForward(upper, self.layers)

        def make(sideways: int, chosen: tuple[int, ...]) -> Forward:
            mine = [geometries[j] for j in chosen]
            return self._sideways(domain, mine, [shifts[j] for j in chosen]) if sideways else self._even(domain, mine)

        return joined([0 if isinstance(geometry, Total | Angular) else 1 for geometry in geometries], make)

    def _even(self, domain: Domain, geometries: Sequence[Geometry]) -> Forward:
        """Evenly lit samples: totals and angles."""
        layouts = self.layouts(domain, geometries, range(len(domain.stack.layers)))
        fine = tuple(_plan(domain, *pair) for pair in zip(geometries, layouts, strict=True))
        coarse = tuple(_plan(domain, geometry, coarsened(layout)) for geometry, layout in zip(geometries, layouts, strict=True))
        return OrdinatesForward(fine, coarse)

    def _sideways(self, domain: Domain, geometries: Sequence[Geometry], shifts: Sequence[tuple[float, float]]) -> Forward:
        """Distances and spatial frequencies."""
        fine = fineness(domain, tables_of(self, domain.stack), self.streams, self.orders, self.frequencies)
        return profiles_forward(domain, geometries, shifts, fine, coarser(domain, fine))


def _count(value: int | None, name: str, least: int, *, even: bool) -> int | None:
    """A setting that is a number of things. Raises InputError."""
    if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < least or (even and value % 2)):
        raise InputError(f"DiscreteOrdinates: {name} = {value!r}; allowed is {'an even' if even else 'a'} whole number, {least} or more")
    return value


def tables_of(solver: DiscreteOrdinates, stack: Stack) -> tuple[tuple[float, ...] | None, ...]:
    """The tabulated phase function of each layer, None where it has none."""
    return tuple(dict(solver.phase).get(layer.name) for layer in stack.layers)


_PER_LOBE = 6.0  # ordinates of a hemisphere for lobes of roughness 1: fewer ring, to negative radiances
_MOST = 128


def enough_streams(domain: Domain, angular: bool) -> int:
    """Streams for an error of 2e-6 in totals, 1e-5 for g above 0.8 (rough faces: about 1e-4). More where directions fall into panels, and
    for the lobes of hardly rough faces."""
    g = float(np.max(np.abs(np.asarray(domain.high.g))))
    panels = len(np.unique(np.concatenate([media(domain.low), media(domain.high)]))) > 1
    streams = 32 if g <= (0.6 if panels else 0.8) else 64 if g <= (0.8 if panels or angular else 0.95) else 96 if g <= 0.95 and not angular else 128
    if all(domain.low.smooth):
        return streams
    least = min(float(s) for s, smooth in zip(np.asarray(domain.low.roughness), domain.low.smooth, strict=True) if not smooth)
    lobes = 2 * int(np.ceil(_PER_LOBE / max(least, 0.01))) if angular else 0
    return max(streams, min(lobes, _MOST), 48)


class _Task(NamedTuple):
    """A geometry as constants: above or below; cosine of incidence (None: diffuse); first-surface reflection left out; sines of the lines of sight
    (None: a total); azimuth [rad] (None: averaged)."""

    above: bool
    cosine: float | None
    net: bool
    sines: tuple[float, ...] | None
    azimuth: float | None


def _task(geometry: Total | Angular) -> _Task:
    return _Task(
        above=geometry.side == "above",
        cosine=None if geometry.incidence == "diffuse" else float(geometry.cosines()[0][0]),
        net=not (isinstance(geometry, TotalReflectance) and geometry.specular == "included"),
        sines=tuple(np.sin(np.radians(geometry.angle)).tolist()) if isinstance(geometry, Angular) else None,
        azimuth=float(np.radians(geometry.azimuth)) if isinstance(geometry, Angular) and geometry.azimuth is not None else None,
    )


class _Plan(eqx.Module):
    """One geometry with all that does not depend on the free numbers of the stack."""

    task: _Task = eqx.field(static=True)
    layout: Layout
    optics: tuple[Grid, tuple[Response[Matrix], ...]] | None

    @property
    def beams(self) -> int:
        return 0 if self.task.cosine is None else 1

    @property
    def key(self) -> tuple:
        """The same for geometries with the same directions."""
        return (self.layout, self.task.cosine, self.task.sines and (self.task.above, self.task.sines))

    def directions(self, columns: Columns) -> tuple[Float[Array, "v"], Float[Array, "b"]]:
        """p = n sin(theta) of lines of sight and beams."""
        task = self.task
        n_out = columns.n_above if task.above else columns.n_below
        views = n_out * np.array(task.sines or ())
        return views, beam_sines(columns, task.cosine)


def _plan(domain: Domain, geometry: Geometry, layout: Layout) -> _Plan:
    assert isinstance(geometry, Total | Angular)
    task = _task(geometry)
    plan = _Plan(task, layout, None)
    return replace(plan, optics=_optics(plan, domain.low)) if domain.fixed_optics else plan


_DECAY = 1e-8  # what an azimuthal order of light scattered twice may fall to before it is left out


def _orders(geometry: Geometry, domain: Domain, terms: int, tabulated: bool) -> int:
    """Azimuthal orders: one for what is averaged over azimuth or symmetric about the normal; else as long as they matter.

    Light scattered twice has them in proportion to g^(2 m) at most; once-scattered light is corrected in closed form.
    """
    if not isinstance(geometry, Angular) or geometry.azimuth is None or geometry.incidence in ("normal", "diffuse", 0.0):
        return 1
    return enough_orders(domain, terms, tabulated, scatterings=2)


def enough_orders(domain: Domain, terms: int, tabulated: bool, scatterings: int) -> int:
    """Azimuthal orders that matter to light scattered so often: they fall as g^(m scatterings). Rough faces and tabulated phase functions need all
    that the rule can tell apart."""
    g = max(float(np.max(np.abs(np.asarray(c.g)))) for c in (domain.low, domain.high))
    if tabulated or not all(domain.low.smooth):
        return terms
    return min(terms, 1 if g == 0.0 else int(np.ceil(np.log(_DECAY) / np.log(g) / scatterings)) + 2)


@eqx.filter_jit
def _optics(plan: _Plan, columns: Columns) -> tuple[Grid, tuple[Response[Matrix], ...]]:
    views, beams = plan.directions(columns)
    grid = make_grid(plan.layout, columns, views, beams)
    return grid, make_faces(columns, grid, plan.layout, beams.size)


_ROUNDING = 1e-12
_CAUTION = 2.0  # the coarser rule may by chance lie closer than the error of the finer one


class OrdinatesForward(Forward):
    """See `Forward`."""

    plans: tuple[_Plan, ...]
    coarser: tuple[_Plan, ...]

    def __call__(self, columns: Columns, shifts: Sequence[Float[Array, ""] | None] | None = None) -> tuple[Array, ...]:
        return _values(self.plans, columns)

    def run(self, columns: Columns) -> tuple[Array, ...]:
        return self(columns)

    def error(self, columns: Columns) -> tuple[np.ndarray | None, ...] | None:
        """Twice the difference to a rule of two thirds of the directions, and rounding."""
        return self.evaluate(columns).errors

    def evaluate(self, columns: Columns) -> Evaluation:
        fine, coarse = ([np.asarray(v) for v in _values(plans, columns)] for plans in (self.plans, self.coarser))
        return Evaluation(tuple(fine), tuple(_CAUTION * np.abs(a - b) + _ROUNDING for a, b in zip(fine, coarse, strict=True)))


@eqx.filter_jit
def _values(plans: tuple[_Plan, ...], columns: Columns) -> tuple[Array, ...]:
    done: dict[tuple, tuple[Grid, tuple[Response[Matrix], ...], list[Response[Matrix]]]] = {}  # geometries that need the same directions share them
    values = []
    for plan in plans:
        if plan.key not in done:
            grid, faces = _optics(plan, columns) if plan.optics is None else plan.optics
            numbers = medium(plan.layout, columns)
            done[plan.key] = grid, faces, pieces(plan.layout, columns, numbers, grid, faces, plan.beams)
        grid, faces, parts = done[plan.key]
        value = _read(plan, grid, parts)
        if plan.task.sines and plan.beams:
            single = correction(plan.layout, columns, medium(plan.layout, columns), grid, faces, plan.task.azimuth)
            lacking = reflection(single) if plan.task.above else compose_all(single).T_down
            value = value + grid.rule.n[0 if plan.task.above else -1] ** 2 * lacking.value[:-1, -1]
        values.append(value)
    return tuple(values)


def _read(plan: _Plan, grid: Grid, parts: list[Response[Matrix]]) -> Float[Array, "values"]:
    """The values of one geometry."""
    task = plan.task
    if task.above:
        seen = reflection(parts).value
        if task.net:
            seen = seen - parts[0].R_above.value
    else:
        seen = compose_all(parts).T_down.value
    n = grid.root.shape[1]
    views = seen.shape[-1] - n - plan.beams
    into, out = grid.root[0], grid.root[0 if task.above else -1]
    if task.sines is None:
        seen = seen[0, views:, views:]
        if plan.beams:
            return (out @ seen[:n, n] + seen[n, n])[None]
        return (out @ seen @ into / jnp.sum(into**2))[None]
    index = grid.rule.n[0 if task.above else -1]
    if plan.beams:  # a beam of power 1 is the amplitude (2 - delta_m0)/(2 pi)
        order = np.arange(seen.shape[0])
        factor = np.where(order == 0, 1.0, 2.0) * np.cos(order * (task.azimuth or 0.0)) / (2.0 * np.pi)
        return index**2 * jnp.tensordot(factor, seen[:, :views, -1], 1)
    uniform = 1.0 / (2.0 * np.pi * jnp.sum(into**2))  # I/n^2 of diffuse light of power 1
    return index**2 * uniform * (seen[0, :views, views:] @ into + jnp.diagonal(seen[0, :views, :views]))
