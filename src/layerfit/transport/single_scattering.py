"""The single-scattered light that delta-M and a finite number of azimuthal orders get wrong, put right (the TMS method).

Light scattered once goes from beam to line of sight without the ordinates, so that its exact phase function can be used, and what the ordinates'
expansion made of it taken out again. Both pass through the stack with the same attenuation, refraction and reflections: for each pair of directions
a diffuse channel (the line of sight) fed by a collimated one (the beam).

References
----------
T. Nakajima, M. Tanaka, J. Quant. Spectrosc. Radiat. Transfer 40, 51 (1988), eq 22.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..arrays import AnyArray
from ..optics.phase import henyey_greenstein, legendre_series
from ..optics.special import expc
from ..scene.columns import Columns
from .discrete_ordinates_layer import Directions, scattering
from .matrix import Matrix
from .ordinate_stack import Grid, Layout, Medium
from .response import Beamed, Nothing, Response, nothing

_ROUND = 512  # azimuths from 0 to pi for the orders of a phase function: g to 0.98

Missing = Callable[[int], list[Array]]  # what the phase function of layer i lacks, into the same hemisphere and into the other
_HEMISPHERES = (1.0, -1.0)


def missing_radiances(
    layout: Layout,
    columns: Columns,
    numbers: Medium,
    grid: Grid,
    faces: tuple[Response[Matrix], ...],
    sights: int,
    which: tuple[int, ...],
    azimuths: Float[AnyArray, "s t"],
) -> list[Response[Beamed]]:
    """Pieces from top to bottom between lines of sight (rows) and beams (columns); the source of their operators, composed, is what the radiance
    lacks per power of the beam.

    sights : number of lines of sight. which : of the grid's beams. azimuths : between the way of each of these and the lines of sight [rad]; the
    mean over them (the leading axis) is taken.
    """
    n = grid.root.shape[1]
    beams = grid.mu.shape[1] - n - sights
    seen, lit = np.arange(n, n + sights), n + sights + np.array(which)
    order = np.arange(layout.orders)
    factor = jnp.mean(np.where(order == 0, 1.0, 2.0)[:, None, None] * jnp.cos(order[:, None, None] * azimuths), axis=1)

    def missing(i: int) -> list[Array]:
        directions = Directions(grid.mu[i + 1], grid.weight[i + 1], grid.root[i + 1])
        kernel = jax.vmap(lambda rows, m: scattering(numbers.moments[i], rows, directions, m, beams))(grid.legendre[i], order.astype(float))

        def into(sign: float) -> Float[Array, "v t"]:
            expanded = jnp.einsum("mt,mvt->vt", factor, (kernel.even_corner + sign * kernel.odd_corner)[:, :, np.array(which)])
            exact = jnp.mean(_phase(layout, columns, i, sign, directions.mu[seen], directions.mu[lit], azimuths[:, None, :]), axis=0)
            return (exact / (1.0 - numbers.forward[i]) - expanded) / (2.0 * np.pi)

        return [into(sign) for sign in _HEMISPHERES]

    return _pieces(columns, numbers, grid, faces, sights, seen, lit, missing)


def missing_orders(layout: Layout, columns: Columns, numbers: Medium, grid: Grid, faces: tuple[Response[Matrix], ...]) -> list[Response[Beamed]]:
    """The same between all pairs of ordinates, by azimuthal order."""
    n = grid.root.shape[1]
    order = np.arange(layout.orders)
    phi = np.pi * (np.arange(_ROUND) + 0.5) / _ROUND
    cosines = np.cos(phi[:, None] * order) / _ROUND

    def missing(i: int) -> list[Array]:
        directions = Directions(grid.mu[i + 1][:n], grid.weight[i + 1][:n], grid.root[i + 1])
        kernel = jax.vmap(lambda rows, m: scattering(numbers.moments[i], rows, directions, m, 0))(grid.legendre[i][:, :, :n], order.astype(float))

        def into(sign: float) -> Float[Array, "orders n n"]:
            exact = jnp.tensordot(_phase(layout, columns, i, sign, directions.mu, directions.mu, phi[:, None, None]), cosines, ((0,), (0,)))
            return jnp.moveaxis(exact, -1, 0) / (1.0 - numbers.forward[i]) - kernel.even - sign * kernel.odd

        return [into(sign) for sign in _HEMISPHERES]

    return _pieces(columns, numbers, grid, faces, 0, np.arange(n), np.arange(n), missing)


def _pieces(
    columns: Columns,
    numbers: Medium,
    grid: Grid,
    faces: tuple[Response[Matrix], ...],
    sights: int,
    seen: np.ndarray,
    lit: np.ndarray,
    missing: Missing,
) -> list[Response[Beamed]]:
    """Faces and layers from top to bottom. seen, lit : lines of sight and beams, as the grid counts directions."""
    result: list[Response[Beamed]] = []
    for i in range(columns.count):
        result.append(_face(faces[i], columns.smooth[i], grid, sights, seen, lit))
        result.append(_layer(numbers, grid, i, seen, lit, missing(i)))
    return result + ([] if columns.half_space else [_face(faces[-1], columns.smooth[-1], grid, sights, seen, lit)])


def _face(face: Response[Matrix], smooth: bool, grid: Grid, sights: int, seen: np.ndarray, lit: np.ndarray) -> Response[Beamed]:
    """An interface without its ordinates. What a rough one scatters is in their solution; it lets no beam through."""
    one, none = jnp.ones(()), jnp.zeros(())
    if isinstance(face, Nothing):
        return nothing(Beamed(one, none, one))
    n = grid.root.shape[1]

    def passed(operator: Matrix) -> Beamed:
        share = jnp.diagonal(operator.value[0]) * float(smooth)
        share = jnp.concatenate([share[sights : sights + n], share[:sights], share[sights + n :]])
        return Beamed(share[seen, None], none, share[lit])

    return Response(passed(face.R_above), passed(face.R_below), passed(face.T_down), passed(face.T_up))


def _layer(numbers: Medium, grid: Grid, i: int, seen: np.ndarray, lit: np.ndarray, missing: list[Array]) -> Response[Beamed]:
    """A layer. missing : of its phase function, into the same hemisphere and into the other."""
    mu, weight = grid.mu[i + 1], grid.weight[i + 1]
    strength = 0.5 * numbers.albedo[i] * weight[seen, None] * weight[lit]
    rate_v, rate_b = 1.0 / mu[seen, None], 1.0 / mu[lit]
    none = jnp.zeros(())
    if i >= numbers.tau.shape[0]:  # a half space
        R, dark = Beamed(none, strength * missing[1] / (rate_v + rate_b), none), Beamed(none, none, none)
        return Response(R, dark, dark, dark)
    tau = numbers.tau[i]
    back = tau * expc(tau * (rate_v + rate_b))
    through = tau * jnp.exp(-tau * jnp.minimum(rate_v, rate_b)) * expc(tau * jnp.abs(rate_v - rate_b))
    R = Beamed(none, strength * missing[1] * back, none)
    T = Beamed(jnp.exp(-tau * rate_v), strength * missing[0] * through, jnp.exp(-tau * rate_b))
    return Response(R, R, T, T)


def _phase(layout: Layout, columns: Columns, i: int, sign: float, mu_v: Float[Array, "v"], mu_b: Float[Array, "b"], phi: AnyArray) -> Array:
    """The exact phase function of a layer, of mean 1, from beams into lines of sight at azimuths phi (any leading axes, then both)."""
    across = jnp.sqrt((1.0 - mu_v[:, None] ** 2) * (1.0 - mu_b**2) + 1e-300)
    cosine = sign * mu_v[:, None] * mu_b + across * jnp.cos(phi)
    table = layout.tables[i]
    return henyey_greenstein(cosine, columns.g[i]) if table is None else legendre_series(cosine, np.array(table))
