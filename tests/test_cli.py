"""The commands, by the contract: what they write, print and return."""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import layerfit as lf
import layerfit.inference.fit
from layerfit.cli import main

SCENE = """
[[layer]]
name = "skin"
sigma_a = 0.02
sigma_s_prime = 2.0
g = 0.8
n = 1.4
thickness = 3

[[measurement]]
name = "rings"
kind = "radial_reflectance"
x_min = [0.5, 1, 3]
x_max = [1, 2, 4]

[[measurement]]
kind = "spatial_frequency"
x = [0, 0.1]

[[measurement]]
kind = "total_reflectance"

[[measurement]]
name = "T"
kind = "total_transmittance"

[[measurement]]
name = "points"
kind = "radial_transmittance"
x = [1, 2]
"""
FITTED = """
[[layer]]
name = "skin"
sigma_a = 0.02
sigma_s_prime = 2.0
n = 1.4

[[measurement]]
name = "camera"
kind = "spatial_frequency"
file = "data.csv"

[fit.free]
"skin.sigma_a" = [0.001, 1]
"skin.sigma_s_prime" = [0.1, 10]
"""
K = np.linspace(0, 0.5, 6)
TRUTH = {"skin.sigma_a": 0.03, "skin.sigma_s_prime": 1.5}


def run(*arguments, code=0):
    result = CliRunner().invoke(main, [str(a) for a in arguments])
    assert result.exit_code == code, (result.output, result.exception)
    return result


def strict(path):
    """JSON without NaN and Infinity, which Python would read."""

    def refuse(constant):
        raise AssertionError(f"{constant} in {path}")

    return json.loads(Path(path).read_text(), parse_constant=refuse)


def written(folder, scene, data=None):
    (folder / "scene.toml").write_text(scene)
    if data is not None:
        (folder / "data.csv").write_text(data)
    return folder / "scene.toml"


def exact(values_of=lambda v: v):
    """A data file made from the model itself, 2 % sd."""
    stack = lf.Stack([lf.HalfSpace("skin", sigma_a=TRUTH["skin.sigma_a"], sigma_s_prime=TRUTH["skin.sigma_s_prime"], n=1.4)])
    value = values_of(lf.predict(stack, lf.SpatialFrequency(K), solver=lf.LayeredDiffusion())[0].values)
    return "k [rad/mm], value [1], sd [1]\n" + "".join(f"{k}, {v!r}, {0.02 * v}\n" for k, v in zip(K, value.tolist(), strict=True))


# ---- predict


@pytest.fixture(scope="module")
def predicted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("predicted")
    result = run("predict", written(folder, SCENE), "--out", folder / "p.json", "--solver", "layered-diffusion")
    assert str(folder / "p.json") in result.stdout
    return strict(folder / "p.json")


def test_prediction_follows_the_contract(predicted):
    assert {"solver", "measurements"} <= set(predicted) and predicted["solver"] == "layered-diffusion"
    found = [(m["name"], m["kind"]) for m in predicted["measurements"]]
    assert found == [
        ("rings", "radial_reflectance"),
        ("measurement2", "spatial_frequency"),
        ("measurement3", "total_reflectance"),
        ("T", "total_transmittance"),
        ("points", "radial_transmittance"),
    ], "the order and the names of the scene"
    for m, size in zip(predicted["measurements"], (3, 2, 1, 1, 2), strict=True):
        assert len(m["value"]) == len(m["estimated_error"]) == size
        assert all(isinstance(v, float) and math.isfinite(v) for v in m["value"])
        assert all(e is None or (isinstance(e, float) and 0 <= e < math.inf) for e in m["estimated_error"])
    rings, camera, total, _, points = predicted["measurements"]
    assert (rings["x_min"], rings["x_max"]) == ([0.5, 1.0, 3.0], [1.0, 2.0, 4.0]) and "x" not in rings
    assert camera["x"] == [0.0, 0.1] and points["x"] == [1.0, 2.0]
    assert not {"x", "x_min", "x_max"} & set(total)


def test_prediction_is_that_of_python(predicted):
    stack = lf.Stack([lf.Layer("skin", sigma_a=0.02, sigma_s_prime=2, g=0.8, n=1.4, thickness=3)])
    geometries = [
        lf.RadialReflectance(r_min=[0.5, 1, 3], r_max=[1, 2, 4]),
        lf.SpatialFrequency([0, 0.1]),
        lf.TotalReflectance(),
        lf.TotalTransmittance(),
        lf.RadialTransmittance(r=[1, 2]),
    ]
    for m, p in zip(predicted["measurements"], lf.predict(stack, geometries, solver=lf.LayeredDiffusion()), strict=True):
        assert np.max(np.abs(p.values - m["value"])) <= 1e-14
    assert predicted["measurements"][2]["value"][0] == pytest.approx(predicted["measurements"][1]["value"][0], rel=1e-12), "R at k = 0"


def test_solver_of_the_command_line_beats_the_file(tmp_path):
    scene = written(tmp_path, SCENE + '\n[fit]\nsolver = "multipole"\n')
    run("predict", scene, "--out", tmp_path / "a.json")
    run("predict", scene, "--out", tmp_path / "b.json", "--solver", "layered-diffusion")
    assert [strict(tmp_path / f"{n}.json")["solver"] for n in "ab"] == ["multipole", "layered-diffusion"]


def test_auto_says_what_it_took(tmp_path):
    result = run("predict", written(tmp_path, SCENE), "--out", tmp_path / "p.json")
    assert strict(tmp_path / "p.json")["solver"] != "auto"
    assert any("auto" in line for line in result.stderr.splitlines())


def test_file_that_holds_values_can_be_predicted(tmp_path):
    scene = written(tmp_path, FITTED, exact())
    run("predict", scene, "--out", tmp_path / "p.json")
    assert np.max(np.abs(np.array(strict(tmp_path / "p.json")["measurements"][0]["x"]) - K)) <= 1e-15


def test_a_file_for_each_measurement(tmp_path):
    result = run("predict", written(tmp_path, SCENE), "--out", tmp_path / "p.json", "--csv", tmp_path / "d.csv")
    names = ["rings", "measurement2", "measurement3", "T", "points"]
    kinds = [None, None, "total_reflectance", "total_transmittance", "radial_transmittance"]
    for name, kind, m in zip(names, kinds, strict(tmp_path / "p.json")["measurements"], strict=True):
        path = tmp_path / f"d_{name}.csv"
        assert str(path) in result.stdout
        data = lf.read(path, kind)
        assert data.sd is None and np.max(np.abs(data.values / m["value"] - 1)) <= 1e-9
        assert [p.tolist() for p in data.geometry.places().values()] == [m[key] for key in ("x", "x_min", "x_max") if key in m]
    assert (tmp_path / "d_T.csv").read_text().startswith("value [1]\n")


def test_noise(tmp_path):
    """Relative, reproducible from the seed, with its sd beside it."""
    scene = written(tmp_path, FITTED.replace('file = "data.csv"', f"x = {np.linspace(0, 0.5, 400).tolist()}"))
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        run("predict", scene, "--out", tmp_path / "p.json", "--csv", tmp_path / f"{name}.csv", "--noise", "0.05", "--seed", seed)
    a, b, c = ((tmp_path / f"{name}.csv").read_text() for name in "abc")
    assert a == b != c
    data, true = lf.read(tmp_path / "a.csv"), np.array(strict(tmp_path / "p.json")["measurements"][0]["value"])
    assert np.max(np.abs(data.sd / (0.05 * true) - 1)) <= 1e-8
    z = (data.values - true) / data.sd
    assert abs(np.mean(z)) <= 4 / math.sqrt(400) and abs(np.std(z) - 1) <= 4 / math.sqrt(800)


# ---- fit


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A fit of simulated data: predicted with the true numbers, fitted from others."""
    folder = tmp_path_factory.mktemp("simulated")
    scene = FITTED.replace("0.02", str(TRUTH["skin.sigma_a"])).replace("2.0", str(TRUTH["skin.sigma_s_prime"]))
    scene = written(folder, scene.replace('file = "data.csv"', f"x = {K.tolist()}"))
    run("predict", scene, "--out", folder / "p.json", "--csv", folder / "data.csv", "--noise", "0.01", "--seed", 4)
    written(folder, FITTED)
    result = run("fit", folder / "scene.toml", "--out", folder / "result")
    (folder / "said").write_text(result.stdout)
    return folder


def test_what_was_predicted_can_be_fitted(folder):
    found = strict(folder / "result" / "fit.json")
    assert found["outcome"] == "converged"
    for name, truth in TRUTH.items():
        assert abs(found["parameters"][name]["value"] - truth) <= 4 * found["parameters"][name]["stderr"]
    assert found["chi2_reduced"] <= 5.0


def check_fit(found, names, units):
    """fit.json by the contract."""
    assert {"outcome", "chi2_reduced", "solver", "parameters", "covariance", "warnings"} <= set(found)
    assert list(found["parameters"]) == names
    for name, unit in zip(names, units, strict=True):
        p = found["parameters"][name]
        assert set(p) == {"value", "stderr", "unit", "at_bound"} and p["unit"] == unit and isinstance(p["at_bound"], bool)
        assert isinstance(p["value"], float) and (p["stderr"] is None or p["stderr"] > 0)
    covariance = np.array(found["covariance"], dtype=float)
    assert covariance.shape == (len(names), len(names))
    assert np.max(np.abs(covariance - covariance.T)) <= 1e-12 * np.max(np.abs(covariance))
    for i, name in enumerate(names):
        p = found["parameters"][name]
        assert abs(math.sqrt(covariance[i, i]) - (p["stderr"] or 0.0)) <= 1e-9 * (p["stderr"] or 1.0), "physical units, also on a log scale"
    assert all(isinstance(w, str) for w in found["warnings"])


def test_fit_follows_the_contract(folder):
    found = strict(folder / "result" / "fit.json")
    check_fit(found, ["skin.sigma_a", "skin.sigma_s_prime"], ["1/mm", "1/mm"])
    assert found["solver"] == "layered-diffusion"
    assert found["settings"]["free"]["skin.sigma_a"]["scale"] == "log"
    assert any("auto" in w for w in found["warnings"]), "until Auto exists it says so"


def test_settings_that_make_the_fit_again(folder):
    """fit.json holds what is needed to do it again: solver, guess, bounds."""
    settings = strict(folder / "result" / "fit.json")["settings"]
    names = {name: getattr(lf, name) for name in ("LayeredDiffusion", "Layer", "HalfSpace", "Stack")}
    assert eval(settings["solver"], names) == lf.LayeredDiffusion()
    assert eval(settings["guess"], names) == lf.Stack([lf.HalfSpace("skin", sigma_a=0.02, sigma_s_prime=2, n=1.4)])


def test_stderr_is_that_of_the_physical_number(folder):
    """The standard error from fit.json against second differences of chi-square in sigma_a and sigma_s_prime themselves."""
    found = strict(folder / "result" / "fit.json")
    data = lf.read(folder / "data.csv")
    best = np.array([p["value"] for p in found["parameters"].values()])

    def residuals(x):
        stack = lf.Stack([lf.HalfSpace("skin", sigma_a=x[0], sigma_s_prime=x[1], n=1.4)])
        return (lf.predict(stack, data.geometry, solver=lf.LayeredDiffusion())[0].values - data.values) / data.sd

    slopes = np.stack(
        [(residuals(best * (1 + h)) - residuals(best * (1 - h))) / (2e-4 * b) for h, b in zip(1e-4 * np.eye(2), best, strict=True)], axis=1
    )
    # the covariance is averaged over what the data allow, here a range so small that the slopes hardly change
    assert np.max(np.abs(np.linalg.inv(slopes.T @ slopes) / np.array(found["covariance"]) - 1)) <= 5e-3


def test_fit_writes_everything(folder):
    names = sorted(path.name for path in (folder / "result").iterdir())
    assert names == ["curve_camera.csv", "fit.json", "fit.svg", "report.html"]
    said = (folder / "said").read_text()
    assert said.splitlines()[-1] == f"report: {folder / 'result' / 'report.html'}"
    assert "skin.sigma_a" in said and "±" in said and "source mixed" in said


def test_curve(folder):
    """The fitted curve beside the data: residuals add up to chi-square."""
    lines = (folder / "result" / "curve_camera.csv").read_text().splitlines()
    assert lines[0] == "k [rad/mm], value [1], sd [1], fit [1], residual [1]"
    k, value, sd, fitted, residual = np.array([[float(c) for c in line.split(",")] for line in lines[1:]]).T
    assert np.max(np.abs(k - K)) <= 1e-9
    assert np.max(np.abs((value - fitted) / sd - residual)) <= 1e-5
    assert abs(np.sum(residual**2) / strict(folder / "result" / "fit.json")["chi2"] - 1) <= 1e-6


@pytest.mark.parametrize(
    ("bounds", "side"), [("[0.001, 0.025]", "upper"), ('{min = 0.05, max = 1, init = 0.3, scale = "log"}', "lower")], ids=["upper", "lower"]
)
def test_at_bound(tmp_path, bounds, side):
    """The truth lies outside: exit code 0, at_bound, no standard error, and a warning."""
    written(tmp_path, FITTED.replace("[0.001, 1]", bounds), exact())
    run("fit", tmp_path / "scene.toml", "--out", tmp_path / "result", "--starts", 2)
    found = strict(tmp_path / "result" / "fit.json")
    check_fit(found, ["skin.sigma_a", "skin.sigma_s_prime"], ["1/mm", "1/mm"])
    p = found["parameters"]
    assert p["skin.sigma_a"]["at_bound"] and p["skin.sigma_a"]["stderr"] is None and not p["skin.sigma_s_prime"]["at_bound"]
    assert np.array(found["covariance"])[0].tolist() == [0.0, 0.0]
    assert any(f"skin.sigma_a is at its {side} bound" in w for w in found["warnings"])
    assert "at its bound" in (tmp_path / "result" / "report.html").read_text()


def test_not_determined(tmp_path):
    """The sd is far too large to say anything: exit code 0 and a warning."""
    data = "k [rad/mm], value [1], sd [1]\n" + "".join(f"{k}, 0.3, 1\n" for k in K)
    run("fit", written(tmp_path, FITTED, data), "--out", tmp_path / "result", "--starts", 1)
    found = strict(tmp_path / "result" / "fit.json")
    assert any("skin.sigma_a" in w and ("not determined" in w or "at its" in w) for w in found["warnings"])


def test_estimated_noise(tmp_path):
    """Neither sd nor noise: it is estimated, and that is said; the unit of a background is that of the value."""
    data = "\n".join(line.rsplit(",", 1)[0] for line in exact(lambda v: v * (1 + 0.01 * (-1) ** np.arange(v.size))).splitlines())
    run("fit", written(tmp_path, FITTED + '"camera.background" = [-0.01, 0.01]\n', data), "--out", tmp_path / "result", "--starts", 1)
    found = strict(tmp_path / "result" / "fit.json")
    check_fit(found, ["skin.sigma_a", "skin.sigma_s_prime", "camera.background"], ["1/mm", "1/mm", "1"])
    assert any("no sd: one relative noise was estimated" in w for w in found["warnings"])
    assert 0.002 <= found["estimated_relative_noise"] <= 0.02
    assert abs(found["chi2_reduced"] - 1) <= 1e-9


def test_no_degrees_of_freedom(fitted_examples):
    found = strict(fitted_examples / "slab-totals" / "result" / "fit.json")
    assert found["chi2_reduced"] is None and found["degrees_of_freedom"] == 0
    assert any("cannot be judged" in w for w in found["warnings"])
    assert "chi-square 0, 0 degrees" in (fitted_examples / "slab-totals" / "said").read_text()


def test_not_converged(tmp_path, monkeypatch):
    """Exit code 1, and all files are there all the same."""
    monkeypatch.setattr(layerfit.inference.fit, "_MAX_STEPS", 1)
    written(tmp_path, FITTED.replace("[0.1, 10]", "{min = 0.1, max = 10, init = 9}"), exact())
    result = run("fit", tmp_path / "scene.toml", "--out", tmp_path / "result", "--starts", 1, code=1)
    found = strict(tmp_path / "result" / "fit.json")
    assert found["outcome"] != "converged" and any("did not converge" in w for w in found["warnings"])
    check_fit(found, ["skin.sigma_a", "skin.sigma_s_prime"], ["1/mm", "1/mm"])
    assert "did not converge" in (tmp_path / "result" / "report.html").read_text()
    assert "did not converge" in result.stdout and "report: " in result.stdout


def test_results_replace_older_ones(tmp_path):
    written(tmp_path, FITTED, exact())
    (tmp_path / "result").mkdir()
    (tmp_path / "result" / "fit.json").write_text("old")
    (tmp_path / "result" / "mine.txt").write_text("kept")
    run("fit", tmp_path / "scene.toml", "--out", tmp_path / "result", "--starts", 1)
    assert strict(tmp_path / "result" / "fit.json")["outcome"] == "converged"
    assert (tmp_path / "result" / "mine.txt").read_text() == "kept"
    assert not list((tmp_path / "result").glob(".*")), "no temporary file is left"


def test_internal_error_is_one_line(tmp_path, monkeypatch):
    """What nobody foresaw: exit code 1, no traceback unless it is asked for."""

    def broken(*_, **__):
        raise RuntimeError("something\nhappened")

    monkeypatch.setattr(layerfit.inference.fit, "fit", broken)
    monkeypatch.delenv("LAYERFIT_DEBUG", raising=False)
    arguments = ("fit", written(tmp_path, FITTED, exact()), "--out", tmp_path / "result")
    lines = run(*arguments, code=1).stderr.splitlines()
    assert len(lines) == 1 and "internal error, please report it (RuntimeError: something happened)" in lines[0]
    monkeypatch.setenv("LAYERFIT_DEBUG", "1")
    assert isinstance(CliRunner().invoke(main, [str(a) for a in arguments]).exception, RuntimeError)


# ---- example


TRUTHS = {
    "two-layer": {"skin.sigma_a": 0.02, "skin.sigma_s_prime": 2, "skin.thickness": 1.5, "fat.sigma_a": 0.005, "fat.sigma_s_prime": 1.2},
    "slab-totals": {"slab.sigma_a": 0.005, "slab.sigma_s_prime": 0.995},
    "spatial-frequency": {"phantom.sigma_a": 0.02, "phantom.sigma_s_prime": 1.0},
}


@pytest.mark.parametrize("name", TRUTHS)
def test_example(fitted_examples, name):
    """The fit of each example is good, comes back to the truth, and the scene states that truth."""
    found = strict(fitted_examples / name / "result" / "fit.json")
    truth = TRUTHS[name]
    check_fit(found, list(truth), ["mm" if "thickness" in key else "1/mm" for key in truth])
    assert found["outcome"] == "converged"
    assert found["chi2_reduced"] is None or found["chi2_reduced"] <= 2.0
    for key, value in truth.items():
        p = found["parameters"][key]
        assert not p["at_bound"] and abs(p["value"] - value) <= 2.5 * p["stderr"], key
    scene = (fitted_examples / name / "scene.toml").read_text()
    comments = " ".join(line for line in scene.splitlines() if line.startswith("#"))
    assert "Truth:" in comments and all(f"{value:g}" in comments for value in truth.values())


def test_honest_warnings_of_the_examples(fitted_examples):
    warnings = {name: " ".join(strict(fitted_examples / name / "result" / "fit.json")["warnings"]) for name in TRUTHS}
    assert "skin.sigma_a is not determined by the data" in warnings["two-layer"]
    assert "trade off: the data leave fat.sigma_a open" in warnings["two-layer"]
    assert "does not describe" not in warnings["two-layer"] + warnings["spatial-frequency"], "the model describes the data"
    assert warnings["spatial-frequency"] == ""


def test_examples_known_to_the_command_are_those_bundled():
    bundled = {path.name for path in (Path(lf.__file__).parent / "examples").iterdir() if (path / "scene.toml").is_file()}
    assert bundled == set(TRUTHS)
    assert all(name in run("example", "--help").stdout for name in bundled)


def test_example_goes_to_a_folder_of_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = run("example", "two-layer").stdout.splitlines()
    assert sorted(p.name for p in (tmp_path / "two-layer").iterdir()) == ["profile.csv", "scene.toml"]
    assert said == ["scene: two-layer/scene.toml", "next: layerfit fit two-layer/scene.toml --out two-layer/result"]
    run("example", "two-layer")  # once more is no mistake


def test_example_does_not_replace_work(tmp_path):
    run("example", "two-layer", "--out", tmp_path)
    (tmp_path / "scene.toml").write_text("mine")
    (tmp_path / "profile.csv").unlink()
    result = run("example", "two-layer", "--out", tmp_path, code=2)
    assert "scene.toml exists and is another file; allowed is --out with a new folder" in result.stderr
    assert (tmp_path / "scene.toml").read_text() == "mine" and not (tmp_path / "profile.csv").exists()


# ---- start


def test_help():
    text = run("--help").stdout
    for command in ("predict", "fit", "example"):
        assert command in text
    assert all(len(line) <= 80 for line in text.splitlines())
    assert run("-h").stdout == text
    assert lf.__version__ in run("--version").stdout


def imported(code):
    """Top-level and other modules that a fresh interpreter holds after some code."""
    program = f"import sys\n{code}\nprint(*sys.modules, sep='\\n', file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return set(done.stderr.split())


def test_help_is_quick():
    """No numerical library is imported for it."""
    modules = imported("from layerfit.cli import main\ntry: main(['--help'])\nexcept SystemExit as e: assert not e.code")
    slow = {"jax", "numpy", "scipy", "equinox", "optimistix", "matplotlib", "numba", "emcee", "colour", "pint", "pydantic", "jinja2", "rich"}
    assert not modules & slow


LATER = {
    "colour",
    "matplotlib",
    "emcee",
    "numba",
    "arviz",
    "jaxopt",
    "pint",
    "pandas",
    "jinja2",
    "pydantic",
    "rich",
    "click",
    "scipy.stats",
    "scipy.optimize",
}


def test_import_is_light():
    assert not imported("import layerfit") & (LATER | {"jax", "numpy", "scipy"})


def test_a_fit_needs_no_more_than_it_uses():
    """Touching every public name imports what the solvers need, and nothing for other work (scipy.optimize comes with jax itself)."""
    ours = imported("import layerfit as lf\nlf.LayeredDiffusion, lf.Problem, lf.fit, lf.Layer, lf.read, lf.predict, lf.RadialReflectance")
    theirs = imported("import jax, jax.scipy, equinox, optimistix, scipy.special, scipy.integrate")
    assert not (ours - theirs) & LATER


def test_double_precision():
    """Importing layerfit before or after jax switches 64 bits on, unless the user has chosen."""
    show = "import jax, sys; print('bits', jax.numpy.ones(1).dtype, file=sys.stderr)"
    assert "float64" in imported(f"import layerfit; {show}")
    assert "float64" in imported(f"import jax, layerfit; {show}")
    assert "float32" in imported(f"import os; os.environ['JAX_ENABLE_X64'] = '0'; import layerfit; {show}")


def test_programs_run_where_they_are_called():
    """No thread of its own for each program on the CPU, unless the user has chosen."""
    show = "import jax, sys, layerfit.compilation; print('apart', jax.config.values['jax_cpu_enable_async_dispatch'], file=sys.stderr)"
    assert "False" in imported(show)
    assert "True" in imported(f"import os; os.environ['JAX_CPU_ENABLE_ASYNC_DISPATCH'] = '1'; {show}")


@pytest.mark.parametrize("command", ["", *sorted(main.commands)])
def test_help_reads_well_at_80_columns(command):
    """Nothing is wider, every option says what it is, and no line of text is cut off."""
    text = CliRunner().invoke(main, [*command.split(), "--help"], terminal_width=80).output
    assert max(len(line) for line in text.splitlines()) <= 80
    assert "..." not in text.replace("COMMAND [ARGS]...", "")
    chosen = main.commands[command] if command else main
    assert chosen.help
    assert all(p.help for p in chosen.params if p.param_type_name == "option")
