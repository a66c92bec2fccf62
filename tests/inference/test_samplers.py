"""Samplers on densities that a grid knows, and what they say where they fail."""

import numpy as np
import pytest
from inference.toy import banana, grid_marginals, kolmogorov, two_hills, with_emcee, with_nuts

from layerfit.inference.judgement import SamplingOutcome, split_r_hat
from layerfit.inference.posterior_remarks import modes

RNG = np.random.default_rng(4)
NEAR, FAR = two_hills(4.0), two_hills(10.0)


def run(sampler, density, begin):
    if sampler == "nuts":
        pytest.importorskip("numpyro")
        return with_nuts(density, begin[:8])
    return with_emcee(density, begin)


def spread(count=48):
    """Beginnings on both hills."""
    x = RNG.standard_normal((count, 2))
    x[::2, 0] += 2.0
    x[1::2, 0] -= 2.0
    return x


@pytest.mark.parametrize("sampler", ["emcee", "nuts"])
@pytest.mark.parametrize("density", [banana, NEAR], ids=["banana", "two hills"])
def test_marginals_are_those_of_a_grid(sampler, density):
    draws, judgement = run(sampler, density, spread())
    assert judgement.outcome is SamplingOutcome.CONVERGED
    assert np.min(judgement.effective) >= 3000
    for column, exact in zip(draws.T, grid_marginals(density), strict=True):
        assert kolmogorov(column, exact) <= 0.03


@pytest.mark.parametrize("sampler", ["emcee", "nuts"])
def test_hills_too_far_apart(sampler):
    """Walkers that cannot cross say so, or have found the right shares."""
    begin = spread() + np.where(np.arange(48) % 2, -3.0, 3.0)[:, None] * [1.0, 0.0]
    begin[3] = [5.0, 0.0]  # a share of beginnings that is not the right one
    draws, judgement = run(sampler, FAR, begin)
    distance = max(kolmogorov(column, exact) for column, exact in zip(draws.T, grid_marginals(FAR), strict=True))
    assert judgement.outcome is SamplingOutcome.DISAGREE or distance <= 0.03
    assert modes(draws[:, 0]) == 2


def test_short_chains_say_so():
    _, judgement = with_emcee(banana, spread(), steps=100)
    assert judgement.outcome is not SamplingOutcome.CONVERGED


def test_one_walker_that_stands_apart_is_noticed():
    x = RNG.standard_normal((400, 32, 1))
    assert abs(split_r_hat(x)[0] - 1.0) <= 0.005
    x[:, 5] += 10.0
    assert split_r_hat(x)[0] >= 1.5


def test_same_seed_same_chain():
    begin = spread()
    one, other, third = (with_emcee(banana, begin, steps=150, seed=seed)[0] for seed in (1, 1, 2))
    assert np.array_equal(one, other)
    assert not np.array_equal(one, third)
