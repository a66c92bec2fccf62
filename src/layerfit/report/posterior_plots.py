"""Figures of a posterior."""

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from scipy.ndimage import gaussian_filter

from ..measurement.geometry import Radial
from .plots import axis_label, value_label
from .tables import unit_text

if TYPE_CHECKING:
    from ..inference.posterior import Posterior

_DRAWS, _FIT, _DATA = "#1f4e79", "#c0392b", "#222222"
_BINS = 36
_LEVELS = (0.9, 0.5)  # shares of the draws inside the lines
_WALKERS = 64  # drawn at most


def _label(posterior: "Posterior", i: int) -> str:
    parameter = posterior.problem.parameters[i]
    unit = unit_text(parameter.unit)
    return parameter.name + (f"\n[{unit}]" if unit != "1" else "")


def plot_corner(posterior: "Posterior") -> Figure:
    """Distribution of every number, and of every pair with the lines that hold half and nine tenths of the draws; the fit in red."""
    flat = posterior.x.reshape(-1, posterior.x.shape[2])
    p = flat.shape[1]
    figure = Figure(figsize=(1.2 + 1.9 * p, 1.0 + 1.9 * p), layout="constrained")
    axes = figure.subplots(p, p, squeeze=False, sharex="col")
    ranges = [_range(draws) for draws in flat.T]
    for i in range(p):
        for j in range(p):
            axis = axes[i, j]
            if j > i:
                axis.set_axis_off()
                continue
            if i == j:
                axis.hist(flat[:, i], _BINS, range=ranges[i], color=_DRAWS, alpha=0.7)
                axis.set_yticks([])
            else:
                _pair(axis, flat[:, j], flat[:, i], ranges[j], ranges[i])
                axis.set_ylim(ranges[i])
                axis.axhline(posterior.fit.x[i], color=_FIT, lw=0.8)
                if j > 0:
                    axis.set_yticklabels([])
            axis.axvline(posterior.fit.x[j], color=_FIT, lw=0.8)
            axis.set_xlim(ranges[j])
            axis.tick_params(axis="x", rotation=45, labelsize=8)
            axis.tick_params(axis="y", labelsize=8)
            axis.locator_params(axis="x", nbins=4)
            axis.locator_params(axis="y", nbins=4)
            if i == p - 1:
                axis.set_xlabel(_label(posterior, j), fontsize=9, parse_math=False)
        if i > 0:
            axes[i, 0].set_ylabel(_label(posterior, i), fontsize=9, parse_math=False)
    figure.align_labels()
    return figure


def _range(draws: np.ndarray) -> tuple[float, float]:
    low, high = np.quantile(draws, [0.002, 0.998])
    margin = 0.06 * (high - low) if high > low else max(abs(low), 1e-12) * 0.01
    return float(low - margin), float(high + margin)


def _pair(axis: Any, x: np.ndarray, y: np.ndarray, x_range: tuple[float, float], y_range: tuple[float, float]) -> None:
    counts, x_edges, y_edges = np.histogram2d(x, y, _BINS, range=[x_range, y_range])
    smooth = gaussian_filter(counts, 1.0)
    ordered = np.sort(smooth.ravel())[::-1]
    inside = np.cumsum(ordered)
    levels = sorted({float(ordered[min(np.searchsorted(inside, share * inside[-1]), ordered.size - 1)]) for share in _LEVELS})
    axis.pcolormesh(x_edges, y_edges, np.where(smooth >= 0.02 * ordered[0], smooth, np.nan).T, cmap="Blues", vmin=0.0, rasterized=True)
    if levels[0] > 0.0 and levels[-1] < ordered[0]:
        centers = [0.5 * (edges[1:] + edges[:-1]) for edges in (x_edges, y_edges)]
        axis.contour(*centers, smooth.T, levels, colors=_DRAWS, linewidths=0.9)


def plot_trace(posterior: "Posterior") -> Figure:
    """Kept draws of every walker one after the other, and their distribution."""
    walkers, kept, p = posterior.x.shape
    figure = Figure(figsize=(9.0, 0.8 + 1.5 * p), layout="constrained")
    axes = figure.subplots(p, 2, squeeze=False, width_ratios=[4, 1], sharey="row", sharex="col")
    steps = posterior.judgement.burn_in + posterior.judgement.thinning * np.arange(kept)
    for i in range(p):
        for walker in posterior.x[:: -(-walkers // _WALKERS), :, i]:
            axes[i, 0].plot(steps, walker, lw=0.5, alpha=0.6, rasterized=True)
        axes[i, 1].hist(posterior.x[:, :, i].ravel(), _BINS, orientation="horizontal", color=_DRAWS, alpha=0.7)
        axes[i, 1].set_xticks([])
        for axis in axes[i]:
            axis.axhline(posterior.fit.x[i], color=_FIT, lw=0.8)
        axes[i, 0].set_ylabel(_label(posterior, i), fontsize=9, parse_math=False)
        axes[i, 0].tick_params(labelsize=8)
    axes[-1, 0].set_xlabel("step")
    return figure


def plot_predictive(
    posterior: "Posterior", predictions: tuple[np.ndarray, ...] | None = None, repeated: tuple[np.ndarray, ...] | None = None
) -> Figure:
    """Data with error bars over bands of 90 %: of the model, and of data measured again. Below both in units of the model's median."""
    from ..inference.replicates import replicates

    predictions = posterior.predictions() if predictions is None else predictions
    repeated = replicates(posterior, predictions) if repeated is None else repeated
    data = posterior.problem.data
    widths = [4.6 if dataset.geometry.places() else 2.2 for dataset in data]
    figure = Figure(figsize=(1.2 + sum(widths), 5.4), layout="constrained")
    axes = figure.subplots(2, len(data), height_ratios=[3, 2], width_ratios=widths, squeeze=False, sharex="col")
    for i, dataset in enumerate(data):
        upper, lower = axes[:, i]
        x, total = dataset.geometry.centers(), not dataset.geometry.places()
        low, median, high = np.quantile(predictions[i], [0.05, 0.5, 0.95], axis=0)
        again = np.quantile(repeated[i], [0.05, 0.95], axis=0)
        size = np.where(median != 0, np.abs(median), 1.0)
        sd = np.std(repeated[i] - predictions[i], axis=0) if dataset.sd is None else dataset.sd
        for axis, unit in ((upper, np.ones_like(size)), (lower, size)):
            for band, shade, label in ((again, 0.2, "data again, 90 %"), ((low, high), 0.5, "model, 90 %")):
                if total or x.size == 1:
                    axis.bar(x, (band[1] - band[0]) / unit, bottom=band[0] / unit, width=0.5, color=_DRAWS, alpha=shade, lw=0, label=label)
                else:
                    axis.fill_between(x, band[0] / unit, band[1] / unit, color=_DRAWS, alpha=shade, lw=0, label=label)
            axis.errorbar(x, dataset.values / unit, sd / unit, fmt="o", ms=3, lw=1, color=_DATA, label="data")
            axis.grid(alpha=0.25)
        if isinstance(dataset.geometry, Radial) and np.all(dataset.values > 0) and np.all(again > 0):
            upper.set_yscale("log")
        upper.set_ylabel(value_label(dataset.geometry))
        upper.set_title(dataset.name, fontsize="medium", parse_math=False)
        lower.set_xlabel(axis_label(dataset.geometry))
        if total:
            lower.set_xticks([])
            lower.set_xlim(-1.0, 1.0)
    axes[0, 0].legend(frameon=False, fontsize="small")
    axes[1, 0].set_ylabel("relative to the median")
    return figure
