"""Priors: their densities against scipy, what they do to a fit, hierarchies, and numbers that follow by a function."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate, stats

import layerfit as lf
from layerfit.inference.density import Density
from layerfit.inference.parameters import free_parameters

SKIN = lf.Stack([lf.HalfSpace("skin", sigma_a=0.02, sigma_s_prime=1.5, n=1.4)])
SOLVER = lf.LayeredDiffusion()
R = np.geomspace(1.0, 10.0, 12)
CLEAN = lf.predict(SKIN, lf.RadialReflectance(r=R), solver=SOLVER)[0].values
BOUNDS = {"skin.sigma_a": (1e-3, 1.0), "skin.sigma_s_prime": (0.1, 10.0)}


def probe(values=CLEAN, *, relative=0.01, name="probe"):
    return lf.Dataset(lf.RadialReflectance(r=R), values, sd=relative * CLEAN, name=name)


def problem(data=None, free=BOUNDS, **more):
    return lf.Problem(SKIN, probe() if data is None else data, free=free, solver=SOLVER, **more)


def with_prior(name, prior, **more):
    low, high = BOUNDS[name]
    return BOUNDS | {name: {"min": low, "max": high, "prior": prior, **more}}


DENSITIES = {
    "uniform": (lf.Uniform(), stats.uniform(0.5, 1.5)),
    "log-uniform": (lf.LogUniform(), stats.loguniform(0.5, 2.0)),
    "normal": (lf.Normal(1.8, 0.3), stats.truncnorm(-1.3 / 0.3, 0.2 / 0.3, 1.8, 0.3)),
    "log-normal": (lf.LogNormal(0.9, 1.5), None),
}


@pytest.mark.parametrize("kind", DENSITIES)
def test_densities(kind):
    """Each is scipy's, its integral is 1, and shares come back from its draws."""
    prior, known = DENSITIES[kind]
    x = np.linspace(0.5, 2.0, 401)
    density = np.exp(prior.log_density(jnp.asarray(x), 0.5, 2.0, *prior.numbers))
    if known is None:
        whole = stats.lognorm(np.log(1.5), scale=0.9)
        expected = whole.pdf(x) / (whole.cdf(2.0) - whole.cdf(0.5))
    else:
        expected = known.pdf(x)
    assert np.max(np.abs(density - expected)) <= 1e-12
    below = integrate.cumulative_simpson(density, x=x, initial=0.0)
    assert abs(below[-1] - 1.0) <= 1e-6
    share = np.array([0.05, 0.5, 0.9])
    assert np.max(np.abs(np.interp(prior.quantile(share, 0.5, 2.0), x, below) - share)) <= 1e-4


def test_far_bounds_lose_nothing():
    """A normal cut off 30 sd from its centre still has integral 1 (its own value underflows there)."""
    prior = lf.Normal(0.0, 1.0)
    x = np.linspace(30.0, 31.0, 2001)
    density = np.exp(prior.log_density(jnp.asarray(x), 30.0, 31.0, *prior.numbers))
    assert abs(integrate.simpson(density, x=x) - 1.0) <= 1e-6


@pytest.mark.parametrize(
    ("name", "prior", "mean", "sd"),
    [
        ("skin.sigma_a", lf.Normal(0.05, 0.004), 0.05, 0.004),
        ("skin.sigma_a", lf.LogNormal(0.05, 1.1), 0.05, 0.05 * np.log(1.1)),
        ("skin.sigma_s_prime", lf.Normal(2.0, 0.1), 2.0, 0.1),
    ],
)
def test_prior_alone(name, prior, mean, sd):
    """Data that say nothing: a fit returns the prior's centre and sd, and does not count it as data."""
    result = lf.fit(problem(probe(relative=1e5), free=with_prior(name, prior)))
    estimate = result.parameters[name]
    assert abs(estimate.value / mean - 1.0) <= 1e-4
    assert abs(estimate.stderr / sd - 1.0) <= 0.02
    assert result.dof == R.size - 2
    assert result.chi2 <= 1e-3


def test_prior_and_data_weigh_by_their_variances():
    """A background (linear) with a prior: value and sd of the closed form, also as the posterior density has it, with the noise known."""
    free = {"probe.background": {"min": -1.0, "max": 1.0, "prior": lf.Normal(2e-5, 1e-5)}}
    sd = np.full(R.size, 4e-5)
    data = lf.Dataset(lf.RadialReflectance(r=R), CLEAN + 6e-5, sd, name="probe")
    stated = problem(data, free=free)
    result = lf.fit(stated)
    weight, prior = R.size / sd[0] ** 2, 1.0 / 1e-5**2
    mean, variance = (weight * 6e-5 + prior * 2e-5) / (weight + prior), 1.0 / (weight + prior)
    assert abs(result.x[0] / mean - 1.0) <= 1e-6
    assert abs(result.parameters["probe.background"].stderr / np.sqrt(variance) - 1.0) <= 1e-6
    assert abs(result.chi2 - R.size * ((mean - 6e-5) / sd[0]) ** 2) <= 1e-6
    x = jnp.array([3e-5])
    expected = np.sum(stats.norm.logpdf(data.values, CLEAN + 3e-5, sd)) + stats.norm.logpdf(3e-5, 2e-5, 1e-5)
    assert abs(float(Density(stated)(x)) - expected) <= 1e-8
    assert float(Density(stated)(jnp.array([1.5]))) == -np.inf


def test_forms_mean_the_same():
    """Object, table, table with names, from a scene file's TOML: one density."""
    forms = [lf.Normal(1.0, 0.05), {"normal": [1.0, 0.05]}, {"normal": {"mean": 1.0, "sd": 0.05}}]
    found = [free_parameters(SKIN, [probe()], {"probe.amplitude": {"min": 0.5, "max": 2, "prior": p}})[0].prior for p in forms]
    assert all(prior == lf.Normal(1.0, 0.05) for prior in found)
    bare = free_parameters(SKIN, [probe()], {"probe.amplitude": {"min": 0.5, "max": 2, "prior": "log-uniform"}})[0].prior
    assert isinstance(bare, lf.LogUniform)


@pytest.mark.parametrize(
    ("prior", "said"),
    [
        ({"gauss": [1, 2]}, 'allowed: "uniform"'),
        ({"normal": [1.0]}, "allowed are 2 numbers (mean, sd)"),
        ({"normal": [1.0, 0.0]}, "sd = 0.0; allowed is a finite number above 0"),
        ({"normal": [np.nan, 1.0]}, "mean = nan"),
        ({"log-normal": [1.0, 0.9]}, "factor = 0.9; allowed is a finite number above 1"),
        ({"normal": [5.0, 0.1]}, "sd outside the bounds"),
        ({"normal": [1.0, "hyper.spread"]}, "'hyper.spread', which is not free"),
        (3.0, "prior = 3.0"),
    ],
)
def test_wrong_priors(prior, said):
    with pytest.raises(lf.InputError, match=r"free 'probe.amplitude'") as error:
        problem(free={"probe.amplitude": {"min": 0.5, "max": 2, "prior": prior}})
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_log_uniform_needs_a_positive_bound():
    with pytest.raises(lf.InputError, match="needs a min above 0"):
        problem(free={"probe.background": {"min": 0.0, "max": 1.0, "prior": "log-uniform"}})


HYPER = {"min": 0.005, "max": 0.5, "prior": "log-uniform"}


def hierarchy():
    """Three profiles whose amplitudes come from one normal of unknown spread."""
    amplitudes = [0.93, 1.02, 1.1]
    data = [probe(a * CLEAN, name=f"m{i}") for i, a in enumerate(amplitudes)]
    free = {f"m{i}.amplitude": {"min": 0.2, "max": 3.0, "prior": lf.Normal(1.0, "hyper.spread")} for i in range(3)}
    return amplitudes, problem(data, free={**free, "hyper.spread": HYPER})


def test_hierarchical_amplitudes():
    """The density is the product of all levels; amplitudes that the data know well have the marginal that this implies for their spread."""
    amplitudes, stated = hierarchy()
    x = np.array([0.95, 1.0, 1.05, 0.08])
    expected = np.sum(stats.norm.logpdf(x[:3], 1.0, 0.08)) + stats.loguniform(0.005, 0.5).logpdf(0.08)
    expected += sum(np.sum(stats.norm.logpdf(a * CLEAN, m * CLEAN, 0.01 * CLEAN)) for a, m in zip(amplitudes, x, strict=False))
    assert abs(float(Density(stated)(jnp.asarray(x))) - expected) <= 1e-6
    slope = jax.grad(Density(stated).log_prior)(jnp.asarray(x))
    assert abs(slope[3] - (np.sum((x[:3] - 1.0) ** 2) / 0.08**3 - 4.0 / 0.08)) <= 1e-6
    result = lf.fit(stated)
    assert result.outcome is lf.Outcome.CONVERGED
    spread = np.sqrt(np.sum((result.x[:3] - 1.0) ** 2) / 3)  # per unit of the logarithm, in which the prior of the spread is flat
    assert abs(result.x[3] / spread - 1.0) <= 1e-3
    assert any("hierarchy" in w for w in result.warnings)


def test_hyper_numbers_must_be_used_and_positive():
    with pytest.raises(lf.InputError, match="no prior names it"):
        problem(free={**BOUNDS, "hyper.spread": HYPER})
    with pytest.raises(lf.InputError, match="as the sd of a prior it must stay above 0"):
        problem(free={"probe.amplitude": {"min": 0.5, "max": 2, "prior": lf.Normal(1, "hyper.s")}, "hyper.s": {"min": 0.0, "max": 1.0}})


def test_tie_by_a_function():
    """sigma_s' as an affine function of sigma_a: the truth comes back in both."""
    result = lf.fit(problem(free={"skin.sigma_a": (1e-3, 0.5)}, ties={"skin.sigma_s_prime": lambda s: 1.3 + 10.0 * s.get("skin.sigma_a")}))
    assert abs(result.x[0] / 0.02 - 1.0) <= 1e-5
    assert abs(result.stack.get("skin.sigma_s_prime") / 1.5 - 1.0) <= 1e-5


def test_a_function_that_leaves_what_is_possible():
    with pytest.raises(lf.InputError, match=r"ties 'skin.sigma_s_prime'"):
        problem(free={"skin.sigma_a": (1e-3, 0.5)}, ties={"skin.sigma_s_prime": lambda s: 1.0 - 10.0 * s.get("skin.sigma_a")})
    with pytest.raises(lf.InputError, match=r"ties 'skin.sigma_s_prime'"):
        problem(free={"skin.sigma_a": (1e-3, 0.5)}, ties={"skin.sigma_s_prime": lambda s: "two"})
