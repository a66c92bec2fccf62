"""Functions with removable singularities, against 60 digits."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

from layerfit.optics.special import divided_differences, expc, log_cosh, tanhc

mp.mp.dps = 60

POINTS = [0.0, 1e-300, 1e-20, 1e-8, 0.05, 0.0999, 0.1001, 0.3, 1.0, 5.0, 100.0, 1e4, 1e6]


def exact_tanhc(x):
    return mp.tanh(mp.sqrt(x)) / mp.sqrt(x) if x else mp.mpf(1)


def exact_sech2(x):
    return 1 / mp.cosh(mp.sqrt(x)) ** 2


def test_tanhc_value_and_slope():
    x = jnp.array(POINTS)
    slope = jax.vmap(jax.grad(tanhc))(x)
    for point, value, derivative in zip(POINTS, tanhc(x), slope, strict=True):
        z = mp.mpf(point)
        expected = (exact_sech2(z) - exact_tanhc(z)) / (2 * z) if point > 1e-15 else mp.mpf(-1) / 3
        assert abs(float(value) / float(exact_tanhc(z)) - 1) <= 1e-15
        assert abs(float(derivative) / float(expected) - 1) <= 3e-14


def test_log_cosh_value_and_slope():
    x = jnp.array(POINTS)
    slope = jax.vmap(jax.grad(log_cosh))(x)
    for point, value, derivative in zip(POINTS, log_cosh(x), slope, strict=True):
        z = mp.mpf(point)
        assert abs(float(value) - float(mp.log(mp.cosh(mp.sqrt(z))))) <= 3e-16 * max(1.0, point**0.5)
        assert abs(float(derivative) / float(exact_tanhc(z) / 2) - 1) <= 1e-15


@pytest.mark.parametrize("y", [0.0, 1e-12, 1e-3, 1.0, 30.0, 1e4])
def test_expc(y):
    z = mp.mpf(y)
    expected = (1 - mp.exp(-z)) / z if y else mp.mpf(1)
    assert abs(float(expc(jnp.array(y))) / float(expected) - 1) <= 1e-15
    assert np.isfinite(jax.grad(expc)(y))


PAIRS = [0.0, 1e-12, 1e-4, 0.05, 0.0999, 0.1001, 0.10011, 0.99, 3.0, 30.0, 30.0000001, 400.0, 1e4]


def test_divided_differences_and_their_slopes():
    """Equal, nearly equal and very different arguments."""
    for i in PAIRS:
        for j in PAIRS:
            a, b = mp.mpf(i), mp.mpf(j)
            found = divided_differences(jnp.array(i), jnp.array(j))
            for value, f in zip(found, (exact_tanhc, exact_sech2), strict=True):
                at_zero = mp.mpf(-1) / 3 if f is exact_tanhc else mp.mpf(-1)
                slope = mp.diff(f, a) if i else at_zero
                expected = (f(a) - f(b)) / (a - b) if i != j else slope
                assert abs(float(value) / float(expected) - 1) <= 5e-14, (i, j, f)
            slopes = jax.grad(lambda x, y: sum(divided_differences(x, y)), (0, 1))(jnp.array(i), jnp.array(j))
            assert np.all(np.isfinite(slopes)), (i, j)
