"""Files that keep a result."""

import json
import os

import jax.numpy as jnp
import numpy as np
import pytest

import layerfit as lf
from layerfit.files import writable_file, writable_folder, write
from layerfit.report.archive import data_csv, fit_dict, prediction_dict, save_fit
from layerfit.solver import Forward, Solver


class Nothing(Forward):
    """Predicts NaN."""

    sizes: tuple[int, ...]

    def __call__(self, columns, shifts=None):
        return tuple(jnp.full(n, jnp.nan) * columns.sigma_a[0] for n in self.sizes)


class Broken(Solver):
    name = "broken"

    def check(self, stack, geometry):
        pass

    def forward(self, domain, geometries, shifts):
        return Nothing(tuple(g.size for g in geometries))


STACK = lf.Stack([lf.HalfSpace("skin", sigma_a=0.02, sigma_s_prime=1.5, n=1.4)])
GEOMETRY = lf.SpatialFrequency([0, 0.1, 0.2])


@pytest.fixture(scope="module")
def failed():
    """A fit of a model that is never finite."""
    data = lf.Dataset(GEOMETRY, [0.5, 0.4, 0.3], noise=lf.Noise(0.01))
    return lf.fit(lf.Problem(STACK, data, free={"skin.sigma_a": (1e-3, 1)}, solver=Broken()), starts=2)


def test_a_failed_fit_is_kept_as_well(failed, tmp_path):
    """No NaN in the file, null instead; the report is there and says what happened."""
    assert failed.outcome is lf.Outcome.NOT_FINITE
    paths = save_fit(failed, tmp_path)
    found = json.loads(paths["fit.json"].read_text(), parse_constant=pytest.fail)
    assert found["outcome"] == "residuals are not finite" and found["chi2_reduced"] is None
    assert found["parameters"]["skin.sigma_a"]["stderr"] is None
    assert found["covariance"] in ([[None]], [[0.0]])
    assert any("did not converge" in w for w in found["warnings"])
    assert '<b style="color: #c0392b">residuals are not finite</b>' in paths["report.html"].read_text()


def test_a_prediction_that_is_not_finite_is_refused():
    with pytest.raises(lf.InputError, match="solver broken: spatial_frequency is not finite"):
        lf.predict(STACK, GEOMETRY, solver=Broken())


def test_fit_dict_is_the_fit(small_fit):
    found = json.loads(json.dumps(fit_dict(small_fit), allow_nan=False))
    assert found["chi2"] == small_fit.chi2 and abs(found["chi2_reduced"] - small_fit.chi2 / 6) <= 1e-12 and found["degrees_of_freedom"] == 6
    assert np.array_equal(found["covariance"], small_fit.covariance)
    assert list(found["parameters"]) == list(small_fit.problem.names)
    assert [p["unit"] for p in found["parameters"].values()] == ["1/mm", "1/mm", "1/mm^2"]
    assert [p["at_bound"] for p in found["parameters"].values()] == [False, True, False]
    assert found["parameters"]["skin.sigma_s_prime"]["stderr"] is None
    assert eval(found["stack"], {"Stack": lf.Stack, "HalfSpace": lf.HalfSpace}) == small_fit.stack
    assert abs(found["starts"][0]["chi2"] - small_fit.chi2) <= 1e-12 * small_fit.chi2


def test_saving_from_python(small_fit, tmp_path):
    paths = small_fit.save(tmp_path / "a" / "b")
    assert sorted(paths) == ["curve_probe.csv", "fit.json", "fit.svg", "report.html"]
    assert all(path == tmp_path / "a" / "b" / name and path.stat().st_size > 100 for name, path in paths.items())
    assert all(path.stat().st_mode & 0o444 == 0o444 for path in paths.values())


def test_errors_of_a_prediction():
    """null where unknown, never NaN, one for each value."""
    prediction = lf.predict(STACK, GEOMETRY, solver=lf.LayeredDiffusion())[0]
    known = type(prediction)(GEOMETRY, prediction.values, np.array([0.1, np.nan, np.inf]), prediction.solver, ("a note", "a note"))
    found = prediction_dict("some", [("a", prediction), ("b", known)])
    assert found["measurements"][1]["estimated_error"] == [0.1, None, None]
    assert len(found["measurements"][0]["estimated_error"]) == 3
    assert found["notes"].count("a note") == 1
    json.dumps(found, allow_nan=False)


@pytest.mark.parametrize(
    ("geometry", "header"),
    [
        (GEOMETRY, "k [rad/mm], value [1], sd [1]"),
        (lf.RadialReflectance(r=[1, 2, 3]), "r [mm], value [1/mm^2], sd [1/mm^2]"),
        (lf.RadialReflectance(r_min=[0, 2, 3], r_max=[1, 3, 5]), "r_min [mm], r_max [mm], value [1/mm^2], sd [1/mm^2]"),
        (lf.RadialReflectance(r=[-1, 0, 1], source=lf.Edge()), "r [mm], value [1], sd [1]"),
        (lf.RadialReflectance(r=[1, 2, 3], source=lf.Line()), "r [mm], value [1/mm], sd [1/mm]"),
    ],
)
def test_data_files_read_back(tmp_path, geometry, header):
    values, sd = np.array([0.512345678901, 1e-9, 3e-3]), np.array([1e-3, 1e-12, 0.1])
    text = data_csv(geometry, values, sd)
    assert text.splitlines()[0] == header
    write(tmp_path / "d.csv", text)
    data = lf.read(tmp_path / "d.csv", geometry.kind, source=getattr(geometry, "source", None))
    for found, expected in ((data.values, values), (data.sd, sd), *zip(data.geometry.places().values(), geometry.places().values(), strict=True)):
        assert np.max(np.abs(found - expected) / np.maximum(np.abs(expected), 1e-300)) <= 1e-9


def test_writing_is_whole_or_not_at_all(tmp_path, monkeypatch):
    write(tmp_path / "file", "old")

    def fails(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fails)
    with pytest.raises(lf.InputError, match=r"file: cannot be written \(No space left on device\)"):
        write(tmp_path / "file", "new")
    assert (tmp_path / "file").read_text() == "old" and len(list(tmp_path.iterdir())) == 1


def test_writable(tmp_path):
    assert writable_folder(tmp_path / "new").is_dir() and not list((tmp_path / "new").iterdir())
    assert writable_file(tmp_path / "p.json") == tmp_path / "p.json" and not (tmp_path / "p.json").exists()
    (tmp_path / "link").symlink_to(tmp_path / "p.json")
    with pytest.raises(lf.InputError, match="would overwrite"):
        writable_file(tmp_path / "link", keep=[tmp_path / "p.json"])
    with pytest.raises(lf.InputError, match="this is a folder"):
        writable_file(tmp_path)
    with pytest.raises(lf.InputError, match="does not exist"):
        writable_file(tmp_path / "nowhere" / "p.json")
