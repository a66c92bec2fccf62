"""Which numbers of a scene are free, within which bounds, and on which scale."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from ..arrays import AnyArray
from ..errors import InputError
from ..measurement.dataset import Dataset
from ..measurement.geometry import Radial, value_unit
from ..scene.stack import Stack

Scale = Literal["linear", "log"]

NUISANCE = {"amplitude": 1.0, "offset": 0.0, "background": 0.0}
_UNITS = {"sigma_a": "1/mm", "sigma_s": "1/mm", "sigma_s_prime": "1/mm", "thickness": "mm", "offset": "mm"}
# lowest and highest value each number may ever have: (value, whether it may be reached)
_PHYSICAL = {
    "sigma_a": ((0.0, True), (math.inf, False)),
    "sigma_s": ((0.0, True), (math.inf, False)),
    "sigma_s_prime": ((0.0, True), (math.inf, False)),
    "thickness": ((0.0, True), (math.inf, False)),
    "roughness": ((0.0, True), (math.inf, False)),
    "roughness_below": ((0.0, True), (math.inf, False)),
    "g": ((-1.0, True), (1.0, False)),
    "n": ((0.0, False), (math.inf, False)),
    "n_above": ((0.0, False), (math.inf, False)),
    "n_below": ((0.0, False), (math.inf, False)),
    "amplitude": ((0.0, False), (math.inf, False)),
}
_LOG_BY_DEFAULT = ("sigma_a", "sigma_s", "sigma_s_prime", "thickness")


@dataclass(frozen=True)
class FreeParameter:
    """A free number: its bounds, where to start, and the scale on which starts are spread and steps are taken.

    low, high : bounds, never crossed. init : start (default: the scene's value). scale : "log" or "linear".
    """

    name: str
    low: float
    high: float
    init: float
    scale: Scale
    unit: str

    @property
    def log(self) -> bool:
        return self.scale == "log"

    @property
    def ends(self) -> tuple[float, float]:
        """Bounds on its scale."""
        return (math.log(self.low), math.log(self.high)) if self.log else (self.low, self.high)

    def share(self, x: float) -> float:
        """Position of a value between the bounds on its scale, 0 to 1."""
        low, high = self.ends
        return ((math.log(x) if self.log else x) - low) / (high - low)

    def at(self, share: float) -> float:
        """The value at a position between the bounds on its scale."""
        low, high = self.ends
        there = low + share * (high - low)
        return math.exp(there) if self.log else there


def free_parameters(stack: Stack, datasets: Sequence[Dataset], free: Mapping[str, Any], *, where: str = "free") -> tuple[FreeParameter, ...]:
    """Free parameters from ``{name: (min, max)}`` or ``{name: {"min":, "max":, "init":, "scale":}}``.

    Without a scale, coefficients and thicknesses whose bounds lie above 0 and span a decade or more are varied on a log scale, all others on a
    linear one. Raises InputError for a name that does not exist, bounds that are no interval, lie outside what the number can be, or do not hold
    the start.
    """
    if not free:
        raise InputError(f"{where}: no free parameter was given; allowed is one or more of {', '.join(_names(stack, datasets))}")
    return tuple(_one(stack, datasets, name, spec, f"{where} '{name}'") for name, spec in free.items())


def _names(stack: Stack, datasets: Sequence[Dataset]) -> list[str]:
    nuisance = [f"{d.name}.{n}" for d in datasets for n in NUISANCE if n != "offset" or isinstance(d.geometry, Radial)]
    return [*stack.names, *nuisance]


def _one(stack: Stack, datasets: Sequence[Dataset], name: str, spec: Any, where: str) -> FreeParameter:
    if name not in _names(stack, datasets):
        raise InputError(f"{where} does not exist; allowed: {', '.join(_names(stack, datasets))}")
    owner, field = name.rsplit(".", 1)
    dataset = next((d for d in datasets if d.name == owner), None) if field in NUISANCE else None
    start = NUISANCE[field] if dataset is not None else float(stack.get(name))
    scale = None
    if isinstance(spec, Mapping):
        unknown = [key for key in spec if key not in ("min", "max", "init", "scale")]
        if unknown or "min" not in spec or "max" not in spec:
            wrong = f"unknown key '{unknown[0]}'" if unknown else "min or max is missing"
            raise InputError(f"{where}: {wrong}; allowed: min, max, init, scale")
        low, high, start, scale = spec["min"], spec["max"], spec.get("init", start), spec.get("scale")
    else:
        try:
            low, high = spec
        except (TypeError, ValueError):
            raise InputError(f"{where} = {spec!r}; allowed is [min, max] or a table with min, max, init, scale") from None
    numbers = {"min": low, "max": high, "init": start}
    for key, value in numbers.items():
        if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
            raise InputError(f"{where}: {key} = {value!r}; allowed is a finite number")
    low, high, start = float(low), float(high), float(start)
    if not low < high:
        raise InputError(f"{where}: min = {low:g} is not below max = {high:g}")
    (lowest, reach_low), (highest, reach_high) = _PHYSICAL.get(field, ((-math.inf, False), (math.inf, False)))
    if low < lowest or (low == lowest and not reach_low) or high > highest or (high == highest and not reach_high):
        raise InputError(
            f"{where}: bounds {low:g} to {high:g}; {field} can only be {lowest:g} to {highest:g}{'' if reach_low else ', the ends excluded'}"
        )
    if not low <= start <= high:
        raise InputError(f"{where}: the start {start:g} lies outside its bounds {low:g} to {high:g}; widen them or give init")
    if scale is None:
        scale = "log" if field in _LOG_BY_DEFAULT and low > 0 and high / low >= 10.0 else "linear"
    if scale not in ("linear", "log"):
        raise InputError(f'{where}: scale = {scale!r}; allowed: "linear", "log"')
    if scale == "log" and low <= 0:
        raise InputError(f"{where}: scale log needs a min above 0; {low:g} was given")
    unit = value_unit(dataset.geometry) if dataset is not None and field == "background" else _UNITS.get(field, "1")
    return FreeParameter(name, low, high, start, scale, unit)


class Tie(eqx.Module):
    """A number that follows another: value = factor * source."""

    name: str = eqx.field(static=True)
    source: str = eqx.field(static=True)
    factor: float = eqx.field(static=True)


def parse_ties(stack: Stack, free: Sequence[FreeParameter], ties: Mapping[str, Any], *, where: str = "ties") -> tuple[Tie, ...]:
    """Ties from ``{name: source}`` or ``{name: (source, factor)}``, both numbers of the stack.

    Raises InputError for a name that does not exist, is free, or follows itself or another tied number.
    """
    parsed = []
    for name, spec in ties.items():
        source, factor = _tie(spec, f"{where} '{name}'")
        for given in (name, source):
            if given not in stack.names:
                raise InputError(f"{where} '{name}': '{given}' is no number of the scene; allowed: {', '.join(stack.names)}")
        if isinstance(factor, bool) or not isinstance(factor, int | float) or not math.isfinite(factor) or factor <= 0:
            raise InputError(f"{where} '{name}': factor = {factor!r}; allowed is a finite number above 0")
        if any(p.name == name for p in free):
            raise InputError(f"{where} '{name}': it is free as well; allowed is one of both")
        if source == name or source in ties:
            raise InputError(f"{where} '{name}': follows '{source}', which is tied itself; tie both to the same number")
        parsed.append(Tie(name, source, float(factor)))
    return tuple(parsed)


def _tie(spec: Any, where: str) -> tuple[str, Any]:
    """Source and factor as given."""
    if isinstance(spec, str):
        return spec, 1.0
    if isinstance(spec, Mapping) and "to" in spec and not set(spec) - {"to", "factor"}:
        spec = (spec["to"], spec.get("factor", 1.0))
    if isinstance(spec, Sequence) and len(spec) == 2 and isinstance(spec[0], str):
        return spec[0], spec[1]
    raise InputError(f"{where} = {spec!r}; allowed is the name of a number, [name, factor], or a table with to and factor")


class Coordinates(eqx.Module):
    """The map from the whole real line to free numbers.

    x = low + (high - low) s(u) with the logistic s, in the number or in its logarithm. Bounds are met only in the limit.
    """

    low: Float[AnyArray, "p"]
    high: Float[AnyArray, "p"]
    log: Bool[AnyArray, "p"]

    def __init__(self, parameters: Sequence[FreeParameter]):
        self.log = np.array([p.log for p in parameters])
        self.low, self.high = np.array([p.ends for p in parameters]).T

    def physical(self, u: Float[Array, "*s p"]) -> Float[Array, "*s p"]:
        """Numbers in physical units at u."""
        inner = self.low + (self.high - self.low) * jax.nn.sigmoid(u)
        return jnp.where(self.log, jnp.exp(jnp.where(self.log, inner, 0.0)), inner)


def shares(parameters: Sequence[FreeParameter], x: Float[np.ndarray, "*m p"]) -> Float[np.ndarray, "*m p"]:
    """Positions of numbers between their bounds, each on its scale, 0 to 1."""
    log = np.array([p.log for p in parameters])
    low, high = np.array([p.ends for p in parameters]).T
    return (np.where(log, np.log(np.where(log, x, 1.0)), x) - low) / (high - low)


def unbounded(share: np.ndarray) -> np.ndarray:
    """u at positions between the bounds; ends are moved in by 1e-4."""
    inside = np.clip(share, 1e-4, 1.0 - 1e-4)
    return np.log(inside / (1.0 - inside))


def spread_points(dimensions: int, count: int, seed: int) -> np.ndarray:
    """Points of the unit cube spread more evenly than by chance, (count, dimensions): a Sobol sequence scrambled by the seed."""
    from scipy.stats import qmc  # slow to import, and one start needs none

    if count == 0:
        return np.empty((0, dimensions))
    return qmc.Sobol(dimensions, rng=seed).random_base2((count - 1).bit_length())[:count]  # its balance holds for powers of two
