"""One form for what is wrong with an input: its name, what was given, what is allowed."""

from __future__ import annotations

import math


def wrong(name: str, given: object, allowed: str) -> ValueError:
    """The error to raise for an argument."""
    return ValueError(f"{name}: given {given}, allowed {allowed}")


def number(name: str, given: float, low: float, high: float, allowed: str, *, above: bool = False) -> float:
    """`given` as a finite float from `low` to `high` (`above`: low itself excluded).

    Raises
    ------
    ValueError
        If it is not.
    """
    try:
        value = float(given)
    except (TypeError, ValueError):
        raise wrong(name, repr(given), allowed) from None
    if not (math.isfinite(value) and low <= value <= high) or (above and value == low):
        raise wrong(name, repr(given), allowed)
    return value


def whole(name: str, given: float, low: int) -> int:
    """`given` as an int not below `low`.

    Raises
    ------
    ValueError
        If it is not a whole number, or too small.
    """
    if isinstance(given, bool) or not math.isfinite(given) or given != int(given) or given < low:
        raise wrong(name, repr(given), f"whole numbers from {low}")
    return int(given)
