"""The cheap model of samplers is the problem's own where it matters."""

import equinox as eqx
import numpy as np

import layerfit as lf
from layerfit.inference import quick_model as module
from layerfit.inference.density import Density
from layerfit.inference.log_densities import LogDensities
from layerfit.inference.quick_model import quick_density


def test_the_quick_density_is_the_density():
    """By a tenth of the frequencies, equal where walkers go; where the two could be told apart the problem's own is taken."""
    r = np.geomspace(1.0, 12.0, 12)
    stack = lf.Layer("top", sigma_a=0.02, sigma_s_prime=1.0, n=1.4, thickness=1.5) | lf.HalfSpace("deep", sigma_a=0.01, sigma_s_prime=1.5, n=1.4)
    clean = lf.predict(stack, lf.RadialReflectance(r=r), solver=lf.LayeredDiffusion())[0].values
    data = lf.Dataset(lf.RadialReflectance(r=r), clean, noise=lf.Noise(relative=0.01))
    problem = lf.Problem(stack, data, free={"top.sigma_a": (5e-3, 0.1), "deep.sigma_s_prime": (0.5, 4.0)}, solver=lf.LayeredDiffusion())
    x = np.array([0.02, 1.5])
    exact, quick = Density(problem), quick_density(problem, x)
    counts = [density.model.samples[0].forward.plans[0].k.size for density in (exact, quick)]
    assert counts[1] <= counts[0] / 4
    around = x * np.exp(0.05 * np.random.default_rng(3).standard_normal((16, 2)))
    assert np.max(np.abs(LogDensities(exact)(around) - LogDensities(quick)(around))) <= 1e-3


def test_a_quick_density_that_errs_is_not_taken(monkeypatch):
    data = lf.Dataset(lf.RadialReflectance(r=[1.0, 2.0, 4.0]), [0.02, 0.008, 0.002], noise=lf.Noise(relative=0.01))
    skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.02, sigma_s_prime=1.2, n=1.4)])
    problem = lf.Problem(skin, data, free={"skin.sigma_a": (1e-3, 1.0)}, solver=lf.LayeredDiffusion())
    wrong = eqx.tree_at(lambda m: m.samples[0].forward.plans[0].weights, problem.model, 1.001 * problem.model.samples[0].forward.plans[0].weights)
    monkeypatch.setattr(module, "quick_model", lambda problem: wrong)
    assert quick_density(problem, np.array([0.02])).model is problem.model
