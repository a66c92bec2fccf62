"""Data files: what a spreadsheet, an instrument or a person writes."""

import numpy as np
import pytest

import layerfit as lf

HEADER = "r [mm], value [1/mm^2], sd [1/mm^2]"
ROWS = "1, 0.02, 0.0004\n2, 0.008, 0.00016\n4, 0.002, 0.00004\n"


@pytest.fixture
def file(tmp_path):
    """Writes a file and returns its path."""

    def write(text):
        path = tmp_path / "data.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def same(a, b):
    """Whether two datasets hold the same numbers."""
    pairs = [(a.values, b.values), *zip(a.geometry.places().values(), b.geometry.places().values(), strict=True)]
    if a.sd is not None or b.sd is not None:
        pairs.append((a.sd, b.sd))
    return list(a.geometry.places()) == list(b.geometry.places()) and all(np.max(np.abs(x - y)) <= 1e-15 for x, y in pairs)


PLAIN = lf.Dataset(lf.RadialReflectance(r=[1, 2, 4]), [0.02, 0.008, 0.002], [4e-4, 1.6e-4, 4e-5])


@pytest.mark.parametrize(
    "text",
    [
        f"{HEADER}\n{ROWS}",
        f"\ufeff{HEADER}\n{ROWS}",
        f"{HEADER}\n{ROWS}".replace("\n", "\r\n"),
        f"{HEADER}\n{ROWS}".rstrip(),
        f"# from the lab\n#, with commas\n\n{HEADER}\n\n# between\n{ROWS}\n# at the end\n\n",
        f"{HEADER},,\n{ROWS}".replace("\n", ",,\n"),
        f"{HEADER}\n{ROWS},,\n , ,\n",
        "\n".join(", ".join(f'"{cell}"' for cell in row.split(", ")) for row in f"{HEADER}\n{ROWS}".splitlines()),
        f"{HEADER}\n{ROWS}".replace(",", ";"),
        f"{HEADER}\n{ROWS}".replace(", ", "\t"),
        "value [1/mm^2], sd [1/mm^2], r [mm]\n0.02, 0.0004, 1\n0.008, 1.6e-4, 2\n2E-3, 4e-05, 4.0",
        f"  r[mm] ,value [ 1/mm^2 ],\tsd [1/mm^2]\n{ROWS}",
        "r [cm], value [cm^-2], sd [1/m^2]\n0.1, 2, 400\n0.2, 0.8, 160\n0.4, 0.2, 40\n",
    ],
    ids=[
        *(
            "plain",
            "byte order mark",
            "Windows newlines",
            "no last newline",
            "comments",
            "trailing commas of a spreadsheet",
            "empty rows of a spreadsheet",
        ),
        *("quotes", "semicolons", "tabs", "other order", "spaces", "other units"),
    ],
)
def test_one_content_in_many_forms(file, text):
    assert same(lf.read(file(text)), PLAIN)


def test_rings(file):
    data = lf.read(file("r_min [cm], r_max [mm], value [%/mm^2]\n0, 1, 3\n0.15, 2, 2\n"))
    assert same(data, lf.Dataset(lf.RadialReflectance(r_min=[0, 1.5], r_max=[1, 2]), [0.03, 0.02]))
    assert data.sd is None


def test_frequencies(file):
    expected = lf.Dataset(lf.SpatialFrequency([0.0, 0.2 * np.pi]), [0.6, 0.3])
    for text in (
        "fx [1/mm], value [1]\n0, 0.6\n0.1, 0.3\n",
        "fx [1/cm], value [%]\n0, 60\n1, 30\n",
        "fx [cycles/mm], value [-]\n0, 0.6\n0.1, 0.3\n",
        f"k [rad/mm], value [1]\n0, 0.6\n{0.2 * np.pi}, 0.3\n",
        f"k [rad/m], value [1]\n0, 0.6\n{200 * np.pi}, 0.3\n",
        "k [deg/mm], value [1]\n0, 0.6\n36, 0.3\n",
    ):
        assert same(lf.read(file(text)), expected), text


def test_kinds_and_options(file):
    data = lf.read(file("value [%]\n40\n"), "total_reflectance", specular="included", incidence=30, noise=lf.Noise(0.01), name="sphere")
    assert data.geometry.specular == "included" and data.geometry.incidence == 30 and data.name == "sphere"
    assert data.values.tolist() == [0.4] and abs(data.sd[0] - 0.004) <= 1e-16
    data = lf.read(file("r [mm], value [1/mm]\n1, 2\n"), "radial_transmittance", source=lf.Line(), detector=lf.Detector(0.1))
    assert isinstance(data.geometry, lf.RadialTransmittance) and data.geometry.source.name == "line" and data.geometry.detector.radius == 0.1


def test_noise_is_used_where_there_is_no_sd(file):
    assert abs(lf.read(file("r [mm], value [1/mm^2]\n1, 0.02\n"), noise=lf.Noise(0.1)).sd[0] - 0.002) <= 1e-17
    assert lf.read(file("r [mm], value [1/mm^2], sd [1/mm^2]\n1, 0.02, 1\n"), noise=lf.Noise(0.1)).sd.tolist() == [1.0]


@pytest.mark.parametrize(
    ("text", "where", "message"),
    [
        ("", "", "the file is empty"),
        ("\n\n# nothing but a comment\n", "", "the file is empty"),
        (HEADER, "", "a header but no row of numbers"),
        (f"{HEADER}\n,,\n", "", "a header but no row of numbers"),
        (ROWS, ", line 1", "header '1' has no unit; allowed is a name and a unit, as in 'r [mm]'"),
        (f"# note\nr, value [1/mm^2]\n{ROWS}", ", line 2", "header 'r' has no unit"),
        ("r (mm), value [1/mm^2]\n1, 2\n", ", line 1", "header 'r (mm)' has no unit"),
        ("r [], value [1/mm^2]\n1, 2\n", ", column 'r'", "the unit is empty; allowed is for example mm"),
        ("r [mm], value []\n1, 2\n", ", column 'value'", "the unit is empty"),
        ("r [miles?], value [1/mm^2]\n1, 2\n", ", column 'r'", "'miles?' is not a unit"),
        ("r [1/mm], value [1/mm^2]\n1, 2\n", ", column 'r'", "unit '1/mm' does not fit; allowed are units like mm"),
        ("r [mm], value [1]\n1, 2\n", ", column 'value'", "unit '1' does not fit; allowed are units like 1/mm^2"),
        ("r [mm], value [counts]\n1, 2\n", ", column 'value'", "unit 'counts' does not fit"),
        ("k [1/mm], value [1]\n1, 2\n", ", column 'k'", "cycles per length are called fx"),
        ("r [mm], value [1/mm^2], sd [mm]\n1, 2, 1\n", ", column 'sd'", "unit 'mm' does not fit"),
        ("fx [1/mm], value [1], sd [%]\n1, 0.5, 2\n", "", "sd in % of what?"),
        ("R [mm], value [1/mm^2]\n1, 2\n", ", line 1", "column 'R' is unknown; allowed: r, r_min, r_max, k, fx, angle, value, sd; did you mean r?"),
        ("rho [mm], value [1/mm^2]\n1, 2\n", ", line 1", "column 'rho' is unknown"),
        ("r [mm], r [mm]\n1, 2\n", ", line 1", "column 'r' is there twice"),
        ("r [mm]\n1\n", "", "there is no column 'value'"),
        ("value [1]\n1\n", "", "do not say where it was measured"),
        ("r [mm], k [rad/mm], value [1]\n1, 1, 1\n", "", "columns r, k, value do not fit spatial_frequency; allowed: k or fx"),
        ("r_min [mm], value [1/mm^2]\n1, 1\n", "", "do not fit radial_reflectance; allowed: r or r_min and r_max"),
        (f"{HEADER}\n1, 0.02, 0.0004\n2, abc, 0.1\n", ", line 3, column 'value'", "'abc' is not a number"),
        (f"{HEADER}\n1, , 0.0004\n", ", line 2, column 'value'", "there is no number"),
        (f"{HEADER}\n1, 1_000, 0.0004\n", ", line 2, column 'value'", "'1_000' is not a number"),
        (f"{HEADER}\n1, nan, 0.0004\n", ", line 2, column 'value'", "nan is given; allowed are finite numbers"),
        (f"{HEADER}\n1, inf, 0.0004\n", ", line 2, column 'value'", "inf is given"),
        (f"{HEADER}\n1, 2\n", ", line 2", "2 cells in a table of 3 columns"),
        (f"{HEADER}\n1, 2, 3, 4\n", ", line 2", "4 cells in a table of 3 columns"),
        (f"{HEADER}\n1,0, 0,02, 0,0004\n", ", line 2", "numbers are written with a point (1.5), not a comma"),
        ("r [mm]; value [1/mm^2]\n1,5; 0,02\n", ", line 2, column 'r'", "numbers are written with a point (1.5), not a comma"),
        (f"{HEADER}\n1, 1, 1\n\n# pause\n1, 1, 1\n", ", line 5", "r is not increasing: number 2 is 1 after 1"),
        (f"{HEADER}\n4, 1, 1\n2, 1, 1\n", ", line 3", "r is not increasing"),
        (f"{HEADER}\n-1, 1, 1\n", "", "r = -1; allowed is 0 or more"),
        ("r [mm], value [1/mm^2]\n0.02, 1\n0.008, 2\n0.002, 4\n", ", line 3", "r is not increasing"),
        ("r_min [mm], r_max [mm], value [1/mm^2]\n0, 2, 1\n1, 3, 1\n", ", line 3", "r not increasing: ring 2 starts at 1, before ring 1 ends at 2"),
        (f"{HEADER}\n1, 1, 1\n2, 1, 0\n", ", line 3", "sd 2 is 0; allowed is a number above 0"),
        (f"{HEADER}\n1, 1, -1\n", ", line 2", "sd 1 is -1"),
        ("r [mm], value [1/mm^2]\n1, 0\n", ", line 2", "value 1 is 0 and has neither sd nor noise"),
        ("r [mm], value [1/mm^2]\n1, 2\n".encode("utf-16"), "", "not a text in UTF-8"),
        ("r [µm], value [1/mm^2]\n1, 2\n".encode("latin-1"), "", "not a text in UTF-8"),
        (b"PK\x03\x04\x14\x00\x06\x00\x08\x00\xff\xfe", "", "not a text in UTF-8; allowed is plain text saved as UTF-8 (a spreadsheet: 'CSV UTF-8')"),
    ],
)
def test_refused(file, text, where, message):
    path = file(text)
    with pytest.raises(lf.InputError) as caught:
        lf.read(path)
    assert str(caught.value).startswith(f"{path}{where}: "), str(caught.value)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_wrong_path(tmp_path):
    with pytest.raises(lf.InputError, match=r"nothing\.csv: no such file"):
        lf.read(tmp_path / "nothing.csv")
    with pytest.raises(lf.InputError, match="this is a folder"):
        lf.read(tmp_path)
    with pytest.raises(lf.InputError, match="cannot be read"):
        lf.read(tmp_path / "a\0b")


def test_unknown_kind(file):
    with pytest.raises(lf.InputError, match="kind = 'reflectance'; allowed: radial_reflectance"):
        lf.read(file(f"{HEADER}\n{ROWS}"), "reflectance")
