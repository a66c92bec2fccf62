"""How finely discrete ordinates are to compute distances and spatial frequencies."""

from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import numpy as np

from ..measurement.geometry import Geometry, Radial
from ..scene.columns import Columns
from ..solver import Domain
from .ordinate_stack import Layout, lay_out, lit_panels, media, medium, middle, resolved_terms


class Events(eqx.Module):
    """Light after a few events, which is followed more finely than other light (`successive`). number : of events."""

    layout: Layout
    count: int = eqx.field(static=True)
    number: int = eqx.field(static=True)


class Fineness(eqx.Module):
    """layout : directions and azimuthal orders. count : frequencies, even. along : light may run far along the sample, or a layer of it."""

    layout: Layout
    count: int = eqx.field(static=True)
    along: bool = eqx.field(static=True)
    events: Events | None


_THIN, _SLAB = 0.3, 3.0  # transport optical thickness of a layer, and of a whole sample, below which light goes far sideways unscattered
_WIDE = 4.0  # ratio of scales from which more frequencies are needed
_FAR = 20.0  # and from which more directions are
_ABSORBING = 0.2  # share of absorption in the extinction of all layers from which R(r) falls steeply
_DARK = 0.1  # share in the half space at the bottom from which more frequencies are needed
_FORWARD, _VERY_FORWARD = 0.85, 0.95  # g
_NEAR = 0.5  # transport mean free paths of the densest layer within which single cones of light are seen
_FEW = 0.8  # transport optical thickness of a whole sample, below which few events make most of the light near the axis behind it
_FINER, _MORE_ORDERS = 1.3, 2.7  # directions and azimuthal orders of light after a few events, as a share of those of all light
_FINER_BESIDE_CLEAR = 4.0  # the same of directions where layers are clear: far behind these each direction alone is a ring
_MOST_EVENTS = 24
_CLEAR = 0.05  # optical thickness of a layer that dims light little, however far along it that gets
_GRAZING = 12  # directions of the outermost panel of such a layer between ones of higher index
_GRAZING_IN_THICK = 20  # the same of any thin clear layer of a sample that is neither thin nor endless: light runs along it for twenty thicknesses


def fineness(
    domain: Domain,
    tables: tuple[tuple[float, ...] | None, ...],
    geometries: Sequence[Geometry],
    shifts: Sequence[tuple[float, float]],
    streams: int | None,
    orders: int | None,
    frequencies: int | None,
) -> Fineness:
    """What is asked for; else what was found to be enough for 0.5 % beyond half a transport mean free path, 2 % nearer.

    shifts : ranges of the offsets of the distances [mm].
    """
    low, high = domain.low, domain.high
    below = any(geometry.side == "below" for geometry in geometries)
    near = _near(domain, geometries, shifts)
    depth = np.asarray(low.thickness * low.sigma_t_prime[: low.thickness.shape[0]])
    thin, slab = bool(np.any(depth < _THIN)), not low.half_space and float(np.sum(depth)) < _SLAB
    mean = middle(domain)
    dense, clear = scales(mean)
    wide = dense > _WIDE * clear
    usual = np.asarray(mean.thickness * mean.sigma_t_prime[: mean.thickness.shape[0]])
    guides = (usual < _THIN) & (dense > _WIDE * np.asarray(mean.sigma_t_prime)[: usual.size])  # light runs far in a thin clear layer
    guiding = bool(np.any(guides))
    far, absorbing = dense > _FAR * clear, float(np.min(np.asarray(mean.sigma_a / mean.sigma_t_prime))) > _ABSORBING
    g = float(np.max(np.asarray(high.g)))
    forward = g > _FORWARD
    of_thin = 40 if forward else 32
    if slab:
        enough, most, count = of_thin if thin else 24, 6 if forward else 5, 64
    elif guiding:
        enough, most, count = 40 if low.half_space else 56, 5, 48
    elif wide and not low.half_space:
        enough, most, count = (32, 5, 64) if below else (24, 5, 48)
    else:
        enough, most = 32 if thin else 24 if forward or far else 16, 5
        dark = float(mean.sigma_a[-1] / mean.sigma_t_prime[-1]) > _DARK
        if thin or not low.half_space:
            count = 48 if wide or thin or absorbing else 32
        elif absorbing or far:
            count = 40
        else:
            count = 32 if wide or forward or dark else 24
    total = float(np.sum(depth))
    few = near and total < (_FEW if below or _clear(domain) else _THIN)
    if near and below:
        enough = max(enough, _behind(total) if not few else 48 if g > _VERY_FORWARD else of_thin)
    layout = lay_out(domain, streams or enough, 1, tables)
    if streams is None and guiding:
        layout = _with_grazing(mean, layout, _between_denser(mean), _GRAZING)
        if not (slab or low.half_space):
            layout = _with_grazing(mean, layout, guides, _GRAZING_IN_THICK)
    layout = _resolved(domain, layout)
    layout = replace(layout, orders=min(orders or most, layout.terms))
    count = frequencies or count
    return Fineness(layout, count, slab or guiding, _events(domain, layout, count) if few else None)


def _behind(depth: float) -> int:
    """Streams for what leaves near the axis behind a sample of this transport optical thickness: the thinner, the narrower it looks from there.

    >>> [_behind(depth) for depth in (1.0, 1.5, 2.0, 5.0)]
    [48, 40, 32, 20]
    """
    return min(4 * int(np.ceil(3.0 + 10.0 / depth)), 48)


def nearest(geometry: Radial, shift: tuple[float, float]) -> np.ndarray:
    """The smallest distance that light of each value can have walked [mm]."""
    extent = geometry.detector.radius + 2.0 * float(getattr(geometry.source, "radius", 0.0))
    return np.maximum(np.abs(next(iter(geometry.places().values()))) + min(shift[0], 0.0) - extent, 0.0)


def _events(domain: Domain, layout: Layout, count: int) -> Events:
    """Finer by what was found to be enough."""
    share = _FINER_BESIDE_CLEAR if _clear(domain) else _FINER
    finer = replace(layout, counts=tuple(round(share * n) for n in layout.counts), orders=min(round(_MORE_ORDERS * layout.orders), layout.terms))
    return Events(finer, 2 * count, _enough_events(float(np.sum(np.asarray(medium(layout, domain.high).tau)))))


def _clear(domain: Domain) -> bool:
    """Whether any layer does not scatter."""
    return bool(np.any((np.asarray(domain.low.sigma_s_prime) == 0.0) & (np.asarray(domain.high.thickness) > 0.0)))


def _between_denser(columns: Columns) -> np.ndarray:
    """Which finite layers are clear, between ones of higher index: what their faces let through varies quickly with the angle near grazing."""
    n = np.asarray(media(columns))
    extinction = np.asarray(columns.sigma_a + columns.sigma_s_prime / (1.0 - columns.g))
    depth = np.asarray(columns.thickness) * extinction[: columns.thickness.shape[0]]
    denser = [n[i] > n[i + 1] < n[min(i + 2, n.size - 1)] for i in range(depth.size)]
    return (depth < _CLEAR) & np.array(denser, dtype=bool)


def _with_grazing(columns: Columns, layout: Layout, which: np.ndarray, least: int) -> Layout:
    """At least so many directions in the outermost panels of some finite layers, where that has light."""
    n, edges = np.asarray(media(columns)), _edges(columns, layout)
    ends = {int(np.searchsorted(edges, n[1 + i])) for i in np.flatnonzero(which)}
    return replace(layout, counts=tuple(max(count, least) if k in ends and count > 1 else count for k, count in enumerate(layout.counts)))


def _enough_events(tau: float) -> int:
    """More in a thick sample, where light is scattered often, and in a very thin one, where it runs far between the faces.

    >>> [_enough_events(tau) for tau in (0.1, 1.0, 3.0, 100.0)]
    [22, 14, 17, 24]
    """
    return min(int(np.ceil(10.0 + 2.0 * tau + 14.0 * np.exp(-2.0 * tau))), _MOST_EVENTS)


def _near(domain: Domain, geometries: Sequence[Geometry], shifts: Sequence[tuple[float, float]]) -> bool:
    """Whether distances are asked for at which single cones of light are seen on either side of a sample with smooth faces."""
    if domain.low.half_space or not all(domain.low.smooth):
        return False
    distance = _NEAR / float(np.max(np.asarray(middle(domain).sigma_t_prime)))
    pairs = zip(geometries, shifts, strict=True)
    return any(isinstance(geometry, Radial) and bool(np.any(nearest(geometry, shift) < distance)) for geometry, shift in pairs)


def scales(columns: Columns) -> tuple[float, float]:
    """Largest and smallest extinction sigma_t' [1/mm] of the layers that light diffuses in, thin ones left out."""
    extinction = np.asarray(columns.sigma_t_prime)
    depth = np.append(np.asarray(columns.thickness) * extinction[: columns.thickness.shape[0]], np.inf if columns.half_space else [])
    diffusing = extinction[depth >= _THIN] if np.any(depth >= _THIN) else extinction
    return float(np.max(extinction)), float(np.min(diffusing))


def coarser(domain: Domain, fine: Fineness) -> Fineness:
    """Three quarters of the directions and one order less."""
    counts = tuple(max(min(2, count), round(0.75 * count)) for count in fine.layout.counts)
    layout = _resolved(domain, replace(fine.layout, counts=counts))
    layout = replace(layout, orders=max(2, min(fine.layout.orders - 1, layout.terms)))
    return Fineness(layout, fine.count, fine.along, None if fine.events is None else _events(domain, layout, fine.count))


def _resolved(domain: Domain, layout: Layout) -> Layout:
    """With the moments that its directions resolve."""
    lit = lit_panels(domain, layout.groups)
    return replace(layout, terms=resolved_terms(layout.counts[:lit], _edges(middle(domain), layout)[:lit]))


def _edges(columns: Columns, layout: Layout) -> np.ndarray:
    """Upper ends of the panels."""
    n = np.asarray(media(columns))
    return np.sort([float(n[layout.groups.index(group)]) for group in range(len(layout.counts))])
