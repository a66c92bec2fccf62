"""Which numbers of a scene are free, within which bounds, and on which scale."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, product
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
from ..scene.tissue import FRACTIONS
from .priors import UNIFORM, Prior, parse_prior

Scale = Literal["linear", "log"]

NUISANCE = {"amplitude": 1.0, "offset": 0.0, "background": 0.0}
SIZES = ("source_radius", "detector_radius")  # of a disk or Gaussian source, of a fibre
MODEL_ERROR = "scene.model_error"  # scale of the solver's stated error
HYPER = "hyper."  # numbers that priors depend on
_UNITS = {
    **dict.fromkeys(("sigma_a", "sigma_s", "sigma_s_prime", "a"), "1/mm"),
    **dict.fromkeys(("thickness", "offset", "vessel_radius", *SIZES), "mm"),
    "bilirubin": "umol/L",
}
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
    "source_radius": ((0.0, False), (math.inf, False)),
    "detector_radius": ((0.0, False), (math.inf, False)),
    MODEL_ERROR: ((0.0, True), (math.inf, False)),
    **dict.fromkeys(("a", "vessel_radius", "bilirubin", "baseline"), ((0.0, True), (math.inf, False))),
} | dict.fromkeys(FRACTIONS, ((0.0, True), (1.0, True)))
_KEYS = ("min", "max", "init", "scale", "prior")
_LOG_BY_DEFAULT = ("sigma_a", "sigma_s", "sigma_s_prime", "thickness", "blood", "melanin", "a", "vessel_radius")


@dataclass(frozen=True)
class FreeParameter:
    """A free number: its bounds, where to start, and the scale on which starts are spread and steps are taken.

    low, high : bounds, never crossed. init : start (default: the scene's value). scale : "log" or "linear". prior : density between the bounds.
    """

    name: str
    low: float
    high: float
    init: float
    scale: Scale
    unit: str
    prior: Prior = UNIFORM

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


def spread_points(parameters: Sequence[FreeParameter], count: int, seed: int = 0) -> np.ndarray:
    """Corners of the box between the bounds (the first 64 of them) and points between them, physical units (points, p)."""
    corners = np.array(list(islice(product((0.0, 1.0), repeat=len(parameters)), 64)))
    places = np.concatenate([corners, spread_shares(len(parameters), count, seed)])
    return np.array([[p.at(float(s)) for p, s in zip(parameters, row, strict=True)] for row in places])


def free_parameters(
    stack: Stack, datasets: Sequence[Dataset], free: Mapping[str, Any], *, others: Sequence[Stack] = (), where: str = "free"
) -> tuple[FreeParameter, ...]:
    """Free parameters from ``{name: (min, max)}`` or ``{name: {"min":, "max":, "init":, "scale":}}``.

    A table may have a ``"prior"`` as well (see `parse_prior`). Names that begin with ``hyper.`` are numbers that priors depend on.
    ``scene.model_error`` is the scale of the solver's error. Without a scale, coefficients and thicknesses whose bounds lie above 0 and span a decade
    or more are varied on a log scale, all others on a linear one. Raises InputError for a name that does not exist, bounds that are no interval, lie
    outside what the number can be, or do not hold the start.

    others : stacks of reference samples, the numbers of whose layers may be free too.
    """
    stacks = (stack, *others)
    if not free:
        raise InputError(f"{where}: no free parameter was given; allowed is one or more of {', '.join(_names(stacks, datasets))}")
    parameters = tuple(_one(stacks, datasets, name, spec, f"{where} '{name}'") for name, spec in free.items())
    names = {p.name for p in parameters}
    used = {name: p.name for p in parameters for name in p.prior.references}
    for p in parameters:
        for number, argument in zip(p.prior.numbers, p.prior.arguments, strict=True):
            least = {"sd": 0.0, "median": 0.0, "factor": 1.0}.get(argument, -math.inf)
            low = next((q.low for q in parameters if q.name == number), math.inf)
            if isinstance(number, str) and low <= least:
                raise InputError(f"{where} '{number}': min = {low:g}; as the {argument} of a prior it must stay above {least:g}")
    for name, user in used.items():
        if name not in names:
            raise InputError(f"{where} '{user}': its prior names '{name}', which is not free; allowed: {', '.join(names - {user})}")
    for name in names:
        if name.startswith(HYPER) and name not in used:
            raise InputError(f"{where} '{name}': no prior names it; allowed are numbers of the scene, and those that a prior depends on")
    return parameters


def _names(stacks: Sequence[Stack], datasets: Sequence[Dataset]) -> list[str]:
    return [*stacks[0].names, *(name for s in stacks[1:] for name in s.names if not name.startswith("scene.")), *calibration_names(datasets)]


def calibration_names(datasets: Sequence[Dataset]) -> list[str]:
    """Names of the numbers of measurements."""
    return [f"{d.name}.{n}" for d in datasets for n in _calibration(d)]


def _calibration(dataset: Dataset) -> dict[str, float]:
    """Names and usual values of a dataset's own numbers."""
    geometry = dataset.geometry
    if not isinstance(geometry, Radial):
        return {name: value for name, value in NUISANCE.items() if name != "offset"}
    radii = (getattr(geometry.source, "radius", 0.0), geometry.detector.radius)
    return NUISANCE | {name: float(radius) for name, radius in zip(SIZES, radii, strict=True) if radius > 0}


def _one(stacks: Sequence[Stack], datasets: Sequence[Dataset], name: str, spec: Any, where: str) -> FreeParameter:
    known = _names(stacks, datasets)
    beside = name not in known and (name == MODEL_ERROR or (name.startswith(HYPER) and len(name) > len(HYPER)))
    if name not in known and not beside:
        raise InputError(f"{where} does not exist; allowed: {', '.join(known)}")
    owner, field = name.rsplit(".", 1)
    dataset = next((d for d in datasets if d.name == owner), None) if field in (*NUISANCE, *SIZES) else None
    start: Any = (
        _calibration(dataset)[field] if dataset is not None else None if beside else float(next(s for s in stacks if name in s.names).get(name))
    )
    scale, prior = None, UNIFORM
    if isinstance(spec, Mapping):
        unknown = [key for key in spec if key not in _KEYS]
        if unknown or "min" not in spec or "max" not in spec:
            wrong = f"unknown key '{unknown[0]}'" if unknown else "min or max is missing"
            raise InputError(f"{where}: {wrong}; allowed: {', '.join(_KEYS)}")
        low, high, start, scale = spec["min"], spec["max"], spec.get("init", start), spec.get("scale")
        prior = parse_prior(spec["prior"], where) if "prior" in spec else prior
    else:
        try:
            low, high = spec
        except (TypeError, ValueError):
            raise InputError(f"{where} = {spec!r}; allowed is [min, max] or a table with {', '.join(_KEYS)}") from None
    if start is None:  # of a number that the scene does not have
        start = _middle(low, high)
    numbers = {"min": low, "max": high, "init": start}
    for key, value in numbers.items():
        if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
            raise InputError(f"{where}: {key} = {value!r}; allowed is a finite number")
    low, high, start = float(low), float(high), float(start)
    if not low < high:
        raise InputError(f"{where}: min = {low:g} is not below max = {high:g}")
    (lowest, reach_low), (highest, reach_high) = _PHYSICAL.get(name if beside else field, ((-math.inf, False), (math.inf, False)))
    if low < lowest or (low == lowest and not reach_low) or high > highest or (high == highest and not reach_high):
        raise InputError(
            f"{where}: bounds {low:g} to {high:g}; {field} can only be {lowest:g} to {highest:g}{'' if reach_low else ', the ends excluded'}"
        )
    if not low <= start <= high:
        raise InputError(f"{where}: the start {start:g} lies outside its bounds {low:g} to {high:g}; widen them or give init")
    prior.check(low, high, where)
    if scale is None:
        scale = "log" if (beside or field in _LOG_BY_DEFAULT) and low > 0 and high / low >= 10.0 else "linear"
    if scale not in ("linear", "log"):
        raise InputError(f'{where}: scale = {scale!r}; allowed: "linear", "log"')
    if scale == "log" and low <= 0:
        raise InputError(f"{where}: scale log needs a min above 0; {low:g} was given")
    unit = value_unit(dataset.geometry) if dataset is not None and field == "background" else _UNITS.get(field, "1")
    return FreeParameter(name, low, high, start, scale, unit, prior)


def _middle(low: Any, high: Any) -> Any:
    """Between two bounds, if they are numbers."""
    try:
        return math.sqrt(low * high) if low > 0 else 0.5 * (low + high)
    except (TypeError, ValueError, OverflowError):
        return 0.0


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
        return self.between(jax.nn.sigmoid(u))

    def between(self, share: Float[AnyArray, "*s p"]) -> Float[Array, "*s p"]:
        """Numbers in physical units at shares between the bounds."""
        inner = self.low + (self.high - self.low) * share
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


def spread_shares(dimensions: int, count: int, seed: int) -> np.ndarray:
    """Points of the unit cube spread more evenly than by chance, (count, dimensions): a Sobol sequence scrambled by the seed."""
    from scipy.stats import qmc  # slow to import, and one start needs none

    if count == 0:
        return np.empty((0, dimensions))
    return qmc.Sobol(dimensions, rng=seed).random_base2((count - 1).bit_length())[:count]  # its balance holds for powers of two
