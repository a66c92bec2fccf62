"""Single directions from bins: the weights undo the width of a bin, and radiances come out as known."""

import numpy as np
import pytest

import layerfit as lf
from layerfit.montecarlo_angles import azimuth_bins, lobe_width, polar_bins
from layerfit.montecarlo_reading import reading, runs

X, W = np.polynomial.legendre.leggauss(20)
DEGREES = np.array([0.0, 1.0, 3.0, 4.0, 30.0, 60.0, 85.0, 89.0])


def means(edges: np.ndarray, f) -> np.ndarray:
    low, high = edges[:-1, None], edges[1:, None]
    return 0.5 * np.sum(W * f(0.5 * (high - low) * X + 0.5 * (high + low)), axis=1)


@pytest.mark.parametrize(
    ("f", "bound"),
    [
        (lambda s: np.ones_like(s), 1e-12),
        (lambda s: 2.0 - s, 1e-12),
        (lambda s: np.exp(-3.0 * s), 1e-4),
        (lambda s: np.sqrt(1.0 - s) + 0.3, 3e-3),  # steep at the horizon
        (lambda s: (0.05 + s) ** -1.5, 4e-3),  # a forward peak of 13 degrees
    ],
)
def test_polar_bins_stand_for_angles(f, bound: float):
    edges, weights = polar_bins(DEGREES)
    assert edges[0] == 0.0
    assert edges[-1] == 1.0
    assert np.all(np.diff(edges) > 0.0)
    exact = f(np.sin(np.radians(DEGREES)) ** 2)
    assert np.max(np.abs(weights @ means(edges, f) / exact - 1.0)) <= bound


@pytest.mark.parametrize("azimuth", [0.0, 5.0, 90.0, 175.0, 180.0, -30.0, 200.0, 360.0])
def test_azimuth_bins_stand_for_an_azimuth(azimuth: float):
    def f(degrees: np.ndarray) -> np.ndarray:
        return 1.0 + 0.5 * np.cos(np.radians(degrees)) + 0.3 * np.cos(np.radians(3.0 * degrees))

    edges, weights = azimuth_bins(azimuth)
    assert edges[0] == 0.0
    assert edges[-1] == 180.0
    assert weights.sum() == pytest.approx(1.0, abs=1e-12)
    assert abs(weights @ means(edges, f) / f(np.array(azimuth)) - 1.0) <= 2e-3


@pytest.mark.parametrize("width", [0.3, 2.0])
def test_bins_follow_the_lobes_of_rough_faces(width: float):
    """The top of a normal distribution of angles, and its flank: half a percent, 1 % of the top."""
    exact = np.exp(-0.5 * np.array([0.0, 1.0]) ** 2)
    edges, weights = polar_bins(np.array([40.0, 40.0 + width]), width)
    found = weights @ means(edges, lambda s: np.exp(-0.5 * ((np.degrees(np.arcsin(np.sqrt(s))) - 40.0) / width) ** 2))
    assert np.max(np.abs(found - exact)) <= 0.01
    for at, value in zip((0.0, width), exact, strict=True):
        edges, share = azimuth_bins(at, width)
        assert abs(share @ means(edges, lambda phi: np.exp(-0.5 * (phi / width) ** 2)) - value) <= 0.01


def test_width_of_the_narrowest_lobe():
    """Facets of slope 0.1: from 1 to 1.5 and back light turns by 0.1 (1 - 1/1.5) in the glass; matched or smooth faces make none."""
    assert abs(lobe_width(np.array([1.0, 1.5, 1.0]), np.array([0.1, 0.3])) - np.degrees(0.1 / 3.0)) <= 1e-9
    assert lobe_width(np.array([1.0, 1.5, 1.5, 1.0]), np.array([0.0, 0.1, 0.0])) == np.inf


def h_function(mu: np.ndarray, albedo: float) -> np.ndarray:
    """Chandrasekhar's H for isotropic scattering, by iteration of its integral equation at 100 Gauss nodes."""
    x, w = np.polynomial.legendre.leggauss(100)
    x, w = 0.5 * (x + 1.0), 0.5 * w
    h = np.ones_like(x)

    def step(at: np.ndarray) -> np.ndarray:
        return 1.0 / (np.sqrt(1.0 - albedo) + 0.5 * albedo * np.sum(w * x * h / (at[:, None] + x), axis=1))

    for _ in range(200):
        h = 0.5 * (h + step(x))
    return step(mu)


@pytest.mark.parametrize(("incidence", "azimuth"), [("normal", None), (60.0, None), (60.0, 0.0), (60.0, 130.0)])
def test_radiance_of_an_isotropic_half_space(incidence, azimuth):
    """Albedo 0.9: Chandrasekhar, Radiative Transfer, ch. III eq. 17: radiance a/(4 pi) H(mu) H(mu0)/(mu + mu0) per unit incident power."""
    stack = lf.Stack([lf.HalfSpace("deep", sigma_a=0.1, sigma_s=0.9, g=0.0, n=1.0)])
    angle = np.array([0.0, 20.0, 45.0, 70.0])
    geometry = lf.AngularReflectance(angle, incidence=incidence, azimuth=azimuth)
    found = lf.predict(stack, geometry, solver=lf.MonteCarlo(200_000, seed=4, threads=1))[0]
    mu, mu0 = np.cos(np.radians(angle)), np.array([1.0 if incidence == "normal" else 0.5])
    exact = 0.9 / (4.0 * np.pi) * h_function(mu, 0.9) * h_function(mu0, 0.9) / (mu + mu0)
    assert found.estimated_error is not None
    assert np.max(np.abs(found.values - exact) / found.estimated_error) <= 4.0
    assert np.median(found.estimated_error / exact) <= (0.05 if azimuth is None else 0.15)


@pytest.mark.parametrize("geometry", [lf.AngularReflectance, lf.AngularTransmittance])
@pytest.mark.parametrize(("incidence", "azimuth"), [("normal", None), (20.0, None), (20.0, 0.0)])
def test_a_beam_is_not_in_the_radiance(geometry, incidence, azimuth):
    """A clear slab with faces: all that leaves is a beam, at 20 degrees or at what Snell's law makes of it."""
    stack = lf.Stack([lf.Layer("glass", sigma_a=0.1, sigma_s=0, g=0.0, n=1.5, thickness=1)], n_below=1.2)
    snell = np.degrees(np.arcsin(np.sin(np.radians(20.0)) / 1.2))
    found = lf.predict(stack, geometry([0.0, snell, 20.0, 50.0], incidence=incidence, azimuth=azimuth), solver=lf.MonteCarlo(1000, threads=1))[0]
    assert np.all(found.values == 0.0)
    assert found.estimated_error is not None
    assert np.all(found.estimated_error > 0.0)


def test_directions_share_a_run_only_with_the_same_bins():
    same = lf.AngularReflectance([10.0, 20.0])
    planned = runs([reading(g) for g in (lf.TotalReflectance(), same, lf.AngularTransmittance([10.0, 20.0]), lf.AngularReflectance([30.0]))])
    assert [run.members for run in planned] == [(0, 1, 2), (3,)]
