"""Light inside the sample against closed forms, and against the balance of energy."""

import numpy as np
import pytest

import layerfit as lf

POINT = lf.LayeredDiffusion(source="point", boundary="extrapolated", diffusion="transport")
STACKS = {
    "half": lf.Layer("top", sigma_a=0.3, sigma_s_prime=5, g=0.8, n=1.4, thickness=0.5)
    | lf.HalfSpace("deep", sigma_a=0.02, sigma_s_prime=2, g=0.8, n=1.33),
    "slabs": lf.Stack(
        [
            lf.Layer("a", sigma_a=0.05, sigma_s_prime=2.0, g=0.7, n=1.5, thickness=0.4),
            lf.Layer("b", sigma_a=0.2, sigma_s_prime=1.0, g=0.0, n=1.33, thickness=1.5),
            lf.Layer("c", sigma_a=0.01, sigma_s_prime=4.0, g=0.9, n=1.4, thickness=0.8),
        ],
        n_below=1.2,
    ),
}


def test_half_space_around_the_beam():
    """phi = alpha'/(4 pi D) (exp(-sigma r1)/r1 - exp(-sigma r2)/r2), source at l and image at l + 2 zb (Farrell et al. 1992, eq 4)."""
    sigma_a, sigma_s_prime = 0.02, 1.5
    l = 1 / (sigma_a + sigma_s_prime)
    D, zb = l / 3, 2 * l / 3
    stack = lf.Stack([lf.HalfSpace("white", sigma_a=sigma_a, sigma_s_prime=sigma_s_prime, n=1.0)])
    z, r = np.array([0.0, 0.2, 1.0, 6.0])[:, None], np.array([0.3, 2.0, 9.0])
    near, far = np.hypot(r, z - l), np.hypot(r, z + l + 2 * zb)
    sigma = np.sqrt(sigma_a / D)
    expected = sigma_s_prime * l / (4 * np.pi * D) * (np.exp(-sigma * near) / near - np.exp(-sigma * far) / far)
    found = np.asarray(lf.fluence(stack, z[:, 0], r=r, solver=POINT))
    assert np.max(np.abs(found / expected - 1)) <= 1e-8


@pytest.mark.parametrize("source", ["mixed", "exponential", "point"])
@pytest.mark.parametrize("name", STACKS)
def test_absorbed_power(name, source):
    """Power absorbed in a layer = int sigma_a phi dz + the unscattered part of the beam; with R and T it makes 1."""
    stack, solver = STACKS[name], lf.LayeredDiffusion(source=source, boundary="partial_current")
    power = lf.absorbed(stack, solver=solver)
    assert all(value > 0 for value in power.values())
    leaving = [lf.TotalReflectance(specular="included"), lf.TotalTransmittance()][: 2 - stack.half_space]
    totals = [float(p.values[0]) for p in lf.predict(stack, leaving, solver=solver)]
    assert abs(sum(totals) + sum(power.values()) - 1) <= 1e-12
    if name == "slabs":
        return  # there faces send part of the beam back
    u, w = np.polynomial.legendre.leggauss(12)
    beam, top = 1.0 - (0.4 / 2.4) ** 2, 0.0
    for layer, step in zip(stack.layers, (((1.4 - 1.33) / (1.4 + 1.33)) ** 2 if source == "exponential" else 0.0, 0.0), strict=True):
        sigma_a, sigma_t_prime = float(layer.sigma_a), float(layer.sigma_a + layer.sigma_s_prime)
        d = float(layer.thickness) if isinstance(layer, lf.Layer) else 80.0
        edges = np.unique([0.0, *(1 / sigma_t_prime * np.array([0.5, 1.0, 2.0])), *np.geomspace(0.05, d, 10)])  # a point source bends the fluence
        edges = edges[edges <= d]
        low, width = edges[:-1, None], np.diff(edges)[:, None]
        phi = np.asarray(lf.fluence(stack, top + (low + width * (u + 1) / 2).ravel(), solver=solver))
        lost = beam * -np.expm1(-sigma_t_prime * d)
        expected = sigma_a * np.sum((width * w / 2).ravel() * phi) + lost * sigma_a / sigma_t_prime
        assert abs(power[layer.name] - expected) <= 2e-5
        beam, top = (beam - lost) * (1 - step), top + d


def test_depth_outside_is_refused():
    with pytest.raises(lf.InputError, match=r"fluence: depth = \[3\.0\]; allowed is 0 to 2\.7 mm"):
        lf.fluence(STACKS["slabs"], [3.0])
