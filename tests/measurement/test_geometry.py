"""What a geometry holds and refuses."""

import numpy as np
import pytest

import layerfit as lf
from layerfit.measurement.geometry import GEOMETRIES, value_unit

RADIAL = [lf.RadialReflectance, lf.RadialTransmittance]


@pytest.mark.parametrize("cls", RADIAL)
def test_points(cls):
    geometry = cls(r=[1, 2.5, 4])
    assert geometry.size == 3 and geometry.places()["r"].tolist() == [1.0, 2.5, 4.0]
    assert geometry.centers().tolist() == [1.0, 2.5, 4.0]
    assert geometry.side == ("above" if cls is lf.RadialReflectance else "below")
    assert geometry.shifted(0.5).places()["r"].tolist() == [1.5, 3.0, 4.5]
    assert cls(r=2).size == 1, "one number will do"


@pytest.mark.parametrize("cls", RADIAL)
def test_rings_with_gaps(cls):
    geometry = cls(r_min=[0, 1, 3], r_max=[1, 2, 4])
    assert geometry.size == 3 and list(geometry.places()) == ["r_min", "r_max"]
    low, high = geometry.places().values()
    center = geometry.centers()
    assert np.max(np.abs((center**2 - low**2) / (high**2 - low**2) - 0.5)) <= 1e-14, "half of the area lies inside"


def test_shifting_keeps_source_and_detector():
    geometry = lf.RadialReflectance(r=[1, 2], source=lf.Disk(0.3), detector=lf.Detector(radius=0.1, na=0.5)).shifted(0.1)
    assert geometry.source.radius == 0.3 and (geometry.detector.radius, geometry.detector.na) == (0.1, 0.5)


def test_frequencies():
    assert lf.SpatialFrequency([0, 0.1]).k.tolist() == [0.0, 0.1]
    assert np.max(np.abs(lf.SpatialFrequency(fx=[0.1, 0.25]).k - 2 * np.pi * np.array([0.1, 0.25]))) <= 1e-15


def test_totals():
    for geometry in (lf.TotalReflectance(), lf.TotalTransmittance()):
        assert geometry.size == 1 and geometry.places() == {} and geometry.centers().tolist() == [0.0]
    mu, w = lf.TotalReflectance(incidence="normal").cosines()
    assert mu.tolist() == [1.0] and w.tolist() == [1.0]
    mu, w = lf.TotalReflectance(incidence=60).cosines()
    assert abs(mu[0] - 0.5) <= 1e-15
    mu, w = lf.TotalTransmittance(incidence="diffuse").cosines()
    for power in range(8):
        assert abs(np.sum(w * mu**power) - 2 / (power + 2)) <= 1e-14, "weight 2 mu dmu"


def test_units_and_kinds():
    assert sorted(k for k in GEOMETRIES if "radial" in k or "total" in k or "spatial" in k) == [
        "radial_reflectance",
        "radial_transmittance",
        "spatial_frequency",
        "total_reflectance",
        "total_transmittance",
    ]
    assert [value_unit(lf.RadialReflectance(r=[1], source=s)) for s in (lf.Pencil(), lf.Disk(1), lf.Gaussian(1), lf.Line(), lf.Edge())] == [
        *3 * ["1/mm^2"],
        "1/mm",
        "1",
    ]
    assert value_unit(lf.TotalReflectance()) == value_unit(lf.SpatialFrequency([0])) == "1"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: lf.RadialReflectance(r=[1, 1]), "r is not increasing: number 2 is 1 after 1"),
        (lambda: lf.RadialReflectance(r=[1, 3, 2]), "number 3 is 2 after 3"),
        (lambda: lf.RadialReflectance(r=[-1, 3]), "r = -1; allowed is 0 or more"),
        (lambda: lf.RadialReflectance(r=[0, 3]), "r = 0 under a pencil beam, where the value is infinite"),
        (lambda: lf.RadialReflectance(r=[0, 3], source=lf.Line()), "r = 0 under a line beam"),
        (lambda: lf.RadialReflectance(r=[]), "an array of shape (0,)"),
        (lambda: lf.RadialReflectance(r=[[1, 2]]), "an array of shape (1, 2)"),
        (lambda: lf.RadialReflectance(r=["a"]), "['a'] was given; allowed are numbers"),
        (lambda: lf.RadialReflectance(r=[1, np.nan]), "number 2 is nan; allowed are finite numbers"),
        (lambda: lf.RadialReflectance(), "give r, or r_min and r_max"),
        (lambda: lf.RadialReflectance(r_min=[1]), "give r, or r_min and r_max"),
        (lambda: lf.RadialReflectance(r=[1], r_min=[1], r_max=[2]), "give r, or r_min and r_max"),
        (lambda: lf.RadialReflectance(r_min=[1, 2], r_max=[2]), "2 values of r_min and 1 of r_max"),
        (lambda: lf.RadialReflectance(r_min=[-1], r_max=[2]), "r_min = -1"),
        (lambda: lf.RadialReflectance(r_min=[1], r_max=[1]), "ring 1 goes from 1 to 1; r_max must be above r_min"),
        (lambda: lf.RadialReflectance(r_min=[1, 2], r_max=[2.5, 3]), "ring 2 starts at 2, before ring 1 ends at 2.5"),
        (lambda: lf.RadialReflectance(r_min=[1], r_max=[2], source=lf.Edge()), "rings with source edge"),
        (lambda: lf.RadialReflectance(r_min=[1], r_max=[2], detector=lf.Detector(radius=0.1)), "rings with a detector radius"),
        (lambda: lf.RadialReflectance(r=[1]).shifted(-1.5), "r = -0.5"),
        (lambda: lf.SpatialFrequency(), "give k or fx"),
        (lambda: lf.SpatialFrequency([1], fx=[1]), "give k or fx"),
        (lambda: lf.SpatialFrequency([-0.1]), "k = -0.1; allowed is 0 or more"),
        (lambda: lf.SpatialFrequency(fx=[0.2, 0.1]), "fx is not increasing"),
        (lambda: lf.TotalReflectance(incidence=90), "incidence = 90; allowed"),
        (lambda: lf.TotalReflectance(incidence=-1), "incidence = -1; allowed"),
        (lambda: lf.TotalReflectance(incidence="oblique"), "incidence = 'oblique'; allowed"),
        (lambda: lf.TotalReflectance(incidence=np.nan), "incidence = nan; allowed"),
        (lambda: lf.TotalReflectance(specular="yes"), 'specular = \'yes\'; allowed: "excluded", "included"'),
        (lambda: lf.Disk(0), "radius of a disk source = 0: allowed is a finite number above 0"),
        (lambda: lf.Gaussian(np.nan), "radius of a Gaussian source = nan"),
        (lambda: lf.Disk("1"), "radius of a disk source = '1'"),
        (lambda: lf.Detector(radius=-1), "detector radius = -1"),
        (lambda: lf.Detector(na=0), "detector na = 0: allowed is a finite number above 0"),
        (lambda: lf.Detector(radius="a"), "detector radius = 'a'"),
    ],
)
def test_refused(make, message):
    with pytest.raises(lf.InputError) as caught:
        make()
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
