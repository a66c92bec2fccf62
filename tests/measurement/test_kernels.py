"""Sources and detectors in spatial frequency against their integrals in space.

F(k) = exp(-a k) is the transform of a / (2 pi (a^2 + r^2)^(3/2)): a spot, ring, line, edge or fibre is then a plain integral over the plane.
"""

import numpy as np
import pytest
from scipy.integrate import dblquad, quad

import layerfit as lf
from layerfit.optics.hankel import Span, quadrature

A = 0.7


def profile(r):
    return A / (2 * np.pi * (A**2 + r**2) ** 1.5)


def along_line(x):
    """Integral of the profile over a line at distance x."""
    return A / (np.pi * (A**2 + x**2))


def beside_edge(x):
    """Integral over the half plane that begins at distance -x."""
    return 0.5 + np.arctan(x / A) / np.pi


def measured(**places):
    """The value by the kernel of a geometry."""
    kernel = lf.RadialReflectance(**places).kernel()
    nodes = quadrature(kernel, Span(0.1, 60 / A, False))
    return nodes.weights @ np.exp(-A * nodes.k)


def over_disk(function, radius, center, weight=lambda rho: 1.0):
    """Mean over a disk whose center lies at a distance, with a radial weight that integrates to the area."""
    value, _ = dblquad(
        lambda angle, rho: 2 * weight(rho) * function(np.sqrt(center**2 + rho**2 + 2 * center * rho * np.cos(angle))) * rho,
        0,
        radius,
        0,
        np.pi,
        epsabs=1e-11,
        epsrel=1e-11,
    )
    return value / (np.pi * radius**2)


def over_strip(function, radius, center):
    """Mean over a disk of a function of one coordinate."""
    value, _ = quad(lambda t: function(center + radius * np.sin(t)) * np.cos(t) ** 2, -np.pi / 2, np.pi / 2, epsabs=1e-12)
    return 2 * value / np.pi


def test_point():
    r = np.array([0.1, 1.0, 7.0])
    assert np.max(np.abs(measured(r=r) / profile(r) - 1)) <= 1e-10


def test_rings():
    """The first starts at 0, there is a gap."""
    low, high = np.array([0.0, 1.0, 3.0]), np.array([1.0, 1.5, 6.0])
    expected = [quad(lambda r: 2 * np.pi * r * profile(r), a, b)[0] / (np.pi * (b**2 - a**2)) for a, b in zip(low, high, strict=True)]
    assert np.max(np.abs(measured(r_min=low, r_max=high) / expected - 1)) <= 1e-10


def test_line():
    x = np.array([0.2, 1.0, 5.0])
    assert np.max(np.abs(measured(r=x, source=lf.Line()) / along_line(x) - 1)) <= 1e-10


def test_edge():
    x = np.array([-5.0, -1.0, 0.0, 1.0, 5.0])
    assert np.max(np.abs(measured(r=x, source=lf.Edge()) - beside_edge(x))) <= 1e-11


@pytest.mark.parametrize("r", [0.0, 0.3, 0.5, 2.0])
def test_fibre(r):
    """A disk source under a point and a pencil under a fibre are the same."""
    expected = over_disk(profile, 0.5, r)
    assert abs(measured(r=[r], detector=lf.Detector(radius=0.5))[0] / expected - 1) <= 1e-9
    assert abs(measured(r=[r], source=lf.Disk(0.5))[0] / expected - 1) <= 1e-9


@pytest.mark.parametrize("r", [0.0, 0.4, 2.0])
def test_gaussian(r):
    """radius: where the irradiance is 1/e^2."""
    w = 0.6
    beyond = 6 * w
    expected = over_disk(profile, beyond, r, weight=lambda rho: np.pi * beyond**2 * 2 / (np.pi * w**2) * np.exp(-2 * (rho / w) ** 2))
    assert abs(measured(r=[r], source=lf.Gaussian(w))[0] / expected - 1) <= 1e-9


def test_disk_under_fibre():
    """Two disks: the mean over one of the mean over the other."""

    def spot(r):
        return measured(r=np.atleast_1d(r), source=lf.Disk(0.5))[0]

    nodes, weights = np.polynomial.legendre.leggauss(20)
    rho, w = 0.15 * (nodes + 1), 0.15 * weights
    angle, v = 0.5 * np.pi * (nodes + 1), 0.5 * np.pi * weights
    values = [[spot(np.sqrt(1 + p**2 + 2 * p * np.cos(t))) for t in angle] for p in rho]
    expected = 2 * np.einsum("p,pt,t,p->", w, values, v, rho) / (np.pi * 0.3**2)
    assert abs(measured(r=[1.0], source=lf.Disk(0.5), detector=lf.Detector(radius=0.3))[0] / expected - 1) <= 1e-9


@pytest.mark.parametrize("x", [-0.4, 0.0, 0.2, 1.5])
def test_edge_under_fibre(x):
    expected = over_strip(beside_edge, 0.5, x)
    assert abs(measured(r=[x], source=lf.Edge(), detector=lf.Detector(radius=0.5))[0] - expected) <= 1e-10


@pytest.mark.parametrize("x", [0.0, 0.2, 1.5])
def test_line_under_fibre(x):
    expected = over_strip(along_line, 0.5, x)
    assert abs(measured(r=[x], source=lf.Line(), detector=lf.Detector(radius=0.5))[0] / expected - 1) <= 1e-9


@pytest.mark.parametrize("source", [lf.Disk(0.5), lf.Gaussian(0.4)], ids=["disk", "gaussian"])
def test_ring_under_spot(source):
    expected = quad(lambda r: r * measured(r=[r], source=source)[0], 0.2, 0.9, epsabs=1e-12)[0] * 2 / (0.9**2 - 0.2**2)
    assert abs(measured(r_min=[0.2], r_max=[0.9], source=source)[0] / expected - 1) <= 1e-9


DIRECT = {
    "disk": (lf.Disk(0.5), [0.1, 0.45, 0.7, 2.0]),
    "gaussian": (lf.Gaussian(0.6), [0.0, 0.3, 1.2]),
    "pencil": (lf.Pencil(), [0.05, 0.1, 0.4]),
}


@pytest.mark.parametrize("name", DIRECT)
def test_direct_light_under_fibre(name):
    """Light that leaves where it entered: the source's own pattern, averaged over the fibre. Counted on a fine grid of the fibre."""
    source, places = DIRECT[name]
    radius = 0.3
    side = (np.arange(1200) + 0.5) / 600 - 1
    x, y = np.meshgrid(radius * side, radius * side)
    inside = x**2 + y**2 < radius**2
    found = lf.RadialReflectance(r=places, source=source, detector=lf.Detector(radius=radius)).direct()
    for r, value in zip(places, found, strict=True):
        expected = (r < radius) / (np.pi * radius**2) if name == "pencil" else np.mean(source.density(np.hypot(x + r, y))[inside])
        assert abs(value - expected) <= 1e-3 / (np.pi * radius**2), r


@pytest.mark.parametrize("source", [lf.Line(), lf.Edge()], ids=["line", "edge"])
@pytest.mark.parametrize("x", [-0.2, 0.0, 0.1, 0.5])
def test_direct_light_of_line_and_edge(source, x):
    radius = 0.3
    if isinstance(source, lf.Line):
        x = abs(x)
        expected = 2 * np.sqrt(max(radius**2 - x**2, 0)) / (np.pi * radius**2)
    else:
        t = np.linspace(-1, 1, 200001)
        expected = np.mean((x + radius * t > 0) * np.sqrt(1 - t**2)) * 4 / np.pi
    found = lf.RadialReflectance(r=[x], source=source, detector=lf.Detector(radius=radius)).direct()[0]
    assert abs(found - expected) <= 1e-4


@pytest.mark.parametrize("source", [lf.Pencil(), lf.Disk(0.5), lf.Gaussian(0.4)], ids=["pencil", "disk", "gaussian"])
def test_direct_light_in_rings_is_the_whole_beam(source):
    low, high = np.array([0.0, 0.2, 0.6, 1.5]), np.array([0.2, 0.6, 1.5, 4.0])
    value = lf.RadialReflectance(r_min=low, r_max=high, source=source).direct()
    assert abs(np.sum(value * np.pi * (high**2 - low**2)) - 1) <= 1e-12
    assert np.all(value >= 0)
    if not isinstance(source, lf.Pencil):
        expected = quad(lambda r: 2 * np.pi * r * source.density(np.array(r)), 0.2, 0.6, points=[0.5])[0] / (np.pi * (0.6**2 - 0.2**2))
        assert abs(value[1] / expected - 1) <= 1e-8


STACK = lf.Stack([lf.HalfSpace("skin", sigma_a=0.05, sigma_s_prime=1.0, n=1.4)])


def predicted(**places):
    return lf.predict(STACK, lf.RadialReflectance(**places), solver=lf.LayeredDiffusion())[0].values


@pytest.fixture(scope="module")
def fine():
    """R(r) of a half space on a fine grid in log r."""
    r = np.exp(np.linspace(np.log(1e-3), np.log(60), 4001))
    return r, predicted(r=r)


def test_prediction_of_rings_is_the_mean_of_points(fine):
    """The kernels reach the solvers: rings, a disk and a line of a real prediction against sums over the points of another."""
    r, value = fine
    low, high = np.array([1.0, 3.0]), np.array([2.0, 5.0])
    expected = []
    for a, b in zip(low, high, strict=True):
        nodes, weights = np.polynomial.legendre.leggauss(12)
        at = 0.5 * (a + b) + 0.5 * (b - a) * nodes
        expected.append(np.sum(0.5 * (b - a) * weights * at * np.exp(np.interp(np.log(at), np.log(r), np.log(value)))) * 2 / (b**2 - a**2))
    assert np.max(np.abs(predicted(r_min=low, r_max=high) / expected - 1)) <= 1e-5


def test_prediction_under_a_line_is_the_sum_over_it(fine):
    r, value = fine
    y = np.concatenate([-r[::-1], r])
    expected = [np.trapezoid(np.exp(np.interp(np.log(np.hypot(x, y)), np.log(r), np.log(value))), y) for x in (1.0, 4.0)]
    assert np.max(np.abs(predicted(r=[1.0, 4.0], source=lf.Line()) / expected - 1)) <= 1e-4


def test_slope_across_an_edge_is_the_line():
    h = 1e-4
    x = np.array([1.0 - h, 1.0 + h])
    up = predicted(r=x, source=lf.Edge())
    assert abs(np.diff(up)[0] / (2 * h) / predicted(r=[1.0], source=lf.Line())[0] - 1) <= 1e-6
    total = lf.predict(STACK, lf.SpatialFrequency([0.0]), solver=lf.LayeredDiffusion())[0].values[0]
    assert abs(np.sum(predicted(r=[-1.0, 1.0], source=lf.Edge())) - total) <= 1e-9, "both sides together are evenly lit"
