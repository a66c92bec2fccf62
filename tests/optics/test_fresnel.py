"""Moments of the Fresnel reflectance against adaptive quadrature, values in print, and both sides of the kink at n = 1."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from layerfit.optics.fresnel import diffuse_moments, egan_hilgeman, mismatch, normal_reflectance, reflectance


def plain_reflectance(mu, n):
    """The textbook formula."""
    sin_t = n * np.sqrt(1 - mu**2)
    if sin_t >= 1:
        return 1.0
    t = np.sqrt(1 - sin_t**2)
    return 0.5 * (((n * mu - t) / (n * mu + t)) ** 2 + ((mu - n * t) / (mu + n * t)) ** 2)


@pytest.mark.parametrize("n", [0.4, 0.7, 0.95, 1.0, 1.01, 1.33, 1.4, 1.5, 2.5, 4.0])
def test_moments(n):
    critical = np.sqrt(max(0.0, 1 - 1 / n**2))
    points = [p for p in (critical, critical + 1e-4, critical + 1e-2) if 0 < p < 1]
    found = [float(m) for m in diffuse_moments(jnp.array(n))]
    for power, value in ((1, found[0]), (2, found[1])):
        integral, error = quad(lambda mu, p=power: plain_reflectance(mu, n) * mu**p, 0, 1, points=points, epsabs=1e-13, epsrel=1e-12, limit=400)
        assert abs(value - (power + 1) * integral) <= 1e-11 + 10 * error


def test_mismatch_in_print():
    """A(1.4) to the digits of reference-numbers.md section 7: 2.9484926 with exact moments."""
    assert abs(float(mismatch(*diffuse_moments(jnp.array(1.4)))) - 2.9484926) <= 0.5e-7


def test_right_slope_at_matched_index():
    """R1 has slopes 7/3 (right) and -1/3 (left) at n = 1; the one to the right is returned, in both modes, and R2 has slope 0."""
    for mode in (jax.jacfwd, jax.jacrev):
        first, second = mode(diffuse_moments)(jnp.array(1.0))
        assert abs(float(first) - 7 / 3) <= 1e-12
        assert abs(float(second)) <= 1e-12
    left = jax.jacfwd(diffuse_moments)(jnp.array(1 - 1e-9))[0]
    assert abs(float(left) + 1 / 3) <= 1e-6


@pytest.mark.parametrize("n", [0.8, 1.0001, 1.4])
def test_slopes_by_differences(n):
    h = 1e-6
    forward, backward = (jnp.stack(diffuse_moments(jnp.array(n + s * h))) for s in (1, -1))
    assert np.max(np.abs((forward - backward) / (2 * h) - jnp.stack(jax.jacfwd(diffuse_moments)(jnp.array(n))))) <= 1e-5


def test_reflectance():
    mu = jnp.linspace(0.01, 1, 50)
    for n in (0.7, 1.0, 1.4):
        assert np.max(np.abs(reflectance(mu, jnp.array(n)) - np.array([plain_reflectance(m, n) for m in np.asarray(mu)]))) <= 1e-14
    assert abs(float(normal_reflectance(jnp.array(1.5))) - 0.04) <= 1e-16


def test_polynomial_of_the_paper():
    """Rounded as printed it gives A = 1.0032 at eta = 1 (1.0034 with one more digit), and it is within 1 % of the truth at 1.4."""
    R1 = float(egan_hilgeman(jnp.array(1.0)))
    assert abs((1 + R1) / (1 - R1) - 1.0032) <= 0.5e-4
    assert abs(float(egan_hilgeman(jnp.array(1.4)) / diffuse_moments(jnp.array(1.4))[0]) - 1) <= 0.01
