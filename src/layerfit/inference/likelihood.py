"""How data scatter about the model, as a user states it."""

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, ClassVar

import equinox as eqx
import numpy as np

from ..errors import InputError, one_of
from ..measurement.dataset import Dataset
from .scatter import NormalScatter, PoissonScatter, Scatter, StudentScatter


class Likelihood(eqx.Module):
    """What kind of errors the values have. kind : its name in a scene file."""

    kind: ClassVar[str]
    needs_sd: ClassVar[bool] = True
    takes_model_error: ClassVar[bool] = False

    @abstractmethod
    def scatter(self, dataset: Dataset, sd: np.ndarray, error: np.ndarray | None) -> Scatter:
        """Of one dataset. sd : of its values. error : covariance of the model's error (n, n), or None.

        Raises InputError where the dataset has not what it needs.
        """


class GaussianNoise(Likelihood):
    """Independent normal errors with the sd of the data (the default)."""

    kind: ClassVar[str] = "gaussian"
    needs_sd: ClassVar[bool] = False
    takes_model_error: ClassVar[bool] = True

    def scatter(self, dataset: Dataset, sd: np.ndarray, error: np.ndarray | None) -> Scatter:
        return NormalScatter(dataset.values, sd, None, error)


class StudentT(Likelihood):
    """Student's t about the prediction, its scale the sd of the data: values far off pull less.

    nu : degrees of freedom, above 0; the smaller the more outliers are expected, 30 is almost normal.
    """

    kind: ClassVar[str] = "student-t"
    nu: float | int = 4.0

    def __check_init__(self):
        _positive(self.nu, "likelihood student-t: nu")

    def scatter(self, dataset: Dataset, sd: np.ndarray, error: np.ndarray | None) -> Scatter:
        return StudentScatter(dataset.values, sd, np.asarray(float(self.nu)))


class Poisson(Likelihood):
    """Counts: of a Dataset with an exposure, for which it is the default."""

    kind: ClassVar[str] = "poisson"

    def scatter(self, dataset: Dataset, sd: np.ndarray, error: np.ndarray | None) -> Scatter:
        if dataset.exposure is None:
            raise InputError(f"measurement '{dataset.name}': likelihood poisson needs counts; allowed with it is a dataset with an exposure")
        return PoissonScatter(dataset.values, sd, dataset.exposure)


class CorrelatedNoise(Likelihood):
    """Normal errors of which a part is alike at neighbouring places: drift, a curved surface.

    To the variance sd^2 comes the covariance a_i a_j exp(-|x_i - x_j|/length), a = relative |value|.

    relative : size of that part, share of the value. length : over which it falls to 1/e, in the unit of the abscissa (mm, rad/mm, deg).
    axis : "place", or "index" for the number of a value in its dataset.
    """

    kind: ClassVar[str] = "correlated"
    takes_model_error: ClassVar[bool] = True
    relative: float | int
    length: float | int
    axis: str = "place"

    def __check_init__(self):
        _positive(self.relative, "likelihood correlated: relative")
        _positive(self.length, "likelihood correlated: length")
        one_of(self.axis, ("place", "index"), "likelihood correlated: axis")

    def scatter(self, dataset: Dataset, sd: np.ndarray, error: np.ndarray | None) -> Scatter:
        x = dataset.geometry.centers() if self.axis == "place" else np.arange(dataset.geometry.size, dtype=float)
        size = self.relative * np.abs(dataset.values)
        kernel = np.exp(-np.abs(x[:, None] - x) / self.length)
        return NormalScatter(dataset.values, sd, np.diag(sd**2) + np.outer(size, size) * kernel, error)


LIKELIHOODS: dict[str, type[Likelihood]] = {cls.kind: cls for cls in (GaussianNoise, StudentT, Poisson, CorrelatedNoise)}


def _positive(value: Any, what: str) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value) or value <= 0:
        raise InputError(f"{what} = {value!r}; allowed is a finite number above 0")


def parse_likelihood(spec: Any, where: str = "likelihood") -> Likelihood:
    """A likelihood from an object, a name, or a table ``{"student-t": {"nu": 4}}``. Raises InputError for one that does not exist.

    >>> parse_likelihood({"student-t": {"nu": 3}})
    StudentT(nu=3)
    """
    if isinstance(spec, Likelihood):
        return spec
    kind, given = spec, {}
    if isinstance(spec, Mapping) and len(spec) == 1:
        kind, given = next(iter(spec.items()))
    name = kind.replace("_", "-") if isinstance(kind, str) else None
    if name not in LIKELIHOODS:
        raise InputError(f"{where} = {spec!r}; allowed: {', '.join(LIKELIHOODS)}, or a table of one of them")
    cls = LIKELIHOODS[name]
    known = [field.name for field in fields(cls)]
    if not isinstance(given, Mapping) or set(given) - set(known):
        raise InputError(f"{where} {name}: {given!r} was given; allowed is a table with {', '.join(known) or 'nothing'}")
    try:
        return cls(**given)
    except TypeError:
        raise InputError(f"{where} {name}: {dict(given)!r} was given; needed are {', '.join(known)}") from None
    except InputError as error:
        raise InputError(f"{where}: {error}".replace("likelihood: likelihood", "likelihood")) from None


def parse_likelihoods(spec: Any, datasets: tuple[Dataset, ...]) -> tuple[Likelihood, ...]:
    """One a dataset, from one for all or ``{measurement: likelihood}``; by default Poisson for counts, else Gaussian."""
    named = {d.name for d in datasets}
    given = spec if isinstance(spec, Mapping) and (not spec or set(spec) & named) else {d.name: spec for d in datasets if spec is not None}
    for name in given:
        if name not in named:
            raise InputError(f"likelihood: there is no measurement '{name}'; allowed: {', '.join(d.name for d in datasets)}")
    usual = {d.name: GaussianNoise() if d.exposure is None else Poisson() for d in datasets}
    return tuple(parse_likelihood(given.get(name, one), f"measurement '{name}': likelihood") for name, one in usual.items())
