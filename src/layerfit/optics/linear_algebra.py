"""Inverses of small matrices that need no pivoting, fast in batches and with a derivative rule of their own; decompositions, matrix by matrix.

LAPACK's triangular solves are not batched on the CPU; these are matrix products in loops. Fit for matrices whose symmetric part is
positive definite (1 + a positive semidefinite matrix, 1 - a product of two reflections) and for triangular ones: pivoting gains nothing there.
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

_LOOP = 32  # up to this size the rows of one matrix are eliminated one by one
_LOOP_IN_BATCH = 10  # and those of many matrices
_BLOCK, _LARGE, _BLOCK_OF_LARGE = 8, 96, 16  # above it, blocks of at most so many
_HALVED = 48  # above this size many matrices are halved first


@partial(jax.custom_jvp, nondiff_argnums=(1,))
def inverse(a: Float[Array, "*b n n"], often: bool = False) -> Float[Array, "*b n n"]:
    """a^-1 without pivoting. often : worth a longer program, which is faster for many matrices."""
    return (_inverse_often if often else _inverse)(a)


@jax.custom_batching.custom_vmap
def _inverse(a: Float[Array, "*b n n"]) -> Float[Array, "*b n n"]:
    return _by_rows_or_blocks(a, _LOOP)


@_inverse.def_vmap
def _inverse_of_many(_size, _batched, a):
    return _by_rows_or_blocks(a, _LOOP_IN_BATCH), True


@jax.custom_batching.custom_vmap
def _inverse_often(a: Float[Array, "*b n n"]) -> Float[Array, "*b n n"]:
    return _inverse(a)


@_inverse_often.def_vmap
def _inverse_of_many_often(_size, _batched, a):
    return _by_halves(a), True


def _by_halves(a: Float[Array, "*b n n"]) -> Float[Array, "*b n n"]:
    """By Schur's complement: most of the work then is products of large blocks, which pass over the matrix seldom."""
    n = a.shape[-1]
    if n <= _HALVED:
        return _by_rows_or_blocks(a, _LOOP_IN_BATCH)
    m = n // 2
    first = _by_halves(a[..., :m, :m])
    left = a[..., m:, :m] @ first
    last = _by_halves(a[..., m:, m:] - left @ a[..., :m, m:])
    up = -first @ a[..., :m, m:] @ last
    return jnp.concatenate([jnp.concatenate([first - up @ left, up], axis=-1), jnp.concatenate([-last @ left, last], axis=-1)], axis=-2)


def _by_rows_or_blocks(a: Float[Array, "*b n n"], loop: int) -> Float[Array, "*b n n"]:
    """loop : largest size that is eliminated row by row."""
    n = a.shape[-1]
    if n <= loop:
        return _eliminate(a)
    count = -(-n // (_BLOCK if n <= _LARGE else _BLOCK_OF_LARGE))
    size = -(-n // count)
    more = count * size - n
    padded = jnp.pad(a, [(0, 0)] * (a.ndim - 2) + [(0, more)] * 2) + jnp.diag(jnp.arange(count * size) >= n)
    return _eliminate_blocks(padded, size)[..., :n, :n]


@inverse.defjvp
def _inverse_jvp(often, primals, tangents):
    result = inverse(primals[0], often)
    return result, -result @ tangents[0] @ result


def _eliminate(a: Float[Array, "*b n n"]) -> Float[Array, "*b n n"]:
    """Gauss-Jordan elimination in place, each step one pass over the matrix."""
    index = np.arange(a.shape[-1])

    def step(k, a):
        here = index == k
        row = jax.lax.dynamic_index_in_dim(a, k, axis=-2, keepdims=False)
        pivot = jax.lax.dynamic_index_in_dim(row, k, axis=-1)
        row = jnp.where(here, 1.0, row) / pivot
        column = jnp.where(here, -1.0, jax.lax.dynamic_index_in_dim(a, k, axis=-1, keepdims=False))
        return jnp.where(here[:, None] | here, 0.0, a) - column[..., :, None] * row[..., None, :]

    return jax.lax.fori_loop(0, a.shape[-1], step, a)


def _eliminate_blocks(a: Float[Array, "*b n n"], size: int) -> Float[Array, "*b n n"]:
    """The same by blocks of some rows, of which n is a multiple: matrix products, and one small program however large the matrix."""

    def step(k, a):
        at = k * size
        rows = jax.lax.dynamic_slice_in_dim(a, at, size, axis=-2)
        pivot = _eliminate(jax.lax.dynamic_slice_in_dim(rows, at, size, axis=-1))
        rows = jax.lax.dynamic_update_slice_in_dim(pivot @ rows, pivot, at, axis=-1)
        columns = jax.lax.dynamic_slice_in_dim(a, at, size, axis=-1)
        columns = jax.lax.dynamic_update_slice_in_dim(columns, jnp.zeros_like(pivot), at, axis=-2)
        a = jax.lax.dynamic_update_slice_in_dim(a, jnp.zeros_like(columns), at, axis=-1) - columns @ rows
        return jax.lax.dynamic_update_slice_in_dim(a, rows, at, axis=-2)

    return jax.lax.fori_loop(0, a.shape[-1] // size, step, a)


# LAPACK's batches on the CPU wait for threads of XLA's pool while they hold one of them: with as many at a time as there are threads, all wait for
# ever (jaxlib 0.10; newer ones do not). Hence one matrix after the other.
def _in_turn(decompose: Callable[[Array], tuple[Array, ...]]) -> Callable[[Array], tuple[Array, ...]]:
    """The decomposition of one matrix; a batch goes through a loop. An axis of length 1 stays an axis, that rounding be the same with and without."""
    alone = jax.custom_batching.custom_vmap(decompose)

    @alone.def_vmap
    def batched(size, _, a):
        found = alone(a) if size == 1 else jax.lax.map(alone, a)
        return found, (True,) * len(found)

    return alone


# from the last row up: where the largest elements are near the end, small eigenvalues then keep their digits. Returned vectors first
_eigh_in_turn = _in_turn(lambda a: tuple(jax.lax.linalg.eigh(a, lower=False, symmetrize_input=False)))
_cholesky_in_turn = _in_turn(lambda a: (jnp.linalg.cholesky(a),))


@jax.custom_jvp
def eigh(a: Float[Array, "n n"]) -> tuple[Float[Array, "n"], Float[Array, "n n"]]:
    """Eigenvalues, rising, and eigenvectors (columns) of a symmetric matrix; the vectors' derivative needs eigenvalues that differ."""
    vectors, value = _eigh_in_turn(a)
    return value, vectors


@eigh.defjvp
def _eigh_jvp(primals, tangents):
    value, vectors = eigh(*primals)
    change = vectors.T @ tangents[0] @ vectors
    apart = value[None, :] - value[:, None] + jnp.eye(len(value))
    return (value, vectors), (jnp.diagonal(change), vectors @ (change / apart * (1.0 - jnp.eye(len(value)))))


@jax.custom_jvp
def cholesky(a: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The lower triangular factor of a symmetric positive definite matrix."""
    return _cholesky_in_turn(a)[0]


@cholesky.defjvp
def _cholesky_jvp(primals, tangents):
    factor = cholesky(*primals)
    back = inverse(factor)
    change = back @ tangents[0] @ back.T
    return factor, factor @ (jnp.tril(change) - 0.5 * jnp.diag(jnp.diagonal(change)))
