"""The parts of the walk against integrals and independent implementations."""

import math

import numpy as np
import pytest
from scipy import integrate, special, stats

from layerfit.montecarlo import (
    CollectingFibre,
    HenyeyGreenstein,
    TabulatedPhase,
    Tallies,
    scattering,
    scoring,
    streams,
    surface,
)
from layerfit.montecarlo.streams import compiled
from layerfit.montecarlo.tallies import bessel_tables

MASK = (1 << 64) - 1


@compiled
def many_uniform(state, count):
    numbers = np.empty(count)
    for index in range(count):
        numbers[index] = streams.uniform(state)
    return numbers


@compiled
def many_slopes(cosine, sine, slope, state, count):
    numbers = np.empty(count)
    for index in range(count):
        numbers[index] = surface.visible_slope(cosine, sine, slope, state)
    return numbers


@compiled
def many_azimuths(numbers):
    out = np.empty((numbers.size, 2))
    for index in range(numbers.size):
        out[index] = scattering.azimuth(numbers[index])
    return out


@compiled
def many_turns(state, count, g):
    ux, uy, uz, worst = 0.0, 0.0, 1.0, 0.0
    for _ in range(count):
        cosine = scattering.henyey_greenstein(g, streams.uniform(state))
        c, s = scattering.azimuth(streams.uniform(state))
        vx, vy, vz = scattering.turn(ux, uy, uz, cosine, c, s)
        worst = max(worst, abs(ux * vx + uy * vy + uz * vz - cosine))
        ux, uy, uz = vx, vy, vz
    return worst, abs(ux * ux + uy * uy + uz * uz - 1.0)


def test_generator_is_xoshiro256plusplus():
    # the algorithm once more, in Python's unbounded integers
    def rotate(x: int, k: int) -> int:
        return ((x << k) | (x >> (64 - k))) & MASK

    state = streams.stream(7, 3)
    s = [int(word) for word in state]
    for _ in range(100):
        word = (rotate((s[0] + s[3]) & MASK, 23) + s[0]) & MASK
        t = (s[1] << 17) & MASK
        s[2] ^= s[0]
        s[3] ^= s[1]
        s[1] ^= s[2]
        s[0] ^= s[3]
        s[2] ^= t
        s[3] = rotate(s[3], 45)
        assert streams.uniform(state) == ((word >> 12) + 0.5) / 2**52


def test_generator_known_answer():
    # state 1, 2, 3, 4: the first outputs published with the generator are 41943041, 58720359, 3588806011781223
    state = np.array([1, 2, 3, 4], dtype=np.uint64)
    assert [math.floor(streams.uniform(state) * 2**52) for _ in range(3)] == [word >> 12 for word in (41943041, 58720359, 3588806011781223)]


def test_streams_are_uniform_and_independent():
    numbers = np.stack([many_uniform(streams.stream(seed, batch), 200_000) for seed in (0, 1) for batch in (0, 1, 2)])
    assert numbers.min() > 0.0
    assert numbers.max() < 1.0
    p = [stats.kstest(row, "uniform").pvalue for row in numbers]
    p += [stats.pearsonr(a, b).pvalue for i, a in enumerate(numbers) for b in numbers[:i]]
    p += [stats.pearsonr(row[1:], row[:-1]).pvalue for row in numbers]
    assert min(p) >= 0.001


@pytest.mark.parametrize("g", [-0.95, -0.3, 0.0, 1e-9, 1e-4, 0.25, 0.8, 0.98])
def test_henyey_greenstein_moments(g: float):
    # the Legendre moments of the phase function are g^l; here as integrals over the random number itself
    for order in range(1, 6):
        value, _ = integrate.quad(
            lambda u, order=order: special.eval_legendre(order, scattering.henyey_greenstein(g, u)),
            0.0, 1.0, points=[1e-3, 0.5, 1 - 1e-3], epsabs=1e-12, limit=500,
        )  # fmt: skip
        assert abs(value - g**order) <= 1e-10
    assert abs(scattering.henyey_greenstein(g, 1e-16) + 1.0) <= 1e-11
    assert abs(scattering.henyey_greenstein(g, 1.0 - 1e-16) - 1.0) <= 1e-11


def test_tabulated_phase_is_sampled_as_given():
    # a rise, a gap without light, a step down
    phase = TabulatedPhase([-1.0, -0.5, -0.2, 0.1, 0.6, 1.0], [0.0, 2.0, 0.0, 0.0, 5.0, 1.0])
    mu, density, cumulative = phase.table()
    numbers = (np.arange(20_000) + 0.5) / 20_000
    sampled = np.array([scattering.tabulated(mu, density, cumulative, 0, mu.size - 1, u) for u in numbers])
    assert np.all(np.diff(sampled) >= 0.0)
    for edge in (-0.9, -0.5, -0.3, 0.0, 0.3, 0.6, 0.9):
        exact, _ = integrate.quad(lambda x: np.interp(x, mu, density), -1.0, edge, points=[-0.5, -0.2, 0.1, 0.6], limit=200)
        assert abs(np.mean(sampled < edge) - exact) <= 1e-4
    assert not np.any((sampled > -0.2 + 1e-6) & (sampled < 0.1 - 1e-6))
    assert abs(sampled.mean() - phase.mean_cosine) <= 1e-5
    assert HenyeyGreenstein(0.7).mean_cosine == 0.7


def test_azimuth_polynomials():
    numbers = np.linspace(0.0, 1.0, 10_001)
    angle = math.pi * (2.0 * numbers - 1.0)
    error = np.abs(many_azimuths(numbers) - np.stack((np.cos(angle), np.sin(angle)), axis=1))
    assert error.max() <= 1e-14


@pytest.mark.parametrize("g", [0.0, 0.9, -0.5])
def test_turns_keep_angle_and_length(g: float):
    worst, length = many_turns(streams.stream(1, 0), 1_000_000, g)
    assert worst <= 1e-13
    assert length <= 1e-13


def test_fresnel():
    assert abs(surface.fresnel(1.0, 1.5, 1.0)[0] - 0.04) <= 1e-15
    assert surface.fresnel(1.5, 1.0, 0.7) == (1.0, 0.0)
    brewster = math.atan(1.5)
    angle = 2.0 * brewster - 0.5 * math.pi  # at Brewster's angle half of the s reflectance is left
    assert abs(surface.fresnel(1.0, 1.5, math.cos(brewster))[0] - 0.5 * math.sin(angle) ** 2) <= 1e-15
    for cosine in (0.05, 0.4, 0.9):
        up, refracted = surface.fresnel(1.33, 1.5, cosine)
        down, back = surface.fresnel(1.5, 1.33, refracted)
        # 1 - cos^2 loses cos^-2 of the last digit on the way
        assert abs(up - down) <= 1e-15 / cosine**2
        assert abs(back - cosine) <= 1e-15 / cosine**2


@pytest.mark.parametrize("n", [1.1, 1.4, 2.0])
def test_fresnel_hemispherical(n: float):
    # diffuse reflectance from outside in closed form (Walsh 1926), from inside by reciprocity with n^2
    total, _ = integrate.quad(lambda c: 2.0 * c * surface.fresnel(1.0, n, c)[0], 0.0, 1.0, epsabs=1e-13)
    walsh = 0.5 + (n - 1) * (3 * n + 1) / (6 * (n + 1) ** 2)
    walsh += n**2 * (n**2 - 1) ** 2 / (n**2 + 1) ** 3 * math.log((n - 1) / (n + 1))
    walsh -= 2 * n**3 * (n**2 + 2 * n - 1) / ((n**2 + 1) * (n**4 - 1))
    walsh += 8 * n**4 * (n**4 + 1) / ((n**2 + 1) * (n**4 - 1) ** 2) * math.log(n)
    assert abs(total - walsh) <= 1e-10
    inside, _ = integrate.quad(
        lambda c: 2.0 * c * surface.fresnel(n, 1.0, c)[0],
        0.0,
        1.0,
        points=[math.sqrt(1 - 1 / n**2)],
        epsabs=1e-13,
        limit=200,
    )
    assert abs((1.0 - inside) - (1.0 - total) / n**2) <= 1e-9


@pytest.mark.parametrize("slope", [0.05, 0.5, 2.0])
@pytest.mark.parametrize("degrees", [5.0, 40.0, 80.0, 90.5, 120.0, 170.0])
def test_smith_lambda_is_the_projected_area(slope: float, degrees: float):
    # projected area of all facets that face w: integral of max(0, cos - x sin) over slopes = cos (1 + Lambda)
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    limit = min(cosine / sine, 12.0 * slope)
    if limit <= -30.0 * slope:
        area = 0.0
    else:
        area, _ = integrate.quad(
            lambda x: (cosine - x * sine) * math.exp(-0.5 * (x / slope) ** 2) / (slope * math.sqrt(2.0 * math.pi)),
            -38.0 * slope, limit, epsabs=1e-300, epsrel=1e-11, limit=500, points=[min(limit, 0.0), max(-8.0 * slope, -38 * slope)],
        )  # fmt: skip
    assert abs(cosine * (1.0 + surface.smith_lambda(cosine, sine, slope)) - area) <= 1e-12 + 1e-7 * area


def test_smith_lambda_is_never_negative():
    # the two terms of the formula cancel, and for steep rays on a nearly smooth surface both underflow: 26 < a < 27
    for a in np.concatenate((np.geomspace(1e-6, 40.0, 2000), np.linspace(26.0, 27.5, 100_001))):
        cosine = a * math.sqrt(2.0) * 0.05 / math.hypot(1.0, a * math.sqrt(2.0) * 0.05)
        up = surface.smith_lambda(cosine, math.sqrt(1.0 - cosine**2), 0.05)
        assert math.copysign(1.0, up) == 1.0  # not even -0: it divides
        assert surface.smith_lambda(-cosine, math.sqrt(1.0 - cosine**2), 0.05) <= -1.0


@pytest.mark.parametrize("slope", [0.1, 1.0])
@pytest.mark.parametrize("degrees", [0.0, 60.0, 89.0, 91.0, 100.0, 150.0])
def test_visible_slopes(slope: float, degrees: float):
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    tilt = cosine / (sine * slope) if sine > 0.0 else math.inf
    if tilt < -8.0:
        pytest.skip("no facet is seen from there: density below 1e-14")
    sampled = many_slopes(cosine, sine, slope, streams.stream(11, 0), 200_000) / slope
    low, high = -40.0, min(tilt, 12.0)

    def density(x: float) -> float:
        return (cosine - x * slope * sine) * math.exp(-0.5 * x * x + 0.5 * min(tilt, 0.0) ** 2)

    peak = min(0.0, tilt)
    norm = integrate.quad(density, low, high, points=[peak - 3.0, peak], limit=500)[0]
    assert np.all(sampled <= high + 1e-12) or tilt > 12.0
    for power in (1, 2, 3):
        mean = integrate.quad(lambda x, power=power: x**power * density(x), low, high, points=[peak - 3.0, peak], limit=500)[0] / norm
        values = sampled**power
        assert abs(values.mean() - mean) <= 4.0 * values.std() / math.sqrt(values.size)


def test_bessel_j0():
    cells, series = bessel_tables()
    x = np.concatenate((np.linspace(0.0, 40.0, 4001), np.geomspace(40.0, 1e4, 200), [31.999999999, 32.0]))
    ours = np.array([scoring.bessel_j0(value, cells, series) for value in x])
    assert np.abs(ours - special.j0(x)).max() <= 2e-14
    assert scoring.bessel_j0(0.0, cells, series) == 1.0 or abs(scoring.bessel_j0(0.0, cells, series) - 1.0) <= 1e-15


@pytest.mark.parametrize("distance", [0.0, 0.3, 1.0, 2.5])
def test_covered_fraction_has_the_area_of_the_disk(distance: float):
    points = sorted({abs(distance - 1.0), distance + 1.0})
    area, _ = integrate.quad(
        lambda r: 2.0 * math.pi * r * scoring.covered_fraction(r, distance, 1.0),
        0.0,
        distance + 1.5,
        points=points,
        limit=500,
    )
    assert abs(area - math.pi) <= 1e-6


def test_interval():
    edges = np.array([0.0, 1.0, 1.5, 4.0])
    assert [scoring.interval(edges, x) for x in (-1.0, 0.0, 0.5, 1.0, 1.49, 3.99, 4.0, 9.0)] == [
        -1,
        0,
        0,
        1,
        1,
        2,
        3,
        3,
    ]
    assert scoring.interval(np.empty(0), 1.0) == -1


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: HenyeyGreenstein(1.0), "g"),
        (lambda: TabulatedPhase([-1, 0.5], [1, 1]), "cosine"),
        (lambda: TabulatedPhase([-1, 1], [1, -1]), "value"),
        (lambda: Tallies(rings=[1.0, 0.5]), "rings"),
        (lambda: Tallies(k=[-1.0]), "k"),
        (lambda: Tallies(theta=[0, 91]), "theta"),
        (lambda: Tallies(phi=[0, 90]), "phi"),
        (lambda: CollectingFibre(1.0, 0.0, 0.5), "radius"),
    ],
)
def test_wrong_input_is_named(call, name: str):
    with pytest.raises(ValueError, match=rf"^{name}.*given.*allowed"):
        call()
