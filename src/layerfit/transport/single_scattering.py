"""The single-scattered light that delta-M and a finite number of azimuthal orders get wrong, put right (the TMS method).

Light scattered once goes from beam to line of sight without the ordinates, so that its exact phase function can be used, and what the ordinates'
expansion made of it taken out again. Both pass through the stack with the same attenuation, refraction and reflections.

References
----------
T. Nakajima, M. Tanaka, J. Quant. Spectrosc. Radiat. Transfer 40, 51 (1988), eq 22.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..optics.phase import henyey_greenstein, legendre_series
from ..optics.special import expc
from ..scene.columns import Columns
from .discrete_ordinates_layer import Directions, scattering
from .matrix import Matrix
from .ordinate_stack import Grid, Layout, Medium
from .response import Response

_AZIMUTHS = 128  # for the average over azimuth


def correction(
    layout: Layout, columns: Columns, numbers: Medium, grid: Grid, faces: tuple[Response[Matrix], ...], azimuth: float | None
) -> list[Response[Matrix]]:
    """Pieces from top to bottom over lines of sight and one beam; their corner, composed, is what the radiance lacks per power of the beam.

    azimuth : between the beam's way and the line of sight [rad]; None: the average.
    """
    n = grid.root.shape[1]
    views = grid.mu.shape[1] - n - 1
    result = []
    for i in range(columns.count):
        result.append(_face(faces[i], views, n))
        rows = (grid.mu[i + 1], grid.weight[i + 1], grid.root[i + 1])
        result.append(_layer(layout, columns, numbers, i, Directions(*rows), grid.legendre[i], azimuth))
    return result + ([] if columns.half_space else [_face(faces[-1], views, n)])


def _face(face: Response[Matrix], views: int, n: int) -> Response[Matrix]:
    """An interface without its ordinates. What a rough one scatters is in their solution; it lets no beam through."""
    kept = np.concatenate([np.arange(views), np.array([views + n])])
    return jax.tree.map(lambda x: jnp.diag(jnp.diagonal(x[0])[kept]), face)


def _layer(
    layout: Layout, columns: Columns, numbers: Medium, i: int, directions: Directions, legendre: Float[Array, "orders l c"], azimuth: float | None
) -> Response[Matrix]:
    n = directions.root.shape[0]
    mu_v, mu_b = directions.mu[n:-1], directions.mu[-1]
    phi = np.array([azimuth]) if azimuth is not None else 2.0 * np.pi * (np.arange(_AZIMUTHS) + 0.5) / _AZIMUTHS
    along, across = mu_v * mu_b, jnp.sqrt((1.0 - mu_v**2) * (1.0 - mu_b**2) + 1e-300)
    order = np.arange(layout.orders)
    kernel = jax.vmap(lambda rows, m: scattering(numbers.moments[i], rows, directions, m, 1))(legendre, order.astype(float))
    factor = np.where(order == 0, 1.0, 2.0) * np.cos(order * (azimuth or 0.0))
    missing = []
    for sign in (1.0, -1.0):  # the same hemisphere, the other
        exact = _phase(layout, columns, i, sign * along[:, None] + across[:, None] * np.cos(phi))
        expanded = jnp.tensordot(factor, kernel.even_corner[:, :, 0] + sign * kernel.odd_corner[:, :, 0], 1)
        missing.append(jnp.mean(exact, axis=1) / (1.0 - numbers.forward[i]) - expanded)
    strength = 0.5 * numbers.albedo[i] * directions.weight[n:-1] * directions.weight[-1] / (2.0 * np.pi)
    back, through, passing = _depths(jnp.append(1.0 / mu_v, 1.0 / mu_b), numbers, i, slice(0, -1), slice(-1, None))
    R = _corner(strength * missing[1] * back[:, 0], jnp.zeros_like(passing))
    T = _corner(strength * missing[0] * through[:, 0], passing)
    return Response(R, R, T, T)


def _corner(corner: Float[Array, "v"], diagonal: Float[Array, "e"]) -> Matrix:
    return Matrix(jnp.diag(diagonal).at[:-1, -1].set(corner))


def _phase(layout: Layout, columns: Columns, i: int, cosine: Array) -> Array:
    """The exact phase function of a layer, of mean 1."""
    table = layout.tables[i]
    return henyey_greenstein(cosine, columns.g[i]) if table is None else legendre_series(cosine, np.array(table))


def _depths(rate: Float[Array, "d"], numbers: Medium, i: int, views: slice, beams: slice) -> tuple[Array, Array, Array]:
    """Integrals over the depth of the scattering, for what leaves where the beam came in and where it goes out: (views, beams). Then what passes.

    rate : 1/cosine of all directions.
    """
    rate_v, rate_b = rate[views, None], rate[None, beams]
    total = rate_v + rate_b
    if i >= numbers.tau.shape[0]:
        return 1.0 / total, jnp.zeros_like(total), jnp.zeros_like(rate)
    tau = numbers.tau[i]
    through = tau * jnp.exp(-tau * jnp.minimum(rate_v, rate_b)) * expc(tau * jnp.abs(rate_v - rate_b))
    return tau * expc(tau * total), through, jnp.exp(-tau * rate)


_ROUND = 512  # azimuths from 0 to pi for the orders of a phase function: g to 0.98


def pairs(layout: Layout, columns: Columns, numbers: Medium, grid: Grid, faces: tuple[Response[Matrix], ...]) -> list[Response[Matrix]]:
    """Pieces from top to bottom over ordinates as lines of sight and once more as beams, by azimuthal order; their corner, composed, is what the
    operators of the stack lack between ordinates (see `corner`)."""
    result = []
    for i in range(columns.count):
        result += [_twice(faces[i], columns.smooth[i]), _between(layout, columns, numbers, grid, i)]
    return result + ([] if columns.half_space else [_twice(faces[-1], columns.smooth[-1])])


def corner(operator: Matrix) -> Float[Array, "orders n n"]:
    """From ordinates as beams to ordinates as lines of sight."""
    n = operator.value.shape[-1] // 2
    return operator.value[:, :n, n:]


def _twice(face: Response[Matrix], smooth: bool) -> Response[Matrix]:
    """An interface; a rough one lets no beam through."""

    def one(x: Float[Array, "orders n n"]) -> Float[Array, "orders n2 n2"]:
        shares = jnp.diagonal(x, axis1=1, axis2=2) * float(smooth)
        return jnp.eye(2 * x.shape[1]) * jnp.concatenate([shares, shares], axis=1)[:, None, :]

    return jax.tree.map(one, face)


def _between(layout: Layout, columns: Columns, numbers: Medium, grid: Grid, i: int) -> Response[Matrix]:
    n = grid.root.shape[1]
    directions = Directions(grid.mu[i + 1][:n], grid.weight[i + 1][:n], grid.root[i + 1])
    order = np.arange(layout.orders)
    kernel = jax.vmap(lambda rows, m: scattering(numbers.moments[i], rows, directions, m, 0))(grid.legendre[i][:, :, :n], order.astype(float))
    mu, phi = directions.mu, np.pi * (np.arange(_ROUND) + 0.5) / _ROUND
    along, across = mu[:, None] * mu, jnp.sqrt((1.0 - mu[:, None] ** 2) * (1.0 - mu**2) + 1e-300)
    cosines = np.cos(phi[:, None] * order) / _ROUND
    strength = 0.5 * numbers.albedo[i] * directions.weight[:, None] * directions.weight
    back, through, passing = _depths(1.0 / mu, numbers, i, slice(None), slice(None))

    def lacking(sign: float, depth: Float[Array, "n n"]) -> Float[Array, "orders n n"]:
        exact = _phase(layout, columns, i, sign * along[..., None] + across[..., None] * np.cos(phi)) @ cosines
        return strength * depth * (jnp.moveaxis(exact, -1, 0) / (1.0 - numbers.forward[i]) - kernel.even - sign * kernel.odd)

    def whole(corner: Float[Array, "orders n n"], diagonal: Float[Array, "n"]) -> Matrix:
        straight = jnp.broadcast_to(jnp.diag(diagonal), corner.shape)
        upper = jnp.concatenate([straight, corner], axis=2)
        return Matrix(jnp.concatenate([upper, jnp.concatenate([jnp.zeros_like(corner), straight], axis=2)], axis=1))

    R, T = whole(lacking(-1.0, back), jnp.zeros(n)), whole(lacking(1.0, through), passing)
    return Response(R, R, T, T)
