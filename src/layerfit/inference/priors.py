"""What is known of a free number before the data: densities in its physical unit, cut off at its bounds.

The numbers of a prior may be names of other free numbers (``lf.Normal(1.0, "hyper.spread")``): a hierarchy.
"""

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.scipy.special import log_ndtr
from jaxtyping import Float

from ..arrays import AnyArray
from ..errors import InputError

_FURTHEST = 5.0  # sd from a prior's centre to the nearest bound, above which the two contradict each other


class Prior(eqx.Module):
    """A density between two bounds.

    kind : its name in a scene file. logarithmic : whether it is flat or normal in the logarithm of the number. square : whether its logarithm is a
    square, so that it can join the residuals of a least-squares fit. arguments : names of its numbers.
    """

    kind: ClassVar[str]
    logarithmic: ClassVar[bool] = False
    square: ClassVar[bool] = False
    arguments: ClassVar[tuple[str, ...]] = ()

    @property
    def numbers(self) -> tuple[Any, ...]:
        """Its numbers, or names of free numbers in their place."""
        return tuple(getattr(self, name) for name in self.arguments)

    @property
    def references(self) -> tuple[str, ...]:
        """Names of free numbers that it depends on."""
        return tuple(v for v in self.numbers if isinstance(v, str))

    def check(self, low: float, high: float, where: str) -> None:
        """Raise InputError where it cannot be between such bounds."""
        if self.logarithmic and low <= 0 and not self.square:
            raise InputError(f"{where}: prior {self.kind} needs a min above 0; {low:g} was given")
        if self.logarithmic and high <= 0:
            raise InputError(f"{where}: prior {self.kind} is for numbers above 0; bounds {low:g} to {high:g} were given")
        if self.square and not self.references:
            centre, spread = self.standard(*self.numbers)
            lowest, highest = (math.log(max(b, 1e-300)) for b in (low, high)) if self.logarithmic else (low, high)
            away = max(lowest - centre, centre - highest) / spread
            if away > _FURTHEST:
                raise InputError(
                    f"{where}: the centre of prior {self!r} lies {away:.3g} sd outside the bounds {low:g} to {high:g}; change one of them"
                )

    @staticmethod
    def standard(*numbers: Any) -> tuple[Any, Any]:
        """Centre and sd, in the logarithm where it is logarithmic."""
        raise NotImplementedError

    @classmethod
    @abstractmethod
    def log_density(cls, x: Array, low: Any, high: Any, *numbers: Any) -> Array:
        """Logarithm of the density at x between the bounds, integral 1 over x."""

    @abstractmethod
    def quantile(self, share: Float[np.ndarray, "*s"], low: float, high: float) -> Float[np.ndarray, "*s"]:
        """Values below which a share of the probability lies: draws, from uniform shares."""


class Uniform(Prior):
    """Uniform in the number (the default)."""

    kind: ClassVar[str] = "uniform"

    @classmethod
    def log_density(cls, x: Array, low: Any, high: Any, *numbers: Any) -> Array:
        return -jnp.log(high - low) * jnp.ones_like(x)

    def quantile(self, share: Float[np.ndarray, "*s"], low: float, high: float) -> Float[np.ndarray, "*s"]:
        return low + share * (high - low)


class LogUniform(Prior):
    """Uniform in the logarithm of the number."""

    kind: ClassVar[str] = "log-uniform"
    logarithmic: ClassVar[bool] = True

    @classmethod
    def log_density(cls, x: Array, low: Any, high: Any, *numbers: Any) -> Array:
        return -jnp.log(x) - jnp.log(jnp.log(high / low))

    def quantile(self, share: Float[np.ndarray, "*s"], low: float, high: float) -> Float[np.ndarray, "*s"]:
        return low * (high / low) ** share


class _Bell(Prior):
    """Normal in the number or in its logarithm."""

    square: ClassVar[bool] = True

    @classmethod
    def log_density(cls, x: Array, low: Any, high: Any, *numbers: Any) -> Array:
        centre, spread = cls.standard(*numbers)
        t, lowest, highest = (jnp.log(jnp.maximum(v, 1e-300)) for v in (x, low, high)) if cls.logarithmic else (x, low, high)
        z, start, end = ((v - centre) / spread for v in (t, lowest, highest))
        density = -0.5 * z**2 - jnp.log(spread) - 0.5 * math.log(2.0 * math.pi) - _log_between(start, end)
        return density - t if cls.logarithmic else density

    def quantile(self, share: Float[np.ndarray, "*s"], low: float, high: float) -> Float[np.ndarray, "*s"]:
        from scipy.stats import truncnorm  # slow to import, and a fit needs none of it

        centre, spread = self.standard(*self.numbers)
        lowest, highest = np.log(np.maximum([low, high], 1e-300)) if self.logarithmic else (low, high)
        t = truncnorm.ppf(share, (lowest - centre) / spread, (highest - centre) / spread, loc=centre, scale=spread)
        return np.exp(t) if self.logarithmic else t


class Normal(_Bell):
    """Normal; with mean 0 and a min of 0 it is half of one.

    mean, sd : in the unit of the number, or names of free numbers.
    """

    kind: ClassVar[str] = "normal"
    arguments: ClassVar[tuple[str, ...]] = ("mean", "sd")
    mean: float | int | str = eqx.field(static=True)
    sd: float | int | str = eqx.field(static=True)

    def __check_init__(self):
        _check_number(self.mean, "prior normal: mean", -math.inf)
        _check_number(self.sd, "prior normal: sd", 0.0)

    @staticmethod
    def standard(*numbers: Any) -> tuple[Any, Any]:
        return numbers[0], numbers[1]


class LogNormal(_Bell):
    """Normal in the logarithm of the number.

    median : in the unit of the number. factor : above 1; 68 % lie between median/factor and median*factor. Either may be the name of a free number.
    """

    kind: ClassVar[str] = "log-normal"
    logarithmic: ClassVar[bool] = True
    arguments: ClassVar[tuple[str, ...]] = ("median", "factor")
    median: float | int | str = eqx.field(static=True)
    factor: float | int | str = eqx.field(static=True)

    def __check_init__(self):
        _check_number(self.median, "prior log-normal: median", 0.0)
        _check_number(self.factor, "prior log-normal: factor", 1.0)

    @staticmethod
    def standard(*numbers: Any) -> tuple[Any, Any]:
        log = jnp.log if any(isinstance(v, Array) for v in numbers) else math.log
        return log(numbers[0]), log(numbers[1])


UNIFORM = Uniform()
PRIORS: dict[str, type[Prior]] = {cls.kind: cls for cls in (Uniform, LogUniform, Normal, LogNormal)}


def _check_number(value: Any, what: str, above: float) -> None:
    if isinstance(value, str):
        return
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value) or value <= above:
        raise InputError(
            f"{what} = {value!r}; allowed is a finite number{f' above {above:g}' if above > -math.inf else ''}, or the name of a free number"
        )


def _log_between(start: Any, end: Any) -> Array:
    """Logarithm of the share of a standard normal between two points, also far out."""
    mirrored = start > 0
    low, high = jnp.where(mirrored, -end, start), jnp.where(mirrored, -start, end)
    return log_ndtr(high) + jnp.log1p(-jnp.exp(log_ndtr(low) - log_ndtr(high)))


def parse_prior(spec: Any, where: str) -> Prior:
    """A prior from an object, a name, or a table: ``Normal(1.0, 0.05)``, ``"log-uniform"``, ``{"normal": [1.0, 0.05]}`` or with the numbers named.

    Raises InputError for one that does not exist or lacks numbers.

    >>> parse_prior({"normal": [1.0, 0.05]}, "free 'probe.amplitude'")
    Normal(mean=1.0, sd=0.05)
    """
    if isinstance(spec, Prior):
        return spec
    kind, given = spec, ()
    if isinstance(spec, Mapping) and len(spec) == 1:
        kind, given = next(iter(spec.items()))
    if not isinstance(kind, str) or kind.replace("_", "-") not in PRIORS:
        forms = ", ".join(f'"{name}"' if not cls.arguments else f"{{{name} = [{', '.join(cls.arguments)}]}}" for name, cls in PRIORS.items())
        raise InputError(f"{where}: prior = {spec!r}; allowed: {forms}")
    cls = PRIORS[kind.replace("_", "-")]
    if isinstance(given, Mapping) and set(given) == set(cls.arguments):
        given = [given[name] for name in cls.arguments]
    if isinstance(given, str | Mapping) or not isinstance(given, Sequence) or len(given) != len(cls.arguments):
        raise InputError(
            f"{where}: prior {cls.kind}: {given!r} was given; allowed are {len(cls.arguments)} numbers ({', '.join(cls.arguments) or 'none'})"
        )
    try:
        return cls(*given)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


class Priors(eqx.Module):
    """The priors of all free numbers, as a function of these."""

    low: Float[AnyArray, "p"]
    high: Float[AnyArray, "p"]
    numbers: tuple[tuple[Float[AnyArray, ""], ...], ...]
    indices: tuple[tuple[int | None, ...], ...] = eqx.field(static=True)  # of the free number that stands in place of a prior's own
    kinds: tuple[type[Prior], ...] = eqx.field(static=True)

    def __init__(self, priors: Sequence[Prior], names: Sequence[str], low: np.ndarray, high: np.ndarray):
        self.low, self.high = low, high
        self.kinds = tuple(type(prior) for prior in priors)
        self.numbers = tuple(tuple(np.asarray(0.0 if isinstance(v, str) else float(v)) for v in prior.numbers) for prior in priors)
        self.indices = tuple(tuple(names.index(v) if isinstance(v, str) else None for v in prior.numbers) for prior in priors)

    @property
    def hierarchical(self) -> bool:
        """Whether a prior depends on free numbers."""
        return any(index is not None for row in self.indices for index in row)

    @property
    def informative(self) -> tuple[int, ...]:
        """Those whose logarithm is a square with known numbers."""
        return tuple(i for i, (kind, row) in enumerate(zip(self.kinds, self.indices, strict=True)) if kind.square and set(row) == {None})

    def residuals(self, x: Float[Array, "p"]) -> Float[Array, "informative"]:
        """(number - centre)/sd of the informative ones."""
        rows = []
        for i in self.informative:
            centre, spread = self.kinds[i].standard(*(jnp.asarray(v) for v in self.numbers[i]))
            rows.append(((jnp.log(x[i]) if self.kinds[i].logarithmic else x[i]) - centre) / spread)
        return jnp.stack(rows) if rows else jnp.zeros(0)

    def log_densities(self, x: Float[Array, "p"]) -> Float[Array, "p"]:
        """Of each number, per unit of it; what lies outside the bounds is not looked at."""
        rows = []
        for i, kind in enumerate(self.kinds):
            numbers = [jnp.asarray(v) if at is None else x[at] for v, at in zip(self.numbers[i], self.indices[i], strict=True)]
            rows.append(kind.log_density(x[i], jnp.asarray(self.low[i]), jnp.asarray(self.high[i]), *numbers))
        return jnp.stack(rows)

    def log_mode(self, x: Float[Array, "p"]) -> Float[Array, ""]:
        """What a fit adds to the likelihood: the density per unit of the number, or of its logarithm where the prior is flat or normal in that."""
        log = np.array([kind.logarithmic for kind in self.kinds])
        return jnp.sum(self.log_densities(x) + jnp.where(log, jnp.log(jnp.where(log, x, 1.0)), 0.0))
