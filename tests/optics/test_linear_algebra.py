"""Inverses without pivoting against LAPACK, at sizes on both sides of the block limits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from layerfit.optics.linear_algebra import inverse


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
