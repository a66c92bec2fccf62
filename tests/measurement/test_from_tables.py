"""Data in and out of pandas and xarray."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import layerfit as lf

RINGS = lf.RadialReflectance(r_min=[0, 1, 2], r_max=[1, 2, 4])
SPECTRUM = lf.Spectrum([500, 600, 700], lf.TotalReflectance(incidence=8.0, specular="included"))


@pytest.mark.parametrize(
    ("geometry", "kind", "options"),
    [
        (lf.RadialReflectance(r=[1, 2, 3]), None, {}),
        (RINGS, None, {}),
        (lf.SpatialFrequency(k=[0, 0.1, 0.3]), None, {}),
        (lf.AngularTransmittance([10, 20, 30]), "angular_transmittance", {}),
        (SPECTRUM, "total_reflectance", {"incidence": 8.0, "specular": "included"}),
    ],
    ids=lambda v: v.kind if hasattr(v, "kind") else None,
)
def test_there_and_back(geometry, kind, options):
    data = lf.Dataset(geometry, [0.3, 0.2, 0.1], [0.01, 0.02, 0.03], name="probe")
    held = data.to_xarray()
    again = lf.from_xarray(held, kind, **options)
    assert again.name == "probe" and type(again.geometry) is type(geometry)
    table = data.to_pandas()
    units = {name: held[name].attrs["units"] for name in geometry.places()} | dict.fromkeys(("value", "sd"), held["probe"].attrs["units"])
    for back in (again, lf.from_pandas(table, kind, units=units, name="probe", **options)):
        assert np.array_equal(back.values, data.values) and np.array_equal(back.sd, data.sd)
        for name, places in geometry.places().items():
            assert np.max(np.abs(back.geometry.places()[name] - places)) <= 1e-12


def test_units_are_converted():
    table = pd.DataFrame({"fx [1/cm]": [0.0, 1.0], "value [%]": [50.0, 25.0]})
    data = lf.from_pandas(table, noise=lf.Noise(relative=0.02))
    assert np.max(np.abs(data.geometry.k - [0.0, 0.2 * np.pi])) <= 1e-12 and list(data.values) == [0.5, 0.25]
    micron = xr.DataArray([0.5, 0.6], dims="wavelength", coords={"wavelength": ("wavelength", [0.5, 0.6], {"units": "um"})}, attrs={"units": "1"})
    assert np.max(np.abs(lf.from_xarray(micron).geometry.wavelength - [500, 600])) <= 1e-9


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: lf.from_pandas(pd.DataFrame({"r": [1.0], "value [1/mm^2]": [0.1]})), "column 'r' has no unit"),
        (lambda: lf.from_pandas(pd.DataFrame({"r [mm]": ["x"], "value [1/mm^2]": [0.1]})), "not a number"),
        (lambda: lf.from_pandas(pd.DataFrame({"r [mm]": [1.0, 2.0], "value [1/mm^2]": [0.1, np.nan]})), "line 2.*nan"),
        (lambda: lf.from_xarray([1.0]), "a list; allowed"),
        (lambda: lf.from_xarray(xr.DataArray([1.0], dims="k", coords={"k": [0.1]}, attrs={"units": "1"})), "'k' has no units"),
        (lambda: lf.from_xarray(xr.DataArray(np.ones((2, 2)), dims=("y", "k"))), "allowed is one"),
    ],
)
def test_wrong_input(make, told):
    with pytest.raises(lf.InputError, match=told):
        make()
