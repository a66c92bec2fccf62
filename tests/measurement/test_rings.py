"""Rings that stand for sources and fibres: all the light is in them, at the right distances."""

import numpy as np
import pytest

import layerfit as lf
from layerfit.measurement.rings import rings

FIBRE = lf.Detector(radius=0.3)
PAIRS = [
    (lf.RadialReflectance(r=[1.0, 2.0], detector=FIBRE), 0.3**2 / 2),
    (lf.RadialReflectance(r=[1.0, 2.0], source=lf.Disk(0.4)), 0.4**2 / 2),
    (lf.RadialReflectance(r=[1.0, 2.0], source=lf.Gaussian(0.5)), 0.5**2 / 2),
    (lf.RadialReflectance(r=[1.0, 2.0], source=lf.Disk(0.4), detector=FIBRE), 0.4**2 / 2 + 0.3**2 / 2),
    (lf.RadialReflectance(r=[1.0, 2.0]), 0.0),
]


@pytest.mark.parametrize(("geometry", "spread"), PAIRS)
def test_power_and_mean_square_distance(geometry, spread):
    low, high, weights = rings(geometry)
    assert np.max(np.abs(weights.sum(axis=1) - 1.0)) <= 2e-3
    square = weights @ (0.5 * (low**2 + high**2))
    assert np.max(np.abs(square / (geometry.r**2 + spread) - 1.0)) <= 2e-3


def test_line_and_edge():
    """A line of 1 W/mm is as long within rho as its chord; an edge lights half of all."""
    _, high, weights = rings(lf.RadialReflectance(r=[1.0], source=lf.Line()))
    assert abs(weights[0, high <= 5.0].sum() / (2.0 * np.sqrt(high[high <= 5.0][-1] ** 2 - 1.0)) - 1.0) <= 1e-9
    edge = rings(lf.RadialReflectance(r=[0.0], source=lf.Edge()))
    assert np.max(np.abs(edge[2][0] / (0.5 * np.pi * (edge[1] ** 2 - edge[0] ** 2)) - 1.0)) <= 1e-9
