"""Likelihoods against scipy's densities, and what they do to a fit."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import layerfit as lf
from layerfit.inference.density import Density

SKIN = lf.Stack([lf.HalfSpace("skin", sigma_a=0.02, sigma_s_prime=1.5, n=1.4)])
SOLVER = lf.LayeredDiffusion()
R = np.geomspace(1.0, 10.0, 20)
GEOMETRY = lf.RadialReflectance(r=R)
CLEAN = lf.predict(SKIN, GEOMETRY, solver=SOLVER)[0].values
FREE = {"skin.sigma_a": (1e-3, 1.0), "skin.sigma_s_prime": (0.1, 10.0)}
NOISY = CLEAN * (1.0 + 0.02 * np.random.default_rng(4).standard_normal(R.size))
PROBE = lf.Dataset(GEOMETRY, NOISY, sd=0.02 * CLEAN, name="probe")
THERE = jnp.array([0.021, 1.4])
PREDICTED = lf.predict(SKIN.set({"skin.sigma_a": 0.021, "skin.sigma_s_prime": 1.4}), GEOMETRY, solver=SOLVER)[0].values


def problem(data=PROBE, **more):
    return lf.Problem(SKIN, data, free=FREE, solver=SOLVER, **more)


def log_likelihood(stated):
    return float(Density(stated).log_likelihood(THERE))


def counts(exposure, seed=5):
    return lf.Dataset(GEOMETRY, np.random.default_rng(seed).poisson(exposure * CLEAN), exposure=exposure, name="probe")


def test_gaussian():
    assert abs(log_likelihood(problem()) - np.sum(stats.norm.logpdf(NOISY, PREDICTED, 0.02 * CLEAN))) <= 1e-8


def test_student():
    expected = np.sum(stats.t.logpdf(NOISY, 3.0, PREDICTED, 0.02 * CLEAN))
    assert abs(log_likelihood(problem(likelihood=lf.StudentT(nu=3.0))) - expected) <= 1e-8


@pytest.mark.parametrize("axis", ["place", "index"])
def test_correlated(axis):
    x = R if axis == "place" else np.arange(R.size)
    size = 0.03 * np.abs(NOISY)
    covariance = np.diag((0.02 * CLEAN) ** 2) + np.outer(size, size) * np.exp(-np.abs(x[:, None] - x) / 1.7)
    expected = stats.multivariate_normal.logpdf(NOISY, PREDICTED, covariance)
    assert abs(log_likelihood(problem(likelihood=lf.CorrelatedNoise(0.03, 1.7, axis))) - expected) <= 1e-7


def test_poisson():
    data = counts(3e4)  # from hundreds of counts down to none
    seen = np.round(data.values * 3e4)
    assert seen.min() <= 5 and seen.max() >= 100
    assert abs(log_likelihood(problem(data)) - np.sum(stats.poisson.logpmf(seen, 3e4 * PREDICTED))) <= 1e-6


def test_an_outlier_hardly_pulls():
    """One value 20 sd off: Student's t moves by less than 1 sd of the clean fit, least squares by more than 2."""
    clean = lf.fit(problem(likelihood=lf.StudentT()))
    off = NOISY.copy()
    off[8] += 20 * 0.02 * CLEAN[8]
    data = lf.Dataset(GEOMETRY, off, sd=0.02 * CLEAN, name="probe")
    robust, plain = lf.fit(problem(data, likelihood=lf.StudentT())), lf.fit(problem(data))
    sd = np.sqrt(np.diag(clean.covariance))
    assert np.max(np.abs(robust.x - clean.x) / sd) <= 1.0
    assert np.max(np.abs(plain.x - clean.x) / sd) >= 2.0
    assert robust.outcome is lf.Outcome.CONVERGED
    assert not any("does not describe" in w for w in robust.warnings)


def test_many_degrees_of_freedom_are_normal():
    """Student's t with a million: value, covariance and chi-square of least squares, by another way through the program."""
    wide, plain = lf.fit(problem(likelihood=lf.StudentT(nu=1e6))), lf.fit(problem())
    assert np.max(np.abs(wide.x / plain.x - 1.0)) <= 1e-5
    assert np.max(np.abs(np.sqrt(np.diag(wide.covariance) / np.diag(plain.covariance)) - 1.0)) <= 0.02
    assert abs(wide.correlation[0, 1] - plain.correlation[0, 1]) <= 0.02
    assert abs(wide.chi2 / plain.chi2 - 1.0) <= 1e-4


def test_correlated_noise_in_a_fit():
    """Amplitude alone (linear): value and sd of generalised least squares in closed form, and wider than without the correlated part."""
    free = {"probe.amplitude": (0.2, 5.0)}
    kind = lf.CorrelatedNoise(0.03, 4.0)
    result = lf.fit(lf.Problem(SKIN, PROBE, free=free, solver=SOLVER, likelihood=kind))
    covariance = np.diag((0.02 * CLEAN) ** 2) + 0.03**2 * np.outer(NOISY, NOISY) * np.exp(-np.abs(R[:, None] - R) / 4.0)
    inverse = np.linalg.inv(covariance)
    variance = 1.0 / (CLEAN @ inverse @ CLEAN)
    assert abs(result.x[0] / (variance * CLEAN @ inverse @ NOISY) - 1.0) <= 1e-6
    assert abs(result.parameters["probe.amplitude"].stderr / np.sqrt(variance) - 1.0) <= 1e-3
    left = NOISY - result.x[0] * CLEAN
    assert abs(result.chi2 / (left @ inverse @ left) - 1.0) <= 1e-6


def test_counts():
    """An amplitude of counts: the maximum is the ratio of sums, its variance their Poisson one; few counts bias neither."""
    data = counts(3e4)
    result = lf.fit(lf.Problem(SKIN, data, free={"probe.amplitude": (0.2, 5.0)}, solver=SOLVER))
    seen = np.sum(np.round(data.values * 3e4))
    best = seen / (3e4 * np.sum(CLEAN))
    assert abs(result.x[0] / best - 1.0) <= 1e-5
    assert abs(result.parameters["probe.amplitude"].stderr / (best / np.sqrt(seen)) - 1.0) <= 0.01


def test_one_likelihood_for_each():
    second = lf.Dataset(lf.TotalReflectance(), [0.4], sd=0.01, name="total")
    stated = problem([PROBE, second], likelihood={"probe": {"student-t": {"nu": 3}}})
    assert [one.kind for one in stated.likelihoods] == ["student-t", "gaussian"]
    with pytest.raises(lf.InputError, match="no measurement 'prob'"):
        problem([PROBE, second], likelihood={"prob": "gaussian", "total": "gaussian"})


WRONG = {
    "cauchy": "allowed: gaussian, student-t, poisson, correlated",
    "poisson": "needs counts",
    "correlated": "needed are relative, length",
}


@pytest.mark.parametrize("kind", WRONG)
def test_wrong_likelihoods(kind):
    with pytest.raises(lf.InputError, match=WRONG[kind]):
        problem(likelihood=kind)


def test_wrong_numbers_of_likelihoods():
    for make in (lambda: lf.StudentT(nu=0.0), lambda: lf.CorrelatedNoise(0.1, -1.0), lambda: lf.CorrelatedNoise(np.nan, 1.0)):
        with pytest.raises(lf.InputError, match="allowed is a finite number above 0"):
            make()
    with pytest.raises(lf.InputError, match="allowed: place, index"):
        lf.CorrelatedNoise(0.1, 1.0, "time")
    with pytest.raises(lf.InputError, match="needs the noise of the data"):
        problem(lf.Dataset(GEOMETRY, NOISY), likelihood=lf.StudentT())


@pytest.mark.parametrize(("count", "exposure", "said"), [(1.5, 1.0, "whole numbers"), (2.0, 0.0, "above 0"), (-1.0, 1.0, "at least 0")])
def test_wrong_counts(count, exposure, said):
    with pytest.raises(lf.InputError, match=said):
        lf.Dataset(GEOMETRY, [count] * R.size, exposure=exposure)


def test_noise_and_prior_estimated_together():
    """Data without sd and a prior that agrees with them: the posterior is narrower than either, and its density integrates the noise out."""
    data = lf.Dataset(GEOMETRY, NOISY, name="probe")
    plain = lf.fit(lf.Problem(SKIN, data, free={"probe.amplitude": (0.2, 5.0)}, solver=SOLVER))
    sd = plain.parameters["probe.amplitude"].stderr
    free = {"probe.amplitude": {"min": 0.2, "max": 5.0, "prior": lf.Normal(float(plain.x[0]) + sd, sd)}}
    both = lf.fit(lf.Problem(SKIN, data, free=free, solver=SOLVER))
    assert abs(both.parameters["probe.amplitude"].stderr / (sd / np.sqrt(2.0)) - 1.0) <= 0.06
    assert abs((both.x[0] - plain.x[0]) / sd - 0.5) <= 0.05
    assert abs(both.noise / plain.noise - 1.0) <= 0.05
