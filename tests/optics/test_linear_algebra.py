"""Inverses without pivoting against LAPACK, at sizes on both sides of the block limits; eigenvalues of graded matrices."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from layerfit.optics.linear_algebra import eigh, inverse


@pytest.mark.parametrize("n", [1, 10, 11, 32, 33, 96, 97])
def test_against_lapack(n):
    """1 + a positive semidefinite matrix with a skew part; value and derivative, in a batch."""
    rng = np.random.default_rng(n)
    root, skew, change = rng.standard_normal((3, 2, n, n))
    a = np.eye(n) + root @ np.swapaxes(root, 1, 2) / n + 0.3 * (skew - np.swapaxes(skew, 1, 2))
    found, slope = jax.jvp(inverse, (jnp.asarray(a),), (jnp.asarray(change),))
    exact = np.linalg.inv(a)
    assert np.max(np.abs(found - exact)) <= 1e-12
    assert np.max(np.abs(slope + exact @ change @ exact)) <= 1e-10
    assert np.max(np.abs(jax.vmap(inverse)(jnp.asarray(a)) - exact)) <= 1e-12
    assert np.max(np.abs(jax.vmap(lambda a: inverse(a, often=True))(jnp.asarray(a)) - exact)) <= 1e-12


def test_small_eigenvalues_of_a_matrix_whose_elements_grow():
    """Elements from 1 to 1e12, as of directions near grazing: the least eigenvalue from the largest of the inverse, which is known."""
    scale = np.geomspace(1.0, 1e6, 8)
    inner = np.eye(8) + 0.3 / (1.0 + np.abs(np.subtract.outer(np.arange(8), np.arange(8))))
    exact = 1.0 / np.linalg.eigvalsh(np.linalg.inv(inner) / np.multiply.outer(scale, scale))[-1]
    value, vectors = eigh(jnp.asarray(inner * np.multiply.outer(scale, scale)))
    assert abs(float(value[0]) / exact - 1.0) <= 1e-12
    assert np.max(np.abs(vectors.T @ vectors - np.eye(8))) <= 1e-13
