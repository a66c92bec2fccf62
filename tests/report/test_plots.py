"""Figures: what is drawn, and how it is called."""

import warnings
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import layerfit as lf
from layerfit.report.html import svg
from layerfit.report.plots import axis_label, plot_correlation, plot_fit, value_label

R = [1.0, 2.0]


@pytest.mark.parametrize(
    ("geometry", "axis", "value"),
    [
        (lf.RadialReflectance(r=R), "distance r [mm]", "R(r) [1/mm²]"),
        (lf.RadialTransmittance(r=R), "distance r [mm]", "T(r) [1/mm²]"),
        (lf.RadialReflectance(r=R, source=lf.Line()), "distance r [mm]", "R(r) [1/mm]"),
        (lf.RadialReflectance(r=R, source=lf.Edge()), "distance r [mm]", "R(r)"),
        (lf.SpatialFrequency([0.0]), "spatial frequency k [rad/mm]", "R(k)"),
        (lf.TotalReflectance(), "", "R"),
        (lf.TotalTransmittance(), "", "T"),
    ],
)
def test_labels(geometry, axis, value):
    assert axis_label(geometry) == axis and value_label(geometry) == value


def test_data_fit_and_residuals(small_fit):
    figure = plot_fit(small_fit)
    upper, lower = figure.axes
    data, fitted = (next(line for line in upper.lines if line.get_marker() == m) for m in ("o", "None"))
    dataset = small_fit.problem.data[0]
    for line, values in ((data, dataset.values), (fitted, small_fit.predictions[0])):
        x, y = line.get_data()
        assert np.array_equal(x, dataset.geometry.r) and np.array_equal(y, values)
    points = next(line for line in lower.lines if line.get_marker() == "o")
    expected = (dataset.values - small_fit.predictions[0]) / dataset.sd
    assert np.max(np.abs(points.get_ydata() - expected)) <= 1e-9, "data minus fit, in sd"
    assert upper.get_yscale() == "log" and upper.get_ylabel() == "R(r) [1/mm²]"
    assert [t.get_text() for t in upper.get_legend().get_texts()] == ["data", "fit"]
    low, high = lower.get_ylim()
    assert low <= np.min(expected) and np.max(expected) <= high


def test_one_column_a_dataset():
    """Several datasets side by side; a total takes less room; a dollar sign in a name is no formula."""
    geometries = [lf.TotalReflectance(), lf.SpatialFrequency([0, 0.1, 0.2])]
    values = [np.array([0.5]), np.array([0.5, 0.4, 0.3])]
    data = [lf.Dataset(g, v, 0.01 * v, name=n) for g, v, n in zip(geometries, values, ("R", "camera $x_{$"), strict=True)]
    names = ("$x_{$.sigma_a", "skin.g")
    fit: Any = SimpleNamespace(
        problem=SimpleNamespace(data=data, names=names, model=SimpleNamespace(scatter=[SimpleNamespace(spread=d.sd) for d in data])),
        predictions=values,
        residuals=[0 * v for v in values],
        noise=None,
        correlation=np.array([[1, -0.5], [-0.5, 1]]),
    )
    figure = plot_fit(fit)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        text = svg(figure)
    assert text.startswith("<svg") and text.rstrip().endswith("</svg>")
    first, second = (figure.axes[i].get_position().width for i in (0, 1))
    assert len(figure.axes) == 4 and first < 0.75 * second
    assert figure.axes[1].get_title() == "camera $x_{$"
    figure = plot_correlation(fit)
    svg(figure)
    assert tuple(t.get_text() for t in figure.axes[0].get_yticklabels()) == names
    assert np.array_equal(figure.axes[0].images[0].get_array(), fit.correlation)


def test_the_same_from_python(small_fit):
    assert len(small_fit.plot().axes) == 2
    assert len(small_fit.plot_correlation().axes) == 2


def test_svg_is_the_same_again(small_fit):
    """No date and no random names in the figure, so that results can be compared."""
    assert svg(plot_fit(small_fit)) == svg(plot_fit(small_fit))
