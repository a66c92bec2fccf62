"""What data could tell, before there are any."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..arrays import AnyArray
from ..compilation import QUICK
from ..errors import InputError
from ..measurement.dataset import Dataset, Noise
from ..measurement.geometry import Angular, Geometry, Radial, RadialReflectance, SpatialFrequency, TotalReflectance, TotalTransmittance
from ..measurement.planned import Planned
from ..scene.stack import Stack
from ..solver import Solver
from ..transport.auto import Auto
from .design import Step, greedy
from .least_squares import value_and_jacobian
from .parameters import FreeParameter, free_parameters
from .problem import Problem
from .uncertainty import UNDETERMINED, correlation, linear_covariance, natural_scales, open_directions, verdicts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NOTHING = 1e3  # relative sd above which the data say nothing
_SPATIAL = (0.0, 0.03, 0.1, 0.3, 1.0)  # [rad/mm], offered where nothing else is said


class Knowledge(eqx.Module):
    """The least uncertainty that any unbiased estimate can have: the Cramer-Rao bound.

    x : values at which it holds (p,). covariance : inverse Fisher information (p, p), physical units. sd : its standard deviations, infinite
    where the data say nothing. relative : sd of the logarithm, or of the number in units of its interval. sentences : what is not determined,
    and which numbers trade off.
    """

    parameters: tuple[FreeParameter, ...] = eqx.field(static=True)
    x: np.ndarray
    covariance: np.ndarray
    relative: np.ndarray
    sentences: tuple[str, ...] = eqx.field(static=True)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free numbers."""
        return tuple(p.name for p in self.parameters)

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations in physical units (p,)."""
        return np.where(np.isfinite(self.relative), np.sqrt(np.diag(self.covariance)), np.inf)

    @property
    def determined(self) -> np.ndarray:
        """Which numbers are determined (p,): those whose relative sd is at most 0.3."""
        return self.relative <= UNDETERMINED

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix (p, p)."""
        return correlation(self.covariance)


class Identification(eqx.Module):
    """The result of `identify`.

    Attributes
    ----------
    absolute, relative : what is known where the amplitude of all profiles is known, and where it is free; None where nothing that is measured
        has a shape.
    stated : that of both which is asked for, "absolute" or "relative".
    places : the given values that tell most, in order. extra : what would tell most besides, in order. Each with the sd that is left, the bounds
        of the free numbers being all that was known before.
    given : relative sd from all given values, the bounds known too (p,). values : predicted values of each measurement.
    """

    problem: Problem
    absolute: Knowledge
    relative: Knowledge | None
    stated: str = eqx.field(static=True)
    places: tuple[Step, ...]
    extra: tuple[Step, ...]
    given: np.ndarray
    values: tuple[np.ndarray, ...]

    @property
    def knowledge(self) -> Knowledge:
        """That which is asked for."""
        return self.relative if self.stated == "relative" and self.relative is not None else self.absolute

    def summary(self) -> str:
        """The result as plain text."""
        from ..report.identification_table import identification_text

        return identification_text(self)

    def plot(self) -> "Figure":
        """Relative standard deviations, what each place tells, and how they fall with more measurements."""
        from ..report.identification_plot import plot_identification

        return plot_identification(self)

    def save(self, folder: Any) -> dict[str, Path]:
        """Write identify.json, identify.txt and identify.svg into a folder; returns their paths by name."""
        from ..report.identification_archive import save_identification

        return save_identification(self, folder)

    def __repr__(self) -> str:
        return self.summary()


def identify(
    stack: Stack,
    data: Dataset | Planned | Sequence[Dataset | Planned],
    *,
    free: Mapping[str, Any],
    ties: Mapping[str, Any] | None = None,
    likelihood: Any = None,
    solver: Solver | None = None,
    candidates: Sequence[Planned] | None = None,
    choose: int = 6,
) -> Identification:
    """What measurements could tell of a stack, from the slopes of the forward model alone.

    The Fisher information J^T J of the weighted predictions gives the Cramer-Rao bound on every free number, at the stack's own values (or init).

    Arguments
    ---------
    stack, free, ties, likelihood, solver : as for `Problem`. Normal and log-normal priors count as known before.
    data : planned measurements with their noise, or datasets with sd (their values are not used).
    candidates : what could be measured besides. Left out: totals, spatial frequencies and distances beyond the given ones, with the median relative
        noise of the data.
    choose : how many places and further measurements are named, in the order of what they tell: each the one that shrinks the volume of the
        uncertainty most (greedy D-optimal design, by the sd alone; correlated noise and outliers count in the bounds).

    Raises InputError where nothing is free, a measurement has no noise, or something does not fit together.

    References
    ----------
    V. V. Fedorov, Theory of Optimal Experiments (1972), section 2.2 (D-optimal design); H. Cramer, Mathematical Methods of Statistics (1946), 32.3.

    >>> import layerfit as lf
    >>> skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.01, sigma_s_prime=1, n=1.4)])
    >>> plan = lf.Planned(lf.RadialReflectance(r=[1, 2, 4, 8]), lf.Noise(relative=0.02))
    >>> found = lf.identify(skin, plan, free={"skin.sigma_a": (1e-3, 1), "skin.sigma_s_prime": (0.1, 10)}, solver=lf.LayeredDiffusion())
    >>> found.absolute.relative.round(3).tolist(), found.relative.determined.tolist()
    ([0.04, 0.015], [True, True, True])
    """
    if not isinstance(choose, int) or choose < 1:
        raise InputError(f"choose = {choose!r}; allowed is a whole number, at least 1")
    stack = stack if isinstance(stack, Stack) else Stack((stack,))
    given = [data] if isinstance(data, Dataset | Planned) else list(data)
    for one in given:
        if isinstance(one, Dataset) and one.sd is None:
            raise InputError(f"measurement '{one.name}' has neither sd nor noise; what can be known depends on it: give one of them")
    if not given:
        raise InputError("identify: no measurement was given; allowed is one or more, each with its noise")
    chosen = (Auto() if solver is None else solver).choose(_start(stack, given, free), [one.geometry for one in given]).solver
    offered = _offered(stack, given, chosen) if candidates is None else list(candidates)
    shells = [Dataset(one.geometry, np.ones(one.geometry.size), np.ones(one.geometry.size), name=one.name) for one in [*given, *offered]]
    shapes = [d.name for d in shells[: len(given)] if isinstance(d.geometry, Radial | SpatialFrequency | Angular) and d.geometry.size > 1]
    amplitudes = {f"{name}.amplitude": (0.5, 2.0) for name in shapes if f"{name}.amplitude" not in free}
    everything = Problem(stack, shells, free={**free, **amplitudes}, ties=ties, solver=chosen)
    x = np.array([p.init for p in everything.parameters])
    values, slopes = _slopes(everything, x)
    if not np.all(np.isfinite(slopes)) or not np.all(np.isfinite(values)):
        raise InputError(f"identify: the slopes of solver {chosen.name} are not finite at these values; move the start of the free numbers")
    parts = np.split(np.asarray(values), np.cumsum([d.geometry.size for d in shells])[:-1])
    usual = Noise(relative=max(float(np.median(np.concatenate([_sd(one, v) / np.abs(v) for one, v in zip(given, parts, strict=False)]))), 1e-12))
    plans = [*given, *(Planned(one.geometry, usual, one.name) if candidates is None else one for one in offered)]
    measured = [Dataset(one.geometry, v, _sd(one, v), name=one.name) for one, v in zip(plans, parts, strict=True)]
    problem = Problem(stack, measured[: len(given)], free=free, ties=ties, likelihood=likelihood, solver=chosen)
    slopes = np.asarray(slopes)
    weighted = slopes / np.concatenate([np.asarray(d.sd) for d in measured])[:, None]
    own = np.split(slopes[: sum(d.geometry.size for d in problem.data)], np.cumsum([d.geometry.size for d in problem.data])[:-1])
    informative = np.concatenate([one.informative(part) for one, part in zip(problem.model.scatter, own, strict=True)])
    return _assemble(problem, everything.parameters, x, informative, weighted, measured, choose)


def _start(stack: Stack, given: Sequence[Dataset | Planned], free: Mapping[str, Any]) -> Stack:
    """The stack at the init of its free numbers."""
    shells = [Dataset(one.geometry, np.ones(one.geometry.size), name=one.name) for one in given]
    return stack.set({p.name: p.init for p in free_parameters(stack, shells, free) if p.name in stack.names})


def _sd(plan: Dataset | Planned, values: np.ndarray) -> np.ndarray:
    """Standard deviations that a measurement would have."""
    if isinstance(plan, Dataset):
        assert plan.sd is not None
        return plan.sd
    return np.asarray(Dataset(plan.geometry, values, noise=plan.noise, name=plan.name).sd)


def _offered(stack: Stack, measured: Sequence[Dataset | Planned], solver: Solver) -> list[Planned]:
    """Further measurements that the solver can predict and that are not among the given ones; their noise is put in later."""
    radial = [d.geometry for d in measured if isinstance(d.geometry, Radial)]
    offers: list[Geometry] = [SpatialFrequency(k=list(_SPATIAL)), TotalReflectance()] + ([] if stack.half_space else [TotalTransmittance()])
    kinds = {d.geometry.kind for d in measured}
    offers = [offer for offer in offers if offer.kind not in kinds and not (offer.kind == "total_reflectance" and "spatial_frequency" in kinds)]
    if radial or not offers:
        reach = max((float(np.max(geometry.centers())) for geometry in radial), default=5.0)
        least = min((float(np.min(geometry.centers()[geometry.centers() > 0])) for geometry in radial), default=1.0)
        offers.insert(0, RadialReflectance(r=[0.5 * least, 1.5 * reach, 2.0 * reach]))
    taken = {d.name for d in measured} | {layer.name for layer in stack.layers}
    names = {offer.kind: offer.kind if offer.kind not in taken else f"extra_{offer.kind}" for offer in offers}
    return [Planned(offer, Noise(relative=1.0), names[offer.kind]) for offer in offers if solver.refusal(stack, [offer]) is None]


def _slopes_of(problem: Problem, x: Float[AnyArray, "p"]) -> tuple[Any, Any]:
    """Predictions and their Jacobian in physical units."""
    return value_and_jacobian(lambda x: jnp.concatenate(problem.model.predict(x)), jnp.asarray(x))


_slopes: Callable[..., tuple[Any, Any]] = eqx.filter_jit(_slopes_of, **QUICK)


def _assemble(
    problem: Problem,
    parameters: Sequence[FreeParameter],
    x: Float[np.ndarray, "p"],
    informative: Float[np.ndarray, "rows p"],
    weighted: Float[np.ndarray, "n p"],
    measured: Sequence[Dataset],
    choose: int,
) -> Identification:
    """parameters, x, weighted (slopes by sd) : of all measurements and candidates, in which the amplitude of every profile is free as well.

    informative : the same of the measurements alone, as their likelihoods have it.
    """
    known = informative * natural_scales(parameters, x)
    rows = len(informative)
    amplitude = np.array([p.name.endswith(".amplitude") for p in parameters])
    shapes = {f"{d.name}.amplitude" for d in problem.data}
    relative = _knowledge(parameters, x, known) if amplitude.any() and any(p.name in shapes for p in parameters) else None
    absolute = _knowledge([p for p in parameters if not p.name.endswith(".amplitude")], x[~amplitude], known[:, ~amplitude])
    asked = np.array([p.name in problem.names for p in parameters])
    mine = [p for p in parameters if p.name in problem.names]
    prior = np.diag(1.0 / np.array([_spread_between(p) for p in mine]) ** 2)
    where = [(d.name, i) for d in measured for i in range(d.geometry.size)]
    weights = (weighted * natural_scales(parameters, x))[:, asked]
    given = prior + known[:, asked].T @ known[:, asked]
    geometries = {d.name: d.geometry for d in measured}
    return Identification(
        problem=problem,
        absolute=absolute,
        relative=relative,
        stated="relative" if any(name.endswith(".amplitude") for name in problem.names) else "absolute",
        places=greedy(prior, weights[:rows], where[:rows], geometries, mine, x[asked], choose),
        extra=greedy(given, weights[rows:], where[rows:], geometries, mine, x[asked], choose),
        given=np.sqrt(np.diag(np.linalg.inv(given))),
        values=tuple(d.values for d in problem.data),
    )


def _knowledge(parameters: Sequence[FreeParameter], x: np.ndarray, scaled: Float[np.ndarray, "n p"]) -> Knowledge:
    """The Cramer-Rao bound from weighted slopes in natural scales."""
    inner = linear_covariance(scaled[None], np.ones(1))[0]
    sd = np.sqrt(np.diag(inner))
    blind = ~np.any(scaled != 0.0, axis=0) | (sd > _NOTHING)
    relative = np.where(blind, math.inf, sd)
    scale = natural_scales(parameters, x)
    sentences = (*verdicts(parameters, relative.tolist()), *open_directions(parameters, inner))
    return Knowledge(tuple(parameters), x, inner * np.outer(scale, scale), relative, sentences)


def _spread_between(parameter: FreeParameter) -> float:
    """What is known before any data, in the natural scale: the sd of a uniform distribution between the bounds, or that of a narrower prior."""
    low, high, prior = parameter.low, parameter.high, parameter.prior
    natural = float(natural_scales([parameter], np.array([parameter.init]))[0])
    between = (math.log(high / low) if parameter.log else (high - low) / natural) / math.sqrt(12.0)
    if not prior.square or prior.references:
        return between
    sd = float(prior.standard(*prior.numbers)[1])
    return min(between, sd if prior.logarithmic else sd / natural)
