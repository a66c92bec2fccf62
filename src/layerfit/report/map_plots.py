"""Pictures of maps."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from ..errors import InputError
from ..inference.batch import predictions_at
from ..inference.map_cube import read_cube
from ..inference.map_tile import OUTCOMES
from ..inference.problem import Problem
from .plots import draw_panel
from .tables import unit_text

if TYPE_CHECKING:
    import xarray as xr

_OUTCOMES = ("#2e7d32", "#f9a825", "#c0392b", "#cfd8dc", "#607d8b", "#263238", "#8e44ad")
_INNER, _OUTER = 2.0, 98.0  # per cent of pixels between which colours are spread


def plot_map(maps: "xr.Dataset", names: Sequence[str] | None = None, *, at: Mapping[str, int] | None = None) -> Figure:
    """Numbers and their standard errors as pictures, chi-square and what became of each pixel.

    maps : of `fit_map`. names : numbers to be shown (default: all). at : index along each dimension beyond the first two.

    Raises InputError for names that are not there, or dimensions that are left.
    """
    known = [str(v).removesuffix(".stderr") for v in maps.data_vars if str(v).endswith(".stderr")]
    names = known if names is None else list(names)
    wrong = [name for name in names if name not in known]
    if wrong:
        raise InputError(f"plot_map: no number '{wrong[0]}'; allowed: {', '.join(known)}")
    picked = _picked(maps, at)
    figure = Figure(figsize=(3.1 * (len(names) + 1), 5.2), layout="constrained")
    axes = figure.subplots(2, len(names) + 1, squeeze=False, sharex=True, sharey=True)
    for i, name in enumerate(names):
        unit = unit_text(picked[name].attrs.get("units", "1"))
        shown = f" [{unit}]" if unit != "1" else ""
        _picture(figure, axes[0, i], picked[name], f"{name}{shown}", "viridis")
        _picture(figure, axes[1, i], picked[f"{name}.stderr"], f"standard error{shown}", "magma")
    dof = int(maps.attrs.get("degrees_of_freedom", 0))
    _picture(figure, axes[0, -1], picked["chi2"] / max(dof, 1), "reduced chi-square" if dof > 0 else "chi-square", "cividis")
    _outcomes(figure, axes[1, -1], picked["outcome"])
    rows, columns = picked["outcome"].dims
    for ax in axes[-1]:
        ax.set_xlabel(str(columns))
    for ax in axes[:, 0]:
        ax.set_ylabel(str(rows))
    return figure


def plot_pixel(problem: Problem, maps: "xr.Dataset", data: Any, at: Mapping[str, int], sd: Any = None) -> Figure:
    """Measured values, fit and residuals of one pixel.

    problem, data, sd : as given to `fit_map`. at : index along each dimension of the pixels.

    Raises InputError where the pixel is not there or was not fitted.
    """
    outcome = maps["outcome"]
    if set(at) != set(map(str, outcome.dims)) or not all(0 <= i < outcome.sizes[dim] for dim, i in at.items()):
        allowed = ", ".join(f"{dim} 0 to {size - 1}" for dim, size in outcome.sizes.items())
        raise InputError(f"plot_pixel: at = {dict(at)}; allowed: {allowed}")
    pixel = maps.isel(dict(at)).compute()
    code = int(pixel["outcome"])
    if not 0 <= code <= 1:
        raise InputError(f"plot_pixel: the pixel was not fitted: {OUTCOMES[code] if 0 <= code < len(OUTCOMES) else 'not done yet'}")
    cube = read_cube(problem, data, sd, None)
    where = tuple(at[dim] for dim in cube.dims)
    values = np.asarray(cube.values[where])
    x = np.array([float(pixel[name]) for name in problem.names])
    fitted = [v[0] for v in predictions_at(problem.model, x[None])]
    cuts = np.cumsum([d.geometry.size for d in problem.data])[:-1]
    measured = np.split(values, cuts)
    if cube.sd is not None:
        spread = np.split(np.asarray(cube.sd[where]), cuts)
    else:
        noise = float(pixel["noise"]) if "noise" in pixel else 1.0
        spread = [noise * np.abs(v) * (1.0 if d.sd is None else d.sd / np.abs(d.values)) for v, d in zip(measured, problem.data, strict=True)]
    figure = Figure(figsize=(1.0 + 4.6 * len(problem.data), 5.0), layout="constrained")
    axes = figure.subplots(2, len(problem.data), height_ratios=[3, 1], squeeze=False, sharex="col")
    for i, d in enumerate(problem.data):
        draw_panel(axes[0, i], axes[1, i], d.geometry, measured[i], spread[i], fitted[i], (fitted[i] - measured[i]) / spread[i])
        axes[0, i].set_title(d.name, fontsize="medium", parse_math=False)
    axes[1, 0].set_ylabel("residual [sd]")
    figure.suptitle(", ".join(f"{dim} {i}" for dim, i in at.items()), fontsize="medium")
    return figure


def _picked(maps: "xr.Dataset", at: Mapping[str, int] | None) -> "xr.Dataset":
    dims = list(map(str, maps["outcome"].dims))
    at = dict(at or {})
    left = [dim for dim in dims if dim not in at]
    if len(left) != 2 or not set(at) <= set(dims):
        raise InputError(f"plot_map: pixels have the dimensions {', '.join(dims)}; allowed is an index (at) along all but two of them")
    return maps.isel(at).compute()


def _picture(figure: Figure, ax: Any, values: "xr.DataArray", title: str, colours: str) -> None:
    known = values.values[np.isfinite(values.values)]
    low, high = np.percentile(known, [_INNER, _OUTER]) if known.size else (0.0, 1.0)
    shades = colormaps[colours].with_extremes(bad="#cfd8dc")
    image = ax.imshow(values.values, cmap=shades, vmin=low, vmax=high if high > low else low + 1.0, interpolation="nearest", aspect="auto")
    figure.colorbar(image, ax=ax, shrink=0.85, extend="both")
    ax.set_title(title, fontsize="small", parse_math=False)


def _outcomes(figure: Figure, ax: Any, values: "xr.DataArray") -> None:
    present = sorted({int(v) for v in np.unique(values.values) if v >= 0})
    shown = np.where(values.values < 0, np.nan, values.values)
    norm = BoundaryNorm(np.arange(-0.5, len(OUTCOMES)), len(OUTCOMES))
    image = ax.imshow(shown, cmap=ListedColormap(list(_OUTCOMES)), norm=norm, interpolation="nearest", aspect="auto")
    bar = figure.colorbar(image, ax=ax, shrink=0.85, ticks=present)
    bar.ax.set_yticklabels([OUTCOMES[code] for code in present], fontsize="x-small")
    ax.set_title("what became of the pixel", fontsize="small")
