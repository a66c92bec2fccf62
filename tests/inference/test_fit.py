"""Fits of data whose truth is known."""

import numpy as np
import pytest

import layerfit as lf

TRUTH = {
    "top.sigma_a": 0.01,
    "top.sigma_s_prime": 1.0,
    "top.thickness": 1.0,
    "deep.sigma_a": 0.02,
    "deep.sigma_s_prime": 1.5,
}
BOUNDS = {name: (1e-4, 1.0) if "sigma_a" in name else (0.1, 20.0) if "sigma_s" in name else (0.1, 10.0) for name in TRUTH}
TWO = lf.Layer("top", sigma_a=0.01, sigma_s_prime=1.0, n=1.4, thickness=1.0) | lf.HalfSpace("deep", sigma_a=0.02, sigma_s_prime=1.5, n=1.4)
R = np.linspace(0.5, 15.0, 40)
SOLVER = lf.LayeredDiffusion()


def profile(stack=TWO, geometry=None):
    return lf.predict(stack, lf.RadialReflectance(r=R) if geometry is None else geometry, solver=SOLVER)[0].values


CLEAN = profile()


def problem(values, free, *, geometry=None, stack=TWO, relative=0.01, **more):
    data = lf.Dataset(lf.RadialReflectance(r=R) if geometry is None else geometry, values, noise=lf.Noise(relative=relative), name="probe")
    return lf.Problem(stack, data, free=free, solver=SOLVER, **more)


def errors(result, truth=TRUTH):
    return {name: abs(estimate.value / truth[name] - 1) for name, estimate in result.parameters.items()}


def test_truth_from_twenty_random_guesses():
    """Two layers, five numbers, guesses log-uniform over the whole range: truth to 1e-6 in 19 or more; the other says that it failed."""
    rng = np.random.default_rng(20)
    found = 0
    for _ in range(20):
        guess = {name: float(np.exp(rng.uniform(np.log(low), np.log(high)))) for name, (low, high) in BOUNDS.items()}
        free = {name: {"min": low, "max": high, "init": guess[name]} for name, (low, high) in BOUNDS.items()}
        result = lf.fit(problem(CLEAN, free))
        if max(errors(result).values()) <= 1e-6:
            found += 1
        else:
            assert result.outcome is not lf.Outcome.CONVERGED or any("at its" in w or "chi-square" in w for w in result.warnings)
    print(f"truth found from {found} of 20 guesses")  # shown by -rP
    assert found >= 19


def test_says_what_the_data_cannot_tell():
    """With 1 % noise sigma_a of the upper layer is all but open; the others are determined."""
    noisy = CLEAN * (1 + 0.01 * np.random.default_rng(3).standard_normal(R.size))
    result = lf.fit(problem(noisy, BOUNDS))
    assert result.outcome is lf.Outcome.CONVERGED
    assert any(w.startswith("top.sigma_a is") and ("determined" in w or "bound" in w) for w in result.warnings)
    for name in ("top.sigma_s_prime", "top.thickness", "deep.sigma_a", "deep.sigma_s_prime"):
        estimate = result.parameters[name]
        assert estimate.stderr is not None
        assert estimate.stderr / estimate.value <= 0.3
        assert abs(estimate.value - TRUTH[name]) <= 4 * estimate.stderr
    exact = lf.fit(problem(CLEAN, BOUNDS))
    relative = exact.parameters["top.sigma_a"].stderr / TRUTH["top.sigma_a"]
    assert relative >= 0.3
    assert "top.sigma_a is not determined by the data" in exact.warnings


def test_intervals_cover_the_truth():
    """200 noisy copies, sigma_a of the upper layer held: 68 % intervals hold the truth in 60 to 76 % for every number."""
    free = {name: bounds for name, bounds in BOUNDS.items() if name != "top.sigma_a"}
    rng = np.random.default_rng(68)
    inside = dict.fromkeys(free, 0)
    chi2 = []
    for _ in range(200):
        noisy = CLEAN * (1 + 0.01 * rng.standard_normal(R.size))
        data = lf.Dataset(lf.RadialReflectance(r=R), noisy, sd=0.01 * CLEAN)
        result = lf.fit(lf.Problem(TWO, data, free=free, solver=SOLVER), starts=1)
        chi2.append(result.chi2)
        for name, estimate in result.parameters.items():
            inside[name] += abs(estimate.value - TRUTH[name]) <= estimate.stderr
    print({name: f"{count / 2:g} % covered" for name, count in inside.items()}, f"mean chi-square {np.mean(chi2):.2f}")
    for name, count in inside.items():
        assert 120 <= count <= 152, name
    assert abs(np.mean(chi2) - 36) <= 3 * np.sqrt(2 * 36 / 200)


def test_covariance_is_that_of_repeated_fits():
    """Off-diagonal elements too: the correlation of two numbers over noisy copies is the one that a single fit states."""
    free = {"deep.sigma_a": BOUNDS["deep.sigma_a"], "deep.sigma_s_prime": BOUNDS["deep.sigma_s_prime"]}
    rng = np.random.default_rng(5)
    ends = []
    for _ in range(200):
        data = lf.Dataset(lf.RadialReflectance(r=R), CLEAN * (1 + 0.01 * rng.standard_normal(R.size)), sd=0.01 * CLEAN)
        result = lf.fit(lf.Problem(TWO, data, free=free, solver=SOLVER), starts=1)
        ends.append(result.x)
    stated, found = result.correlation[0, 1], np.corrcoef(np.array(ends).T)[0, 1]
    assert abs(np.arctanh(stated) - np.arctanh(found)) <= 3 / np.sqrt(197)
    spread = np.std(ends, axis=0, ddof=1) / np.sqrt(np.diag(result.covariance))
    assert np.max(np.abs(spread - 1)) <= 0.15
    assert abs(stated) > 0.3


def test_calibration_numbers_come_back():
    """Amplitude, offset of r and background as free numbers beside the layers."""
    rings = lf.RadialReflectance(r=R + 0.07)
    values = 1.13 * profile(geometry=rings) + 2e-6
    free = {
        "deep.sigma_a": BOUNDS["deep.sigma_a"],
        "deep.sigma_s_prime": BOUNDS["deep.sigma_s_prime"],
        "probe.amplitude": (0.5, 2.0),
        "probe.offset": (-0.2, 0.2),
        "probe.background": (0.0, 1e-4),
    }
    result = lf.fit(problem(values, free))
    truth = {"deep.sigma_a": 0.02, "deep.sigma_s_prime": 1.5, "probe.amplitude": 1.13, "probe.offset": 0.07, "probe.background": 2e-6}
    assert max(errors(result, truth).values()) <= 1e-5
    assert [result.parameters[name].unit for name in truth] == ["1/mm", "1/mm", "1", "mm", "1/mm^2"]


def test_tied_numbers_move_together():
    """sigma_s' of the upper layer is 2/3 of the lower one's; only one of them is free."""
    free = {"deep.sigma_s_prime": BOUNDS["deep.sigma_s_prime"], "deep.sigma_a": BOUNDS["deep.sigma_a"]}
    result = lf.fit(problem(CLEAN, free, stack=TWO.set({"deep.sigma_s_prime": 3.0}), ties={"top.sigma_s_prime": ("deep.sigma_s_prime", 2 / 3)}))
    assert max(errors(result).values()) <= 1e-6
    assert abs(result.stack.get("top.sigma_s_prime") / 1.0 - 1) <= 1e-6


@pytest.mark.parametrize(("name", "truth", "bounds"), [("top.n", 1.45, (1.3, 1.6)), ("top.roughness", 0.2, (0.0, 0.5)), ("deep.g", 0.7, (0.0, 0.95))])
def test_any_number_can_be_free(name, truth, bounds):
    stack = lf.Stack([layer.replace(g=0.8) for layer in TWO.layers])
    geometries = [lf.SpatialFrequency(k=[0.0, 0.1, 0.3, 1.0]), lf.TotalReflectance(incidence=50.0, specular="included")]
    predicted = lf.predict(stack.set({name: truth}), geometries, solver=SOLVER)
    data = [lf.Dataset(p.geometry, p.values, noise=lf.Noise(relative=0.01), name=f"m{i}") for i, p in enumerate(predicted)]
    start = 0.5 * (bounds[0] + bounds[1])
    result = lf.fit(lf.Problem(stack, data, free={name: {"min": bounds[0], "max": bounds[1], "init": start}}, solver=SOLVER))
    assert abs(result.x[0] - truth) <= 1e-5


def test_says_that_a_number_is_at_its_bound():
    result = lf.fit(problem(CLEAN, {"deep.sigma_a": (0.03, 1.0), "deep.sigma_s_prime": (0.1, 20.0)}, stack=TWO.set({"deep.sigma_a": 0.05})))
    estimate = result.parameters["deep.sigma_a"]
    assert estimate.at_bound
    assert estimate.stderr is None
    assert any(w.startswith("deep.sigma_a is at its lower bound") for w in result.warnings)
    assert np.all(result.covariance[0] == 0)
    assert result.parameters["deep.sigma_s_prime"].stderr > 0


def test_says_that_the_model_does_not_fit():
    bent = CLEAN * (1 + 0.1 * np.sin(R))
    result = lf.fit(problem(bent, {"deep.sigma_a": BOUNDS["deep.sigma_a"]}))
    assert any("does not describe the data" in w for w in result.warnings)
    assert result.chi2_reduced > 10


def test_noise_is_estimated_where_none_was_given():
    noisy = CLEAN * (1 + 0.03 * np.random.default_rng(8).standard_normal(R.size))
    data = lf.Dataset(lf.RadialReflectance(r=R), noisy)
    free = {"deep.sigma_a": BOUNDS["deep.sigma_a"], "deep.sigma_s_prime": BOUNDS["deep.sigma_s_prime"]}
    result = lf.fit(lf.Problem(TWO, data, free=free, solver=SOLVER))
    assert abs(result.noise / 0.03 - 1) <= 0.35
    assert abs(result.chi2_reduced - 1) <= 1e-9
    assert any("one relative noise was estimated" in w for w in result.warnings)


def test_starts_that_disagree_are_reported():
    """One value of total reflectance of a slab against its thickness and absorption: many starts, one valley; two minima need a warning."""
    slab = lf.Stack([lf.Layer("slab", sigma_a=0.01, sigma_s_prime=1.0, n=1.4, thickness=2.0)])
    geometry = lf.RadialReflectance(r=np.linspace(0.5, 6, 12))
    values = profile(slab, geometry)
    data = lf.Dataset(geometry, values * (1 + 0.3 * np.cos(4 * np.arange(12))), noise=lf.Noise(relative=0.02))
    free = {"slab.sigma_a": (1e-4, 3.0), "slab.sigma_s_prime": (0.05, 50.0), "slab.thickness": (0.05, 50.0)}
    result = lf.fit(lf.Problem(slab, data, free=free, solver=SOLVER))
    ends = {round(start.chi2, 1) for start in result.starts}
    assert (len(ends) > 1) == any("starts reached the best minimum" in w for w in result.warnings)
    assert result.starts[0].chi2 <= min(start.chi2 for start in result.starts)


def test_nothing_of_the_problem_changes():
    stated = problem(CLEAN, BOUNDS, stack=TWO.set({"top.sigma_s_prime": 2.0}))
    before = repr(stated.stack)
    one, other = lf.fit(stated), lf.fit(stated)
    assert repr(stated.stack) == before
    assert np.max(np.abs(one.x - other.x) / one.x) <= 1e-12
    assert one.problem is stated
