"""Polynomials in place of a slow model."""

import numpy as np
import pytest

import layerfit as lf
from layerfit.inference.batch import predictions_at

CAMERA = lf.SpatialFrequency(fx=[0.0, 0.1, 0.3])
SKIN = lf.Stack([lf.HalfSpace("skin", sigma_a=0.02, sigma_s_prime=1.0, g=0.8, n=1.4)])
FREE = {"skin.sigma_a": (1e-3, 0.5), "skin.sigma_s_prime": (0.3, 5.0)}


def problem(free=FREE, stack=SKIN):
    values = lf.predict(stack, CAMERA, solver=lf.LayeredDiffusion())[0].values
    return lf.Problem(stack, lf.Dataset(CAMERA, values, noise=lf.Noise(relative=0.01)), free=free, solver=lf.LayeredDiffusion())


def test_error_is_as_stated():
    """At fresh points between the bounds, and at the bounds; the error falls with the tolerance."""
    exact = problem()
    rng = np.random.default_rng(0)
    x = np.exp(rng.uniform(np.log([1e-3, 0.3]), np.log([0.5, 5.0]), (300, 2)))
    x[:2] = [[1e-3, 0.3], [0.5, 5.0]]
    known = predictions_at(exact.model, x)[0]
    errors = []
    for tolerance in (1e-2, 1e-5):
        quick = lf.emulate(exact, tolerance=tolerance)
        assert quick.model.error <= tolerance
        errors.append(np.max(np.abs(predictions_at(quick.model, x)[0] / known - 1)))
        assert errors[-1] <= 5 * quick.model.error
    assert errors[1] <= 0.01 * errors[0]


def test_fits_are_the_same():
    exact = problem()
    quick = lf.emulate(exact, tolerance=1e-6)
    values = exact.data[0].values * np.array([[1.0, 1.01, 0.98], [0.9, 1.0, 1.02]])
    many, direct = (lf.fit_many(one, values) for one in (quick, exact))
    assert np.max(np.abs(many.x / direct.x - 1)) <= 1e-5
    assert np.max(np.abs(many.stderr / direct.stderr - 1)) <= 1e-3


def test_values_of_both_signs():
    """A background moves values below 0: no logarithm then."""
    free = FREE | {"measurement.background": {"min": -1.0, "max": 1.0, "scale": "linear"}}
    quick = lf.emulate(problem(free), tolerance=1e-3)
    x = np.array([[0.02, 1.0, -0.9], [0.02, 1.0, 0.5]])
    assert np.max(np.abs(predictions_at(quick.model, x)[0] - predictions_at(problem(free).model, x)[0])) <= 2e-3


def test_what_cannot_be_done():
    """The kink of layered diffusion, where its source meets the interface, is no polynomial."""
    layers = lf.Layer("top", sigma_a=0.05, sigma_s_prime=1.5, n=1.4, thickness=0.6) | SKIN.layers[0]
    with pytest.raises(lf.InputError, match="not reached"):
        lf.emulate(problem({"top.thickness": (0.01, 20.0), "top.sigma_s_prime": (0.1, 20.0), "skin.sigma_a": (1e-3, 1.0)}, layers), tolerance=1e-6)
    with pytest.raises(lf.InputError, match="tolerance"):
        lf.emulate(problem(), tolerance=0.0)
