"""Rough interfaces: energy, the limit of a smooth one, reciprocity, equilibrium, and the single bounce in closed form."""

import math

import numpy as np
import pytest
from montecarlo_interface import DEGREES, ROUGHNESS, SIDES, fresnel, interface, reciprocity, totals
from scipy import special

import layerfit.montecarlo as mc
from layerfit.montecarlo import engine, streams, surface
from layerfit.montecarlo.streams import compiled


@compiled
def bounce_counts(n_in, n_out, slope, cosine, state, count):
    """How often a ray is reflected, or refracted, by one facet and no other."""
    reflected, refracted, longest = 0, 0, 0
    sine = math.sqrt(1.0 - cosine * cosine)
    for _ in range(count):
        crossed, _, _, _, bounces = surface.facet_walk(sine, 0.0, cosine, n_in, n_out, slope, state)
        longest = max(longest, bounces)
        if bounces == 1 and crossed:
            refracted += 1
        elif bounces == 1:
            reflected += 1
    return reflected, refracted, longest


def upward_lambda(cosine: np.ndarray, slope: float) -> np.ndarray:
    a = cosine / (np.sqrt(2.0 * np.maximum(1.0 - cosine**2, 1e-30)) * slope)
    return 0.5 * (np.exp(-(a**2)) / (a * math.sqrt(math.pi)) - special.erfc(a))


def single_bounce(n_in: float, n_out: float, slope: float, cosine: float) -> tuple[float, float]:
    """Probability of one reflection and of one refraction without another facet: the microfacet integrals.

    Visible normals of the incident direction times Fresnel times the height-correlated shadowing-masking ratio G2 / G1:
    (1 + L_i) / (1 + L_i + L_o) in reflection, (1 + L_i) Beta(1 + L_i, 1 + L_t) in refraction; quadrature over both slopes.
    """
    sine = math.sqrt(1.0 - cosine**2)
    grid = np.linspace(-8.0, 8.0, 801)
    x, y = slope * grid[:, None], slope * grid[None, :]
    weight = np.exp(-0.5 * (grid[:, None] ** 2 + grid[None, :] ** 2)) * (grid[1] - grid[0]) ** 2 / (2.0 * math.pi)
    length = 1.0 / np.sqrt(1.0 + x**2 + y**2)
    facet = (cosine - x * sine) * length
    arriving = float(upward_lambda(np.array(cosine), slope)) if sine > 0.0 else 0.0
    visible = weight * np.maximum(cosine - x * sine, 0.0) / (cosine * (1.0 + arriving))
    seen = np.where(facet > 0.0, facet, 1.0)
    root = 1.0 - (n_in / n_out) ** 2 * (1.0 - seen**2)
    refracted = np.sqrt(np.maximum(root, 0.0))
    s = (n_in * seen - n_out * refracted) / (n_in * seen + n_out * refracted)
    p = (n_out * seen - n_in * refracted) / (n_out * seen + n_in * refracted)
    reflectance = np.where(root > 0.0, 0.5 * (s**2 + p**2), 1.0)
    up = 2.0 * seen * length - cosine
    leaving = upward_lambda(np.where(up > 0.0, up, 1.0), slope)
    one = np.sum(np.where(up > 0.0, visible * reflectance * (1.0 + arriving) / (1.0 + arriving + leaving), 0.0))
    down = (n_in / n_out) * cosine - (n_in / n_out * seen - refracted) * length
    below = upward_lambda(np.where(down > 0.0, np.minimum(down, 1.0), 1.0), slope)
    through = (1.0 + arriving) * special.beta(1.0 + arriving, 1.0 + below)
    two = np.sum(np.where(down > 0.0, visible * (1.0 - reflectance) * through, 0.0))
    return float(one), float(two)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("slope", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("degrees", [0.0, 45.0, 75.0])
def test_single_bounce_is_the_microfacet_integral(side: str, slope: float, degrees: float):
    cosine, count = math.cos(math.radians(degrees)), 200_000
    reflected, refracted, longest = bounce_counts(*SIDES[side], slope, cosine, streams.stream(5, 0), count)
    expected = single_bounce(*SIDES[side], slope, cosine)
    for found, probability in zip((reflected, refracted), expected, strict=True):
        error = math.sqrt(max(probability * (1.0 - probability), 25.0 / count) / count)
        assert abs(found / count - probability) <= 4.0 * error
    assert longest <= 1000


@compiled
def longest_walk(n_in, n_out, slope, low, high, state, count):
    longest = 0
    for _ in range(count):
        cosine = low + (high - low) * streams.uniform(state)
        longest = max(longest, surface.facet_walk(math.sqrt(1.0 - cosine * cosine), 0.0, cosine, n_in, n_out, slope, state)[4])
    return longest


@pytest.mark.parametrize("slope", [1e-3, 0.02, 0.05, 0.2, 1.0, 5.0])
def test_walks_end(slope: float):
    # every angle of incidence: a rare endless walk once hid where Lambda underflows
    for n_in, n_out in SIDES.values():
        assert longest_walk(n_in, n_out, slope, 0.0, 1.0, streams.stream(3, 0), 300_000) <= 2000


def test_a_walk_without_end_is_not_passed_over(monkeypatch: pytest.MonkeyPatch):
    # cut after the first facet, as a walk would be after a million: no direction is handed on
    assert surface.facet_walk(0.6, 0.0, 0.8, 1.0, 1.4, 0.3, streams.stream(0, 0), 0)[3] == -1.0
    assert surface.facet_walk(0.6, 0.0, 0.8, 1.0, 1.4, 0.3, streams.stream(0, 0))[3] > 0.0
    monkeypatch.setattr(engine, "kernel", lambda: lambda *_: engine.LOST)
    with pytest.raises(RuntimeError, match="facets"):
        mc.simulate(interface(1.0, 1.4, 0.1), photons=2, threads=1)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("roughness", ROUGHNESS)
def test_no_energy_is_lost(side: str, roughness: float):
    for index, degrees in enumerate(DEGREES):
        found = totals(roughness, side, degrees, 20_000, 50 + index)
        assert found["balance"] <= 1e-12
        assert abs(found["R"] + found["T"] - 1.0) <= 1e-12


@pytest.mark.parametrize("side", SIDES)
def test_small_roughness_tends_to_fresnel(side: str):
    photons = 100_000
    for index, degrees in enumerate(DEGREES):
        found = totals(1e-3, side, degrees, photons, 70 + index)
        exact = fresnel(*SIDES[side], math.cos(math.radians(degrees)))
        assert abs(found["R"] - exact) <= 4.0 * max(math.sqrt(exact * (1.0 - exact) / photons), 1.0 / photons)


def test_small_roughness_keeps_the_direction_of_refraction():
    # 60 degrees in air are 38.21 degrees in 1.4
    refracted = math.degrees(math.asin(math.sin(math.radians(60.0)) / 1.4))
    tallies = mc.Tallies(theta=[refracted - 1.0, refracted + 1.0], phi=[0.0, 2.0, 180.0])
    result = mc.simulate(interface(1.0, 1.4, 1e-3), mc.Pencil(0.5), tallies, photons=20_000, threads=1)
    sphere = math.sin(math.radians(refracted + 1.0)) ** 2 - math.sin(math.radians(refracted - 1.0)) ** 2
    assert float(result.value("T_angle")[0, 0]) * sphere * math.radians(2.0) >= 0.9999 * float(result.value("T"))


@pytest.mark.parametrize("roughness", ROUGHNESS)
def test_reciprocity(roughness: float):
    found = reciprocity(roughness, 40_000, 4000 + int(1000 * roughness))
    assert found["verdict"] == "agree"
    assert 0.5 <= found["sd"] <= 1.5


@pytest.mark.parametrize("roughness", [0.1, 0.5, 1.5])
def test_uniform_radiance_stays_uniform(roughness: float):
    # diffuse light of radiance n^2 on both sides of an interface is in equilibrium: what leaves is diffuse again
    tallies = mc.Tallies(theta=np.linspace(0.0, 90.0, 10))
    above = mc.simulate(interface(1.0, 1.4, roughness), mc.Lambertian(), tallies, photons=400_000, seed=8, threads=1)
    below = mc.simulate(interface(1.4, 1.0, roughness), mc.Lambertian(), tallies, photons=400_000, seed=9, threads=1)
    for near, far, n_near, n_far in ((above, below, 1.0, 1.4), (below, above, 1.4, 1.0)):
        reflected, crossed = near.estimate("R_specular_angle"), far.estimate("T_angle")
        # a full hemisphere of unit power has the radiance 1/pi
        leaving = mc.Estimate(
            n_near**2 * reflected.value + n_far**2 * crossed.value,
            np.hypot(n_near**2 * reflected.standard_error, n_far**2 * crossed.standard_error),
            99,
        )
        comparison = mc.compare(leaving, np.full((9, 1), n_near**2 / math.pi), limit=0.01)
        assert comparison.agree, str(comparison)


def test_equal_indices_make_roughness_void():
    layers = {"n": [1.4, 1.4], "sigma_a": [0.1, 0.2], "sigma_s": [5.0, 2.0], "g": [0.5, 0.0], "thickness": [0.5, 1.0]}
    smooth = mc.Medium(**layers, n_above=1.4, n_below=1.4)
    rough = mc.Medium(**layers, n_above=1.4, n_below=1.4, roughness=[0.3, 0.5, 1.0])
    one, other = (mc.simulate(m, photons=2000, threads=1) for m in (smooth, rough))
    assert np.array_equal(one.sums, other.sums)


STACKS = {
    "matched": mc.Medium([1.0], [0.0], [3.0], [0.7], [1.0]),
    "index steps": mc.Medium([1.4, 1.6, 1.2], [0.0] * 3, [3.0, 0.0, 5.0], [0.7, 0.0, 0.0], [1.0, 0.3, 0.5]),
    "rough": mc.Medium([1.4, 1.6, 1.2], [0.0] * 3, [3.0, 0.5, 5.0], [0.7, 0.0, 0.0], [1.0, 0.3, 0.5], roughness=[0.3, 0.8, 0.1, 0.4]),
    "rough, clear layer": mc.Medium([1.4, 1.6], [0.0] * 2, [0.0, 1.0], None, [0.5, 0.5], n_below=1.2, roughness=[0.5, 0.2, 0.6]),
    "thin film": mc.Medium([1.5, 1.3], [0.0] * 2, [1.0, 2.0], 0.3, [0.0, 0.5], roughness=[0.3, 0.2, 0.0]),
}  # fmt: skip


@pytest.mark.parametrize("name", STACKS)
def test_mean_path_lengths_are_invariant(name: str):
    """Without absorption, diffuse light of radiance n^2 from both sides fills layer l with the fluence 4 pi n_l^2.

    The length travelled in it per unit area is then 4 pi n_l^2 d_l, whatever scatters or reflects: for unit power from above and from
    below, n_above^2 <L_l>_above + n_below^2 <L_l>_below = 4 n_l^2 d_l. (Blanco and Fournier 2003, here with indices and layers.)
    Only directions that no light can come to stay dark: in a clear smooth layer of 1.6 on 1.4, those beyond the critical angle.
    """
    medium = STACKS[name]
    above = mc.simulate(medium, mc.Lambertian(), photons=100_000, seed=21, threads=1).estimate("path")
    below = mc.simulate(medium.flipped(), mc.Lambertian(), photons=100_000, seed=22, threads=1).estimate("path")
    value = medium.n_above**2 * above.value + medium.n_below**2 * below.value[::-1]
    error = np.hypot(medium.n_above**2 * above.standard_error, medium.n_below**2 * below.standard_error[::-1])
    expected = 4.0 * np.array(medium.n) ** 2 * np.array(medium.thickness)
    if name == "index steps":
        expected[1] *= 1.0 - math.sqrt(1.0 - (1.4 / 1.6) ** 2)
    comparison = mc.compare(mc.Estimate(value, error, 99), expected)
    assert comparison.agree, str(comparison)
