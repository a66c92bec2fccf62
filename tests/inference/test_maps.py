"""A fit for every pixel: against `lf.fit`, what is left out, lazy data, stores that go on, workers."""

import numpy as np
import pytest
import xarray as xr

import layerfit as lf
from layerfit.inference import map_tile
from layerfit.inference.batch import predictions_at
from layerfit.inference.map_store import tile_size, tiles

FX = [0.0, 0.05, 0.1, 0.25]
NOISE = lf.Noise(relative=0.01)
CAMERA = lf.SpatialFrequency(fx=FX)
STACK = lf.Layer("top", sigma_a=0.05, sigma_s_prime=1.5, n=1.4, thickness=0.6) | lf.HalfSpace("deep", sigma_a=0.03, sigma_s_prime=1.0, n=1.4)
FREE = {"top.thickness": (0.1, 5.0), "deep.sigma_a": (1e-3, 0.5)}
SOLVER = lf.LayeredDiffusion()
NAMES = tuple(FREE)


def problem(values, noise=NOISE, geometry=CAMERA, free=FREE):
    return lf.Problem(STACK, lf.Dataset(geometry, values, noise=noise), free=free, solver=SOLVER)


@pytest.fixture(scope="module")
def stated():
    return problem(lf.predict(STACK, CAMERA, solver=SOLVER)[0].values)


@pytest.fixture(scope="module")
def image(stated):
    """6 x 7 pixels with noise: one is dead, one saturated, one lacks a value."""
    thickness, absorption = np.meshgrid(np.linspace(0.3, 0.9, 7), np.linspace(0.02, 0.06, 6))
    values = predictions_at(stated.model, np.stack([thickness.ravel(), absorption.ravel()], axis=1))[0]
    values *= 1 + 0.01 * np.random.default_rng(2).standard_normal(values.shape)
    values = values.reshape(6, 7, 4)
    values[1, 2], values[3, 3, 0], values[4, 5, 1] = 0.0, 0.99, np.nan
    coords = {"fx": ("fx", FX, {"units": "1/mm"}), "y": np.arange(6) * 0.5}
    return xr.DataArray(values, dims=("y", "x", "fx"), coords=coords, attrs={"units": "1"})


@pytest.fixture(scope="module")
def maps(stated, image):
    return lf.fit_map(stated, image, limits=(0.0, 0.98), correlations=True)


def same(one, other):
    """Up to rounding, which the number of threads changes."""
    for name in NAMES:
        for shown in (name, f"{name}.stderr"):
            assert np.allclose(one[shown], other[shown], rtol=1e-6, atol=0, equal_nan=True), shown
    assert np.array_equal(one.outcome, other.outcome)


def test_against_fit(maps, image):
    for y, x in ((0, 0), (2, 5), (5, 6)):
        one = lf.fit(problem(image.values[y, x]))
        for q, name in enumerate(NAMES):
            assert abs(float(maps[name][y, x]) / one.x[q] - 1) <= 1e-6
            assert abs(float(maps[f"{name}.stderr"][y, x]) / one.parameters[name].stderr - 1) <= 1e-4
        assert abs(float(maps.chi2[y, x]) - one.chi2) <= 1e-9
        assert np.max(np.abs(maps.correlation[y, x] - one.correlation)) <= 1e-4
    assert maps.attrs["degrees_of_freedom"] == 2
    assert maps["deep.sigma_a"].attrs["units"] == "1/mm" and maps["top.thickness"].attrs["units"] == "mm"
    assert list(maps.y.values) == list(image.y.values)


def test_what_is_left_out(maps, stated, image):
    outcome = maps.outcome.values
    assert (outcome[1, 2], outcome[3, 3], outcome[4, 5]) == (5, 6, 4)
    assert np.sum(outcome == 0) == 39
    meanings = maps.outcome.attrs["flag_meanings"].split()
    assert [meanings[i] for i in (0, 4, 5, 6)] == ["converged", "a_value_is_missing", "a_value_is_too_low", "a_value_is_too_high"]
    for at in ((1, 2), (3, 3), (4, 5)):
        assert np.isnan(maps["deep.sigma_a"].values[at]) and maps["deep.sigma_a.at_bound"].values[at] == -1 and maps.runs.values[at] == -1
    mask = xr.DataArray(np.arange(42).reshape(6, 7) % 2 == 0, dims=("y", "x"))
    some = lf.fit_map(stated, image, mask=mask, limits=(0.0, 0.98))
    assert np.all(some.outcome.values[~mask.values] == 3)
    kept = mask.values & (outcome == 0)
    assert np.max(np.abs(some["deep.sigma_a"].values[kept] / maps["deep.sigma_a"].values[kept] - 1)) <= 1e-6
    assert np.all(lf.fit_map(stated, image, mask=mask & False).outcome == 3)


def test_dimensions_and_units(stated, image, maps):
    """Any order of dimensions, rad/mm and per cent for cycles and shares."""
    turned = (100 * image).transpose("fx", "x", "y").assign_attrs(units="%").rename(fx="k")
    turned = turned.assign_coords(k=("k", 2 * np.pi * np.array(FX) * 10, {"units": "rad/cm"}))
    found = lf.fit_map(stated, turned, limits=(0.0, 0.98))
    assert found.outcome.dims == ("x", "y")
    same(found.transpose("y", "x"), maps)


def test_noise(stated, image):
    """Given as numbers, by place, by measurement, or estimated."""
    row = image.isel(y=0, x=slice(0, 3))
    wide = lf.fit_map(stated, row, noise=lf.Noise(relative=0.02))
    sd = xr.DataArray(0.02 * row.values, dims=("x", "fx"))
    same(lf.fit_map(stated, row, sd), wide)
    same(lf.fit_map(stated, row.to_dataset(name="camera").assign({"camera.sd": sd})), wide)
    narrow = lf.fit_map(stated, row, noise={"measurement": NOISE})
    assert np.max(np.abs(wide["deep.sigma_a.stderr"] / narrow["deep.sigma_a.stderr"] - 2)) <= 0.1
    estimated = lf.fit_map(problem(stated.data[0].values, noise=None), row)
    assert np.all((estimated.noise > 1e-4) & (estimated.noise < 0.1))


def test_lazy(stated, image, maps):
    found = lf.fit_map(stated, image.chunk({"y": 4, "x": 7}), limits=(0.0, 0.98))
    assert found["deep.sigma_a"].chunks == ((4, 2), (7,))
    same(found.compute(scheduler="synchronous"), maps)


def test_store_goes_on(stated, image, maps, tmp_path):
    """What an interrupted run has written is kept, and is not fitted again."""
    store = tmp_path / "maps.zarr"
    done = []

    def stop(count, total):
        done.append((count, total))
        if count == 2 and total == 6:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        lf.fit_map(stated, image, limits=(0.0, 0.98), block=7, store=store, on_tiles=stop)
    there = lf.open_map(store).compute()
    untouched = np.all(there.outcome.values == -1, axis=1)  # tiles are rows here, done in any order
    assert np.sum(untouched) == 4 and np.all(there.outcome.values[~untouched] >= 0)
    assert np.all(np.isnan(there["deep.sigma_a"].values[untouched]))
    done.clear()
    found = lf.fit_map(stated, image, limits=(0.0, 0.98), block=7, store=store, on_tiles=stop)
    assert done == [(i, 4) for i in range(5)]
    same(found.compute(), maps)
    assert found["deep.sigma_a"].attrs["units"] == "1/mm" and found.attrs["degrees_of_freedom"] == 2
    done.clear()
    lf.fit_map(stated, image, limits=(0.0, 0.98), block=7, store=store, on_tiles=stop)
    assert done == [(0, 0)]
    for change, told in (
        ({"limits": (0.0, 0.97)}, "limits"),
        ({"block": 14}, "tile"),
        ({"data": image + 0.001}, "data"),
        ({"problem": problem(stated.data[0].values, free={"deep.sigma_a": (1e-3, 0.4)})}, "parameters"),
    ):
        given = {"problem": stated, "data": image, "limits": (0.0, 0.98), "block": 7} | change
        with pytest.raises(lf.InputError, match=f"other settings: .*{told}"):
            lf.fit_map(given.pop("problem"), given.pop("data"), store=store, **given)


def test_workers(stated, image, maps, tmp_path):
    """The same call under a client; into a store as well."""
    dask, distributed = pytest.importorskip("dask"), pytest.importorskip("distributed")
    patient = {"distributed.comm.timeouts.connect": "120s", "distributed.comm.timeouts.tcp": "120s"}  # a busy machine starts a worker slowly
    with dask.config.set(patient), distributed.Client(n_workers=1, threads_per_worker=1, dashboard_address=None):
        same(lf.fit_map(stated, image, limits=(0.0, 0.98), block=14), maps)
        same(lf.fit_map(stated, image.chunk({"y": 3}), limits=(0.0, 0.98), store=tmp_path / "maps.zarr").compute(), maps)


def test_an_interrupt_ends_the_tiles_that_run(stated, image, monkeypatch):
    begun = []

    def counted(*arguments):
        begun.append(1)
        return fit_rows(*arguments)

    def interrupted(done, to_do):
        if done:
            raise KeyboardInterrupt

    fit_rows = map_tile.fit_rows
    monkeypatch.setattr(map_tile, "fit_rows", counted)
    with pytest.raises(KeyboardInterrupt):
        lf.fit_map(stated, image, limits=(0.0, 0.98), block=1, on_tiles=interrupted)
    assert len(begun) <= 8 < image.shape[0] * image.shape[1]


def test_noise_of_no_measurement(stated, image):
    name = stated.data[0].name
    with pytest.raises(lf.InputError, match=f"noise of 'camra', which is no measurement; allowed: {name}"):
        lf.fit_map(stated, image, noise={"camra": lf.Noise(relative=0.01)})


def test_tiles():
    assert tile_size((256, 256), 4096) == (16, 256) and tile_size((3, 5000), 4096) == (1, 4096) and tile_size((7,), 100) == (7,)
    covered = np.zeros((5, 7), int)
    for tile in tiles((5, 7), (2, 3)):
        covered[tile] += 1
    assert np.all(covered == 1)


def test_pictures(stated, image, maps):
    figure = lf.plot_map(maps)
    titles = [ax.get_title() for ax in figure.axes if ax.get_title()]
    assert titles == [
        "top.thickness [mm]", "deep.sigma_a [1/mm]", "reduced chi-square", "standard error [mm]", "standard error [1/mm]", "what became of the pixel",
    ]  # fmt: skip
    upper = lf.plot_pixel(stated, maps, image, {"y": 2, "x": 5}).axes[0]
    points = upper.containers[0].lines[0].get_xydata()
    assert np.max(np.abs(points[:, 1] - image.values[2, 5])) <= 1e-15
    with pytest.raises(lf.InputError, match="y 0 to 5, x 0 to 6"):
        lf.plot_pixel(stated, maps, image, {"y": 6, "x": 0})
    with pytest.raises(lf.InputError, match="a value is too low"):
        lf.plot_pixel(stated, maps, image, {"y": 1, "x": 2})
    with pytest.raises(lf.InputError, match="no number 'deep"):
        lf.plot_map(maps, ["deep.sigma"])
    with pytest.raises(lf.InputError, match="all but two"):
        lf.plot_map(maps.expand_dims("wavelength"))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda a: a.values, "ndarray; allowed is an xarray"),
        (lambda a: a.rename(fx="f"), "no dimension k or fx among y, x, f"),
        (lambda a: a.isel(fx=slice(0, 3)), "3 along 'fx'; the problem has 4"),
        (lambda a: a.assign_coords(fx=("fx", [0.0, 0.05, 0.1, 0.3])), "number 4 is 0.3; the problem has 0.25"),
        (lambda a: a.assign_coords(fx=("fx", FX, {"units": "mm"})), "unit 'mm' does not fit"),
        (lambda a: a.assign_attrs(units="1/mm^2"), "unit '1/mm\\^2' does not fit"),
        (lambda a: a.isel(x=0, y=0), "alone; allowed is one more"),
        (lambda a: xr.Dataset({"a": a, "b": a}), "no variable 'measurement'"),
    ],
)
def test_wrong_data(stated, image, change, told):
    with pytest.raises(lf.InputError, match=told):
        lf.fit_map(stated, change(image))


def test_wrong_settings(stated, image, tmp_path):
    for given, told in (({"starts": 0}, "starts"), ({"block": 0}, "block"), ({"limits": (1.0, 0.0)}, "limits"), ({"mask": image.values > 0}, "mask")):
        with pytest.raises(lf.InputError, match=told):
            lf.fit_map(stated, image, **given)
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(lf.InputError, match="no map"):
        lf.fit_map(stated, image, store=tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]
    with pytest.raises(lf.InputError, match="no map"):
        lf.open_map(tmp_path)
    correlated = lf.Problem(STACK, stated.data, free=FREE, solver=SOLVER, likelihood=lf.CorrelatedNoise(relative=0.01, length=1.0))
    with pytest.raises(lf.InputError, match="are correlated"):
        lf.fit_map(correlated, image)
