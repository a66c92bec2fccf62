"""A map in words, and its pictures as files."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..files import write
from ..inference.map_tile import OUTCOMES
from ..inference.problem import Problem
from .map_plots import plot_map
from .tables import unit_text

if TYPE_CHECKING:
    import xarray as xr


def map_text(maps: "xr.Dataset", problem: Problem) -> str:
    """How many pixels ended how, and the spread of each number over those that were fitted."""
    codes = np.asarray(maps["outcome"])
    counts = [(int(np.sum(codes == code)), text) for code, text in enumerate(OUTCOMES)]
    lines = [f"{codes.size} pixels: " + ", ".join(f"{count} {text}" for count, text in counts if count)]
    lines.append(f"  {'':28}{'median':>10}  {'5 to 95 %':>20}  {'median error':>12}  undetermined, at a bound")
    good = codes == 0
    for p in problem.parameters:
        x, stderr = np.asarray(maps[p.name])[good], np.asarray(maps[f"{p.name}.stderr"])[good]
        if x.size == 0:
            continue
        low, middle, high = np.quantile(x, [0.05, 0.5, 0.95])
        error = float(np.median(stderr[np.isfinite(stderr)])) if np.any(np.isfinite(stderr)) else np.nan
        bound, known = np.asarray(maps[f"{p.name}.at_bound"])[good] == 1, np.asarray(maps[f"{p.name}.determined"])[good] == 1
        open_share, at_bound = (100.0 * float(np.mean(flag)) for flag in (~known & ~bound, bound))
        name = p.name if p.unit == "1" else f"{p.name} [{unit_text(p.unit)}]"
        lines.append(f"  {name:28}{middle:>10.4g}  {f'{low:.4g} to {high:.4g}':>20}  {error:>12.2g}  {open_share:.1f} %, {at_bound:.1f} %")
    return "\n".join(lines)


def save_pictures(maps: "xr.Dataset", out: Path) -> list[Path]:
    """The maps as pictures beside their store, the first one along dimensions beyond two; none for a map of one dimension."""
    dims = list(map(str, maps["outcome"].dims))
    if len(dims) < 2:
        return []
    from io import BytesIO

    content = BytesIO()
    plot_map(maps, at=dict.fromkeys(dims[2:], 0)).savefig(content, format="png", dpi=110)
    return [write(out.with_suffix(".png"), content.getvalue())]
