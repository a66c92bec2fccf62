"""All solvers on one scene: rows, text, files, the command."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import layerfit as lf
from layerfit.cli import main

SLAB = lf.Stack([lf.Layer("slab", sigma_a=0.01, sigma_s_prime=1.0, g=0.5, n=1.4, thickness=5.0)])
SCENE = """
[[layer]]
name = "slab"
sigma_a = 0.01
sigma_s_prime = 1.0
g = 0.5
n = 1.4
thickness = 5.0
[[measurement]]
kind = "total_transmittance"
"""


def test_rows_text_and_figure():
    found = lf.compare(SLAB, lf.TotalTransmittance(), tolerance=0.1)
    rows = {row["solver"]: row for row in found.table()}
    assert rows["dipole"]["refused"] and rows["dipole"]["median_error"] is None
    assert 0.0 < rows["layered-diffusion"]["largest_error"] <= 0.1
    assert rows["layered-diffusion"]["auto"] and sum(row["auto"] for row in rows.values()) == 1
    best = list(rows.values())[-1]
    assert best["largest_error"] == 0.0 and best["warm_seconds"] < best["first_seconds"]
    assert "* " in found.summary() and "solver auto took layered-diffusion" in found.summary()
    assert len(found.plot().axes[0].lines) >= 2 * sum(row["refused"] is None for row in rows.values()) - 2  # the reference has no error


@pytest.mark.long
def test_against_monte_carlo():
    """The reference is then the Monte Carlo, and its noise stands in the headline."""
    found = lf.compare(SLAB, lf.TotalTransmittance(), photons=20_000)
    assert found.reference == "monte-carlo"
    assert np.max(found.rows[-1].errors) <= 5.0 * found.reference_error[0]


def test_the_command(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    result = CliRunner().invoke(main, ["compare", str(tmp_path / "scene.toml"), "--tolerance", "0.001"])
    assert result.exit_code == 0, result.output
    folder = tmp_path / "scene-comparison"
    content = json.loads((folder / "comparison.json").read_text())
    assert [row["auto"] for row in content["rows"]].count(True) == 1
    assert "discrete-ordinates" in (folder / "comparison.txt").read_text() and (folder / "comparison.svg").exists()
    wrong = CliRunner().invoke(main, ["compare", str(tmp_path / "scene.toml"), "--tolerance", "-1"])
    assert wrong.exit_code == 2 and "tolerance" in wrong.stderr
