"""The figure of a comparison: speed against error."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from ..comparison import Comparison

_SOLVER, _CHOSEN = "#1f4e79", "#c0392b"
_LEAST = 1e-5  # the reference itself has no error: it stands here


def plot_comparison(comparison: "Comparison") -> Figure:
    """Median error (dot) to the largest (line) over the time of a warm prediction; red: what Auto takes."""
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axis = figure.subplots()
    for i, row in enumerate(comparison.rows):
        if row.errors is None or row.warm is None:
            continue
        colour = _CHOSEN if i == comparison.chosen else _SOLVER
        median, largest = (max(float(f(row.errors)), _LEAST) for f in (np.median, np.max))
        axis.plot([1e3 * row.warm] * 2, [median, largest], color=colour, lw=1)
        axis.plot(1e3 * row.warm, median, "o", color=colour)
        axis.annotate(row.label, (1e3 * row.warm, largest), fontsize="x-small", rotation=30, xytext=(2, 3), textcoords="offset points")
    own = comparison.reference_error[np.isfinite(comparison.reference_error)]
    if own.size:
        axis.axhline(float(np.median(own)), color="#999999", lw=0.8, ls="--", label="error of the reference (median)")
        axis.legend(frameon=False, fontsize="small")
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.margins(x=0.25, y=0.3)
    axis.set_xlabel("one prediction, warm [ms]")
    axis.set_ylabel(f"relative error against {comparison.reference}")
    axis.grid(alpha=0.25)
    return figure
