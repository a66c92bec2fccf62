"""A stack in discrete ordinates: its directions, its layers and interfaces as responses over them."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from ..arrays import AnyArray
from ..compilation import at_once
from ..optics.phase import delta_m, henyey_greenstein_moments, legendre_functions
from ..optics.quadrature import Ordinates, allot, cosine, ordinates, panel_shares
from ..scene.columns import Columns
from ..solver import Domain
from .discrete_ordinates_interface import fresnel_shares, smooth_interface
from .discrete_ordinates_layer import Directions, deep_layer, layer, problem, scattering
from .matrix import Matrix
from .response import Response, nothing
from .rough_interface import Side, rough_interfaces

# Least optical thickness of a layer. Light trapped in one of none has no definite slope; near none, slopes show rounding in proportion to 1/depth.
_LEAST_DEPTH = 1e-12
_LEAST_DEPTH_OF_A_TRAP = 1e-10  # where indices differ


class Layout(eqx.Module):
    """What is fixed before any number of the stack is known.

    groups, counts : see `optics.quadrature.ordinates`. terms : moments of the phase function that count; the next one is the share of delta-M.
    orders : azimuthal orders. tables : tabulated moments of a layer's phase function in place of Henyey and Greenstein's.
    """

    groups: tuple[int, ...] = eqx.field(static=True)
    counts: tuple[int, ...] = eqx.field(static=True)
    terms: int = eqx.field(static=True)
    orders: int = eqx.field(static=True)
    tables: tuple[tuple[float, ...] | None, ...] = eqx.field(static=True)

    @property
    def size(self) -> int:
        """Ordinates of one hemisphere."""
        return sum(self.counts)


def media(columns: Columns) -> Float[Array, "media"]:
    """Refractive indices from above to below; under a half space there is no medium."""
    below = [] if columns.half_space else [columns.n_below[None]]
    return jnp.concatenate([columns.n_above[None], columns.n, *below])


def lay_out(domain: Domain, streams: int, orders: int, tables: tuple[tuple[float, ...] | None, ...]) -> Layout:
    """The panels of all stacks of a domain: indices that are free to move get one of their own. Where no light gets to a panel has one direction."""
    low, high, now = (np.asarray(media(c)) for c in (domain.low, domain.high, middle(domain)))
    keys = [("fixed", float(a)) if a == b else ("free", i) for i, (a, b) in enumerate(zip(low, high, strict=True))]
    distinct = list(dict.fromkeys(keys))
    groups = tuple(distinct.index(key) for key in keys)
    edges = np.sort([now[keys.index(key)] for key in distinct])
    lit = lit_panels(domain, groups)
    counts = (*allot(streams // 2, edges[:lit]), *[1] * (edges.size - lit))
    return Layout(groups, counts, terms_of(counts[:lit]), orders, tables)


def lit_panels(domain: Domain, groups: tuple[int, ...]) -> int:
    """How many panels, from p = 0 outwards, light gets to.

    Not to those beyond the indices of all media that scatter and of the surroundings: in a slide between smooth faces it keeps to the
    directions that it came in with.
    """
    first = [groups.index(group) for group in range(max(groups) + 1)]
    if not all(domain.low.smooth):
        return len(first)
    low, high, now = (np.asarray(media(c)) for c in (domain.low, domain.high, middle(domain)))
    scatters = np.full(high.size, True)
    scatters[1 : domain.high.count + 1] = np.asarray(domain.high.sigma_s_prime) > 0.0
    edges = low[np.array(sorted(first, key=lambda i: now[i]))]
    return 1 + int(np.sum(edges[:-1] < np.max(high[scatters])))


def coarsened(domain: Domain, layout: Layout) -> Layout:
    """The same with two thirds of the directions in each panel."""
    counts = tuple(max(1, round(2 * count / 3)) for count in layout.counts)
    terms = terms_of(counts[: lit_panels(domain, layout.groups)])
    return Layout(layout.groups, counts, terms, min(layout.orders, terms), layout.tables)


def terms_of(counts: tuple[int, ...]) -> int:
    """Moments of the phase function that a rule integrates: of n Gauss nodes the first 2 n; of panels, which are narrower than the whole range and
    mapped from another medium, 3/2 of their nodes (more do harm, fewer leave more to delta-M; found by trial at g = 0.8 to 0.98)."""
    return 2 * counts[0] if len(counts) == 1 else 3 * sum(counts) // 2


def resolved_terms(counts: tuple[int, ...], edges: np.ndarray) -> int:
    """The same for panels of any width, by the one that resolves angles least: narrow panels hold more directions than their share.

    edges : see `optics.quadrature.allot`.
    """
    return terms_of(counts) if len(counts) == 1 else int(1.5 * np.min(np.array(counts) / panel_shares(edges)) + 1e-9)


def middle(domain: Domain) -> Columns:
    """Middle of a domain."""
    return jax.tree.map(lambda a, b: 0.5 * (a + b), domain.low, domain.high)


class Grid(NamedTuple):
    """Directions in all media and what depends on them alone. Channels: lines of sight, ordinates, beams.

    mu, weight, real, root : see `Directions`, one row a medium; legendre : Legendre functions in each layer, ordinates first.
    """

    rule: Ordinates
    mu: Float[AnyArray, "media c"]
    weight: Float[AnyArray, "media c"]
    real: Bool[AnyArray, "media c"]
    root: Float[AnyArray, "media n"]
    legendre: Float[AnyArray, "layers orders l c"]


def make_grid(layout: Layout, columns: Columns, views: Float[Array, "v"], beams: Float[Array, "b"]) -> Grid:
    """views, beams : p = n sin(theta) of the lines of sight and the beams."""
    rule = ordinates(media(columns), layout.groups, layout.counts)
    mu, real = cosine(rule.n[:, None], jnp.concatenate([views, beams])[None, :])
    W = jnp.where(rule.real, rule.W, 0.0)
    root = jnp.sqrt(jnp.where(rule.real, W, 1.0)) * rule.real
    mu = jnp.concatenate([rule.mu, mu], axis=1)
    real = jnp.concatenate([rule.real, real], axis=1)
    weight = jnp.concatenate([root, jnp.ones((root.shape[0], views.size + beams.size))], axis=1) * real / (mu * rule.n[:, None])
    count = columns.count
    legendre = jnp.moveaxis(legendre_functions(mu[1 : count + 1], layout.terms, layout.orders), 2, 0)
    return Grid(rule, mu, weight, real, root, legendre)


def channels(grid: Grid, beams: int, values: Array) -> Array:
    """Values given for ordinates, lines of sight, beams, in the order of channels."""
    n = grid.root.shape[1]
    end = values.shape[-1] - beams
    return jnp.concatenate([values[..., n:end], values[..., :n], values[..., end:]], axis=-1)


class Medium(NamedTuple):
    """Optical numbers of layers after the delta-M scaling. tau : optical thickness of the finite ones. absorbed : 1 - albedo.
    forward : share of what is scattered that delta-M counts as not scattered. extinction : [1/mm]."""

    tau: Float[Array, "finite"]
    albedo: Float[Array, "layers"]
    absorbed: Float[Array, "layers"]
    moments: Float[Array, "layers l"]
    forward: Float[Array, "layers"]
    extinction: Float[Array, "layers"]


def medium(layout: Layout, columns: Columns) -> Medium:
    """Transport coefficients of all layers from the columns."""
    sigma_s = columns.sigma_s_prime / (1.0 - columns.g)
    extinction = columns.sigma_a + sigma_s
    finite = columns.thickness.shape[0]
    depth = jnp.concatenate([columns.thickness, jnp.ones(columns.count - finite)])
    clear = extinction == 0.0
    extra = jnp.where(clear, _LEAST_DEPTH / jnp.where(depth > 0.0, depth, 1.0), 0.0)
    extinction = extinction + extra
    chi = [
        henyey_greenstein_moments(columns.g[i], layout.terms + 1) if table is None else _padded(table, layout.terms + 1)
        for i, table in enumerate(layout.tables)
    ]
    chi = jnp.stack(chi)
    forward = jnp.maximum(chi[:, -1], 0.0)
    left, albedo, moments = jax.vmap(delta_m)(sigma_s / extinction, chi[:, :-1], forward)
    absorbed = (columns.sigma_a + extra) / (extinction * left)
    tau = (extinction * left)[:finite] * columns.thickness
    least = jnp.where(clear[:finite] | (len(set(layout.groups)) == 1), _LEAST_DEPTH, _LEAST_DEPTH_OF_A_TRAP)
    tau = tau + jax.lax.stop_gradient(jnp.maximum(least - tau, 0.0))
    tau, albedo, absorbed, extinction = at_once(tau, albedo, absorbed, extinction * left)
    return Medium(tau, albedo, absorbed, moments, forward, extinction)


def _padded(table: tuple[float, ...], count: int) -> Float[Array, "l"]:
    return jnp.asarray(np.pad(np.asarray(table)[:count], (0, max(count - len(table), 0))))


def pieces(layout: Layout, columns: Columns, numbers: Medium, grid: Grid, faces: tuple[Response[Matrix], ...], beams: int) -> list[Response[Matrix]]:
    """Responses from top to bottom: face, layer, face, layer ..., with the azimuthal orders as leading axis."""
    finite = columns.thickness.shape[0]
    order = jnp.arange(layout.orders, dtype=float)

    def one(i: int | slice):
        row = slice(1, columns.count + 1)
        directions = Directions(grid.mu[row][i], grid.weight[row][i], grid.root[row][i])
        return directions, grid.legendre[i], numbers.albedo[i], numbers.absorbed[i], numbers.moments[i]

    def posed(directions, legendre, albedo, absorbed, moments, m):
        return problem(scattering(moments, legendre, directions, m, beams), directions, albedo, absorbed, m)

    def finite_layer(args, tau):
        directions, legendre, albedo, absorbed, moments = args
        return jax.vmap(lambda legendre, m: layer(posed(directions, legendre, albedo, absorbed, moments, m), tau))(legendre, order)

    responses = []
    if finite:
        stacked = jax.vmap(finite_layer)(one(slice(0, finite)), numbers.tau)
        responses = [jax.tree.map(lambda x, i=i: x[i], stacked) for i in range(finite)]
    if columns.half_space:
        directions, legendre, albedo, absorbed, moments = one(finite)
        R = jax.vmap(lambda legendre, m: deep_layer(posed(directions, legendre, albedo, absorbed, moments, m)))(legendre, order)
        responses.append(Response(R, R.zero(), R.zero(), R.zero()))
    result = []
    for i, response in enumerate(responses):
        result += [faces[i], response]
    return result + ([] if columns.half_space else [faces[-1]])


def make_faces(columns: Columns, grid: Grid, layout: Layout, beams: int) -> tuple[Response[Matrix], ...]:
    """All interfaces, top first, with the azimuthal orders as leading axis."""
    n = grid.rule.n
    sides = [Side(n[j], grid.mu[j], grid.real[j], grid.root[j]) for j in range(n.shape[0])]
    pairs = [(sides[i], sides[i + 1], columns.roughness[i]) for i in range(n.shape[0] - 1) if not columns.smooth[i]]
    rough = iter(rough_interfaces(pairs, grid.rule.edges, layout.counts, layout.orders, beams))
    faces = []
    for i in range(n.shape[0] - 1):
        if columns.smooth[i] and layout.groups[i] == layout.groups[i + 1]:
            faces.append(nothing(Matrix(jnp.zeros((layout.orders, grid.mu.shape[1], grid.mu.shape[1])))))
        elif columns.smooth[i]:
            mu, real = ([channels(grid, beams, values[j]) for j in (i, i + 1)] for values in (grid.mu, grid.real))
            face = smooth_interface(*fresnel_shares(n[i], n[i + 1], mu[0], mu[1], real[0], real[1]))
            faces.append(jax.tree.map(lambda x: jnp.broadcast_to(x, (layout.orders, *x.shape)), face))
        else:
            faces.append(next(rough))
    return tuple(faces)
