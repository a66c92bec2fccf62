"""Fluence and absorbed power in discrete ordinates: against each other, the Monte Carlo, and the balance of energy."""

import numpy as np
import pytest

import layerfit as lf
import layerfit.montecarlo as mc

SOLVER = lf.DiscreteOrdinates(streams=12)
SLABS = lf.Stack(
    [
        lf.Layer("a", sigma_a=0.05, sigma_s=2.0, g=0.7, n=1.5, thickness=0.4),
        lf.Layer("b", sigma_a=0.2, sigma_s=1.0, g=0.0, n=1.33, thickness=1.5),
    ],
    n_below=1.2,
)
DEEP = lf.Layer("a", sigma_a=0.05, sigma_s=2.0, g=0.7, n=1.5, thickness=0.4) | lf.HalfSpace("b", sigma_a=0.2, sigma_s=1.0, g=0.0, n=1.33)


@pytest.mark.parametrize(("stack", "incidence"), [(SLABS, "normal"), (DEEP, 40.0)], ids=["slabs", "deep, oblique"])
def test_absorbed_power_is_the_integral_of_the_fluence(stack, incidence):
    """int sigma_a phi dz over a layer; all of it with R and T makes 1."""
    power = lf.absorbed(stack, incidence=incidence, solver=SOLVER)
    leaving = [lf.TotalReflectance(specular="included", incidence=incidence), lf.TotalTransmittance(incidence=incidence)][: 2 - stack.half_space]
    totals = [float(p.values[0]) for p in lf.predict(stack, leaving, solver=SOLVER)]
    assert abs(sum(totals) + sum(power.values()) - 1) <= 1e-13
    u, w = np.polynomial.legendre.leggauss(12)
    edges = {"a": [0.0, 0.1, 0.4], "b": [0.4, 0.5, 0.9, 1.9] if stack is SLABS else [0.4, 0.5, 1.0, 3.0, 7.0, 15.0, 40.0]}
    depths = {name: np.array(e)[:-1, None] + np.diff(e)[:, None] * (u + 1) / 2 for name, e in edges.items()}
    phi = np.asarray(lf.fluence(stack, np.concatenate([z.ravel() for z in depths.values()]), incidence=incidence, solver=SOLVER))
    for name, sigma_a, part in (("a", 0.05, phi[:24]), ("b", 0.2, phi[24:])):
        weight = (np.diff(edges[name])[:, None] * w / 2).ravel()
        assert abs(sigma_a * weight @ part - power[name]) <= 1e-7 * power[name], name


def test_absorbed_power_of_the_monte_carlo():
    medium = mc.Medium([1.5, 1.33], [0.05, 0.2], [2.0, 1.0], [0.7, 0.0], [0.4, 1.5], n_below=1.2)
    walked = mc.simulate(medium, photons=200_000, seed=3, threads=2)
    power = np.array(list(lf.absorbed(SLABS, solver=SOLVER).values()))
    assert np.all(np.abs(power - walked.value("A")) <= 4.0 * walked.standard_error("A"))
    assert np.max(walked.standard_error("A") / power) <= 0.01


def test_nothing_is_absorbed_at_albedo_one():
    """Lit from both sides, the light in an unabsorbing, matched layer is the same everywhere and in all directions: I = 1/pi, phi = 4."""
    white = lf.Stack([lf.Layer("white", sigma_a=0.0, sigma_s=3.0, g=0.5, n=1.0, thickness=1.0)])
    assert abs(lf.absorbed(white, solver=SOLVER, incidence="diffuse")["white"]) <= 1e-13
    phi = np.asarray(lf.fluence(white, [0.2, 0.8], solver=SOLVER, incidence="diffuse"))
    assert abs(phi.sum() - 4.0) <= 1e-12


def test_refusals():
    with pytest.raises(lf.InputError, match="r was given"):
        lf.fluence(SLABS, [0.1], r=[1.0], solver=SOLVER)
    with pytest.raises(lf.InputError, match=r"incidence = 30\.0 with solver layered-diffusion"):
        lf.absorbed(SLABS, incidence=30.0)
    with pytest.raises(lf.InputError, match="depth"):
        lf.fluence(SLABS, [2.5], solver=SOLVER)
