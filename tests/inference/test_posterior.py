"""Posteriors of problems whose answer is known, and what is refused."""

import json
import subprocess
import sys

import numpy as np
import pytest

import layerfit as lf
from layerfit.inference.chain import FILE, read_chain

K = np.linspace(0.0, 0.5, 8)
SKIN = lf.Stack([lf.HalfSpace("skin", sigma_a=0.03, sigma_s_prime=1.5, n=1.4)])
CLEAN = lf.predict(SKIN, lf.SpatialFrequency(K), solver=lf.LayeredDiffusion())[0].values
FREE = {"skin.sigma_a": (0.001, 1.0), "skin.sigma_s_prime": (0.1, 10.0)}


def problem(*, relative=1e-3, seed=0, free=None, scale=1.0, **more):
    values = scale * CLEAN * (1 + relative * np.random.default_rng(seed).standard_normal(K.size))
    data = lf.Dataset(lf.SpatialFrequency(K), values, noise=None if more.pop("no_sd", False) else lf.Noise(relative=relative), name="camera")
    return lf.Problem(SKIN, data, free=FREE if free is None else free, solver=lf.LayeredDiffusion(), **more)


NARROW = problem()  # so little noise that the model is linear within it
FIT = lf.fit(NARROW)


@pytest.fixture(scope="module")
def posterior():
    return lf.sample(NARROW, FIT, walkers=24, effective=3000)


def laplace(posterior, effective, *, sd_within):
    """Means of draws and fit agree within 3 Monte Carlo errors, sd and correlation as well as asked."""
    table = posterior.table()
    stderr = np.sqrt(np.diag(FIT.covariance))
    for i, (name, row) in enumerate(table.items()):
        assert row["ess"] >= effective
        assert abs(row["mean"] - FIT.x[i]) <= 3 * row["mcse"] + 0.02 * stderr[i], name  # what the bending of the model is worth
        assert abs(row["sd"] / stderr[i] - 1) <= sd_within, name
    found = np.corrcoef(np.stack(list(posterior.draws.values())))[0, 1]
    assert abs(np.arctanh(found) - np.arctanh(FIT.correlation[0, 1])) <= 2 * sd_within


def test_linear_limit(posterior):
    assert posterior.outcome is lf.SamplingOutcome.CONVERGED
    laplace(posterior, 2000, sd_within=0.06)
    assert not posterior.warnings


def test_linear_limit_nuts():
    pytest.importorskip("numpyro")
    found = lf.sample(NARROW, FIT, sampler="nuts", effective=2500)
    assert found.outcome is lf.SamplingOutcome.CONVERGED
    assert found.judgement.divergent <= 0.001
    laplace(found, 1500, sd_within=0.06)


@pytest.mark.long
@pytest.mark.parametrize("sampler", ["emcee", "nuts"])
def test_linear_limit_in_full(sampler):
    """Means within 3 Monte Carlo errors, sd within 3 %."""
    found = lf.sample(NARROW, FIT, sampler=sampler, effective=20_000, steps=60_000)
    assert found.outcome is lf.SamplingOutcome.CONVERGED
    laplace(found, 10_000, sd_within=0.03)


def test_draws_by_name(posterior):
    assert list(posterior.draws) == list(FREE) == list(posterior.units)
    assert posterior.units["skin.sigma_a"] == "1/mm"
    assert all(values.size >= 1000 for values in posterior.draws.values())
    assert np.all(np.isfinite(posterior.log_density))
    predicted = posterior.predictions(60)
    assert predicted[0].shape == (60, K.size)
    assert np.max(np.abs(np.mean(predicted[0], axis=0) / FIT.predictions[0] - 1)) <= 5e-4


def test_arviz_has_names_and_units(posterior):
    found = posterior.to_arviz()
    assert set(FREE) == set(found.posterior.data_vars)
    assert found.posterior["skin.sigma_a"].attrs["units"] == "1/mm"
    assert found.posterior.sizes["chain"] == 24
    assert np.array_equal(found.posterior["skin.sigma_s_prime"].values, posterior.x[:, :, 1])
    assert np.array_equal(found.observed_data["camera"].values, NARROW.data[0].values)
    assert np.allclose(found.posterior_predictive["camera_k"].values, K)
    again = found.posterior_predictive["camera"].values[0] / NARROW.data[0].values - 1
    assert abs(np.std(again) / np.hypot(1e-3, np.std(posterior.predictions()[0] / NARROW.data[0].values - 1)) - 1) <= 0.1


def test_summary_in_words(posterior):
    text = repr(posterior)
    assert text.startswith("converged: emcee, 24 walkers") and "skin.sigma_a" in text and "1/mm" in text
    assert "<table>" in posterior._repr_html_() and "skin.sigma_s_prime" in posterior._repr_html_()


def test_files(posterior, tmp_path):
    import xarray

    paths = posterior.save(tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == set(paths)
    with xarray.open_dataset(paths["posterior.nc"], group="posterior", engine="h5netcdf") as found:
        assert set(found.data_vars) == set(FREE)
        assert found["skin.sigma_a"].attrs["units"] == "1/mm"
        assert found["skin.sigma_a"].size >= 1000
    kept = json.loads(paths["posterior.json"].read_text())
    assert kept["outcome"] == "converged"
    assert abs(kept["parameters"]["skin.sigma_a"]["mean"] / FIT.x[0] - 1) <= 0.01
    report = paths["report.html"].read_text()
    assert "Posterior" in report and report.count("<svg") == 5
    for name in ("corner.svg", "trace.svg", "predictive.svg"):
        assert paths[name].read_text().startswith("<svg")


def test_estimated_noise_is_integrated():
    """Without sd the posterior is wider, as Student's distribution is, than the fit's Gaussian with the noise that it estimated."""
    stated = problem(relative=0.01, no_sd=True)
    fit = lf.fit(stated)
    found = lf.sample(stated, fit, effective=3000)
    dof = K.size - 2
    widths = [row["sd"] for row in found.table().values()] / np.sqrt(np.diag(fit.covariance))
    assert np.max(np.abs(widths / np.sqrt(dof / (dof - 2)) - 1)) <= 0.12


def test_a_bound_is_said():
    """Truth outside the bounds: draws pile up there, and none lies outside."""
    stated = problem(relative=0.01, free={"skin.sigma_a": {"min": 0.031, "max": 1.0, "init": 0.1}, "skin.sigma_s_prime": (0.1, 10.0)})
    found = lf.sample(stated, effective=500)
    assert any(w.startswith("skin.sigma_a is piled up at its lower bound") for w in found.warnings)
    assert np.min(found.draws["skin.sigma_a"]) >= 0.031


def test_what_the_data_do_not_tell_fills_its_bounds():
    stated = problem(relative=0.01, free={**FREE, "camera.background": (-1e-6, 1e-6)})
    found = lf.sample(stated, effective=500)
    assert any(w.startswith("camera.background fills its bounds") for w in found.warnings)


def test_too_few_steps_are_said():
    found = lf.sample(NARROW, FIT, walkers=8, steps=20)
    assert found.outcome is not lf.SamplingOutcome.CONVERGED
    assert found.warnings
    assert repr(found).startswith(found.outcome.value)


def test_goes_on_in_its_folder(tmp_path):
    """Stopped and continued is the same chain as one run; what is done is not done again."""
    options = {"walkers": 8, "effective": np.inf, "seed": 3}
    lf.sample(NARROW, FIT, steps=40, folder=tmp_path, **options)
    done = []
    longer = lf.sample(NARROW, FIT, steps=90, folder=tmp_path, on_step=lambda count, last: done.append((count, last)), **options)
    assert done[0] == (42, 91) and done[-1] == (91, 91)
    whole = lf.sample(NARROW, FIT, steps=90, **options)
    assert np.array_equal(longer.x, whole.x)
    done.clear()
    again = lf.sample(NARROW, FIT, steps=90, folder=tmp_path, on_step=lambda *counts: done.append(counts), **options)
    assert not done and np.array_equal(again.x, whole.x)
    assert read_chain(tmp_path / FILE).count == 91


def test_nuts_goes_on_in_its_folder(tmp_path):
    pytest.importorskip("numpyro")
    options = {"sampler": "nuts", "walkers": 2, "effective": np.inf, "seed": 3}
    lf.sample(NARROW, FIT, steps=40, folder=tmp_path, **options)
    longer = lf.sample(NARROW, FIT, steps=80, folder=tmp_path, **options)
    assert np.array_equal(longer.x, lf.sample(NARROW, FIT, steps=80, **options).x)


def test_interrupted_and_resumed(tmp_path):
    def stop(count, _):
        if count == 30:
            raise KeyboardInterrupt

    options = {"walkers": 8, "steps": 60, "effective": np.inf}
    with pytest.raises(KeyboardInterrupt):
        lf.sample(NARROW, FIT, folder=tmp_path, on_step=stop, **options)
    assert read_chain(tmp_path / FILE).count == 30
    assert np.array_equal(lf.sample(NARROW, FIT, folder=tmp_path, **options).x, lf.sample(NARROW, FIT, **options).x)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda: (problem(seed=1), {}), "data camera values"),
        (lambda: (problem(relative=2e-3), {}), "data camera"),
        (lambda: (problem(free={**FREE, "skin.sigma_a": (0.001, 0.5)}), {}), "parameters skin.sigma_a high = 1.0, now it is 0.5"),
        (lambda: (NARROW, {"seed": 1}), "seed = 0, now it is 1"),
        (lambda: (NARROW, {"walkers": 10}), "walkers = 8, now it is 10"),
    ],
)
def test_a_folder_of_something_else_is_refused(tmp_path, change, named):
    lf.sample(NARROW, FIT, walkers=8, steps=10, folder=tmp_path)
    stated, options = change()
    with pytest.raises(lf.InputError, match=named):
        lf.sample(stated, **({"walkers": 8, "steps": 10} | options), folder=tmp_path)


STATED = """
import layerfit as lf
from layerfit.inference.settings import problem_settings
skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.03, sigma_s_prime=1.5, n=1.4)])
data = lf.Dataset(lf.SpatialFrequency([0.0, 0.1, 0.2]), [0.4, 0.3, 0.2], noise=lf.Noise(relative=0.01))
found = problem_settings(lf.Problem(skin, data, free={"skin.sigma_a": (0.001, 1.0)}, solver=lf.Auto()))
"""


def test_settings_are_the_same_in_another_program():
    here: dict = {}
    exec(STATED, here)
    said = subprocess.run([sys.executable, "-c", STATED + "print(found)"], capture_output=True, text=True, check=True).stdout
    assert said.strip() == str(here["found"])
    assert len(here["found"]) >= 20


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"sampler": "gibbs"}, "sampler = 'gibbs'; allowed: emcee, nuts"),
        ({"walkers": 7}, "walkers = 7; allowed is an even number, at least 4"),
        ({"walkers": 2}, "walkers = 2; allowed is an even number, at least 4"),
        ({"steps": 0}, "steps = 0; allowed is a whole number, at least 10"),
        ({"effective": 0}, "effective = 0; allowed is a number above 0"),
        ({"seed": -1}, "seed = -1; allowed is a whole number"),
        ({"fit": FIT, "problem": problem(seed=5)}, "the fit is of another problem: data camera values"),
    ],
)
def test_wrong_input(options, said):
    with pytest.raises(lf.InputError, match=said):
        lf.sample(**({"problem": NARROW} | options))


def test_nuts_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "numpyro.infer", None)
    with pytest.raises(lf.InputError, match=r"pip install layerfit\[nuts\]"):
        lf.sample(NARROW, FIT, sampler="nuts")
