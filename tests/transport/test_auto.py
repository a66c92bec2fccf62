"""Auto: which rung it takes, what it says, and that it keeps its word."""

import cases
import jax
import numpy as np
import pytest

import layerfit as lf

DEEP = lf.Stack([lf.HalfSpace("deep", sigma_a=0.01, sigma_s_prime=1.0, g=0.8, n=1.4)])
WITHOUT_G = lf.Stack([lf.HalfSpace("deep", sigma_a=0.01, sigma_s_prime=1.0, n=1.4)])


def test_diffusion_where_it_holds():
    found = lf.predict(DEEP, lf.RadialReflectance(r=[10.0, 12.0]), solver=lf.Auto(tolerance=0.1))[0]
    assert found.solver.name == "layered-diffusion"
    assert "solver auto took layered-diffusion: stated error at most" in found.notes[0]
    assert np.all(found.estimated_error <= 0.1 * found.values)


def test_without_g_diffusion_is_all_there_is():
    found = lf.predict(WITHOUT_G, lf.RadialReflectance(r=[0.5]), solver=lf.Auto(tolerance=0.01))[0]
    assert found.solver.name == "layered-diffusion"
    assert "nothing better" in found.notes[0] and "needs g" in found.notes[0]


def test_transport_near_the_source_and_its_word():
    """A tolerance of 3 %: the first rung of transport theory is enough, is taken, and is that good against Monte Carlo."""
    case = cases.load("si_n14_g08_a0980")
    low, high = case.rings
    use = (low >= 0.5 * case.mfp) & (case.R_se < 0.01 * case.R)
    found = lf.predict(case.stack, lf.RadialReflectance(r_min=low[use], r_max=high[use]), solver=lf.Auto(tolerance=0.03))[0]
    assert found.solver == lf.Auto.ladder()[1]
    assert "12 streams" in found.notes[0] and "layered-diffusion is off by" in found.notes[0]
    assert np.all(np.abs(found.values - case.R[use]) <= 0.03 * case.R[use] + 3.0 * case.R_se[use])


def test_a_fit_says_it_and_looks_again():
    """Made with diffusion far from the source and loose data: diffusion is taken. At absorption found to be high it no longer holds, and a better
    solver goes on; without g there is none."""
    r = np.linspace(9.0, 14.0, 8)
    values = lf.predict(WITHOUT_G, lf.RadialReflectance(r=r), solver=lf.LayeredDiffusion())[0].values
    data = lf.Dataset(lf.RadialReflectance(r=r), values, 0.3 * values)
    problem = lf.Problem(WITHOUT_G, data, free={"deep.sigma_a": {"min": 1e-3, "max": 1.0, "init": 0.02}})
    assert problem.chosen == lf.LayeredDiffusion()
    result = lf.fit(problem, starts=1)
    assert any("solver auto took layered-diffusion" in warning for warning in result.warnings)
    assert problem.solver.choose_again(problem.choice, WITHOUT_G.set({"deep.sigma_a": 5.0}), [data.geometry], 0.3) is None
    again = problem.solver.choose_again(problem.choice, DEEP.set({"deep.sigma_a": 1.0}), [lf.RadialReflectance(r=[1.0])], 0.3)
    assert again is not None and again.rung >= 1


def test_wrong_tolerances():
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="tolerance"):
            lf.Auto(tolerance=wrong)


TEN = [
    "si_n14_g09_a0990",
    "si_match_g0_a0990",
    "si_n14_g08_a0667",
    "si_n14_g098",
    "two_thick_low_over_thin_high",
    "skin_over_fat",
    "head_scalp_skull_csf_brain",
    "absorbing_top",
    "slab_n14_g08_5mfp",
    "skin3_dj_R",
]


@pytest.mark.long
@pytest.mark.parametrize("name", TEN)
@pytest.mark.parametrize("tolerance", [0.05, 0.01])
def test_it_keeps_its_word(name, tolerance):
    """Ten kinds of scenes against Monte Carlo, distances from half a transport mean free path where the reference is good to 2 %."""
    case = cases.load(name)
    low, high = case.rings
    use = (low >= 0.5 * case.mfp) & (case.R_se < 0.02 * case.R)
    found = lf.predict(case.stack, lf.RadialReflectance(r_min=low[use], r_max=high[use]), solver=lf.Auto(tolerance=tolerance))[0]
    jax.clear_caches()
    beyond = np.abs(found.values - case.R[use]) > np.maximum(tolerance, found.estimated_error / found.values) * case.R[use] + 3.0 * case.R_se[use]
    assert np.sum(beyond) <= 1, found.notes
