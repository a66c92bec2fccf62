"""The assembled BSSRDF against Fresnel's formulas written out, and its symmetry."""

import numpy as np
import pytest

import layerfit as lf

SKIN = lf.Stack([lf.HalfSpace("skin", sigma_a=0.01, sigma_s_prime=1, n=1.4)])


def transmittance(cosine: float, n: float) -> float:
    """Fresnel transmittance from air into n by the angles themselves."""
    a = np.arccos(cosine)
    b = np.arcsin(np.sin(a) / n)
    s, p = (np.sin(a - b) / np.sin(a + b)) ** 2, (np.tan(a - b) / np.tan(a + b)) ** 2
    return 1.0 - 0.5 * (s + p)


def test_product_of_its_parts():
    """S = Ft(mu_in) R(r) Ft(mu_out)/pi (Donner & Jensen 2005, eq 2), R per unit power that has entered."""
    r = np.array([0.5, 1.0, 4.0])
    found = np.asarray(lf.bssrdf(SKIN, r, 0.8, np.array([0.3, 0.6, 0.9])))
    profile = lf.predict(SKIN, lf.RadialReflectance(r), solver=lf.Multipole())[0].values / (1.0 - (0.4 / 2.4) ** 2)
    expected = transmittance(0.8, 1.4) * profile * np.array([transmittance(mu, 1.4) for mu in (0.3, 0.6, 0.9)]) / np.pi
    assert np.max(np.abs(found / expected - 1.0)) <= 1e-10


@pytest.mark.parametrize("roughness", [0.0, 0.2])
def test_entry_and_exit_change_places(roughness):
    skin = SKIN.set({"skin.roughness": roughness})
    there, back = lf.bssrdf(skin, [1.0, 2.0], np.array([0.9, 0.7]), 0.4), lf.bssrdf(skin, [1.0, 2.0], 0.4, np.array([0.9, 0.7]))
    assert np.max(np.abs(there / back - 1.0)) <= 1e-12
    if roughness:
        assert abs(float(there[0] / lf.bssrdf(SKIN, [1.0], 0.9, 0.4)[0]) - 1.0) >= 1e-3
