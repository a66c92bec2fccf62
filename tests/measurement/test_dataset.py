"""Values and their noise."""

import numpy as np
import pytest

import layerfit as lf

R = lf.RadialReflectance(r=[1, 2, 4])
VALUES = [0.02, 0.008, -0.001]


def test_sd():
    data = lf.Dataset(R, VALUES, [1e-3, 2e-3, 3e-3], noise=lf.Noise(0.5), name="probe")
    assert data.values.tolist() == VALUES and data.sd.tolist() == [1e-3, 2e-3, 3e-3], "sd beats a noise"
    assert data.name == "probe" and data.geometry is R


@pytest.mark.parametrize(
    ("noise", "expected"),
    [
        (lf.Noise(relative=0.02), [4e-4, 1.6e-4, 2e-5]),
        (lf.Noise(absolute=1e-3), [1e-3, 1e-3, 1e-3]),
        (lf.Noise(0.02, 3e-4), [5e-4, 3.4e-4, np.sqrt(4e-10 + 9e-8)]),
    ],
    ids=["relative", "absolute", "both in quadrature"],
)
def test_noise(noise, expected):
    assert np.max(np.abs(lf.Dataset(R, VALUES, noise=noise).sd / expected - 1)) <= 1e-14


def test_neither():
    """One relative noise for all, to be estimated: nothing is invented here."""
    assert lf.Dataset(R, [0.02, 0.008, 0.001]).sd is None


def test_one_value():
    data = lf.Dataset(lf.TotalReflectance(), 0.5, 0.01)
    assert data.values.tolist() == [0.5] and data.sd.tolist() == [0.01]


@pytest.mark.parametrize(
    ("make", "message", "row"),
    [
        (lambda: lf.Dataset(R, [1, 2]), "measurement 'measurement': 2 numbers of value for 3 places", None),
        (lambda: lf.Dataset(R, VALUES, [1e-3]), "1 numbers of sd for 3 places", None),
        (lambda: lf.Dataset(R, VALUES, [1, 0, 1]), "sd 2 is 0; allowed is a number above 0", 1),
        (lambda: lf.Dataset(R, VALUES, [1, 1, -1]), "sd 3 is -1; allowed is a number above 0", 2),
        (lambda: lf.Dataset(R, VALUES, [np.nan, 1, 1]), "sd 1 is nan; allowed are finite numbers", 0),
        (lambda: lf.Dataset(R, [1, np.inf, 1], [1, 1, 1]), "value 2 is inf; allowed are finite numbers", 1),
        (lambda: lf.Dataset(R, ["a", 1, 1]), "value holds something that is not a number", None),
        (lambda: lf.Dataset(R, [1, 1, 0], noise=lf.Noise(0.1)), "value 3 is 0 and its noise relative", 2),
        (lambda: lf.Dataset(R, VALUES), "value 3 is -0.001 and has neither sd nor noise", 2),
        (lambda: lf.Dataset(R, VALUES, name="a.b"), "measurement name 'a.b'", None),
        (lambda: lf.Dataset(R, VALUES, name="scene"), "other than 'scene'", None),
        (lambda: lf.Dataset(R, VALUES, name="a/b"), "without dots and slashes", None),
        (lambda: lf.Dataset(R, VALUES, name=""), "measurement name ''", None),
        (lambda: lf.Dataset(R, VALUES, name=3), "measurement name 3", None),
        (lambda: lf.Noise(), "relative and absolute are both 0", None),
        (lambda: lf.Noise(-0.1), "noise relative = -0.1", None),
        (lambda: lf.Noise(absolute=np.nan), "noise absolute = nan", None),
        (lambda: lf.Noise("2%"), "noise relative = '2%'", None),
    ],
)
def test_refused(make, message, row):
    with pytest.raises(lf.InputError) as caught:
        make()
    assert message in str(caught.value) and caught.value.row == row
    assert "\n" not in str(caught.value)
