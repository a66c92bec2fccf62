"""The quadrature from spatial frequency to distance on functions whose transform is known."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import k1

from layerfit.optics.hankel import Kernel, Span, Term, quadrature

SIGMA, DEPTH = 0.2, 0.05
R = np.geomspace(1e-3, 30, 40)


def spectrum(k):
    return np.exp(-np.sqrt(k**2 + SIGMA**2) * DEPTH)


def profile(r, z=DEPTH):
    rho = np.hypot(r, z)
    return z * (1 + SIGMA * rho) * np.exp(-SIGMA * rho) / (2 * np.pi * rho**3)


def points(r=R):
    return (Term(np.full(r.size, 1 / (2 * np.pi)), r, "J0", 1),)


def test_points_over_ten_decades():
    rule = quadrature(Kernel(points()), Span(SIGMA, 38 / DEPTH, False))
    relative = np.abs(rule.weights @ spectrum(rule.k) / profile(R) - 1)
    peak = profile(R[0])
    assert np.max(relative[profile(R) > 1e-6 * peak]) <= 1e-8
    assert np.max(relative[profile(R) > 1e-10 * peak]) <= 1e-4


def test_rings_hold_the_power_between_their_radii():
    low, high = R, 1.3 * R
    area = np.pi * (high**2 - low**2)
    kernel = Kernel((Term(high / area, high, "J1", 0), Term(-low / area, low, "J1", 0)))
    rule = quadrature(kernel, Span(SIGMA, 38 / DEPTH, False))
    enclosed = lambda r: -DEPTH * np.exp(-SIGMA * np.hypot(r, DEPTH)) / np.hypot(r, DEPTH)  # noqa: E731
    expected = (enclosed(high) - enclosed(low)) / area
    relative = np.abs(rule.weights @ spectrum(rule.k) / expected - 1)
    assert np.max(relative[expected > 1e-6 * expected[0]]) <= 1e-8


def test_algebraic_tail():
    """1/(1 + gamma): an exponential source, whose spectrum falls off as 1/k only."""
    r = R[::5]
    expected = [
        quad(lambda u, x=x: np.exp(-(x * np.exp(u)) + u) * x * profile(x, x * np.exp(u)), -12, 12, epsabs=0, epsrel=1e-11, limit=400)[0] for x in r
    ]
    for k_high in (20.0, 200.0):
        rule = quadrature(Kernel(points(r)), Span(SIGMA, k_high, True))
        values = rule.weights @ (1 / (1 + np.sqrt(rule.k**2 + SIGMA**2)))
        assert np.max(np.abs(values / expected - 1)) <= 2e-8


@pytest.mark.parametrize("r", [0.0, 0.1, 0.3, 0.5, 5.0])
def test_disk(r):
    """The mean of the profile over a disk, its centre at r."""
    a = 0.3
    rule = quadrature(Kernel(points(np.array([r])), disks=(a,)), Span(SIGMA, 38 / DEPTH, False))
    x, w = np.polynomial.legendre.leggauss(200)
    rho, angle = 0.5 * a * (x + 1), 0.5 * np.pi * (x + 1)
    distance = np.sqrt(r**2 + rho[:, None] ** 2 + 2 * r * rho[:, None] * np.cos(angle))
    expected = np.sum(w[:, None] * w * profile(distance) * rho[:, None]) * 0.25 * a * np.pi * 2 / (np.pi * a**2)
    assert abs((rule.weights @ spectrum(rule.k))[0] / expected - 1) <= 1e-9


def test_two_disks_and_a_gaussian_commute_with_each_other():
    """Spot and fibre enter alike, and a Gaussian of the same second moment is close to a disk far away."""
    one = quadrature(Kernel(points(), disks=(0.2, 0.4)), Span(SIGMA, 38 / DEPTH, False))
    other = quadrature(Kernel(points(), disks=(0.4, 0.2)), Span(SIGMA, 38 / DEPTH, False))
    a, b = one.weights @ spectrum(one.k), other.weights @ spectrum(other.k)
    assert np.max(np.abs(a - b)) <= 1e-13 * a.max()
    far = np.array([20.0])
    gaussian = quadrature(Kernel(points(far), gaussian=0.4), Span(SIGMA, 38 / DEPTH, False))  # second moments: w^2/2 and a^2/2
    disk = quadrature(Kernel(points(far), disks=(0.4,)), Span(SIGMA, 38 / DEPTH, False))
    assert abs((gaussian.weights @ spectrum(gaussian.k))[0] / (disk.weights @ spectrum(disk.k))[0] - 1) <= 1e-4


def test_line_and_edge():
    line = quadrature(Kernel((Term(np.full(R.size, 1 / np.pi), R, "cos", 0),)), Span(SIGMA, 38 / DEPTH, False))
    rho = np.hypot(R, DEPTH)
    expected = DEPTH * SIGMA * k1(SIGMA * rho) / (np.pi * rho)
    assert np.max(np.abs(line.weights @ spectrum(line.k) - expected)) <= 1e-12 * expected.max()
    x = np.array([-30.0, 0.5, 30.0])
    edge = quadrature(Kernel((Term(np.full(3, 1 / np.pi), x, "sin", -1),), at_zero=0.5), Span(SIGMA, 38 / DEPTH, False))
    dark, near, lit = edge.weights @ spectrum(edge.k)
    assert abs(dark + lit - spectrum(0.0)) <= 1e-10
    missing = quad(lambda t: DEPTH * SIGMA * k1(SIGMA * np.hypot(t, DEPTH)) / (np.pi * np.hypot(t, DEPTH)), 0.5, np.inf, epsabs=1e-13)[0]
    assert abs(near - (spectrum(0.0) - missing)) <= 1e-10


def test_long_paths_bend_into_the_complex_plane_without_a_seam():
    """k r of 1e6: panels above and below the switch agree."""
    z = 1e-4
    f = lambda k: np.exp(-np.sqrt(k**2 + SIGMA**2) * z)  # noqa: E731
    rule = quadrature(Kernel(points()), Span(SIGMA, 38 / z, False))
    assert rule.k.size <= 500
    assert np.max(np.abs(rule.weights @ f(rule.k) - profile(R, z))) <= 1e-13 * profile(0.0, z)
