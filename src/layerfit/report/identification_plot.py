"""The figure of an identification."""

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from ..inference.uncertainty import POOR, UNDETERMINED

if TYPE_CHECKING:
    from ..inference.design import Step
    from ..inference.identify import Identification

_ABSOLUTE, _RELATIVE, _MOST = "#1f4e79", "#c0392b", 3.0
_COLOURS = ("#1f4e79", "#c0392b", "#2e7d32", "#b8860b", "#6a3d9a", "#5b8fc7", "#999999", "#333333")


def plot_identification(found: "Identification") -> Figure:
    """Left: relative sd of each number, absolute and relative data. Right: how they fall with the values that tell most, and with further ones."""
    names = list((found.relative or found.absolute).names)
    figure = Figure(figsize=(11.0, max(3.8, 1.6 + 0.45 * len(names))), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1, 1.2])
    both = [("absolute data", found.absolute, _ABSOLUTE)] + ([("relative data", found.relative, _RELATIVE)] if found.relative is not None else [])
    for number, (label, knowledge, colour) in enumerate(both):
        offset = 0.2 - 0.4 * number if len(both) > 1 else 0.0
        share = np.minimum(knowledge.relative, _MOST)
        y = [names.index(name) - offset for name in knowledge.names]
        left.barh(y, share, height=0.36, color=colour, label=label)
        for at, value in zip(y, knowledge.relative, strict=True):
            if value > _MOST:
                left.text(_MOST, at, " open", va="center", fontsize="small", color=colour)
    left.axvline(UNDETERMINED, color="#666666", lw=0.8, ls="--")
    left.axvspan(POOR, UNDETERMINED, color="#e0a800", alpha=0.15, lw=0)
    left.set_xscale("log")
    left.set_xlim(right=2.2 * _MOST)
    left.set_yticks(range(len(names)), names, parse_math=False)
    left.invert_yaxis()
    left.set_xlabel("relative sd (dashed: not determined beyond)")
    left.legend(frameon=False, fontsize="small", loc="upper center", bbox_to_anchor=(0.5, 1.12), ncols=2)
    left.grid(alpha=0.25, axis="x")
    _fall(right, found)
    return figure


def _fall(axis: Any, found: "Identification") -> None:
    """Relative sd after each value."""
    places, extra = found.places, found.extra
    labels = [_label(step) for step in places] + ["all given"] + [f"+ {_label(step)}" for step in extra]
    for i, name in enumerate(found.problem.names):
        shares = [step.relative[i] for step in places] + [found.given[i]] + [step.relative[i] for step in extra]
        axis.plot(range(len(labels)), shares, "o-", ms=4, lw=1.2, color=_COLOURS[i % len(_COLOURS)], label=name)
    axis.axhline(UNDETERMINED, color="#666666", lw=0.8, ls="--")
    axis.axvspan(len(places) - 0.5, len(places) + 0.5, color="#999999", alpha=0.15, lw=0)
    axis.set_xticks(range(len(labels)), labels, rotation=55, ha="right", rotation_mode="anchor", fontsize="small", parse_math=False)
    axis.set_yscale("log")
    axis.set_ylabel("relative sd that is left")
    axis.grid(alpha=0.25)
    legend = axis.legend(frameon=False, fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    for text in legend.get_texts():
        text.set_parse_math(False)


def _label(step: "Step") -> str:
    return f"{step.measurement} {step.place}".strip()
