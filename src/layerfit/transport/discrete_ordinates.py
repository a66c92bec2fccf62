"""Discrete ordinates: radiative transport in any number of layers, exact in angle."""

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import equinox as eqx
import numpy as np
from jax.core import Tracer

from ..errors import InputError
from ..measurement.geometry import Angular, Geometry, Total
from ..scene.stack import Stack
from ..solver import Domain, Forward, Solver
from .evenly_lit import evenly_lit_forward
from .fineness import coarser, fineness
from .joint import joined
from .ordinate_profiles import profiles_forward
from .ordinate_stack import Layout, lay_out, media
from .upper_layers import UpperLayersForward, upper_domain


class DiscreteOrdinates(Solver):
    """Radiative transport by discrete ordinates: totals, angular distributions, and light that walks sideways, of any stack of layers.

    Exact at albedo 1 and for any thickness; layers may differ in index, be clear, thin or strongly forward scattering, faces may be rough. Every
    layer that scatters needs its g.

    Arguments
    ---------
    streams : directions in both hemispheres of the densest medium, even, at least 4 (as NSTR of DISORT; a panel of directions between two indices
        takes at least 8). Left out: 32 to 128, by g and the indices.
        For distances and spatial frequencies 16 to 56.
    orders : azimuthal orders of light that walks sideways, at least 2. Left out: 5 or 6. Totals and angles take what they need.
    frequencies : at which distances are computed, even, at least 8. Left out: 24 to 64.
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
            return self._sideways(domain, mine, [shifts[j] for j in chosen]) if sideways else self._evenly_lit(domain, mine)

        return joined([0 if isinstance(geometry, Total | Angular) else 1 for geometry in geometries], make)

    def _evenly_lit(self, domain: Domain, geometries: Sequence[Geometry]) -> Forward:
        """Totals and angles."""
        return evenly_lit_forward(domain, geometries, self.layouts(domain, geometries, range(len(domain.stack.layers))))

    def _sideways(self, domain: Domain, geometries: Sequence[Geometry], shifts: Sequence[tuple[float, float]]) -> Forward:
        """Distances and spatial frequencies."""
        fine = fineness(domain, tables_of(self, domain.stack), geometries, shifts, self.streams, self.orders, self.frequencies)
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
