"""Figures. The only place where matplotlib is used."""

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from ..measurement.geometry import Angular, Geometry, Radial, SpatialFrequency, value_unit
from ..measurement.spectrum import Spectrum
from .tables import unit_text

if TYPE_CHECKING:
    from ..inference.result import Fit

_DATA, _FIT = "#1f4e79", "#c0392b"


def axis_label(geometry: Geometry) -> str:
    """Name and unit of the abscissa."""
    if isinstance(geometry, Radial):
        return "distance r [mm]"
    if isinstance(geometry, Angular):
        return "angle [deg]"
    if isinstance(geometry, Spectrum):
        return "wavelength [nm]"
    return "spatial frequency k [rad/mm]" if isinstance(geometry, SpatialFrequency) else ""


def value_label(geometry: Geometry) -> str:
    """Name and unit of the values."""
    if isinstance(geometry, Spectrum):
        return value_label(geometry.geometry)
    symbol = "R" if geometry.side == "above" else "T"
    argument = {"radial_reflectance": "(r)", "radial_transmittance": "(r)", "spatial_frequency": "(k)"}.get(geometry.kind, "")
    unit = unit_text(value_unit(geometry))
    return f"{symbol}{argument}" + (f" [{unit}]" if unit != "1" else "")


def plot_fit(fit: "Fit") -> Figure:
    """Data with error bars, the fit, and residuals in standard deviations, one column a dataset."""
    data = fit.problem.data
    widths = [4.6 if dataset.geometry.places() else 2.2 for dataset in data]
    figure = Figure(figsize=(1.0 + sum(widths), 5.4), layout="constrained")
    axes = figure.subplots(2, len(data), height_ratios=[3, 1], width_ratios=widths, squeeze=False, sharex="col")
    for i, dataset in enumerate(data):
        noise = 1.0 if fit.noise is None else fit.noise
        sd = noise * np.asarray(fit.problem.model.scatter[i].spread)
        draw_panel(axes[0, i], axes[1, i], dataset.geometry, dataset.values, sd, fit.predictions[i], fit.residuals[i])
        axes[0, i].set_title(dataset.name, fontsize="medium", parse_math=False)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    axes[0, 0].legend(handles[::-1], labels[::-1], frameon=False)
    axes[1, 0].set_ylabel("residual [sd]")
    return figure


def draw_panel(upper: Any, lower: Any, geometry: Geometry, values: np.ndarray, sd: np.ndarray, fitted: np.ndarray, residuals: np.ndarray) -> None:
    """Data with sd and what was fitted (upper), residuals in sd (lower), over the abscissa of a measurement."""
    x = geometry.centers()
    total = not geometry.places()
    upper.errorbar(x, values, sd, fmt="o", ms=4, lw=1, color=_DATA, label="data", zorder=3)
    places = geometry.places()
    if "r_min" in places:
        upper.hlines(values, places["r_min"], places["r_max"], color=_DATA, lw=0.8, alpha=0.6)
    upper.plot(x, fitted, "_" if total else "-", ms=18, color=_FIT, lw=1.6, label="fit")
    upper.set_ylabel(value_label(geometry))
    if isinstance(geometry, Radial) and np.all(values > 0) and np.all(fitted > 0):
        upper.set_yscale("log")
    upper.grid(alpha=0.25)
    lower.axhspan(-1, 1, color="#dddddd", lw=0)
    lower.axhline(0, color="#888888", lw=0.8)
    lower.plot(x, -residuals, "o", ms=4, color=_DATA)
    limit = max(3.0, 1.15 * float(np.max(np.abs(residuals))))
    lower.set_ylim(-limit, limit)
    lower.set_xlabel(axis_label(geometry))
    if total:
        lower.set_xticks([])


def plot_correlation(fit: "Fit") -> Figure:
    """Correlation matrix of the free numbers."""
    names = fit.problem.names
    matrix = fit.correlation
    side = 1.8 + 0.55 * len(names)
    figure = Figure(figsize=(side + 1.2, side), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(matrix, vmin=-1, vmax=1, cmap="RdBu_r")
    axes.set_xticks(range(len(names)), names, rotation=45, ha="right", rotation_mode="anchor", parse_math=False)
    axes.set_yticks(range(len(names)), names, parse_math=False)
    for i in range(len(names)):
        for j in range(len(names)):
            dark = abs(matrix[i, j]) > 0.6
            axes.text(j, i, f"{matrix[i, j]:.2f}", ha="center", va="center", fontsize=8, color="white" if dark else "black")
    figure.colorbar(image, label="correlation", shrink=0.8)
    return figure
