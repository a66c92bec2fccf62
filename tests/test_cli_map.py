"""The command map: a scene, a cube and a store."""

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

import layerfit as lf
from layerfit.cli import main

SCENE = """
[[layer]]
name = "skin"
sigma_a = 0.02
sigma_s_prime = 1.2
n = 1.4

[[measurement]]
kind = "spatial_frequency"
x = [0.0, 0.3, 0.6]
noise = {relative = 0.01}

[fit]
solver = "layered-diffusion"

[fit.free]
"skin.sigma_a" = [1e-3, 0.5]
"skin.sigma_s_prime" = [0.1, 10]
"""


@pytest.fixture
def files(tmp_path):
    """A scene, and 3 x 4 pixels of which one is saturated."""
    (tmp_path / "scene.toml").write_text(SCENE)
    geometry = lf.SpatialFrequency(k=[0.0, 0.3, 0.6])
    absorption = np.linspace(0.01, 0.05, 12)
    rows = [
        lf.predict(lf.Stack([lf.HalfSpace("skin", sigma_a=a, sigma_s_prime=1.0, n=1.4)]), geometry, solver=lf.LayeredDiffusion())[0].values
        for a in absorption
    ]
    values = np.array(rows).reshape(3, 4, 3)
    values[0, 0, 0] = 1.0
    cube = xr.DataArray(values, dims=("y", "x", "k"), coords={"k": [0.0, 0.3, 0.6]}, name="camera")
    cube.to_dataset().to_netcdf(tmp_path / "cube.nc", engine="h5netcdf")
    return tmp_path, absorption.reshape(3, 4)


def run(*arguments):
    return CliRunner().invoke(main, ["map", *map(str, arguments)])


def test_map(files):
    folder, absorption = files
    given = [folder / "scene.toml", "--data", folder / "cube.nc", "--out", folder / "maps.zarr", "--saturated", 0.99]
    result = run(*given)
    assert result.exit_code == 0, result.output
    assert "12 pixels: 11 converged, 1 a value is too high" in result.output and "skin.sigma_a" in result.output
    assert (folder / "maps.png").read_bytes()[:4] == b"\x89PNG"
    maps = lf.open_map(folder / "maps.zarr").compute()
    good = maps.outcome.values == 0
    assert np.sum(good) == 11 and not good[0, 0]
    assert np.max(np.abs(maps["skin.sigma_a"].values / absorption - 1)[good]) <= 1e-6
    assert run(*given).exit_code == 0  # nothing left to do


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"--data": "none.nc"}, "there is no such file"),
        ({"--data": "scene.toml"}, "cannot be read as netCDF"),
        ({"--out": "scene.toml/maps.zarr"}, "cannot be written"),
        ({"--scheduler": "tcp://127.0.0.1:1"}, "no scheduler answers"),
    ],
)
def test_wrong_input(files, change, told):
    folder, _ = files
    given = {"--data": folder / "cube.nc", "--out": folder / "maps.zarr"} | {k: folder / v if k != "--scheduler" else v for k, v in change.items()}
    result = run(folder / "scene.toml", *(part for pair in given.items() for part in pair))
    assert result.exit_code == 2 and told in result.output and "Traceback" not in result.output, result.output
