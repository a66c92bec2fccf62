"""layerfit sample, by the contract."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
import xarray
from test_cli import FITTED, exact, run, written

from layerfit.inference.chain import FILE, read_chain

NAMES = {"skin.sigma_a", "skin.sigma_s_prime"}
FOUND = {"posterior.nc", "posterior.json", "posterior.txt", "report.html", "corner.svg", "trace.svg", "predictive.svg", "fit.json", FILE}


@pytest.fixture(scope="module")
def sampled(tmp_path_factory):
    """A scene, the folder of its posterior, and what the command said."""
    folder = tmp_path_factory.mktemp("sampled")
    scene = written(folder, FITTED, exact())
    result = run("sample", scene, "--out", folder / "out")
    return scene, folder / "out", result.stdout


def test_writes_what_the_contract_says(sampled):
    _, out, said = sampled
    assert {path.name for path in out.iterdir() if not path.name.startswith(".")} >= FOUND
    with xarray.open_dataset(out / "posterior.nc", group="posterior", engine="h5netcdf") as found:
        assert set(found.data_vars) == NAMES
        assert found["skin.sigma_a"].size >= 1000
        assert abs(float(found["skin.sigma_a"].mean()) / 0.03 - 1) <= 0.1
        assert abs(float(found["skin.sigma_s_prime"].mean()) / 1.5 - 1) <= 0.1
    assert json.loads((out / "posterior.json").read_text())["outcome"] == "converged"
    assert said.startswith("converged: emcee, 32 walkers") and "skin.sigma_a" in said
    assert said.rstrip().endswith(str(out / "report.html"))
    assert "Posterior" in (out / "report.html").read_text()


def test_a_finished_run_ends_at_once(sampled, monkeypatch):
    scene, out, said = sampled
    before = {path.name: path.stat().st_mtime_ns for path in out.iterdir()}
    monkeypatch.setattr("layerfit.inference.fit.fit", None)  # nothing is fitted any more
    assert run("sample", scene, "--out", out).stdout == said
    assert {path.name: path.stat().st_mtime_ns for path in out.iterdir()} == before


def test_other_settings_in_the_folder_are_refused(sampled):
    scene, out, _ = sampled
    result = run("sample", scene, "--out", out, "--seed", 5, code=2)
    assert "seed = 0, now it is 5" in result.stderr and len(result.stderr.splitlines()) == 1


def test_too_few_steps(tmp_path):
    """Not converged: 1, with its files; more steps go on from there."""
    scene = written(tmp_path, FITTED, exact())
    result = run("sample", scene, "--out", tmp_path / "out", "--steps", 20, "--walkers", 8, code=1)
    assert "! " in result.stdout
    assert {path.name for path in (tmp_path / "out").iterdir()} >= FOUND
    assert run("sample", scene, "--out", tmp_path / "out", "--steps", 20, "--walkers", 8, code=1).stdout == result.stdout
    run("sample", scene, "--out", tmp_path / "out", "--steps", 30, "--walkers", 8, code=1)
    assert read_chain(tmp_path / "out" / FILE).count == 31


@pytest.mark.parametrize(
    ("options", "said"),
    [(("--walkers", 3), "walkers = 3"), (("--steps", 0), "steps = 0"), (("--sampler", "gibbs"), "sampler = 'gibbs'"), (("--seed", -1), "seed = -1")],
)
def test_wrong_options(tmp_path, options, said):
    result = run("sample", written(tmp_path, FITTED, exact()), "--out", tmp_path / "out", *options, code=2)
    assert said in result.stderr and len(result.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_interrupted(tmp_path):
    """Ctrl-C ends with 130 and leaves a chain that the next run goes on with."""
    scene = written(tmp_path, FITTED, exact())
    # a shell's background jobs begin with Ctrl-C ignored
    program = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from layerfit.cli import run; run()"
    command = [sys.executable, "-c", program, "sample", str(scene), "--out", str(tmp_path / "out"), "--walkers", "8", "--steps", "100000"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as child:
        chain = tmp_path / "out" / FILE
        until = time.monotonic() + 120
        while not (chain.exists() and read_chain(chain).count > 5) and time.monotonic() < until and child.poll() is None:
            time.sleep(0.02)
        os.kill(child.pid, signal.SIGINT)
        assert child.stderr is not None
        said = child.stderr.read()
    assert child.returncode == 130, said
    assert said.splitlines()[-1].startswith("layerfit: interrupted")
    count = read_chain(chain).count
    assert count > 5
    run("sample", scene, "--out", tmp_path / "out", "--walkers", 8, "--steps", count + 20, code=1)
    assert read_chain(chain).count == count + 21
