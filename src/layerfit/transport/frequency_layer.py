"""Response of a homogeneous layer in discrete ordinates at one spatial frequency, all azimuthal orders together.

With y_m = i^m I_m, I_m the orders of the radiance in cos(m phi), all is real: the matrices P and M of every order (see `ordinate_functions`) stand on
the diagonal, and streaming sideways adds the same antisymmetric k J to both. With s and d the sum and the difference of down- and upwelling light,
ds/dz = -A d and dd/dz = -B s, A = P + k J, B = M + k J, in 1/mm. A layer of half thickness h has Y = h phi(X) A, Z = h B phi(X), X = h^2 A B,
phi(x) = tanh(sqrt x)/sqrt x. The beam is one more channel, the last; it feeds the others and is not fed.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Complex, Float

from ..arrays import AnyArray
from ..optics.linear_algebra import inverse


class Sheet(NamedTuple):
    """One layer in all azimuthal orders. P, M [1/mm] : orders one after another. p, q : borders of the beam, which only feeds order 0. rate : of its
    attenuation [1/mm]. tangent : of each direction. depth : thickness [mm], 0 for a half space. decay : of diffuse light, squared [1/mm^2]."""

    P: Float[Array, "orders n n"]
    M: Float[Array, "orders n n"]
    p: Float[Array, "n"]
    q: Float[Array, "n"]
    rate: Float[Array, ""]
    tangent: Float[Array, "n"]
    depth: Float[Array, ""]
    decay: Float[Array, ""]


def matrices(sheet: Sheet, k: Float[Array, ""], share: Float[Array, "n"]) -> tuple[Float[Array, "c c"], Float[Array, "c c"]]:
    """A and B at spatial frequency k [1/mm]. share : see `Closing`."""
    orders = sheet.P.shape[0]
    last = jnp.zeros((orders, orders)).at[-1, -1].set(0.5)
    sideways = k * (jnp.kron(coupling(orders), jnp.diag(sheet.tangent)) + jnp.kron(last, jnp.diag(share * sheet.tangent)))
    return tuple(_bordered(all_orders(diagonal) + sideways, -border, sheet.rate) for diagonal, border in ((sheet.P, sheet.p), (sheet.M, sheet.q)))  # pyright: ignore[reportReturnType]


def all_orders(blocks: Float[Array, "orders n n"]) -> Float[Array, "c c"]:
    """One matrix over all orders from its blocks on the diagonal."""
    orders, n, _ = blocks.shape
    return (jnp.eye(orders)[:, None, :, None] * blocks[:, :, None, :]).reshape(orders * n, orders * n)


def coupling(orders: int) -> np.ndarray:
    """Streaming along cos(phi) between neighbouring orders, after the factors i^m, cut off after the last order.

    Cut off, the chain reflects what should run on to higher orders: at large k that converges slowly. An unscattered chain hands on the share
    rho = sqrt(1 + x^2) - x, x = 1/(k tan theta) in mean free paths; half of such a share stands at the end of the chain of each direction
    (`Closing`), and three or four orders then do what eight would without it.
    """
    steps = np.full(orders - 1, 0.5)
    steps[:1] = np.sqrt(0.5)
    return np.diag(steps, -1) - np.diag(steps, 1)


class Closing(NamedTuple):
    """How the chain of azimuthal orders ends, for each direction (and frequency, before these are mapped over).

    share : handed on by the last order. modes : eigenvalues of the chain, cosines of azimuths, times i. vectors, inverse : orders of each mode, and
    how much of each mode the orders make.
    """

    share: Float[AnyArray, "*k n"]
    modes: Complex[AnyArray, "*k n o"]
    vectors: Complex[AnyArray, "*k n o o"]
    inverse: Complex[AnyArray, "*k n o o"]


def closing(orders: int, share: np.ndarray) -> Closing:
    """The chain with its modes. share : see `Closing`."""
    chain = np.zeros((*share.shape, orders, orders), complex) + coupling(orders)
    chain[..., -1, -1] = 0.5 * share
    modes, vectors = np.linalg.eig(chain)
    return Closing(share, modes, vectors, np.linalg.inv(vectors))


def _bordered(square: Float[Array, "c c"], fed: Float[Array, "n"], corner: Float[Array, ""]) -> Float[Array, "c1 c1"]:
    """With the beam as last channel."""
    size = square.shape[0]
    column = jnp.concatenate([fed, jnp.zeros(size - fed.shape[0])])
    return jnp.concatenate([jnp.concatenate([square, column[:, None]], axis=1), jnp.zeros((1, size + 1)).at[0, -1].set(corner)], axis=0)


def _rational(A: Float[Array, "c c"], B: Float[Array, "c c"], h: Float[Array, ""]) -> tuple[Float[Array, "c c"], Float[Array, "c c"]]:
    """Y and Z of a thin layer, phi(x) = (945 + 105 x + x^2)/(945 + 420 x + 15 x^2)."""
    X = h**2 * (A @ B)
    X2 = X @ X
    one = jnp.eye(A.shape[0])
    phi = inverse(945.0 * one + 420.0 * X + 15.0 * X2) @ (945.0 * one + 105.0 * X + X2)
    return h * (phi @ A), h * (B @ phi)


def _ends(Y: Float[Array, "c c"], Z: Float[Array, "c c"]) -> tuple[Float[Array, "c c"], Float[Array, "c c"]]:
    """R and T: R + T = (1 - Z)(1 + Z)^-1, R - T = -(1 - Y)(1 + Y)^-1."""
    one = jnp.eye(Y.shape[0])
    Zi, Yi = inverse(one + jnp.stack([Z, Y]))
    return Zi - Yi, Zi + Yi - one


def _weights(least: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """a, b, c of x (a + b x^2)/(1 + c x^2), which brings what lies between least and 1 as near to 1 as can be; at least = 1 it is tanh(3 artanh x).

    References
    ----------
    Y. Nakatsukasa, Z. Bai, F. Gygi, SIAM J. Matrix Anal. Appl. 31, 2700 (2010): the dynamically weighted Halley iteration.
    """
    square = least**2
    d = jnp.cbrt(4.0 * (1.0 - square)) / jnp.cbrt(square) ** 2
    root = jnp.sqrt(1.0 + d)
    a = root + jnp.sqrt(2.0 - d + 2.0 * (2.0 - square) / (square * root))
    b = 0.25 * (a - 1.0) ** 2
    return a, b, a + b - 1.0


_ACROSS = 0.1
_DEEP, _FAR, _EACH = 7, 1600.0, 3.0  # steps of a half space for frequencies up to so many times sigma_t', another for each such factor above


def deep_steps(ratio: float) -> int:
    """Steps that a half space needs for frequencies up to ratio times its sigma_t'.

    >>> deep_steps(100.0), deep_steps(4000.0)
    (7, 8)
    """
    return _DEEP + times(ratio / _FAR, _EACH)


def times(ratio: float, factor: float) -> int:
    """How often to multiply by a factor to get to a ratio.

    >>> times(0.5, 2.0), times(4.1, 2.0)
    (0, 3)
    """
    return int(np.ceil(np.log(max(ratio, 1.0)) / np.log(factor)))


def thick_layer(
    sheet: Sheet, k: Float[Array, ""], share: Float[Array, "n"], steps: int, deep: Float[Array, ""]
) -> tuple[Float[Array, "c c"], Float[Array, "c c"]]:
    """R and T of a layer that dims a beam by half or more, by tripling its thickness; of a half space where ``deep`` is 1 (0 elsewhere).

    tanh(3 x) = tanh(x) (3 + tanh(x)^2)/(1 + 3 tanh(x)^2), as matrices F Y and Z F with F = (1 + 8 (1 + 3 Y Z)^-1)/3: no dearer than doubling.
    Fast modes of a finite layer are wrong at the start and right in the end: tripling is also Halley's iteration for their limit. In a half space all
    modes reach it, Y Z = 1, and each step is weighted by where the slowest of them still is; how slow need not be known well.

    References
    ----------
    N. J. Higham, Functions of Matrices (2008), section 5.4 (for the sign function), and see `_weights`.
    """
    A, B = matrices(sheet, k, share)
    one = jnp.eye(A.shape[0])
    Y, Z = _rational(A, B, 0.5 * sheet.depth / 3.0**steps)
    fastest = jax.lax.stop_gradient(jnp.max(jnp.sum(jnp.abs(A), axis=1)) * jnp.max(jnp.sum(jnp.abs(B), axis=1)))
    across = sheet.rate**2 + (_ACROSS * k) ** 2  # at large k the slowest modes run straight down, or across the wave
    slowest = jax.lax.stop_gradient(jnp.minimum(jnp.minimum(k**2 + sheet.decay, across), fastest))
    Y, Z = (jnp.where(deep, whole * jax.lax.rsqrt(fastest), start) for whole, start in ((A, Y), (B, Z)))

    def step(state, _):
        Y, Z, least = state
        a, b, c = _weights(least)
        F = (b / c) * one + (a - b / c) * inverse(one + c * (Y @ Z), often=True)
        return (F @ Y, Z @ F, jnp.minimum(least * (a + b * least**2) / (1.0 + c * least**2), 1.0)), None

    (Y, Z, _), _ = jax.lax.scan(step, (Y, Z, jnp.where(deep, jnp.sqrt(slowest / fastest), 1.0)), length=steps)
    R, T = _ends(Y, Z)
    return jnp.where(deep, R + T, R), jnp.where(deep, 0.0, T)


def thin_layer(sheet: Sheet, k: Float[Array, ""], share: Float[Array, "n"], steps: int) -> tuple[Float[Array, "c c"], Float[Array, "c c"]]:
    """R and T of a layer that may be clear, by doubling R and T: there Y and Z have poles, where light sideways has gone through half a period."""
    A, B = matrices(sheet, k, share)
    one = jnp.eye(A.shape[0])

    def double(pair, _):
        R, T = pair
        passed = T @ inverse(one - R @ R, often=True)
        return (R + passed @ R @ T, passed @ T), None

    pair, _ = jax.lax.scan(double, _ends(*_rational(A, B, 0.5 * sheet.depth / 2.0**steps)), length=steps)
    return pair
