"""Rough faces: brute-force averaging over facets, the smooth limit, and slopes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from layerfit.optics.fresnel import diffuse_moments, reflectance
from layerfit.optics.microfacet import rough_moments, rough_reflectance


def by_sampling(mu, n, sigma, count=1_000_000, seed=1):
    """Mean reflectance over random facets weighted by their projected area, with its standard error."""
    x, y = sigma * np.random.default_rng(seed).standard_normal((2, count))
    area = np.maximum(mu + np.sqrt(1 - mu**2) * x, 0.0)
    local = np.clip(area / np.sqrt(1 + x**2 + y**2), 1e-12, 1)
    value = np.asarray(reflectance(jnp.asarray(local), jnp.array(n)))
    mean = np.sum(area * value) / np.sum(area)
    return mean, np.sqrt(np.sum((area * (value - mean)) ** 2)) / np.sum(area)


@pytest.mark.parametrize("n", [1.4, 1 / 1.4])
@pytest.mark.parametrize("sigma", [0.1, 0.3, 0.6])
def test_reflectance_of_sampled_facets(n, sigma):
    for i, mu in enumerate((0.1, 0.6, 0.99)):
        expected, error = by_sampling(mu, n, sigma, seed=i)
        assert abs(float(rough_reflectance(jnp.array(mu), jnp.array(n), jnp.array(sigma))) - expected) <= 4 * error + 3e-4


@pytest.mark.parametrize("n", [1 / 1.4, 1.05, 1.4])
def test_smooth_limit(n):
    smooth = np.array(diffuse_moments(jnp.array(n)))
    for sigma, bound in ((0.0, 1e-15), (1e-6, 1e-8), (1e-3, 1e-5)):
        assert np.max(np.abs(np.array(rough_moments(jnp.array(n), jnp.array(sigma))) - smooth)) <= bound


def test_matched_index_reflects_nothing():
    assert np.max(np.abs(np.array(rough_moments(jnp.array(1.0), jnp.array(0.3))))) <= 1e-15


def test_slope_in_roughness():
    f = lambda s: jnp.stack(rough_moments(jnp.array(1.4), s))  # noqa: E731
    h = 1e-7
    assert np.max(np.abs((f(0.1 + h) - f(0.1 - h)) / (2 * h) - jax.jacfwd(f)(0.1))) <= 1e-5
    assert np.all(np.isfinite(jax.jacrev(f)(0.0)))
