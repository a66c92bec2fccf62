"""A profile likelihood as text."""

from typing import TYPE_CHECKING

from .tables import unit_text, with_uncertainty

if TYPE_CHECKING:
    from ..inference.profile_likelihood import ProfileLikelihood


def profile_text(profile: "ProfileLikelihood") -> str:
    """The interval of each level, beside the standard error."""
    estimate, unit = profile.fit.parameters[profile.name], unit_text(profile.unit)
    lines = [f"{profile.name} = {with_uncertainty(estimate.value, estimate.stderr)} {unit} (standard error); by profile likelihood:"]
    for level, interval in profile.intervals.items():
        low = "open below" if interval.low_open else f"{interval.low:.4g}"
        high = "open above" if interval.high_open else f"{interval.high:.4g}"
        lines.append(f"  {100 * level:g} %: {low} to {high} {unit}")
    return "\n".join([*lines, *(f"  ! {warning}" for warning in profile.warnings)])
