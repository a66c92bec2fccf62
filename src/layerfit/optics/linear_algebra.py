"""Inverses of small matrices that need no pivoting, fast in batches and with a derivative rule of their own.

LAPACK's triangular solves are not batched on the CPU; these are matrix products and one loop. Fit for matrices whose symmetric part is
positive definite (1 + a positive semidefinite matrix, 1 - a product of two reflections) and for triangular ones: pivoting gains nothing there.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

_LOOP = 24  # up to this size rows are eliminated one by one; above it, blocks are halved


@jax.custom_jvp
def inverse(a: Float[Array, "*b n n"]) -> Float[Array, "*b n n"]:
    """a^-1 without pivoting."""
    n = a.shape[-1]
    if n <= _LOOP:
        return _eliminate(a)
    half = n // 2
    upper, right, below, lower = a[..., :half, :half], a[..., :half, half:], a[..., half:, :half], a[..., half:, half:]
    first = inverse(upper)
    forward, back = below @ first, first @ right
    rest = inverse(lower - forward @ right)
    corner = rest @ forward
    top = jnp.concatenate([first + back @ corner, -back @ rest], axis=-1)
    return jnp.concatenate([top, jnp.concatenate([-corner, rest], axis=-1)], axis=-2)


@inverse.defjvp
def _inverse_jvp(primals, tangents):
    result = inverse(primals[0])
    return result, -result @ tangents[0] @ result


def _eliminate(a: Float[Array, "*b n n"]) -> Float[Array, "*b n n"]:
    """Gauss-Jordan elimination in place."""

    def step(k, a):
        pivot_row = a[..., k, :]
        pivot = pivot_row[..., k]
        row = (pivot_row / pivot[..., None]).at[..., k].set(1.0 / pivot)
        column = a[..., :, k].at[..., k].set(0.0)
        a = a.at[..., :, k].set(0.0) - column[..., :, None] * row[..., None, :]
        return a.at[..., k, :].set(row)

    return jax.lax.fori_loop(0, a.shape[-1], step, a)
