"""Outputs of MCML: what they say, and whether transport says the same of their layers."""

from pathlib import Path

import numpy as np
import pytest

import layerfit as lf

REAL = Path(__file__).parents[3] / "shared" / "data" / "mcml-outputs" / "sample2.mco"
# the sample of the MCML package, its first rings (see the manual)
R = [30.924, 10.071, 6.1187, 4.4015, 3.5138, 2.8528, 2.4344]
A1 = f"""A1 \t# Version number of the file format.

####
# Data categories include:
####
# User time: 1488 sec
InParam \t\t\t# Input parameters. cm is used.
sample.mco \tA\t\t# output file name, ASCII.
1000000 \t\t# No. of photons
0.01\t0.01\t\t# dz, dr [cm]
40\t{len(R)}\t4\t# No. of dz, dr, da.

3\t\t\t# Number of layers
#n\tmua\tmus\tg\td\t# One line for each layer
1\t\t\t# n for medium above.
1.37\t1\t100\t0.90\t0.1\t# layer 1
1.37\t1\t10\t0.00\t0.1\t# layer 2
1.37\t2\t10\t0.70\t0.2\t# layer 3
1.1\t\t\t# n for medium below.

RAT #Reflectance, absorption, transmission.
0.0243729 \t#Specular reflectance [-]
0.237544 \t#Diffuse reflectance [-]
0.641594 \t#Absorbed fraction [-]
0.0964896 \t#Transmittance [-]

Rd_r #Rd[0], [1],..Rd[nr]. [1/cm2]
{chr(10).join(f" {value:12.4E}" for value in R)}
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "sample.mco"
    path.write_text(A1)
    return lf.read_mco(path)


def test_version_1(file):
    assert file.photons == 1_000_000 and file.totals == {"R_specular": 0.0243729, "R_diffuse": 0.237544, "absorbed": 0.641594, "T": 0.0964896}
    assert [layer.thickness for layer in file.stack.layers] == [1.0, 1.0, 2.0]
    assert [layer.sigma_a for layer in file.stack.layers] == [0.1, 0.1, 0.2] and file.stack.n_below == 1.1
    assert abs(file.stack.layers[0].sigma_s_prime - 1.0) <= 1e-12
    assert np.max(np.abs(file.R / (np.array(R) / 100) - 1)) <= 1e-12 and file.T is None
    assert np.max(np.abs(file.r - 0.1 * np.arange(8))) <= 1e-12
    (data,) = file.datasets(lf.Noise(relative=0.02))
    assert data.values.size == 6 and data.geometry.r_max[-1] == pytest.approx(0.6)


def test_real_file():
    """Version 2 of the same sample: energy, and totals and rings against transport theory."""
    if not REAL.is_file():
        pytest.skip(f"{REAL.name} is not beside the project")
    found = lf.read_mco(REAL)
    assert found.photons == 533670 and abs(sum(found.totals.values()) - 1) <= 1e-5
    area = np.pi * np.diff(found.r**2)
    assert abs(np.sum(found.R * area) / found.totals["R_diffuse"] - 1) <= 1e-4
    assert abs(np.sum(found.T * area) / found.totals["T"] - 1) <= 1e-4
    asked = [lf.TotalReflectance(), lf.TotalTransmittance()]
    R, T = (p.values[0] for p in lf.predict(found.stack, asked, solver=lf.DiscreteOrdinates()))
    assert abs(R - found.totals["R_diffuse"]) <= 3 * 0.00043 and abs(T - found.totals["T"]) <= 3 * 0.00026
    assert [d.name for d in found.datasets()] == ["R", "T"]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("hello", "no output of MCML"),
        (A1[:600], "ends early"),
        (A1.replace("1.37\t1\t100", "1.37\tone\t100"), "something unknown"),
        (None, "cannot be read"),
    ],
)
def test_wrong_files(tmp_path, text, told):
    path = tmp_path / "wrong.mco"
    if text is not None:
        path.write_text(text)
    with pytest.raises(lf.InputError, match=told):
        lf.read_mco(path)
