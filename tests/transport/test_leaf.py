"""A leaf seen from both sides: two layers in air, their faces rough or smooth, turned over."""

import numpy as np
import pytest

import layerfit as lf

ANGLES = [10.0, 50.0]
SOLVER = lf.DiscreteOrdinates(streams=8)


def leaf(roughness, n, *, turned=False):
    """Upper side first, or the lower one. roughness : of the upper face, of that between the layers, and of the lower face."""
    palisade = {"sigma_a": 1.5, "sigma_s": 30.0, "g": 0.7, "n": 1.4, "thickness": 0.1}
    spongy = {"sigma_a": 0.5, "sigma_s": 60.0, "g": 0.6, "n": n, "thickness": 0.12}
    layers = [("palisade", palisade), ("spongy", spongy)]
    if turned:
        layers, roughness = layers[::-1], roughness[::-1]
    stack = [lf.Layer(name, roughness=s, **optics) for (name, optics), s in zip(layers, roughness[:2], strict=True)]
    return lf.Stack(stack, roughness_below=roughness[2])


@pytest.mark.parametrize(
    ("roughness", "n"),
    [pytest.param((0.0, 0.0, 0.0), 1.33, id="smooth", marks=pytest.mark.long), pytest.param((0.4, 0.1, 0.2), 1.33, id="rough")],
)
def test_two_sides(roughness, n):
    """Reflectance tells the sides apart, transmittance cannot: T is equal, and BTDF(mu, mu') is that of the turned leaf from mu' to mu."""
    upper, lower = leaf(roughness, n), leaf(roughness, n, turned=True)
    asked = [
        lf.TotalReflectance(incidence="diffuse", specular="included"),
        lf.TotalTransmittance(incidence="diffuse"),
        *(lf.AngularTransmittance(ANGLES, incidence=angle, azimuth=40.0) for angle in ANGLES),
    ]
    (r, t, *there), (r_turned, t_turned, *back) = ([found.values for found in lf.predict(side, asked, solver=SOLVER)] for side in (upper, lower))
    assert abs(r[0] - r_turned[0]) >= 0.1
    assert abs(t[0] - t_turned[0]) <= 1e-9
    there, back = np.array(there), np.array(back)  # from each angle (rows) into each
    assert np.max(np.abs(there - back.T)) <= 1e-9 * np.max(there)
    assert np.max(np.abs(there - there.T)) >= 1e-3 * np.max(there)  # without turning it there is no such law
