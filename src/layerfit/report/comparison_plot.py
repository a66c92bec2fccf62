"""The figure of a comparison: speed against error."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from ..comparison import Comparison

_COLOURS = ("#999999", "#b8860b", "#2e7d32", "#5b8fc7", "#1f4e79", "#6a3d9a")


def plot_comparison(comparison: "Comparison") -> Figure:
    """Median error (dot) to the largest (line) over the time of a warm prediction; a star: what Auto takes. The reference is left out."""
    figure = Figure(figsize=(7.6, 3.8), layout="constrained")
    axis = figure.subplots()
    for i, row in enumerate(comparison.rows):
        if row.errors is None or row.warm is None or not np.max(row.errors) > 0.0:
            continue
        colour, chosen = _COLOURS[i % len(_COLOURS)], i == comparison.chosen
        largest = float(np.max(row.errors))
        median = float(np.median(row.errors)) or largest
        axis.plot([1e3 * row.warm] * 2, [median, largest], color=colour, lw=1)
        label = row.label.replace(" (", "\n(") + ("\n(auto)" if chosen else "")
        axis.plot(1e3 * row.warm, median, "*" if chosen else "o", ms=12 if chosen else 6, color=colour, ls="none", label=label)
    own = comparison.reference_error[np.isfinite(comparison.reference_error)]
    if own.size:
        axis.axhline(float(np.median(own)), color="#999999", lw=0.8, ls="--", label="reference's own error")
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.margins(x=0.15, y=0.15)
    axis.set_xlabel("one prediction, warm [ms]")
    axis.set_ylabel("relative error (median to largest)")
    axis.set_title(f"against {comparison.reference}", fontsize="small")
    axis.grid(alpha=0.25)
    figure.legend(loc="outside right upper", frameon=False, fontsize="small")
    return figure
