"""Response of a homogeneous layer and of a half space in discrete ordinates, at one azimuthal order.

Channels: lines of sight (v), ordinates (n), beams (b), in this order. An ordinate carries sqrt(W) I/n^2, a beam F (2 - delta_m0)/(2 pi), F its power
per horizontal area, a line of sight I/n^2. In these units all reflections are symmetric matrices, whatever the index, and every operator is block
triangular: beams feed the others, lines of sight are fed.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..arrays import AnyArray
from ..compilation import at_once
from ..optics.linear_algebra import inverse
from .matrix import Matrix
from .ordinate_functions import Parts, Problem, half_space, slab
from .response import Response


class Directions(NamedTuple):
    """Directions in one medium and how much light they stand for.

    mu : cosines of ordinates, then lines of sight, then beams. weight : sqrt(W)/(mu n), with W = 1 for the latter two; 0 where the medium does not
    have the direction. root : sqrt(W) of the ordinates, 0 where absent.
    """

    mu: Float[AnyArray, "c"]
    weight: Float[AnyArray, "c"]
    root: Float[AnyArray, "n"]


class Scattering(NamedTuple):
    """What a layer scatters between directions, at one azimuthal order: sums of (2 l + 1) chi_l Lambda_l(mu) Lambda_l(mu').

    odd, even : over odd and even l + m: twice the difference and the sum of scattering into the same and the other hemisphere. The corners are those
    from beams into lines of sight.
    """

    odd: Float[Array, "n c"]
    even: Float[Array, "n c"]
    odd_corner: Float[Array, "v b"]
    even_corner: Float[Array, "v b"]


def scattering(
    moments: Float[Array, "l"], legendre: Float[AnyArray, "l c"], directions: Directions, order: Float[AnyArray, ""], beams: int
) -> Scattering:
    """Scattering by a phase function of given moments.

    legendre : see `optics.phase.legendre_functions`, at one order. At order 0 what is scattered is made to be 1 exactly under the quadrature, by a
    symmetric correction: mapped rules integrate the phase function only nearly.
    """
    n = directions.root.shape[0]
    l = np.arange(legendre.shape[0])
    scaled = ((2 * l + 1) * moments)[:, None] * legendre
    parity = ((l + order) % 2)[:, None]
    views = slice(n, legendre.shape[1] - beams)
    odd_rows, even_rows = legendre * parity, legendre * (1 - parity)
    odd, even = odd_rows[:, :n].T @ scaled, even_rows[:, :n].T @ scaled
    corner = slice(legendre.shape[1] - beams, None)
    odd_corner, even_corner = odd_rows[:, views].T @ scaled[:, corner], even_rows[:, views].T @ scaled[:, corner]
    w = directions.weight[:n] ** 2 * directions.mu[:n]  # quadrature weights in mu
    total = jnp.sum(w)
    excess = w @ even - 1.0
    mean = jnp.sum(w * excess[:n]) / total**2
    first = jnp.where(order == 0, 1.0, 0.0)
    even = even - first * ((excess[:n, None] + excess) / total - mean)
    even_corner = even_corner - first * ((excess[views, None] + excess[corner]) / total - mean)
    return Scattering(odd, even, odd_corner, even_corner)


def problem(kernel: Scattering, directions: Directions, albedo: Float[Array, ""], absorbed: Float[Array, ""], order: Float[AnyArray, ""]) -> Problem:
    """The matrices of a layer. absorbed : 1 - albedo, given on its own because their difference has lost its digits near albedo 1."""
    n = directions.root.shape[0]
    rate, b = 1.0 / directions.mu, directions.weight
    attenuation = jnp.diag(rate[:n])
    coupling = albedo * b[:n, None] * b
    odd, even = coupling * kernel.odd, coupling * kernel.even
    views = kernel.odd_corner.shape[0]
    between = albedo * b[n : n + views, None] * b[n + views :]
    M = attenuation - even[:, :n]
    null = directions.root
    lost = jnp.where(order == 0, absorbed * rate[:n] * null, M @ null)
    P, M, p, q, lost = at_once(attenuation - odd[:, :n], M, odd[:, n:], even[:, n:], lost)
    return Problem(
        P=P,
        M=M,
        p=p,
        q=q,
        rate=rate[n:],
        pc=between * kernel.odd_corner,
        qc=between * kernel.even_corner,
        null=null,
        lost=lost,
    )


def layer(problem: Problem, tau: Float[Array, ""]) -> Response[Matrix]:
    """Response of a layer of optical thickness tau >= 0."""
    h = 0.5 * tau
    parts: Parts = slab(problem, h)
    views = problem.pc.shape[0]
    one = jnp.eye(parts.Y.shape[0])
    Zi, Yi = inverse(one + jnp.stack([parts.Z, parts.Y]))
    t = jnp.tanh(h * problem.rate)
    t, half, passing = at_once(t, 1.0 / (1.0 + t), jnp.exp(-2.0 * h * problem.rate))
    z = -(Zi @ parts.z) * half
    y, through = jnp.split(Yi @ jnp.concatenate([-parts.y * half, parts.S @ z + parts.s * half], axis=1), 2, axis=1)
    through = through + y * (1.0 - t)
    zc, yc = (
        half[:views, None] * (side[:, :views].T @ inner @ side[:, views:] - corner) * half[views:]
        for side, inner, corner in ((parts.z, Zi, parts.zc), (parts.y, Yi, parts.yc))
    )
    R = _assemble(Zi - Yi, z - y, zc - yc, jnp.zeros_like(passing))
    T = _assemble(Yi @ parts.S @ Zi, through, zc + yc, passing)
    return Response(R, R, T, T)


def deep_layer(problem: Problem) -> Matrix:
    """Reflection of a half space."""
    parts = half_space(problem)
    views = problem.pc.shape[0]
    Zi = inverse(jnp.eye(parts.Z.shape[0]) + parts.Z)
    z = -(Zi @ parts.z)  # twice half of the border's 1/(1 + 1)
    corner = 0.5 * (parts.z[:, :views].T @ Zi @ parts.z[:, views:] - parts.zc)
    return _assemble(2.0 * Zi - jnp.eye(Zi.shape[0]), z, corner, jnp.zeros_like(problem.rate))


def _assemble(ordinates: Float[Array, "n n"], columns: Float[Array, "n e"], corner: Float[Array, "v b"], diagonal: Float[Array, "e"]) -> Matrix:
    """One matrix over all channels from its blocks; rows of lines of sight are the columns of the same directions as beams (reciprocity)."""
    views, n = corner.shape[0], ordinates.shape[0]
    top = jnp.concatenate([jnp.diag(diagonal[:views]), columns[:, :views].T, corner], axis=1)
    middle = jnp.concatenate([jnp.zeros((n, views)), ordinates, columns[:, views:]], axis=1)
    bottom = jnp.concatenate([jnp.zeros((corner.shape[1], views + n)), jnp.diag(diagonal[views:])], axis=1)
    return Matrix(jnp.concatenate([top, middle, bottom], axis=0))
