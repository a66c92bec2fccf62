"""The table that solvers read."""

import jax
import numpy as np
import pytest

import layerfit as lf
from layerfit.scene.columns import to_columns

A = lf.Layer("a", sigma_a=0.3, sigma_s=25.0, g=0.8, n=1.4, thickness=0.1, roughness=0.2)
B = lf.Layer("b", sigma_a=0.005, sigma_s_prime=1.2, n=1.44, thickness=4.0)
C = lf.HalfSpace("c", sigma_a=0.02, sigma_s_prime=2.0, g=0.9, n=1.37, roughness=0.3)


def test_slab():
    columns = to_columns(lf.Stack([A, B], n_above=1.1, n_below=1.2, roughness_below=0.4))
    expected = {
        "sigma_a": [0.3, 0.005],
        "sigma_s_prime": [5.0, 1.2],
        "sigma_t_prime": [5.3, 1.205],
        "g": [0.8, 0.0],
        "n": [1.4, 1.44],
        "thickness": [0.1, 4.0],
        "roughness": [0.2, 0.0, 0.4],
        "n_above": 1.1,
        "n_below": 1.2,
    }
    for name, values in expected.items():
        found = np.asarray(getattr(columns, name))
        assert found.dtype == np.float64 and found.shape == np.shape(values), name
        assert np.max(np.abs(found - values)) <= 1e-14, name
    assert columns.g_unknown == (False, True)
    assert columns.smooth == (False, True, False)
    assert not columns.half_space and columns.count == 2


def test_half_space():
    columns = to_columns(A | B | C)
    assert columns.half_space and columns.count == 3
    assert columns.thickness.tolist() == [0.1, 4.0]
    assert columns.roughness.tolist() == [0.2, 0.0, 0.3], "no face under a half space"
    assert columns.smooth == (False, True, False)
    assert abs(float(columns.sigma_s_prime[2]) - 2.0) <= 1e-15


def test_traced_roughness_counts_as_rough():
    smooth = jax.eval_shape(lambda r: to_columns((A | C).set({"a.roughness": r, "c.roughness": 0.0})), 0.0).smooth
    assert smooth == (False, True)
    stated = to_columns((A | C).set({"a.roughness": 0.0}), rough_faces=(True, False))
    assert stated.smooth == (False, True)


def test_no_sample():
    with pytest.raises(lf.InputError, match="every layer of the stack has thickness 0"):
        to_columns(lf.Stack([A.replace(thickness=0)]))
    assert to_columns(A.replace(thickness=0) | C).thickness.tolist() == [0.0]
