"""The matrix functions behind a homogeneous layer in discrete ordinates, with derivative rules that stay finite.

With half-range ordinates the sum and the difference of down- and upwelling light obey ds/dtau = -P d, dd/dtau = -M s, both matrices symmetric and
positive (M positive semidefinite: it is singular at albedo 1). A layer of half thickness h is fully described by

    Y = h phi(X) P,   Z = h M phi(X),   S = sech^2(sqrt X),   X = h^2 P M,   phi(x) = tanh(sqrt x)/sqrt x.

Directions of zero weight (a beam, a line of sight) border the problem: P^ = [[P, -p], [-p^T, 1/mu]], M^ likewise with -q. They feed the ordinates
or are fed by them, never both, so that the bordered X is block triangular and its functions are divided differences of phi.

References
----------
J. Stam, Proc. Eurographics Workshop on Rendering 2001, section 3 (A and B there are -(P + M)/2 and (P - M)/2).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ..compilation import at_once
from ..optics.differences import second_differences, third_difference
from ..optics.linear_algebra import cholesky, eigh, inverse
from ..optics.special import divided_differences, tanhc

_THIN = 1e-10  # half an optical thickness below which what is of second order in it is rounding


class Problem(NamedTuple):
    """One layer at one azimuthal order.

    P, M : the symmetric matrices. p, q : borders, one column a direction of zero weight; rate : 1/mu of these directions.
    pc, qc : the borders' corner, from beam (column) to line of sight (row): the last ``beams`` of the directions are beams, the others are looked
    along. null : a vector whose image lost = M null is known without cancellation (at albedo 1 it is 0).
    """

    P: Float[Array, "n n"]
    M: Float[Array, "n n"]
    p: Float[Array, "n e"]
    q: Float[Array, "n e"]
    rate: Float[Array, "e"]
    pc: Float[Array, "v b"]
    qc: Float[Array, "v b"]
    null: Float[Array, "n"]
    lost: Float[Array, "n"]


class Modes(NamedTuple):
    """P = B B^T, M = B^-T diag(value) B^-1."""

    value: Float[Array, "n"]
    B: Float[Array, "n n"]
    inverse: Float[Array, "n n"]


class Parts(NamedTuple):
    """Y, Z, S of the ordinates; their columns for directions of zero weight; the corners of Y and Z."""

    Y: Float[Array, "n n"]
    Z: Float[Array, "n n"]
    S: Float[Array, "n n"]
    y: Float[Array, "n e"]
    z: Float[Array, "n e"]
    s: Float[Array, "n e"]
    yc: Float[Array, "v b"]
    zc: Float[Array, "v b"]


def modes(problem: Problem) -> Modes:
    """One Cholesky decomposition and one symmetric eigenproblem.

    The direction that carries conservative light is split off first, so that at albedo 1 its eigenvalue is 0 and not rounding: a thick layer would
    multiply that by tau^2.
    """
    L = cholesky(problem.P)
    L_inverse = inverse(L)
    y = L_inverse @ problem.null
    length = jnp.linalg.norm(y)
    sign = jnp.where(y[0] < 0, -1.0, 1.0)
    v, scale, back = at_once(y.at[0].add(sign * length), 1.0 / (length * (length + jnp.abs(y[0]))), -sign / length)

    def reflect(a: Float[Array, "n *k"]) -> Float[Array, "n *k"]:
        return a - scale * jnp.tensordot(v, jnp.tensordot(v, a, 1), 0)  # first axis: y becomes a multiple of the first unit vector

    turned = reflect(L.T).T  # L H
    A = turned.T @ problem.M @ turned
    first = turned.T @ problem.lost * back
    A = A.at[0, :].set(first).at[:, 0].set(first)
    value, Q = eigh(A)
    return Modes(jnp.maximum(value, 0.0), turned @ Q, Q.T @ reflect(L_inverse))


class _Slab(NamedTuple):
    """What both the value and the derivative of a slab use. x, chi: eigenvalues of h^2 P M, and of the borders."""

    x: Float[Array, "n"]
    chi: Float[Array, "e"]
    phi: Float[Array, "n"]
    phi_chi: Float[Array, "e"]
    p: Float[Array, "n e"]  # B^-1 p
    q: Float[Array, "n e"]  # B^T q
    c: Float[Array, "n e"]  # B^-1 times the border of X, from a beam
    r: Float[Array, "n e"]  # the border of X, towards a line of sight, times B
    tanh1: Float[Array, "n e"]
    sech1: Float[Array, "n e"]


def _prepare(problem: Problem, h: Float[Array, ""], m: Modes) -> _Slab:
    x, chi = h**2 * m.value, (h * problem.rate) ** 2
    p, q = m.inverse @ problem.p, m.B.T @ problem.q
    c = -(h**2) * (q + p * problem.rate)
    r = -(h**2) * (q * problem.rate + m.value[:, None] * p)
    tanh1, sech1 = divided_differences(*jnp.broadcast_arrays(x[:, None], chi[None, :]))
    return _Slab(x, chi, tanhc(x), tanhc(chi), p, q, c, r, tanh1, sech1)


@jax.custom_jvp
def slab(problem: Problem, h: Float[Array, ""]) -> Parts:
    """Y, Z, S of a layer of half optical thickness h >= 0."""
    return _slab(problem, h, modes(problem))


def _split(problem: Problem) -> tuple[slice, slice]:
    views = problem.pc.shape[0]
    return slice(0, views), slice(views, None)


def _slab(problem: Problem, h: Float[Array, ""], m: Modes) -> Parts:
    t = _prepare(problem, h, m)
    up, down = m.inverse.T, m.B
    sech2 = 1.0 / jnp.cosh(jnp.minimum(jnp.sqrt(t.x), 350.0)) ** 2
    tanh1, sech1, phi, phi_chi, sech2 = at_once(t.tanh1, t.sech1, t.phi, t.phi_chi, sech2)
    t = t._replace(tanh1=tanh1, sech1=sech1, phi=phi, phi_chi=phi_chi)
    fed = t.tanh1 * t.c
    y = h * (fed * problem.rate - t.phi[:, None] * t.p)
    z = h * (m.value[:, None] * fed - t.phi_chi * t.q)
    of_Y, of_Z, of_S, y, z, s = at_once(h * (down * t.phi), h * (up * (m.value * t.phi)), down * sech2, y, z, t.sech1 * t.c)
    y, s = jnp.split(down @ jnp.concatenate([y, s], axis=1), 2, axis=1)
    views, beams = _split(problem)
    corner, _, _ = _corner(problem, h, t)
    sight = (t.r * t.tanh1)[:, views]
    yc = h * (-t.phi_chi[views, None] * problem.pc - sight.T @ t.p[:, beams] + corner * problem.rate[beams])
    zc = h * (corner * problem.rate[views, None] - t.q[:, views].T @ fed[:, beams] - problem.qc * t.phi_chi[beams])
    # to first order in h nothing of the modes: their rounding would join directions that a layer of next to nothing keeps apart, and light that is
    # trapped in it multiplies that by 1/h^2
    thin = h <= _THIN
    return Parts(
        Y=jnp.where(thin, h * problem.P, of_Y @ down.T),
        Z=jnp.where(thin, h * problem.M, of_Z @ up.T),
        S=jnp.where(thin, jnp.eye(t.x.size), of_S @ m.inverse),
        y=y,
        z=up @ z,
        s=s,
        yc=yc,
        zc=zc,
    )


def _corner(problem: Problem, h: Float[Array, ""], t: _Slab) -> tuple[Float[Array, "v b"], Float[Array, "v b"], Float[Array, "n v b"]]:
    """phi(X^) from beam to line of sight; X^ there; and the second differences used."""
    views, beams = _split(problem)
    X = h**2 * (-problem.rate[views, None] * problem.qc - problem.pc * problem.rate[beams] + problem.p[:, views].T @ problem.q[:, beams])
    chi_v, chi_b = t.chi[views, None], t.chi[None, beams]
    second = second_differences(t.x[:, None, None], chi_v, chi_b)[0]
    direct = divided_differences(*jnp.broadcast_arrays(chi_v, chi_b))[0]
    return X * direct + jnp.einsum("iv,ivb,ib->vb", t.r[:, views], second, t.c[:, beams]), X, second


class _Change(NamedTuple):
    """Tangents of P, M, p, q in the basis of the modes: B^-1 dP B^-T, B^T dM B, B^-1 dp, B^T dq."""

    P: Float[Array, "n n"]
    M: Float[Array, "n n"]
    p: Float[Array, "n e"]
    q: Float[Array, "n e"]


def _change(problem: Problem, tangent: Problem, m: Modes) -> _Change:
    dM = m.B.T @ tangent.M @ m.B
    # where the first mode is conservative, B[:, 0] is a multiple of the null vector and dM's image of it is known without cancellation
    share = jnp.sum(m.B[:, 0] * problem.null) / jnp.sum(problem.null**2)
    first = share * (m.B.T @ tangent.lost - m.value * (m.inverse @ tangent.null))
    exact = dM.at[0, :].set(first).at[:, 0].set(first)
    return _Change(
        P=m.inverse @ tangent.P @ m.inverse.T,
        M=jnp.where(m.value[0] == 0.0, exact, dM),
        p=m.inverse @ tangent.p,
        q=m.B.T @ tangent.q,
    )


@slab.defjvp
def _slab_jvp(primals, tangents):
    """Daleckii and Krein: the derivative of a matrix function is the divided differences times the tangent, in the basis of the modes."""
    (problem, h), (tangent, dh) = primals, tangents
    m = modes(problem)
    t, d = _prepare(problem, h, m), _change(problem, tangent, m)
    value, rate, drate = m.value, problem.rate, tangent.rate
    up, down = m.inverse.T, m.B
    eye = jnp.eye(value.shape[0])
    G = h**2 * (d.P * value + d.M) + 2.0 * h * dh * value * eye  # B^-1 dX B
    dchi = 2.0 * h * dh * rate**2 + 2.0 * h**2 * rate * drate
    tanh, sech = divided_differences(*jnp.broadcast_arrays(t.x[:, None], t.x[None, :]))
    dphi = tanh * G
    tanh2, sech2 = second_differences(t.x[:, None, None], t.x[None, :, None], t.chi)
    tanh_chi, sech_chi = second_differences(t.x[:, None], t.chi, t.chi)
    dphi_chi = divided_differences(t.chi, t.chi)[0] * dchi

    dc = -2.0 * h * dh * (t.q + t.p * rate) - h**2 * (d.P @ t.q + d.q + d.p * rate + t.p * drate)
    dr = -2.0 * h * dh * (t.q * rate + value[:, None] * t.p) - h**2 * (d.q * rate + t.q * drate + d.M @ t.p + value[:, None] * d.p)
    fed = t.tanh1 * t.c
    dfed = jnp.einsum("ije,ij,je->ie", tanh2, G, t.c) + t.tanh1 * dc + tanh_chi * dchi * t.c
    y, z = fed * rate - t.phi[:, None] * t.p, value[:, None] * fed - t.phi_chi * t.q
    dy = dh * y + h * (dfed * rate + fed * drate - dphi @ t.p - t.phi[:, None] * d.p)
    dz = dh * z + h * (d.M @ fed + value[:, None] * dfed - d.q * t.phi_chi - t.q * dphi_chi)
    ds = jnp.einsum("ije,ij,je->ie", sech2, G, t.c) + t.sech1 * dc + sech_chi * dchi * t.c
    dyc, dzc = _corner_jvp(problem, tangent, h, dh, t, d, G, dchi, dc, dr, dfed, dphi_chi, tanh2, tanh_chi)
    change = Parts(
        Y=down @ (dh * t.phi * eye + h * (t.phi[:, None] * d.P + dphi)) @ down.T,
        Z=up @ (dh * value * t.phi * eye + h * (d.M * t.phi + value[:, None] * dphi)) @ up.T,
        S=down @ (sech * G) @ m.inverse,
        y=down @ dy,
        z=up @ dz,
        s=down @ ds,
        yc=dyc,
        zc=dzc,
    )
    return _slab(problem, h, m), change


def _corner_jvp(problem, tangent, h, dh, t, d, G, dchi, dc, dr, dfed, dphi_chi, tanh2, tanh_chi):
    """Tangents of the corners of Y and Z."""
    views, beams = _split(problem)
    rate_v, rate_b, drate_v, drate_b = problem.rate[views, None], problem.rate[beams], tangent.rate[views, None], tangent.rate[beams]
    p, q, r, c = t.p, t.q, t.r[:, views], t.c[:, beams]
    corner, X, second = _corner(problem, h, t)
    chi_v, chi_b = t.chi[views, None], t.chi[None, beams]
    flat = -rate_v * problem.qc - problem.pc * rate_b + p[:, views].T @ q[:, beams]
    dflat = -drate_v * problem.qc - rate_v * tangent.qc - tangent.pc * rate_b - problem.pc * drate_b
    dX = 2.0 * h * dh * flat + h**2 * (dflat + d.p[:, views].T @ q[:, beams] + p[:, views].T @ d.q[:, beams])
    x = t.x[:, None, None]
    third = third_difference(chi_v, x[:, None], x[None], chi_b)
    dcorner = (
        dX * divided_differences(*jnp.broadcast_arrays(chi_v, chi_b))[0]
        + X * (second_differences(chi_v, chi_v, chi_b)[0] * dchi[views, None] + second_differences(chi_v, chi_b, chi_b)[0] * dchi[beams])
        + jnp.einsum("iv,ivb,ib->vb", dr[:, views], second, c)
        + jnp.einsum("iv,ivb,ib->vb", r, second, dc[:, beams])
        + jnp.einsum("iv,ijvb,ij,jb->vb", r, third, G, c)
        + jnp.einsum("iv,ivb,ib->vb", r, third_difference(chi_v, chi_v, x, chi_b), c) * dchi[views, None]
        + jnp.einsum("iv,ivb,ib->vb", r, third_difference(chi_v, x, chi_b, chi_b), c) * dchi[beams]
    )
    sight = t.tanh1[:, views] * r
    dsight = t.tanh1[:, views] * dr[:, views] + jnp.einsum("ijv,ij,iv->jv", tanh2[..., views], G, r) + tanh_chi[:, views] * dchi[views] * r
    fed = t.tanh1[:, beams] * c
    y = -t.phi_chi[views, None] * problem.pc - sight.T @ p[:, beams] + corner * rate_b
    z = corner * rate_v - q[:, views].T @ fed - problem.qc * t.phi_chi[beams]
    dy = -dphi_chi[views, None] * problem.pc - t.phi_chi[views, None] * tangent.pc - dsight.T @ p[:, beams] - sight.T @ d.p[:, beams]
    dy = dy + dcorner * rate_b + corner * drate_b
    dz = dcorner * rate_v + corner * drate_v - d.q[:, views].T @ fed - q[:, views].T @ dfed[:, beams]
    dz = dz - tangent.qc * t.phi_chi[beams] - problem.qc * dphi_chi[beams]
    return dh * y + h * dy, dh * z + h * dz


class DeepParts(NamedTuple):
    """Z of a half space, with its columns and its corner."""

    Z: Float[Array, "n n"]
    z: Float[Array, "n e"]
    zc: Float[Array, "v b"]


@jax.custom_jvp
def half_space(problem: Problem) -> DeepParts:
    """Z in the limit of infinite thickness, where Y is its inverse and Z P Z = M."""
    return _half_space(problem, modes(problem))


def _decays(m: Modes) -> Float[Array, "n"]:
    """Decay rates per optical depth. The offset keeps the true infinite slope at albedo 1 a (huge) number."""
    return jnp.sqrt(m.value) + 1e-150


def _half_space(problem: Problem, m: Modes) -> DeepParts:
    decay = _decays(m)
    p, q = m.inverse @ problem.p, m.B.T @ problem.q
    z = (decay[:, None] * p - q) / (decay[:, None] + problem.rate)
    up = m.inverse.T
    return DeepParts(Z=(up * decay) @ m.inverse, z=up @ z, zc=_deep_corner(problem, p, z))


def _deep_corner(problem: Problem, p: Float[Array, "n e"], z: Float[Array, "n e"]) -> Float[Array, "v b"]:
    views, beams = _split(problem)
    products = p[:, views].T @ z[:, beams] + z[:, views].T @ p[:, beams] - z[:, views].T @ z[:, beams]
    return (products + problem.pc - problem.qc) / (problem.rate[views, None] + problem.rate[beams])


@half_space.defjvp
def _half_space_jvp(primals, tangents):
    """From the derivative of Z^ P^ Z^ = M^."""
    (problem,), (tangent,) = primals, tangents
    m = modes(problem)
    d = _change(problem, tangent, m)
    decay, up = _decays(m), m.inverse.T
    p, q = m.inverse @ problem.p, m.B.T @ problem.q
    across = decay[:, None] + problem.rate
    z = (decay[:, None] * p - q) / across
    dZ = (d.M - decay[:, None] * d.P * decay) / (decay[:, None] + decay)
    dz = (decay[:, None] * (d.p - d.P @ z) - d.q - dZ @ (z - p) - z * tangent.rate) / across
    views, beams = _split(problem)
    zc = _deep_corner(problem, p, z)
    zv, zb, dzv, dzb = z[:, views], z[:, beams], dz[:, views], dz[:, beams]
    products = d.p[:, views].T @ zb + p[:, views].T @ dzb + dzv.T @ p[:, beams] + zv.T @ d.p[:, beams]
    products = products - dzv.T @ zb - zv.T @ d.P @ zb - zv.T @ dzb + tangent.pc - tangent.qc
    slower = tangent.rate[views, None] + tangent.rate[beams]
    dzc = (products - slower * zc) / (problem.rate[views, None] + problem.rate[beams])
    return _half_space(problem, m), DeepParts(Z=up @ dZ @ m.inverse, z=up @ dz, zc=dzc)
