"""Whether the error that discrete ordinates state is the true one; backward scattering."""

import numpy as np
import pytest
from ordinates_scenes import R_ALL, R_DIFFUSE, T_DIFFUSE, R, T, predicted, slab

import layerfit as lf

ALL = [R_ALL, T, R_DIFFUSE, T_DIFFUSE]


def random_scenes(n: float, g_max: float, count: int, seed: int):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        tau, g, albedo = 10.0 ** rng.uniform(-3.0, 2.0), rng.uniform(0.0, g_max), rng.uniform(0.3, 1.0)
        yield slab(tau, albedo, g, n)


@pytest.mark.long
def test_stated_errors():
    """Where 32 streams are the default, against 64: stated at least as large as true in 95 % of the totals, and within 100 times in the median."""
    true, stated = [], []
    for stack in [*random_scenes(1.0, 0.8, 20, 5), *random_scenes(1.4, 0.6, 20, 6)]:
        found = lf.predict(stack, ALL, solver=lf.DiscreteOrdinates())
        true.append([abs(a.values[0] - b[0]) for a, b in zip(found, predicted(stack, ALL, 64), strict=True)])
        stated.append([a.estimated_error[0] for a in found])
    true, stated = np.array(true), np.array(stated)
    assert np.mean(true > stated) <= 0.05
    assert np.median(stated / np.maximum(true, 1e-12)) <= 100.0


def test_backward_scattering():
    """Henyey-Greenstein of g -0.5 against Monte Carlo: totals within 4 standard errors, to which 24 streams add 1e-5."""
    stack = slab(2.0, 0.9, -0.5, 1.4)
    walked = lf.predict(stack, [R, T], solver=lf.MonteCarlo(photons=200_000, seed=3))
    for value, other in zip(predicted(stack, [R, T], 24), walked, strict=True):
        assert abs(value[0] - other.values[0]) <= 4.0 * other.estimated_error[0] + 1e-5
        assert other.estimated_error[0] <= 2e-3


@pytest.mark.long
def test_backward_scattering_converges():
    """32 streams against 64, matched, down to g -0.75; backward scattering reflects more."""
    last = 0.0
    for g in (0.0, -0.25, -0.5, -0.75):
        few, many = (np.array(predicted(slab(2.0, 0.9, g), ALL, streams))[:, 0] for streams in (32, 64))
        assert np.abs(few - many).max() <= 2e-6
        assert few[0] >= last
        last = few[0]
