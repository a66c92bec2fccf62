"""A free number of a compact form: its range and its grid."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer

from ..errors import InputError
from ..optics.splines import interpolating_knots
from ..scene.stack import Stack

_LOG_BY_DEFAULT = ("sigma_a", "sigma_s", "sigma_s_prime", "thickness")


class Axis(NamedTuple):
    """low, high : range. log : whether the grid is even in the logarithm. points : of the grid."""

    name: str
    low: float
    high: float
    log: bool
    points: int

    @property
    def degree(self) -> int:
        """Of the spline: cubic, with fewer than four points less."""
        return min(3, self.points - 1)

    @property
    def grid(self) -> np.ndarray:
        """Its points as shares of the range."""
        return np.linspace(0.0, 1.0, self.points)

    @property
    def knots(self) -> np.ndarray:
        """Of the spline over the share of the range."""
        return interpolating_knots(self.grid)

    def at(self, share: float) -> float:
        """The number at a share of the range."""
        if self.log:
            return math.exp(math.log(self.low) + share * math.log(self.high / self.low))
        return self.low + share * (self.high - self.low)

    def share(self, value: Any) -> Array:
        """The share of the range at which a number lies. Raises InputError for a known number outside."""
        if not isinstance(value, Tracer) and not self.low * (1 - 1e-12) <= float(value) <= self.high * (1 + 1e-12):
            raise InputError(f"'{self.name}' = {float(value):g}; the compact form holds from {self.low:g} to {self.high:g}")
        value = jnp.asarray(value, dtype=float)
        if self.log:
            return jnp.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


def axes(stack: Stack, free: Mapping[str, Any], points: int | Mapping[str, int]) -> tuple[Axis, ...]:
    """Axes from ``{name: (min, max)}`` or ``{name: {"min":, "max":, "scale":}}``. Raises InputError for names, ranges or counts that cannot be."""
    if not free:
        raise InputError(f"free: nothing was given; allowed is one or more of {', '.join(stack.names)}")
    counts = points if isinstance(points, Mapping) else dict.fromkeys(free, points)
    return tuple(_axis(stack, name, spec, counts.get(name, 5)) for name, spec in free.items())


def _axis(stack: Stack, name: str, spec: Any, points: Any) -> Axis:
    stack.get(name)  # refuses names that do not exist
    try:
        low, high = (spec["min"], spec["max"]) if isinstance(spec, Mapping) else spec
        low, high = float(low), float(high)
    except (KeyError, TypeError, ValueError):
        raise InputError(f"free '{name}' = {spec!r}; allowed is (min, max) or a table with min, max, scale") from None
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise InputError(f"free '{name}': {low:g} to {high:g}; allowed are finite numbers, the first below the second")
    field = name.rsplit(".", 1)[1]
    if field in ("roughness", "roughness_below") and low <= 0.0:
        raise InputError(f"free '{name}': min = {low:g}; allowed is a roughness above 0 (a smooth face is another stack)")
    scale = spec.get("scale") if isinstance(spec, Mapping) else None
    if scale is None:
        scale = "log" if field in _LOG_BY_DEFAULT and low > 0.0 and high / low >= 10.0 else "linear"
    if scale not in ("linear", "log") or (scale == "log" and low <= 0.0):
        raise InputError(f'free \'{name}\': scale = {scale!r} with min = {low:g}; allowed: "linear", or "log" with a min above 0')
    if isinstance(points, bool) or not isinstance(points, int) or points < 2:
        raise InputError(f"points of '{name}' = {points!r}; allowed is a whole number, 2 or more")
    return Axis(name, low, high, scale == "log", points)
