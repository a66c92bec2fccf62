"""Derivatives from the paths against exact ones, identities between them, and differences of runs."""

import math

import montecarlo_derivatives as long_run
import numpy as np
import pytest
from test_physics import h_function

import layerfit.montecarlo as mc


def run(medium: mc.Medium, source=None, photons: float = 200_000, seed: int = 1, **tallies) -> mc.Result:
    return mc.simulate(medium, source, mc.Tallies(derivatives=True, **tallies), photons=photons, seed=seed, threads=1)


def close(found: mc.Estimate, exact: float, sharp: float) -> None:
    """Within 3.5 standard errors, which are at most `sharp` of the exact value."""
    error = float(found.standard_error)
    assert abs(float(found.value) - exact) <= 3.5 * error
    assert error <= sharp * abs(exact)


@pytest.mark.parametrize(("albedo", "incidence"), [(0.9, 1.0), (0.9, 0.5), (0.99, 1.0)])
def test_half_space_against_the_h_function(albedo: float, incidence: float):
    # R depends on a = sigma_s / (sigma_a + sigma_s) only; dR/da from the exact solution on both sides
    def reflectance(a: float) -> float:
        return 1.0 - math.sqrt(1.0 - a) * float(h_function(a)(np.array([incidence]))[0])

    slope = (reflectance(albedo + 1e-4) - reflectance(albedo - 1e-4)) / 2e-4
    result = run(mc.Medium([1.0], [1.0 - albedo], [albedo], 0.0, [math.inf]), mc.Pencil(incidence), photons=400_000)
    close(result.derivative("R", "sigma_s", 0), slope * (1.0 - albedo), 0.05)
    close(result.derivative("R", "sigma_a", 0), -slope * albedo, 0.05)
    close(result.derivative("A_total", "sigma_a", 0), slope * albedo, 0.05)


def test_unscattered_light():
    # T = exp(-(sigma_a + sigma_s) d)
    result = run(mc.Medium([1.0], [0.3], [0.7], 0.5, [1.5]))
    for parameter in ("sigma_a", "sigma_s"):
        close(result.derivative("T_unscattered", parameter, 0), -1.5 * math.exp(-1.5), 0.01)
    assert abs(float(result.mean_path("T_unscattered", 0).value) - 1.5) <= 1e-12


def test_absorption_at_zero_absorption():
    # with no absorption dA/dsigma_a of a layer is the length travelled there, and minus the sum of dR and dT
    medium = mc.Medium([1.4, 1.6, 1.4], [0.0] * 3, [3.0, 0.0, 5.0], 0.5, [0.3, 0.2, 0.5])
    result = run(medium)
    for layer in range(3):
        gained = result.derivative("A", "sigma_a", layer).value
        assert abs(gained[layer] - result.value("path")[layer]) <= 1e-12 * gained[layer]
        assert np.all(np.delete(gained, layer) == 0.0)
        lost = [result.derivative(name, "sigma_a", layer) for name in ("R", "T")]
        total = mc.Estimate.from_samples(sum(e.samples for e in lost if e.samples is not None))
        assert abs(float(total.value) + gained[layer]) <= 3.5 * math.hypot(
            float(total.standard_error), float(result.derivative("A", "sigma_a", layer).standard_error[layer])
        )


TWO = mc.Medium([1.4, 1.33], [0.1, 0.05], [10.0, 5.0], [0.8, 0.5], [0.2, 1.0], roughness=[0.2, 0.0, 0.1])


def test_energy_and_scaling_identities():
    result = run(TWO, rings=[0.0, 0.2, 0.5])
    kept = []
    for parameter in ("sigma_a", "sigma_s"):
        for layer in (0, 1):
            parts = [result.derivative(name, parameter, layer).samples for name in ("R", "T", "A_total")]
            kept.append(sum(p for p in parts if p is not None))
    balance = mc.Estimate.from_samples(np.stack(kept, axis=1))
    assert (np.abs(balance.value) / balance.standard_error).max() <= 3.5
    # a half space of one coefficient scale: sum of sigma dR/dsigma over all layers is 0 (only ratios matter)
    deep = run(mc.Medium([1.4, 1.4], [0.1, 0.2], [10.0, 5.0], [0.8, 0.5], [0.0, math.inf]))
    scaled = sum(
        value * samples
        for parameter, value in (("sigma_a", 0.2), ("sigma_s", 5.0))
        if (samples := deep.derivative("R", parameter, 1).samples) is not None
    )
    both = mc.Estimate.from_samples(np.asarray(scaled))
    assert abs(float(both.value)) <= 3.5 * float(both.standard_error)
    # mean paths: the light of the outer ring has come further in both layers than that of the inner one
    for layer in (0, 1):
        path = result.mean_path("R_rings", layer)
        assert path.value[1] - path.value[0] >= 5.0 * np.hypot(*path.standard_error)


def test_against_differences():
    """The run of benchmarks/montecarlo_derivatives.py with fewer photons (sigma_s of the thin layer, which hardly matters, is left to it)."""
    base = mc.simulate(long_run.scene(), long_run.LIGHT, long_run.tallies(True), photons=200_000, seed=41, threads=1)
    for index, (parameter, layer, sharp) in enumerate((("sigma_a", 0, 0.1), ("sigma_a", 1, 0.1), ("sigma_s", 1, 0.5))):
        found = long_run.compare(base, parameter, layer, 200_000, 51 + 10 * index)
        assert found.verdict != "disagree", str(found)
        assert np.nanmin(found.noticeable) <= sharp
    # the derivatives of one layer are not those of the other: a swapped index would be seen
    for parameter in ("sigma_a", "sigma_s"):
        one, other = (mc.Estimate.join([base.derivative(name, parameter, layer) for name in ("R", "T")]) for layer in (0, 1))
        assert mc.compare(one, other, reliable=math.inf).verdict == "disagree"
