"""Covariances of many minima, linear ones, where all is known in closed form."""

import numpy as np
import pytest

import layerfit as lf
from layerfit.inference.parameters import FreeParameter
from layerfit.inference.uncertainty import covariances

# numbers of either sign, whose natural scale is their interval: a linear model stays one
PARAMETERS = [FreeParameter(f"probe.{name}", -2.0, 2.0, 0.0, "linear", "1") for name in ("offset", "background", "other.offset")]
JACOBIAN = np.random.default_rng(1).standard_normal((9, 3))


def known(x, residual, variance=1.0):
    found = covariances(
        PARAMETERS,
        np.array([x, [0.1, 0.2, 0.3]]),
        lambda points, owner: np.repeat(JACOBIAN[None], len(points), axis=0),
        np.stack([JACOBIAN, JACOBIAN]),
        np.stack([residual, np.zeros(9)]),
        np.array([variance, 1.0]),
    )
    assert np.max(np.abs(found.covariance[1] - np.linalg.inv(JACOBIAN.T @ JACOBIAN))) <= 1e-12
    return found


def test_inside():
    found = known([0.0, 0.5, -0.5], np.zeros(9), variance=2.5)
    assert np.max(np.abs(found.covariance[0] - 2.5 * np.linalg.inv(JACOBIAN.T @ JACOBIAN))) <= 1e-12
    assert np.max(np.abs(found.relative[0] - np.sqrt(np.diag(found.covariance[0])) / 4.0)) <= 1e-12
    assert not np.any(found.at_bound)


@pytest.mark.parametrize("push", [0.0, 3.0])
def test_others_follow_a_number_that_leaves_its_bound(push):
    """At its lower bound, pushed against it or not: the others move as least squares says until chi-square has risen by 1."""
    ours, bound = JACOBIAN[:, [0, 2]], JACOBIAN[:, 1]
    across = bound - ours @ np.linalg.lstsq(ours, bound, rcond=None)[0]
    residual = push * across / (across @ across)
    found = known([0.0, -2.0, 0.5], residual)
    assert found.at_bound[0].tolist() == [False, True, False]
    assert np.all(found.covariance[0][1] == 0)

    def rise(way):
        others = np.linalg.lstsq(ours, -(residual + way * bound), rcond=None)[0]
        return np.sum((residual + way * bound + ours @ others) ** 2) - np.sum(residual**2), others

    low, high = 0.0, 4.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rise(middle)[0] < 1 else (low, middle)
    moved = rise(low)[1]
    expected = np.linalg.inv(ours.T @ ours) + np.outer(moved, moved)
    assert np.max(np.abs(found.covariance[0][np.ix_([0, 2], [0, 2])] - expected)) <= 1e-8
    assert np.max(np.abs(moved)) >= 0.02


SOLVERS = {"layered-diffusion": lf.LayeredDiffusion(), "multipole": lf.Multipole()}
TRUTH = {
    "top.sigma_a": 0.005,
    "top.sigma_s_prime": 1.2,
    "top.thickness": 4.0,
    "deep.sigma_a": 0.05,
    "deep.sigma_s_prime": 0.8,
    "probe.amplitude": 1.3,
}
STACK = lf.Layer("top", sigma_a=0.01, sigma_s_prime=1.0, n=1.4, thickness=2.0) | lf.HalfSpace("deep", sigma_a=0.01, sigma_s_prime=1.0, n=1.4)
BOUNDS = {"sigma_a": (1e-4, 1.0), "sigma_s_prime": (0.1, 20.0), "thickness": (0.1, 20.0), "amplitude": {"min": 0.1, "max": 10.0, "scale": "log"}}


@pytest.mark.parametrize("solver", SOLVERS)
def test_relative_profiles_give_no_confident_wrong_number(solver):
    """Six free numbers, the amplitude among them, 1 %: the fit says ill-posed; a number off by more than 4 standard errors is named in a warning."""
    geometry = lf.RadialReflectance(r=np.geomspace(1.0, 20.0, 20))
    stack = STACK.set({name: value for name, value in TRUTH.items() if name != "probe.amplitude"})
    clean = 1.3 * lf.predict(stack, geometry, solver=SOLVERS[solver])[0].values
    free = {name: BOUNDS[name.split(".")[1]] for name in TRUTH}
    rng = np.random.default_rng(11)
    said = 0
    for _ in range(6):
        data = lf.Dataset(geometry, clean * (1 + 0.01 * rng.standard_normal(clean.size)), sd=0.01 * clean, name="probe")
        result = lf.fit(lf.Problem(STACK, data, free=free, solver=SOLVERS[solver]))
        said += any(warning.startswith("ill-posed") for warning in result.warnings)
        for name, estimate in result.parameters.items():
            silent = not any(name in warning for warning in result.warnings)
            if silent:
                assert estimate.stderr is not None
                assert abs(estimate.value - TRUTH[name]) <= 4 * estimate.stderr, (name, result)
    assert said >= 5
