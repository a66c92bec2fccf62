"""Light that crosses a layer without being scattered, at one spatial frequency.

A few ordinates are a few cones of light: behind a layer that hardly scatters, one sharp ring each, where there should be a smooth spot. The radiance
is smooth in angle, only its phase k d tan(theta) is not. Within each panel of directions it is therefore interpolated between the ordinates, crosses
on all directions of a fine rule, and is projected onto the same polynomials again (`rays_between`). Nothing changes where the phase is small: a clear
layer at k = 0 remains the identity. Radiances are in the azimuthal orders y_m of `frequency_layer`.
"""

from functools import cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from ..arrays import AnyArray
from ..optics.gauss import unit_gauss
from ..optics.quadrature import Ordinates, cosine, in_panel, node_polynomials
from .frequency_layer import Closing

_DIRECTIONS = 48  # of each panel
_AZIMUTHS = 32  # of half a circle


class Fine(NamedTuple):
    """Directions between the ordinates, one row a layer.

    basis : polynomials of the ordinates times the root of the weights of both. mu, tangent : of the directions. spacing : of their tangents.
    """

    basis: Float[AnyArray, "f n"]
    mu: Float[AnyArray, "layers f"]
    tangent: Float[AnyArray, "layers f"]
    spacing: Float[AnyArray, "layers f"]
    real: Bool[AnyArray, "layers f"]


def fine_directions(rule: Ordinates, counts: tuple[int, ...], layers: int) -> Fine:
    """layers : how many media follow the first."""
    y, w = unit_gauss(_DIRECTIONS)
    blocks, places, steps = [], [], []
    low, start = jnp.zeros(()), 0
    for k, count in enumerate(counts):
        x, weight = unit_gauss(count)
        basis = node_polynomials(count, y).T * np.sqrt((w * y)[:, None] / (weight * x))
        blocks.append(np.pad(basis, ((0, 0), (start, sum(counts) - start - count))))
        _, W, p = in_panel(low, rule.edges[k], y, w)
        places.append(p)
        steps.append(W / p)  # W stands for p dp
        low, start = rule.edges[k], start + count
    p, step = jnp.concatenate(places), jnp.concatenate(steps)
    n = rule.n[1 : layers + 1, None]
    mu, real = cosine(n, p[None])
    tangent = jnp.where(real, p / (n * mu), 0.0)
    return Fine(np.concatenate(blocks), mu, tangent, jnp.where(real, step / (n * mu**3), 0.0), real)


class Crossing(NamedTuple):
    """Transmission of a layer for light that it does not scatter, the beam left out.

    rays : of each ordinate alone, between azimuthal orders. whole : with all directions between the ordinates; None where that is not asked for.
    """

    rays: Float[Array, "n o o"]
    whole: Float[Array, "o n o n"] | None

    def __call__(self, light: Float[AnyArray, "o n"]) -> Float[Array, "o n"]:
        if self.whole is None:
            return jnp.einsum("nij,jn->in", self.rays, light)
        return jnp.tensordot(self.whole, light, 2)

    def lacking(self) -> Float[Array, "c c"] | float:
        """What the rays alone get wrong, over all orders and ordinates."""
        if self.whole is None:
            return 0.0
        n, orders, _ = self.rays.shape
        alone = jnp.moveaxis(self.rays, 0, 1)[:, :, :, None] * jnp.eye(n)[:, None]
        return (self.whole - alone).reshape(orders * n, orders * n)


def rays(
    k: Float[Array, ""], rate: Float[Array, "n"], tangent: Float[Array, "n"], depth: Float[Array, ""], closing: Closing
) -> Float[Array, "n o o"]:
    """The ordinates' own transmission. rate : along each, per depth [1/mm]. depth : of the layer [mm]."""
    dim = jnp.exp(-(rate[:, None] + k * tangent[:, None] * closing.modes) * depth)
    return jnp.einsum("nim,nm,nmj->nij", closing.vectors, dim, closing.inverse).real


def rays_between(fine: Fine, i: int, k: Float[Array, ""], rate: Float[Array, ""], depth: Float[Array, ""], orders: int) -> Float[Array, "o n o n"]:
    """The same with all directions. i : the layer. rate : of the beam [1/mm]."""
    cosines, even, odd = _turns(orders)
    wave = k * depth * fine.tangent[i][:, None] * cosines
    turned = jnp.tensordot(jnp.cos(wave), even, 1) + jnp.tensordot(jnp.sin(wave), odd, 1)
    blur = (k * depth * fine.spacing[i]) ** 2 / 8.0  # between directions too far apart to tell the phase
    dim = jnp.exp(-rate * depth / fine.mu[i] - blur) * fine.real[i]
    return jnp.einsum("fa,fij,fb->iajb", fine.basis, dim[:, None, None] * turned, fine.basis)


@cache
def _turns(orders: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For the phase exp(-i x cos(phi)) between orders y_m = (-i)^m I_m: cosines of azimuths, and by which cos(x cos(phi)) and sin(x cos(phi)) there
    count for each pair of orders (Jacobi and Anger's series, by the midpoint rule)."""
    phi = (np.arange(_AZIMUTHS) + 0.5) * np.pi / _AZIMUTHS
    m = np.arange(orders)
    wave = np.where(m == 0, 1.0, np.sqrt(2.0)) * np.cos(np.outer(phi, m))
    apart = m[:, None] - m
    even = apart % 2 == 0
    sign = (-1.0) ** np.where(even, apart // 2, (apart + 1) // 2)
    pairs = wave[:, :, None] * wave[:, None, :] * sign / _AZIMUTHS
    return np.cos(phi), pairs * even, pairs * ~even
