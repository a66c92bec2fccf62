"""The README's Python block runs as it stands, on the example that its first command writes."""

import re
from pathlib import Path

from click.testing import CliRunner

import layerfit as lf
from layerfit.cli import main

ROOT = Path(__file__).parent.parent


def test_the_python_block(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert CliRunner().invoke(main, ["example", "two-layer"]).exit_code == 0
    code = re.findall(r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(), re.S | re.M)[0]
    names: dict = {}
    exec(code, names)
    fit = names["fit"]
    assert fit.outcome is lf.Outcome.CONVERGED
    assert "skin.thickness" in capsys.readouterr().out
    truth = {"skin.sigma_a": 0.02, "skin.sigma_s_prime": 2.0, "skin.thickness": 1.5, "fat.sigma_a": 0.005, "fat.sigma_s_prime": 1.2}
    for name, value in truth.items():
        estimate = fit.parameters[name]
        assert abs(estimate.value - value) <= max(3.0 * estimate.stderr, 0.02 * value), name
