"""The Monte Carlo on the command line: predict and validate, their files and their exit codes."""

import json
import subprocess
import sys
from pathlib import Path

from click.testing import CliRunner, Result

from layerfit.cli import main

SCENE = """
[[layer]]
name = "slab"
sigma_a = 0.01
sigma_s_prime = 1.0
{g}
n = 1.4
thickness = 5.0

[[measurement]]
name = "R"
kind = "total_reflectance"
value = 0.5
sd = 0.01

[[measurement]]
name = "probe"
kind = "radial_reflectance"
x_min = [{first}]
x_max = [5.0]

[fit]
solver = "layered-diffusion"
[fit.free]
"slab.sigma_a" = [1e-3, 0.1]
"""


def scene(folder: Path, *, g: str = "g = 0.5", first: float = 3.0) -> str:
    path = folder / "scene.toml"
    path.write_text(SCENE.format(g=g, first=first))
    return str(path)


def layerfit(*arguments: str) -> Result:
    return CliRunner().invoke(main, list(arguments))


def refused(result: Result, said: str) -> None:
    """Exit code 2 and one line that says why."""
    assert result.exit_code == 2, result.output
    assert said in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_predict(tmp_path: Path):
    out, again = tmp_path / "out.json", tmp_path / "again.json"
    common = ("predict", scene(tmp_path), "--solver", "monte-carlo", "--photons", "2000")
    result = layerfit(*common, "--seed", "5", "--out", str(out))
    assert result.exit_code == 0, result.output
    content = json.loads(out.read_text())
    assert content["solver"] == "monte-carlo"
    assert [m["kind"] for m in content["measurements"]] == ["total_reflectance", "radial_reflectance"]
    for measurement in content["measurements"]:
        assert len(measurement["value"]) == len(measurement["estimated_error"]) == 1
        assert 0.0 < measurement["estimated_error"][0] < measurement["value"][0]
    assert "2,000 photons, seed 5" in result.stderr
    layerfit(*common, "--seed", "5", "--out", str(again))
    assert again.read_bytes() == out.read_bytes()
    layerfit(*common, "--seed", "6", "--out", str(again))
    assert again.read_bytes() != out.read_bytes()


def test_predict_refuses(tmp_path: Path):
    out = ("--out", str(tmp_path / "out.json"))
    refused(layerfit("predict", scene(tmp_path), "--photons", "1000", *out), "--photons has no meaning for solver layered-diffusion")
    refused(layerfit("predict", scene(tmp_path, g=""), "--solver", "monte-carlo", *out), "layer 'slab' has no g, which solver monte-carlo needs")
    refused(layerfit("predict", scene(tmp_path), "--solver", "monte-carlo", "--photons", "7", *out), "photons = 7; allowed is a whole number")
    assert not (tmp_path / "out.json").exists()


def test_fit_refuses(tmp_path: Path):
    path = Path(scene(tmp_path))
    text = path.read_text()
    start, end = text.index('[[measurement]]\nname = "probe"'), text.index("[fit]")
    path.write_text(text[:start] + text[end:])
    refused(layerfit("fit", str(path), "--solver", "monte-carlo", "--out", str(tmp_path / "fit")), "monte-carlo has no derivatives")


def test_validate_agrees(tmp_path: Path):
    """Far from the source diffusion is right to within what 20,000 photons can tell."""
    result = layerfit("validate", scene(tmp_path), "--photons", "20000")
    assert result.exit_code == 0, result.output
    folder = tmp_path / "scene-validation"
    assert sorted(p.name for p in folder.iterdir()) == ["validation.json", "validation.svg", "validation.txt"]
    assert f"figure: {folder / 'validation.svg'}" in result.output
    content = json.loads((folder / "validation.json").read_text())
    assert content["verdict"] in ("agree", "undecided")
    assert [row["measurement"] for row in content["rows"]] == ["R", "probe"]


def test_validate_disagrees(tmp_path: Path):
    """A ring that starts at a tenth of a mean free path is not diffusion's: exit code 1, with the same files in the folder asked for."""
    folder = tmp_path / "here"
    text = scene(tmp_path, first=0.05)
    Path(text).write_text(Path(text).read_text().replace("x_max = [5.0]", "x_max = [0.15]"))
    result = layerfit("validate", text, "--photons", "100000", "--seed", "2", "--out", str(folder))
    assert result.exit_code == 1, result.output
    assert "differs" in result.output
    assert (folder / "validation.svg").exists()
    assert json.loads((folder / "validation.json").read_text())["verdict"] in ("disagree", "overstated error")


def test_validate_refuses(tmp_path: Path):
    refused(layerfit("validate", scene(tmp_path, g="")), "layer 'slab' has no g")
    refused(layerfit("validate", scene(tmp_path), "--solver", "monte-carlo"), "monte-carlo is the judge")
    refused(layerfit("validate", scene(tmp_path), "--solver", "guess"), "solver 'guess' does not exist")
    refused(layerfit("validate", scene(tmp_path), "--photons", "50"), "photons = 50; allowed is a whole number, at least 100")
    assert not (tmp_path / "scene-validation").exists()


INTERRUPTED = """
import os, signal
from layerfit.cli import main
from layerfit.montecarlo import engine

run_batch, done = engine.run_batch, []

def counted(*arguments):
    sums = run_batch(*arguments)
    done.append(1)
    if len(done) == 6 * os.cpu_count():
        signal.raise_signal(signal.SIGINT)
    return sums

engine.run_batch = counted
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs begin with it ignored
main()
"""


def test_interrupted_on_the_command_line(tmp_path: Path):
    """Ctrl-C after some batches of a run that would take hours: the file is written, with what is there, and it says so."""
    out = tmp_path / "out.json"
    common = ("predict", scene(tmp_path), "--solver", "monte-carlo", "--out", str(out))
    command = [sys.executable, "-c", INTERRUPTED, *common, "--photons", "1000000000"]
    process = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert process.returncode == 0, process.stderr
    assert "was interrupted" in process.stderr
    content = json.loads(out.read_text())
    assert all(m["estimated_error"][0] > 0.0 for m in content["measurements"])
