"""R(r) of slabs and layers against the same integral in arbitrary precision (tests/reference/make_hankel.py)."""

import json

import numpy as np
import pytest
from cases import FOLDER

import layerfit as lf

STORED = json.loads((FOLDER.parent / "hankel.json").read_text())
R = np.array([float(r) for r in STORED["r_mm"]])
ENTERING = 1 - (0.4 / 2.4) ** 2

SLAB = lf.Stack([lf.Layer("slab", sigma_a=0.01, sigma_s_prime=1, n=1.4, thickness=5)])
TWO = lf.Layer("top", sigma_a=0.02, sigma_s_prime=1.5, n=1.4, thickness=2) | lf.HalfSpace("deep", sigma_a=0.01, sigma_s_prime=1, n=1.4)
TEXTBOOK = {"source": "point", "boundary": "extrapolated", "diffusion": "transport"}


@pytest.mark.parametrize("subtract", [True, False])
@pytest.mark.parametrize(("layers", "stack"), [("slab", SLAB), ("two layers", TWO)])
@pytest.mark.parametrize(("method", "solver"), [("multipole", lf.Multipole), ("layered diffusion", lambda **s: lf.LayeredDiffusion(**TEXTBOOK, **s))])
def test_profile_against_arbitrary_precision(method, solver, layers, stack, subtract):
    """Relative error 1e-8 over six decades of R, 1e-4 over ten, the nearest images taken out or not."""
    expected = np.array([float(v) for v in next(v for k, v in STORED.items() if k.startswith(f"{method} {layers}"))])
    found = lf.predict(stack, lf.RadialReflectance(r=R), solver=solver(subtract=subtract))[0].values / ENTERING
    error = np.abs(found / expected - 1)
    assert np.max(error[expected > 1e-6 * expected[0]]) <= 1e-8
    assert np.max(error[expected > 1e-10 * expected[0]]) <= 1e-4
    assert np.sum(expected > 1e-10 * expected[0]) >= 13


@pytest.mark.parametrize(
    "solver", [lf.LayeredDiffusion(), lf.LayeredDiffusion(source="exponential"), lf.LayeredDiffusion(source="point"), lf.Multipole()], ids=str
)
def test_ring_from_the_axis_on(solver):
    """A ring that starts at 0 is the average over its disk; together with the ring around it, it is the average over both."""
    stack = lf.Stack([lf.Layer("slab", sigma_a=0.02, sigma_s_prime=1, g=0.8, n=1.4, thickness=4)])
    r, w = np.polynomial.legendre.leggauss(24)
    r = 0.5 * (r + 1)
    geometries = [lf.RadialReflectance(r_min=[0, 1], r_max=[1, 2]), lf.RadialReflectance(r_min=[0], r_max=[2]), lf.RadialReflectance(r=r)]
    (inner, outer), (both,), points = (p.values for p in lf.predict(stack, geometries, solver=solver))
    assert abs((inner + 3 * outer) / (4 * both) - 1) <= 1e-8
    assert abs(np.sum(w * r * points) / inner - 1) <= 1e-4
