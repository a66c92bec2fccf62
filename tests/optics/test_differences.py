"""Divided differences between three and four points, against 120 digits, from 1e-12 to 1e10, apart and coinciding."""

import jax.numpy as jnp
import mpmath as mp
import numpy as np

from layerfit.optics.differences import second_differences, third_difference


def _tanh(x):
    return mp.tanh(mp.sqrt(x)) / mp.sqrt(x)


def _sech2(x):
    return mp.sech(mp.sqrt(x)) ** 2


def _divided(function, points):
    points = [mp.mpf(float(x)) * (1 + mp.mpf(10) ** -25 * (i + 1)) + mp.mpf(10) ** -27 * (i + 1) for i, x in enumerate(points)]
    table = [function(x) for x in points]
    for k in range(1, len(points)):
        table = [(table[i + 1] - table[i]) / (points[i + k] - points[i]) for i in range(len(table) - 1)]
    return table[0]


def _points(rng):
    points = 10 ** rng.uniform(-12, 9) * (1 + 10 ** rng.uniform(-14, 1) * rng.uniform(0, 1, 4))
    kind = rng.integers(4)
    if kind == 1:
        points[0] = 0.0
    elif kind == 2:
        points[:2] = 0.0
    elif kind == 3:
        points[2] = 10 ** rng.uniform(-9, 9)
    return rng.permutation(points)


def test_differences_keep_their_digits():
    rng = np.random.default_rng(0)
    points = np.array([_points(rng) for _ in range(150)])
    two, sech = (np.asarray(v) for v in second_differences(*jnp.asarray(points[:, :3].T)))
    three = np.asarray(third_difference(*jnp.asarray(points.T)))
    with mp.workdps(120):
        for i, row in enumerate(points):
            exact2, exact3, exact_sech = _divided(_tanh, row[:3]), _divided(_tanh, row), _divided(_sech2, row[:3])
            assert abs(two[i] - exact2) <= 1e-9 * abs(exact2)
            assert abs(three[i] - exact3) <= 1e-7 * abs(exact3)
            assert abs(sech[i] - exact_sech) <= 1e-8 * abs(exact_sech) + mp.mpf(1e-20) * abs(exact2)
