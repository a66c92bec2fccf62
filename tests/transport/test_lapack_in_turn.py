"""No LAPACK batches in transport: they wait for threads that they hold themselves, and two programs could wait for ever."""

import re

import equinox as eqx
import jax
import numpy as np
import pytest

import layerfit as lf
from layerfit.optics.linear_algebra import cholesky, eigh
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain

SKIN = lf.Stack([lf.Layer(f"layer{i}", sigma_a=0.1, sigma_s_prime=1.0 + i, g=0.8, n=1.4, thickness=0.5) for i in range(3)])


@pytest.mark.parametrize("geometry", [lf.TotalReflectance(), lf.AngularReflectance(angle=[30.0], incidence=20.0, azimuth=40.0)], ids=lambda g: g.kind)
def test_matrices_go_one_by_one(geometry):
    """Side by side over layers, orders and a batch of stacks, value and Jacobian."""
    columns = to_columns(SKIN)
    forward = lf.DiscreteOrdinates(streams=8).forward(Domain(SKIN, columns, columns), [geometry], [(0.0, 0.0)])

    def values(sigma_a):
        return forward(eqx.tree_at(lambda c: c.sigma_a, columns, sigma_a))[0]

    program = jax.jit(jax.vmap(jax.jacfwd(values))).lower(np.full((4, 3), 0.1)).as_text()
    called = re.findall(r"custom_call @lapack_\w+\(.*\) -> .*", program)
    assert called
    for call in called:
        shape = re.search(r": \(tensor<([\dx]+)xf64>", call)
        assert shape and all(size == "1" for size in shape[1].split("x")[:-2]), call


def test_decompositions():
    """The same as LAPACK's, in batches and with derivatives."""
    a = np.random.default_rng(0).random((5, 4, 4))
    a = a @ a.transpose(0, 2, 1) + np.eye(4)
    change = np.ones((4, 4)) + np.eye(4)

    def projections(m):
        value, vectors = eigh(m)
        return value, (vectors[:, -1:] * vectors[:, -1]), (vectors * value) @ vectors.T

    def plain_projections(m):
        value, vectors = np.linalg.eigh(m)
        last = vectors[..., -1]
        return value, last[..., :, None] * last[..., None, :], m

    cases = [(cholesky, np.linalg.cholesky)] + [(lambda m, i=i: projections(m)[i], lambda m, i=i: plain_projections(m)[i]) for i in range(3)]
    for ours, plain in cases:
        assert np.max(np.abs(jax.vmap(ours)(a) - plain(a))) <= 1e-13
        slope = jax.vmap(lambda m, ours=ours: jax.jvp(ours, (m,), (change,))[1])(a)
        step = 1e-5
        assert np.max(np.abs(slope - (plain(a + step * change) - plain(a - step * change)) / (2 * step))) <= 1e-8
