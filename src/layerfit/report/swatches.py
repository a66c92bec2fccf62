"""Patches of colour."""

from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

if TYPE_CHECKING:
    from ..appearance import Colour

_SHOWN = 400  # patches in a notebook; more are a picture


def swatches_figure(colours: "Mapping[str, Colour]") -> Figure:
    """One row of patches a name."""
    figure = Figure(figsize=(5.6, 0.35 + 0.55 * len(colours)), layout="constrained")
    axes = figure.subplots()
    for row, one in enumerate(colours.values()):
        shown = np.reshape(one.sRGB, (-1, 3))
        inside = np.reshape(one.in_gamut, -1)
        for i, (rgb, ok) in enumerate(zip(shown, inside, strict=True)):
            axes.add_patch(Rectangle((i / len(shown), -row - 0.92), 1 / len(shown), 0.84, color=tuple(rgb), lw=0))
            if not ok:
                axes.text((i + 0.5) / len(shown), -row - 0.5, "outside sRGB", ha="center", va="center", fontsize="x-small", color=_readable(rgb))
    axes.set(xlim=(0, 1), ylim=(-len(colours), 0))
    axes.set_yticks([-row - 0.5 for row in range(len(colours))], list(colours), parse_math=False)
    axes.set_xticks([])
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    told = {f"{one.illuminant}, {one.observer} degrees" for one in colours.values()}
    axes.set_title("; ".join(sorted(told)), fontsize="small", loc="right")
    return figure


def _readable(rgb: np.ndarray) -> str:
    return "black" if float(np.mean(rgb)) > 0.5 else "white"


def swatches_html(colours: "Colour") -> str:
    """Patches side by side, with their values where there is one."""
    codes = np.reshape(colours.hex, -1)
    patch = "<span style='display:inline-block;width:{w}em;height:2em;background:{code};border:1px solid #888' title='{code}'></span>"
    patches = "".join(patch.format(w=4 if codes.size == 1 else 1.2, code=code) for code in codes[:_SHOWN])
    return f"<div>{patches} <span>{escape(repr(colours))}</span></div>"
