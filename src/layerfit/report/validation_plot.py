"""The figure of a validation: a solver over the Monte Carlo."""

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from .plots import axis_label

if TYPE_CHECKING:
    from ..validation import Check, Validation

_SOLVER, _WRONG, _JUDGE = "#1f4e79", "#c0392b", "#999999"


def plot_validation(validation: "Validation") -> Figure:
    """Ratio of the solver to the Monte Carlo, one panel a measurement.

    Bands: one standard error of the Monte Carlo, and what chance allows at the level of the validation. Bars: the solver's stated error.
    Red: differs, or an error that is overstated. Hollow: not judged.
    """
    count = len(validation.checks)
    columns = min(count, 3)
    lines = -(-count // columns)
    figure = Figure(figsize=(1.0 + 4.6 * columns, 0.6 + 3.4 * lines), layout="constrained")
    axes = figure.subplots(lines, columns, squeeze=False).ravel()
    for axis in axes[count:]:
        axis.set_axis_off()
    for axis, check in zip(axes, validation.checks, strict=False):
        _panel(axis, check)
        axis.set_title(check.name, fontsize="medium")
    axes[0].set_ylabel(f"{validation.solver.name} / monte-carlo")
    axes[0].legend(frameon=False, fontsize="small")
    figure.suptitle(f"{validation.verdict.value}: {validation.solver.name} against monte-carlo", fontsize="medium")
    return figure


def _panel(axis: Any, check: "Check") -> None:
    total = not check.geometry.places()
    x = check.geometry.centers()
    size = np.where(check.reference != 0.0, np.abs(check.reference), np.nan)
    one = check.standard_error / size
    for width, shade, label in ((check.allowed / size, 0.18, "chance"), (one, 0.4, "one standard error")):
        if total or x.size == 1:
            axis.bar(x, 2.0 * width, bottom=1.0 - width, width=0.5, color=_JUDGE, alpha=shade, lw=0, label=label)
        else:
            axis.fill_between(x, 1.0 - width, 1.0 + width, color=_JUDGE, alpha=shade, lw=0, label=label)
    axis.axhline(1.0, color="#666666", lw=0.8)
    if check.stated_error is not None:
        axis.errorbar(x, check.ratio, check.stated_error / size, fmt="none", ecolor=_SOLVER, lw=1, label="stated error")
    wrong = check.beyond | check.overstated
    for chosen, style in (
        (check.judged & ~wrong, {"color": _SOLVER, "label": "ratio"}),
        (wrong, {"color": _WRONG, "label": "differs, or error overstated"}),
        (~check.judged & ~wrong, {"color": _SOLVER, "mfc": "none", "label": "too few photons"}),
    ):
        if np.any(chosen):
            axis.plot(x[chosen], check.ratio[chosen], "o", ms=4.5, **style)
    axis.set_ylim(*_limits(check, one))
    axis.grid(alpha=0.25)
    axis.set_xlabel(axis_label(check.geometry))
    if total:
        axis.set_xticks([])
        axis.set_xlim(-1.0, 1.0)


def _limits(check: "Check", one: np.ndarray) -> tuple[float, float]:
    """What is judged decides the scale; a point without photons may lie outside."""
    away = np.abs(check.ratio - 1.0)[check.judged]
    noise = one[check.judged]
    half = 1.3 * max(float(np.nanmax(away, initial=0.0)), 4.0 * float(np.nanmedian(noise)) if noise.size else 0.0, 1e-4)
    return 1.0 - half, 1.0 + half
