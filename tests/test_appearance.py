"""Colour, judged by published tristimulus values and colour differences."""

import subprocess
import sys

import numpy as np
import pytest

import layerfit as lf

WAVELENGTH = np.arange(380.0, 781.0, 5.0)
# G. Sharma, W. Wu and E. N. Dalal, Color Res. Appl. 30, 21 (2005), table 1: pairs 1, 4, 7, 9, 17, 20, 21, 25, 28, 31, 34
SHARMA = [
    ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
    ((50.0, -1.3802, -84.2814), (50.0, 0.0, -82.7485), 1.0000),
    ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
    ((50.0, 2.4900, -0.0010), (50.0, -2.4900, 0.0009), 7.1792),
    ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
    ((50.0, 2.5, 0.0), (58.0, 24.0, 15.0), 19.4535),
    ((50.0, 2.5, 0.0), (50.0, 3.1736, 0.5854), 1.0000),
    ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ((22.7233, 20.0904, -46.6940), (23.0331, 14.9730, -42.5619), 2.0373),
    ((90.8027, -2.0831, 1.4410), (91.1528, -1.6435, 0.0447), 1.4441),
    ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
]
# CIE 15:2004, table T.3 (5 nm, 380 to 780 nm): X and Z of a perfect white, Y = 100
WHITES = {
    ("A", 2): (109.85, 35.58),
    ("D65", 2): (95.04, 108.88),
    ("D50", 2): (96.42, 82.51),
    ("A", 10): (111.14, 35.20),
    ("D65", 10): (94.81, 107.32),
}


@pytest.mark.parametrize(("first", "second", "difference"), SHARMA)
def test_ciede2000_of_sharma(first, second, difference):
    assert abs(float(lf.delta_e(first, second)) - difference) <= 5e-5
    assert abs(float(lf.delta_e(second, first)) - difference) <= 5e-5


@pytest.mark.parametrize(("light", "white"), WHITES.items(), ids=str)
def test_white(light, white):
    illuminant, observer = light
    seen = lf.colour(WAVELENGTH, np.ones_like(WAVELENGTH), illuminant=illuminant, observer=observer)
    assert np.max(np.abs(100 * seen.XYZ - [white[0], 100.0, white[1]])) <= 0.011
    assert np.max(np.abs(seen.Lab - [100, 0, 0])) <= 1e-9
    assert np.max(np.abs(seen.sRGB - 1)) <= 1e-6  # white stays white under every illuminant
    assert seen.hex == "#ffffff"


def test_grey_and_shape():
    """Lightness of a grey by its formula; many spectra at once are the same as one by one; coarse steps change little of a smooth spectrum."""
    assert abs(lf.colour(WAVELENGTH, np.full(81, 0.18)).Lab[0] - (116 * 0.18 ** (1 / 3) - 16)) <= 1e-9
    slope = 0.2 + 0.5 * (WAVELENGTH - 380) / 400
    many = lf.colour(WAVELENGTH, np.stack([[slope, 1 - slope]] * 3))
    assert many.Lab.shape == (3, 2, 3) and many.in_gamut.shape == (3, 2) and many.hex.shape == (3, 2)
    one = lf.colour(WAVELENGTH, slope)
    assert np.max(np.abs(many.Lab[1, 0] - one.Lab)) <= 1e-10
    assert one.Lab[1] > 2 and one.Lab[2] > 10  # more red than blue: yellow to red
    coarse = lf.colour(WAVELENGTH[::4], slope[::4])
    assert float(one.delta_e(coarse)) <= 0.02


def test_numpy_prints_as_before():
    """colour-science changes that when it is imported."""
    code = "import numpy as np, layerfit as lf; lf.delta_e([50, 0, 0], [50, 1, 0]); print(np.array([0.5]))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[0.5]\n"


def test_out_of_gamut_is_said():
    narrow = np.exp(-(((WAVELENGTH - 520) / 8) ** 2))
    seen = lf.colour(WAVELENGTH, narrow)
    assert not seen.in_gamut and "cut off" in repr(seen)
    assert seen.sRGB.min() >= 0 and seen.sRGB.max() <= 1
    figure = lf.swatches({"narrow": seen, "grey": lf.colour(WAVELENGTH, np.full(81, 0.5))})
    assert [text.get_text() for text in figure.axes[0].texts] == ["outside sRGB"]
    assert "background:#" in seen._repr_html_()


def test_three_bands():
    """Linear sRGB in, its code out."""
    seen = lf.colour_of_rgb([[1.0, 0.0, 0.0], [0.2158605, 0.2158605, 0.2158605]])
    assert list(seen.hex) == ["#ff0000", "#808080"]
    assert np.max(np.abs(seen.Lab[0] - [53.233, 80.109, 67.220])) <= 0.01  # of the red primary (IEC 61966-2-1 matrix)


@pytest.mark.parametrize(
    ("wavelength", "values", "more", "told"),
    [
        (np.arange(450, 1001, 50), np.ones(12), {}, "450 to 1000 nm; allowed are spectra that hold 420 to 680"),
        ([400, 700, 600], [1, 1, 1], {}, "increasing"),
        ([400, 700], [50, 60], {}, "1, not 100"),
        ([400, 700], [0.5], {}, "for 2 wavelengths"),
        ([400, 700], [0.5, np.nan], {}, "not finite"),
        ([400, 700], [0.5, 0.5], {"illuminant": "sun"}, "illuminant 'sun'; allowed"),
        ([400, 700], [0.5, 0.5], {"observer": 4}, "allowed: 2, 10"),
    ],
)
def test_wrong_input(wavelength, values, more, told):
    with pytest.raises(lf.InputError, match=told):
        lf.colour(wavelength, values, **more)


def test_others_compared():
    grey = np.full(81, 0.5)
    with pytest.raises(lf.InputError, match="allowed are two alike"):
        lf.colour(WAVELENGTH, grey).delta_e(lf.colour(WAVELENGTH, grey, illuminant="A"))
    with pytest.raises(lf.InputError, match="no colour"):
        lf.swatches({})
    with pytest.raises(lf.InputError, match="shape"):
        lf.colour_of_rgb([0.1, 0.2])
