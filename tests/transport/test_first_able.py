"""Several solvers in one prediction and one fit."""

import numpy as np
import pytest

import layerfit as lf

SOLVER = lf.FirstAble(lf.LayeredDiffusion(), lf.DiscreteOrdinates(streams=16))
STACK = lf.Stack([lf.Layer("top", sigma_a=0.05, sigma_s_prime=1.5, g=0.7, n=1.4, thickness=2.0)])
RADIAL = lf.RadialReflectance(r=np.linspace(1.0, 10.0, 12))
ANGLES = lf.AngularReflectance([20.0, 50.0])
GEOMETRIES = [lf.TotalReflectance(), RADIAL, ANGLES, lf.TotalTransmittance()]


def test_each_value_is_that_of_its_solver_in_the_order_asked():
    together = lf.predict(STACK, GEOMETRIES, solver=SOLVER)
    for i, geometry in enumerate(GEOMETRIES):
        alone = lf.predict(STACK, geometry, solver=SOLVER.solvers[1 if geometry is ANGLES else 0])[0]
        assert np.max(np.abs(together[i].values / alone.values - 1.0)) <= 1e-9
        assert (together[i].estimated_error is None) == (alone.estimated_error is None)
        assert together[i].notes[0] == f"predicted by {'discrete-ordinates' if geometry is ANGLES else 'layered-diffusion'}"
    transport_first = lf.FirstAble(lf.DiscreteOrdinates(), lf.LayeredDiffusion())
    assert transport_first.taken(STACK, GEOMETRIES[0]).name == "discrete-ordinates"


@pytest.mark.long
def test_joint_fit_of_totals_angles_and_radial_data():
    """What none of them determines alone: absorption, scattering and thickness from exact data of all four, an offset of r beside them."""
    truth = {"top.sigma_a": 0.05, "top.sigma_s_prime": 1.5, "top.thickness": 2.0}
    values = [p.values for p in lf.predict(STACK, GEOMETRIES, solver=SOLVER)]
    data = [lf.Dataset(g, v, 0.01 * v, name=f"m{i}") for i, (g, v) in enumerate(zip(GEOMETRIES, values, strict=True))]
    free = {
        "top.sigma_a": {"min": 1e-3, "max": 1.0, "init": 0.15},
        "top.sigma_s_prime": {"min": 0.3, "max": 8.0, "init": 0.8},
        "top.thickness": {"min": 0.5, "max": 8.0, "init": 3.0},
        "m1.offset": (-0.2, 0.2),
    }
    fit = lf.fit(lf.Problem(STACK, data, free=free, solver=SOLVER), starts=1)
    assert fit.outcome is lf.Outcome.CONVERGED
    for name, value in truth.items():
        assert abs(fit.parameters[name].value / value - 1.0) <= 1e-6, name
    assert abs(fit.parameters["m1.offset"].value) <= 1e-6
    assert "predicted by layered-diffusion" in fit.warnings
    assert "first-able" in fit.summary()


def test_what_it_refuses():
    with pytest.raises(ValueError, match="one solver or more"):
        lf.FirstAble()
    with pytest.raises(ValueError, match="one solver or more"):
        lf.FirstAble("auto")  # pyright: ignore[reportArgumentType]
    only = lf.FirstAble(lf.DiscreteOrdinates(), lf.Dipole())
    without_g = lf.Stack([lf.Layer("top", sigma_a=0.05, sigma_s_prime=1.5, n=1.4, thickness=2.0)])
    with pytest.raises(ValueError, match=r"discrete-ordinates needs g.*; .*dipole"):
        lf.predict(without_g, RADIAL, solver=only)
    walked = lf.FirstAble(lf.MonteCarlo(photons=1000), lf.LayeredDiffusion())
    with pytest.raises(ValueError, match="first-able has no derivatives"):
        lf.Problem(STACK, lf.Dataset(RADIAL, np.ones(12), 0.1 * np.ones(12)), free={"top.sigma_a": (0.01, 1.0)}, solver=walked)
