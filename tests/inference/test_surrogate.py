"""Draws through a surrogate are draws from the posterior, also where the surrogate is poor."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import layerfit as lf
from layerfit.inference import surrogate as module
from layerfit.inference.density import Density
from layerfit.inference.surrogate import Emulator, Surrogate

R = np.array([1.0, 1.5, 2.5, 4.0, 6.0, 9.0])
SKIN = lf.Stack([lf.HalfSpace("skin", sigma_a=0.02, sigma_s_prime=1.2, n=1.4)])
FREE = {"skin.sigma_a": (1e-3, 0.5), "skin.sigma_s_prime": (0.2, 6.0)}
CLEAN = lf.predict(SKIN, lf.RadialReflectance(r=R), solver=lf.LayeredDiffusion())[0].values


@pytest.fixture(scope="module")
def fit():
    values = CLEAN * (1 + 0.02 * np.random.default_rng(2).standard_normal(R.size))
    data = lf.Dataset(lf.RadialReflectance(r=R), values, noise=lf.Noise(relative=0.02))
    return lf.fit(lf.Problem(SKIN, data, free=FREE, solver=lf.LayeredDiffusion()), starts=1)


@pytest.fixture(scope="module")
def grid(fit):
    """Means, sd and correlation of the posterior by summing over a grid of 161 x 161 points, 6 sd to each side."""
    density = eqx.filter_jit(eqx.filter_vmap(Density(fit.problem)))
    sd = np.sqrt(np.diag(fit.covariance))
    axes = [np.linspace(x - 6 * s, x + 6 * s, 161) for x, s in zip(fit.x, sd, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    log = np.asarray(density(jnp.asarray(points)))
    weight = np.exp(log - np.max(log))
    weight /= np.sum(weight)
    mean = weight @ points
    covariance = (points - mean).T @ ((points - mean) * weight[:, None])
    return mean, np.sqrt(np.diag(covariance)), covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])


def compared(posterior, grid, errors):
    mean, sd, correlation = grid
    table = posterior.table()
    for i, row in enumerate(table.values()):
        assert abs(row["mean"] - mean[i]) <= errors * row["mcse"]
        assert abs(row["sd"] / sd[i] - 1) <= errors / np.sqrt(2 * row["ess"])
    draws = np.array(list(posterior.draws.values()))
    assert abs(np.corrcoef(draws)[0, 1] - correlation) <= errors / np.sqrt(min(row["ess"] for row in table.values()))


def test_against_a_grid(fit, grid):
    posterior = lf.sample(fit.problem, fit, sampler="surrogate", walkers=16, effective=2000)
    assert posterior.outcome is lf.SamplingOutcome.CONVERGED
    assert np.max(posterior.judgement.tau) <= 2.5  # most proposals are taken
    assert posterior.warnings == ()
    compared(posterior, grid, 3.5)


def test_a_poor_surrogate_costs_steps_not_truth(fit, grid, monkeypatch):
    """Predictions 1.5 % off, three quarters of a standard deviation: the posterior is the same."""
    whole = Emulator.__init__

    def poor(self, *arguments):
        whole(self, *arguments)
        self.coefficients = tuple(np.concatenate([part[:1] + np.log(1.015), part[1:]]) for part in self.coefficients)

    monkeypatch.setattr(Emulator, "__init__", poor)
    posterior = lf.sample(fit.problem, fit, sampler="surrogate", walkers=16, effective=1000)
    assert np.max(posterior.judgement.tau) >= 2.0
    compared(posterior, grid, 3.5)


def test_where_the_surrogate_ends_is_said(fit):
    way = Surrogate(fit, Density(fit.problem), 8, 0)
    inside = np.tile(fit.x, (10, 1))
    assert way.said(inside) == []
    assert "10 % of the draws lie where the surrogate ends" in way.said(np.concatenate([inside[1:], [[0.4, 5.0]]]))[0]


def test_too_many_numbers(fit, monkeypatch):
    monkeypatch.setattr(module, "_DEGREES", ((1, 3),))
    with pytest.raises(lf.InputError, match="'surrogate' with 2 free numbers; allowed are at most 1"):
        lf.sample(fit.problem, fit, sampler="surrogate")
