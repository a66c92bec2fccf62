"""Profile likelihoods against parabolas, brute force and coverage."""

import numpy as np
import pytest

import layerfit as lf

SOLVER = lf.LayeredDiffusion()
R = np.linspace(0.5, 15.0, 24)
TWO = lf.Layer("top", sigma_a=0.01, sigma_s_prime=1.0, n=1.4, thickness=1.5) | lf.HalfSpace("deep", sigma_a=0.02, sigma_s_prime=1.5, n=1.4)
FREE = {"top.sigma_a": (1e-4, 1.0), "top.thickness": (0.1, 10.0), "deep.sigma_a": (1e-3, 1.0), "deep.sigma_s_prime": (0.1, 20.0)}
CLEAN = lf.predict(TWO, lf.RadialReflectance(r=R), solver=SOLVER)[0].values


def fitted(free, noise, *, seed=1, stated=True):
    values = CLEAN * (1 + noise * np.random.default_rng(seed).standard_normal(R.size))
    data = lf.Dataset(lf.RadialReflectance(r=R), values, noise=lf.Noise(relative=noise) if stated else None)
    return lf.fit(lf.Problem(TWO, data, free=free, solver=SOLVER), starts=4)


@pytest.fixture(scope="module")
def low_noise():
    return fitted({name: FREE[name] for name in ("deep.sigma_a", "deep.sigma_s_prime")}, 1e-3)


@pytest.fixture(scope="module")
def bent():
    return fitted(FREE, 0.01, seed=3)


def test_parabola_at_low_noise(low_noise):
    """There the profile is the parabola of the standard error, and the intervals are 0.994 and 1.960 of them."""
    profile = low_noise.profile("deep.sigma_a")
    estimate = low_noise.parameters["deep.sigma_a"]
    z = (profile.values - estimate.value) / estimate.stderr
    assert np.max(np.abs(profile.delta - z**2)[np.abs(z) <= 2.5]) <= 0.06
    for level, factor in ((0.68, 0.9945), (0.95, 1.95996)):
        interval = profile.intervals[level]
        assert not interval.low_open and not interval.high_open
        assert abs((interval.high - estimate.value) / estimate.stderr / factor - 1) <= 0.02
        assert abs((estimate.value - interval.low) / estimate.stderr / factor - 1) <= 0.02
    assert profile.warnings == ()


def test_against_fits_with_the_number_held(bent):
    """Each point is the chi-square of a fit in which the number is not free; the others follow."""
    profile = bent.profile("deep.sigma_a")
    free = {name: bounds for name, bounds in FREE.items() if name != "deep.sigma_a"}
    for i in (3, len(profile.values) // 2, len(profile.values) - 4):
        held = lf.fit(lf.Problem(TWO.set({"deep.sigma_a": float(profile.values[i])}), bent.problem.data, free=free, solver=SOLVER), starts=6)
        assert abs(profile.delta[i] - (held.chi2 - bent.chi2)) <= 2e-3
        assert profile.x[i, 2] == pytest.approx(profile.values[i], rel=1e-9)
    crossing = {level: np.interp([i.low, i.high], profile.values, profile.delta) for level, i in profile.intervals.items()}
    assert np.max(np.abs(crossing[0.68] - 0.989)) <= 0.05
    assert np.max(np.abs(crossing[0.95] - 3.841)) <= 0.1


def test_correlated_noise_and_a_prior_count():
    """The rise is that of both together: chi-square by the covariance and the square of the prior, against fits with the number held."""
    prior = {"min": 0.1, "max": 20.0, "init": 1.5, "prior": lf.Normal(1.48, 0.02)}
    free = {"deep.sigma_a": (1e-3, 1.0), "deep.sigma_s_prime": prior}
    values = CLEAN * (1 + 0.01 * np.random.default_rng(5).standard_normal(R.size))
    data = lf.Dataset(lf.RadialReflectance(r=R), values, noise=lf.Noise(relative=0.01))
    noise = lf.CorrelatedNoise(relative=0.02, length=3.0)
    fit = lf.fit(lf.Problem(TWO, data, free=free, likelihood=noise, solver=SOLVER), starts=2)
    profile = fit.profile("deep.sigma_a")
    best = fit.chi2 + ((fit.x[1] - 1.48) / 0.02) ** 2
    for i in (2, len(profile.values) - 3):
        stack = TWO.set({"deep.sigma_a": float(profile.values[i])})
        held = lf.fit(lf.Problem(stack, data, free={"deep.sigma_s_prime": prior}, likelihood=noise, solver=SOLVER), starts=2)
        assert profile.delta[i] >= 0.5
        assert abs(profile.delta[i] - (held.chi2 + ((held.x[0] - 1.48) / 0.02) ** 2 - best)) <= 2e-3


def test_only_least_squares():
    data = lf.Dataset(lf.RadialReflectance(r=R), CLEAN, noise=lf.Noise(relative=0.01))
    fit = lf.fit(lf.Problem(TWO, data, free={"deep.sigma_a": (1e-3, 1.0)}, likelihood=lf.StudentT(), solver=SOLVER), starts=1)
    with pytest.raises(lf.InputError, match="profile likelihood takes least squares alone; allowed are"):
        fit.profile("deep.sigma_a")


def test_an_open_side_is_said(bent):
    """sigma_a of the thin upper layer may be anything below its upper end."""
    profile = bent.profile("top.sigma_a")
    assert profile.intervals[0.95].low_open
    assert profile.intervals[0.95].low == 1e-4
    assert not profile.intervals[0.95].high_open
    assert any("top.sigma_a is open below at" in warning and "its bound 0.0001 1/mm" in warning for warning in profile.warnings)
    assert "open below to" in profile.summary()
    assert profile.plot().axes[0].get_ylabel() == "rise of chi-square"


def test_estimated_noise(low_noise):
    """Without sd the rise is n log of the ratio of the sums of squares."""
    fit = fitted({name: FREE[name] for name in ("deep.sigma_a", "deep.sigma_s_prime")}, 1e-3, stated=False)
    profile = fit.profile("deep.sigma_a")
    estimate = fit.parameters["deep.sigma_a"]
    width = 0.5 * (profile.intervals[0.68].high - profile.intervals[0.68].low)
    # n log(1 + z^2/dof) = 0.989 at this many standard errors, the sd of the noise being estimated with dof
    expected = np.sqrt(fit.dof * np.expm1(0.98895 / R.size))
    assert abs(width / estimate.stderr / expected - 1) <= 0.03


@pytest.mark.parametrize(
    ("name", "levels", "said"),
    [("deep.n", (0.68,), "'deep.n' is not free"), ("deep.sigma_a", (68.0,), "level = 68"), ("deep.sigma_a", (0.0,), "level = 0")],
)
def test_wrong_input(low_noise, name, levels, said):
    with pytest.raises(lf.InputError) as raised:
        lf.profile_likelihood(low_noise, name, levels=levels)
    assert said in str(raised.value)
