"""The figure of a profile likelihood."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter
from scipy.special import chdtri

from .tables import unit_text

if TYPE_CHECKING:
    from ..inference.profile_likelihood import ProfileLikelihood

_PROFILE, _PARABOLA = "#1f4e79", "#c0392b"


class _Plain(LogFormatter):
    """Logarithmic ticks as 0.3, neither 3e-01 nor 3 x 10^-1."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return f"{x:g}" if super().__call__(x, pos) else ""


def plot_profile(profile: "ProfileLikelihood") -> Figure:
    """Above: the rise of chi-square, the parabola of the standard error, the levels. Below: the other numbers, relative to the fit."""
    names = profile.fit.problem.names
    index = names.index(profile.name)
    parameter = profile.fit.problem.parameters[index]
    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    highest = max(float(chdtri(1, 1.0 - level)) for level in profile.intervals)
    upper.plot(profile.values, profile.delta, "o-", ms=4, color=_PROFILE, label="profile likelihood")
    estimate = profile.fit.parameters[profile.name]
    if estimate.stderr:
        x = np.linspace(profile.values[0], profile.values[-1], 400)
        upper.plot(x, ((x - estimate.value) / estimate.stderr) ** 2, "--", lw=1, color=_PARABOLA, label="standard error")
    for level, interval in profile.intervals.items():
        rise = float(chdtri(1, 1.0 - level))
        upper.axhline(rise, color="#888888", lw=0.8)
        upper.annotate(f"{100 * level:g} %", (1.0, rise), xycoords=("axes fraction", "data"), ha="right", va="bottom", fontsize="small")
        for end, is_open in ((interval.low, interval.low_open), (interval.high, interval.high_open)):
            if not is_open:
                upper.plot([end, end], [0.0, rise], color="#888888", lw=0.8, ls=":")
    upper.set_ylim(-0.04 * highest, 1.6 * highest)
    upper.set_ylabel("rise of chi-square")
    upper.legend(frameon=False, loc="upper center", fontsize="small")
    for i, name in enumerate(names):
        if i != index:
            lower.plot(profile.values, profile.x[:, i] / profile.fit.x[i] if profile.fit.x[i] else profile.x[:, i], ".-", lw=1, label=name)
    if len(names) > 1:
        legend = lower.legend(frameon=False, fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
        for text in legend.get_texts():
            text.set_parse_math(False)
    lower.set_ylabel("others / fit")
    lower.set_yscale("log" if np.all(profile.x > 0) else "linear")
    lower.set_xscale("log" if parameter.log else "linear")
    for axis in (lower.xaxis, lower.yaxis):
        if axis.get_scale() == "log":
            axis.set_major_formatter(_Plain())
            axis.set_minor_formatter(_Plain(minor_thresholds=(1.5, 0.6)))
    lower.set_xlabel(f"{profile.name} [{unit_text(profile.unit)}]", parse_math=False)
    for axis in (upper, lower):
        axis.grid(alpha=0.25)
    return figure
