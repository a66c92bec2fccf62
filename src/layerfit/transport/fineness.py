"""How finely discrete ordinates are to compute distances and spatial frequencies."""

from dataclasses import replace

import equinox as eqx
import numpy as np

from ..scene.columns import Columns
from ..solver import Domain
from .ordinate_stack import Layout, lay_out, lit_panels, media, middle, resolved_terms


class Fineness(eqx.Module):
    """layout : directions and azimuthal orders. count : frequencies, even. along : light may run far along the sample, or a layer of it."""

    layout: Layout
    count: int = eqx.field(static=True)
    along: bool = eqx.field(static=True)


_THIN, _SLAB = 0.3, 3.0  # transport optical thickness of a layer, and of a whole sample, below which light goes far sideways unscattered
_WIDE = 4.0  # ratio of scales from which more frequencies are needed
_FAR = 20.0  # and from which more directions are
_ABSORBING = 0.2  # share of absorption in the extinction of all layers from which R(r) falls steeply
_DARK = 0.1  # share in the half space at the bottom from which more frequencies are needed
_FORWARD = 0.85  # g


def fineness(
    domain: Domain, tables: tuple[tuple[float, ...] | None, ...], below: bool, streams: int | None, orders: int | None, frequencies: int | None
) -> Fineness:
    """What is asked for; else what was found to be enough for 0.5 % beyond half a transport mean free path.

    below : whether light that has crossed the sample is looked at.
    """
    low, high = domain.low, domain.high
    depth = np.asarray(low.thickness * low.sigma_t_prime[: low.thickness.shape[0]])
    thin, slab = bool(np.any(depth < _THIN)), not low.half_space and float(np.sum(depth)) < _SLAB
    mean = middle(domain)
    dense, clear = scales(mean)
    wide = dense > _WIDE * clear
    usual = np.asarray(mean.thickness * mean.sigma_t_prime[: mean.thickness.shape[0]])
    guiding = bool(np.any(usual < _THIN)) and dense > _WIDE * float(np.min(np.asarray(mean.sigma_t_prime)))  # light runs far in a thin clear layer
    far, absorbing = dense > _FAR * clear, float(np.min(np.asarray(mean.sigma_a / mean.sigma_t_prime))) > _ABSORBING
    forward = float(np.max(np.asarray(high.g))) > _FORWARD
    if slab:
        enough, most, count = (40 if forward else 32) if thin else 24, 6 if forward else 5, 64
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
    layout = _resolved(domain, lay_out(domain, streams or enough, 1, tables))
    return Fineness(replace(layout, orders=min(orders or most, layout.terms)), frequencies or count, slab or guiding)


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
    return Fineness(replace(layout, orders=max(2, min(fine.layout.orders - 1, layout.terms))), fine.count, fine.along)


def _resolved(domain: Domain, layout: Layout) -> Layout:
    """With the moments that its directions resolve."""
    n, lit = media(middle(domain)), lit_panels(domain, layout.groups)
    edges = np.sort([float(n[layout.groups.index(group)]) for group in range(len(layout.counts))])
    return replace(layout, terms=resolved_terms(layout.counts[:lit], edges[:lit]))
