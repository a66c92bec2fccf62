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
        cosine = sign * along[:, None] + across[:, None] * np.cos(phi)
        table = layout.tables[i]
        exact = henyey_greenstein(cosine, columns.g[i]) if table is None else legendre_series(cosine, np.array(table))
        expanded = jnp.tensordot(factor, kernel.even_corner[:, :, 0] + sign * kernel.odd_corner[:, :, 0], 1)
        missing.append(jnp.mean(exact, axis=1) / (1.0 - numbers.forward[i]) - expanded)
    strength = 0.5 * numbers.albedo[i] * directions.weight[n:-1] * directions.weight[-1] / (2.0 * np.pi)
    rate_v, rate_b = 1.0 / mu_v, 1.0 / mu_b
    total = rate_v + rate_b
    if i < columns.thickness.shape[0]:
        tau = numbers.tau[i]
        back = tau * expc(tau * total)
        through = tau * jnp.exp(-tau * jnp.minimum(rate_v, rate_b)) * expc(tau * jnp.abs(rate_v - rate_b))
        passing = jnp.exp(-tau * jnp.concatenate([rate_v, rate_b[None]]))
    else:
        back, through, passing = 1.0 / total, jnp.zeros_like(total), jnp.zeros(mu_v.size + 1)
    R = _corner(strength * missing[1] * back, jnp.zeros_like(passing))
    T = _corner(strength * missing[0] * through, passing)
    return Response(R, R, T, T)


def _corner(corner: Float[Array, "v"], diagonal: Float[Array, "e"]) -> Matrix:
    return Matrix(jnp.diag(diagonal).at[:-1, -1].set(corner))
