"""The reflection and transmission matrices of a whole stack in discrete ordinates, by azimuthal order, as a user reads them."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer
from jaxtyping import Float

from ..compilation import compiled
from ..errors import InputError, one_of
from ..measurement.geometry import TotalReflectance
from ..optics.microfacet_paths import brdf
from ..scene.columns import Columns, to_columns
from ..scene.stack import Stack
from ..solver import Domain
from .discrete_ordinates import DiscreteOrdinates, enough_orders, enough_streams, tables_of
from .matrix import Matrix
from .ordinate_stack import Grid, Layout, Medium, lay_out, make_faces, make_grid, media, medium, pieces
from .regular import SIDES, Face, regular
from .response import Beamed, Response, compose_all, reflection
from .single_scattering import missing_orders

_AZIMUTHS = 256  # for the azimuthal orders of a rough surface
_MOVES = 1e-9  # relative width of the domain given to a refractive index that is traced


class ReciprocalMatrices(eqx.Module):
    """Light that a stack reflects and transmits, between ordinates outside of it. Made by `reciprocal_matrices`.

    Axes: orders (k), above (a: ordinates in the medium above), below (b: in the medium below; none under a half space). A matrix holds the cosine
    coefficients [1/sr] of a BRDF or BTDF f = sum over k of f_k cos(k phi), phi the azimuth between the two ways of travel, at [k, out, in]. Light
    that leaves as a beam (unscattered, through smooth faces alone) is not in them but in the ``regular`` shares, which smooth faces alone have.

    Reciprocity: R_above, R_below and the surfaces are symmetric; T_down/n_below^2 is the transpose of T_up/n_above^2.

    mu_above, mu_below : cosines outside. weight_above, weight_below : weights w of d mu; the sum of w mu is 1/2.
    R_above, R_below : subsurface reflection, of light that has passed the first face. surface_above, surface_below : what the first face alone
        scatters back (0 where it is smooth). T_down, T_up : transmission.
    regular_surface_above, regular_surface_below : share of a beam at each ordinate that the first face mirrors; regular_above, regular_below : that
        comes back as a beam from deeper faces; regular_down, regular_up : that passes as a beam. delta-M counts light scattered into the forward
        peak that the rule cannot resolve as not scattered.
    share_above, share_below, share_down, share_up : share of a beam at each ordinate that comes back scattered by the sample, or is transmitted
        scattered: of the rule, which conserves energy. Sums over the matrices, in which light scattered once is exact direction by direction, only
        come near.
    """

    mu_above: Float[Array, "a"]
    mu_below: Float[Array, "b"]
    weight_above: Float[Array, "a"]
    weight_below: Float[Array, "b"]
    n_above: Float[Array, ""]
    n_below: Float[Array, ""]
    R_above: Float[Array, "k a a"]
    R_below: Float[Array, "k b b"]
    T_down: Float[Array, "k b a"]
    T_up: Float[Array, "k a b"]
    surface_above: Float[Array, "k a a"]
    surface_below: Float[Array, "k b b"]
    regular_surface_above: Float[Array, "a"]
    regular_surface_below: Float[Array, "b"]
    regular_above: Float[Array, "a"]
    regular_below: Float[Array, "b"]
    regular_down: Float[Array, "a"]
    regular_up: Float[Array, "b"]
    share_above: Float[Array, "a"]
    share_below: Float[Array, "b"]
    share_down: Float[Array, "a"]
    share_up: Float[Array, "b"]

    @property
    def orders(self) -> int:
        """Azimuthal orders."""
        return self.R_above.shape[0]

    @property
    def r_tot(self) -> Float[Array, "k a a"]:
        """Surface and subsurface reflection from above, without beams [1/sr]."""
        return self.surface_above + self.R_above

    def brdf(self, azimuth: Any, *, side: Face = "above", surface: bool = False) -> Float[Array, "..."]:
        """Reflected radiance per irradiance [1/sr] at all pairs of ordinates (out, in).

        azimuth : [rad], of any shape, which leads in the result; 0 on the side of the mirror reflection.
        surface : whether what the first face scatters is counted.
        """
        one_of(side, SIDES, "side")
        R, first = (self.R_above, self.surface_above) if side == "above" else (self.R_below, self.surface_below)
        return _series(R + first if surface else R, azimuth)

    def btdf(self, azimuth: Any, *, side: Face = "above") -> Float[Array, "..."]:
        """Transmitted radiance, in the medium where it leaves, per irradiance on ``side`` [1/sr], at all pairs of ordinates (out, in)."""
        one_of(side, SIDES, "side")
        return _series(self.T_down if side == "above" else self.T_up, azimuth)

    def reflectance(self, *, side: Face = "above", surface: bool = True) -> Float[Array, "i"]:
        """Share of a beam at each ordinate that is reflected in all directions, beams included; without what the first face reflects on request."""
        one_of(side, SIDES, "side")
        first, mirrored, beam = (
            (self.surface_above, self.regular_surface_above, self.regular_above)
            if side == "above"
            else (self.surface_below, self.regular_surface_below, self.regular_below)
        )
        scattered = self.share_above if side == "above" else self.share_below
        return self._hemispherical(first, side) + scattered + mirrored + beam if surface else scattered + beam

    def transmittance(self, *, side: Face = "above") -> Float[Array, "i"]:
        """Share of a beam at each ordinate of ``side`` that is transmitted in all directions, beams included."""
        one_of(side, SIDES, "side")
        if side == "above":
            return self.share_down + self.regular_down
        return self.share_up + self.regular_up

    def diffuse(self, shares: Float[Array, "i"], *, side: Face = "above") -> Float[Array, ""]:
        """The mean of shares at the ordinates of ``side`` for Lambertian light."""
        one_of(side, SIDES, "side")
        mu, weight = (self.mu_above, self.weight_above) if side == "above" else (self.mu_below, self.weight_below)
        return 2.0 * jnp.sum(weight * mu * shares)

    def _hemispherical(self, kernel: Float[Array, "k o i"], out: Face) -> Float[Array, "i"]:
        mu, weight = (self.mu_above, self.weight_above) if out == "above" else (self.mu_below, self.weight_below)
        return _hemispherical(kernel, weight * mu)


def _hemispherical(kernel: Float[Array, "k o i"], weight: Float[Array, "o"]) -> Float[Array, "i"]:
    """weight : of each direction in projected solid angle over 2 pi."""
    return 2.0 * jnp.pi * weight @ kernel[0]


def _series(kernel: Float[Array, "k o i"], azimuth: Any) -> Float[Array, "..."]:
    return jnp.tensordot(jnp.cos(jnp.asarray(azimuth)[..., None] * np.arange(kernel.shape[0])), kernel, 1)


def reciprocal_matrices(
    stack: Stack, *, solver: DiscreteOrdinates | None = None, orders: int | None = None, like: Stack | None = None
) -> ReciprocalMatrices:
    """All R_k and T_k of a stack with its faces.

    The matrices of Stam's algorithm for any number of layers. Light scattered once between smooth faces is exact at each pair of ordinates, as far
    as the azimuthal orders go, like in predicted radiances; the shares that stay beams are those of delta-M. Behind rough faces transmitted light
    that was hardly scattered scatters about the truth at single ordinates, within 3 degrees of grazing by up to a fifth; sums over ordinates do not,
    nor do the radiances of `predict`. What a rough surface itself scatters back is exact at each ordinate for one facet.

    Arguments
    ---------
    stack : its numbers may be traced, so that the function can be compiled and differentiated.
    solver : sets the streams and tabulated phase functions.
    orders : azimuthal orders K, at most 3/2 of the ordinates of one hemisphere. Left out: as many as matter.
    like : a stack of the same layers with known numbers, from which the directions are laid out where the given one is traced.

    Raises InputError for layers without g, for orders that are no whole number from 1 to what the rule can tell apart, and for traced refractive
    indices or traced everything else without ``like``.

    >>> import layerfit as lf
    >>> slab = lf.Stack([lf.Layer("slab", sigma_a=0, sigma_s=2, g=0.5, n=1.4, thickness=1)])
    >>> m = lf.reciprocal_matrices(slab, solver=lf.DiscreteOrdinates(streams=16), orders=4)
    >>> m.r_tot.shape, abs(m.reflectance() + m.transmittance() - 1).max() < 1e-12
    ((4, 4, 4), Array(True, dtype=bool))

    References
    ----------
    J. Stam, Proc. Eurographics Workshop on Rendering, 39 (2001), sections 3 and 5.
    T. Nakajima, M. Tanaka, J. Quant. Spectrosc. Radiat. Transfer 40, 51 (1988), eq 22.
    """
    solver = DiscreteOrdinates() if solver is None else solver
    known = stack if like is None else like
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(known)):
        raise InputError("reciprocal_matrices: the stack has traced numbers; give like, a stack with known ones that stands for it")
    if like is not None and (like.names != stack.names or like.half_space != stack.half_space):
        raise InputError("reciprocal_matrices: like has other layers or numbers than the stack; allowed is the same stack with other values")
    solver.check(known, TotalReflectance())
    columns = to_columns(stack, rough_faces=_rough(known, stack))
    with jax.ensure_compile_time_eval():
        shape = plan(_domain(stack, known), solver, orders)
    return assemble(shape, columns, *optics(shape, columns))


class Shape(eqx.Module):
    """What is fixed before the numbers of a stack are known: its layout, and the numbers of ordinates above and below (0 under a half space)."""

    layout: Layout
    above: int = eqx.field(static=True)
    below: int = eqx.field(static=True)


def _rough(known: Stack, stack: Stack) -> tuple[bool, ...]:
    """Faces that are or, being traced, may be rough."""

    def faces(one: Stack) -> list:
        return [layer.roughness for layer in one.layers] + ([] if one.half_space else [one.roughness_below])

    return tuple(isinstance(b, Tracer) or float(a) > 0.0 for a, b in zip(faces(known), faces(stack), strict=True))


def _domain(stack: Stack, known: Stack) -> Domain:
    """A domain whose traced refractive indices are free to move."""
    columns = to_columns(known, rough_faces=_rough(known, stack))
    around = [stack.n_above, *(layer.n for layer in stack.layers), stack.n_below]
    width = _MOVES * np.array([isinstance(n, Tracer) for n in around])

    def moved(sign: float) -> Columns:
        scale = 1.0 + sign * width
        indices = (columns.n_above * scale[0], columns.n * scale[1:-1], columns.n_below * scale[-1])
        return eqx.tree_at(lambda c: (c.n_above, c.n, c.n_below), columns, indices)

    return Domain(known, moved(-1.0), moved(1.0))


def plan(domain: Domain, solver: DiscreteOrdinates, orders: int | None) -> Shape:
    """The shape of the matrices of all stacks of a domain. Raises InputError for wrong orders."""
    tables = tables_of(solver, domain.stack)
    streams = solver.streams or enough_streams(domain, angular=True)
    layout = lay_out(domain, streams, 1, tables)
    if orders is None:
        orders = enough_orders(domain, layout.terms, any(table is not None for table in tables), scatterings=1)
    if isinstance(orders, bool) or not isinstance(orders, int) or not 1 <= orders <= layout.terms:
        raise InputError(f"orders = {orders!r}; allowed with these streams: a whole number from 1 to {layout.terms}")
    layout = Layout(layout.groups, layout.counts, layout.terms, orders, tables)
    n = np.asarray(media(domain.low))
    distinct = np.array([n[layout.groups.index(group)] for group in range(len(layout.counts))])
    rank = np.argsort(np.argsort(distinct, kind="stable"), kind="stable")
    inside = np.cumsum(layout.counts)  # ordinates up to each panel: a medium has those of its own and all inner ones
    below = 0 if domain.stack.half_space else int(inside[rank[layout.groups[-1]]])
    return Shape(layout, int(inside[rank[layout.groups[0]]]), below)


@compiled
def optics(shape: Shape, columns: Columns) -> tuple[Grid, tuple[Response[Matrix], ...]]:
    """Directions and interfaces: what refractive indices and roughness alone decide."""
    grid = make_grid(shape.layout, columns, jnp.zeros(0), jnp.zeros(0))
    return grid, make_faces(columns, grid, shape.layout, 0)


@compiled
def assemble(shape: Shape, columns: Columns, grid: Grid, faces: tuple[Response[Matrix], ...], *, peaks: bool = True) -> ReciprocalMatrices:
    """The matrices of one stack. peaks : whether light transmitted after one scattering has its exact forward peak."""
    layout, a, b = shape.layout, shape.above, shape.below
    numbers = medium(layout, columns)
    parts = pieces(layout, columns, numbers, grid, faces, 0)
    first = parts[0].R_above
    if columns.half_space:
        whole = Response(reflection(parts), *[first.zero()] * 3)
        last = first.zero()
    else:
        whole, last = compose_all(parts), parts[-1].R_below
    count = max(a, b)
    lacking = _lacking(layout, columns, numbers, grid, faces, peaks)
    beams = regular(columns, numbers.tau, grid.rule.n, grid.mu[:, :count], grid.real[:, :count])
    n2 = (columns.n_above**2, columns.n_below**2)
    mu, root = (grid.mu[0][:a], grid.mu[-1][:b]), (grid.root[0][:a], grid.root[-1][:b])
    weight = [r**2 / (m * n) for r, m, n in zip(root, mu, n2, strict=True)]
    share = (2.0 - (np.arange(layout.orders) == 0)) / (2.0 * np.pi)

    def kernel(operator: Matrix, direct: Float[Array, "d"], out: int, into: int) -> Float[Array, "k o i"]:
        """Coefficients of a BRDF or BTDF from an operator, less what stays a beam. out, into : 0 above, 1 below."""
        rows, size = root[out].size, root[into].size
        scattered = operator.value[:, :rows, :size] - jnp.eye(rows, size) * direct[:size]
        return n2[out] * share[:, None, None] * scattered / (root[out][:, None] * root[into])

    scattered = (
        kernel(whole.R_above - first, beams.above, 0, 0),
        kernel(whole.R_below - last, beams.below, 1, 1),
        kernel(whole.T_down, beams.down, 1, 0),
        kernel(whole.T_up, beams.up, 0, 1),
    )
    shares = [_hemispherical(k, weight[out] * mu[out]) for k, out in zip(scattered, (0, 1, 1, 0), strict=True)]
    if lacking is not None:
        ends = ((lacking.R_above, 0, 0), (lacking.R_below, 1, 1), (lacking.T_down, 1, 0), (lacking.T_up, 0, 1))
        none = jnp.zeros(count)
        scattered = [k + kernel(Matrix(more.source), none, out, into) for k, (more, out, into) in zip(scattered, ends, strict=True)]
    surfaces = [kernel(first, beams.surface_above, 0, 0), kernel(last, beams.surface_below, 1, 1)]
    indices = (columns.n_above / columns.n[0], columns.n_below / columns.n[-1])
    for side, face in ((0, 0), (1, -1)):
        if not columns.smooth[face] and not (side == 1 and columns.half_space):
            surfaces[side] = _surface(mu[side], weight[side], indices[side], columns.roughness[face], surfaces[side])

    return ReciprocalMatrices(
        mu_above=mu[0],
        mu_below=mu[1],
        weight_above=weight[0],
        weight_below=weight[1],
        n_above=columns.n_above,
        n_below=columns.n_below,
        R_above=scattered[0],
        R_below=scattered[1],
        T_down=scattered[2],
        T_up=scattered[3],
        surface_above=surfaces[0],
        surface_below=surfaces[1],
        regular_surface_above=beams.surface_above[:a],
        regular_surface_below=beams.surface_below[:b],
        regular_above=beams.above[:a],
        regular_below=beams.below[:b],
        regular_down=beams.down[:a],
        regular_up=beams.up[:b],
        share_above=shares[0],
        share_below=shares[1],
        share_down=shares[2],
        share_up=shares[3],
    )


def _lacking(
    layout: Layout, columns: Columns, numbers: Medium, grid: Grid, faces: tuple[Response[Matrix], ...], peaks: bool
) -> Response[Beamed] | None:
    """What the operators lack of light scattered once, the sources of these; None where rough faces let no beam in."""
    if not columns.smooth[0] and (columns.half_space or not columns.smooth[-1]):
        return None
    parts = missing_orders(layout, columns, numbers, grid, faces)
    if columns.half_space:
        up = reflection(parts)
        return Response(up, *[up.zero()] * 3)
    whole = compose_all(parts)
    return whole if peaks else Response(whole.R_above, whole.R_below, whole.T_down.zero(), whole.T_up.zero())


def _surface(
    mu: Float[Array, "a"], weight: Float[Array, "a"], n: Float[Array, ""], roughness: Float[Array, ""], kernel: Float[Array, "k a a"]
) -> Float[Array, "k a a"]:
    """What a rough face scatters back, at the ordinates themselves: one facet in closed form, and evenly what is then missing of each share.

    kernel : the same as the rule deposits it between its ordinates, which has the right share in all directions and not the right value in each.
    """
    azimuth = 2.0 * np.pi * (np.arange(_AZIMUTHS) + 0.5) / _AZIMUTHS
    value = brdf(mu[None, :, None], mu[:, None, None], jnp.asarray(azimuth), n, roughness)
    k = np.arange(kernel.shape[0])
    modes = (2.0 - (k[:, None] == 0)) / _AZIMUTHS * np.cos(k[:, None] * azimuth)
    once = jnp.einsum("oif,kf->koi", value, modes)
    solid = 2.0 * jnp.pi * weight * mu  # of sum pi
    missing = solid @ (kernel[0] - once[0])
    even = (missing[:, None] + missing[None, :]) / jnp.pi - (solid @ missing) / jnp.pi**2
    return once.at[0].add(even)
