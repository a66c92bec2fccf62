"""What data could tell, before there are any."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..errors import InputError
from ..measurement.dataset import Dataset, Noise
from ..measurement.geometry import Angular, Geometry, Radial, RadialReflectance, SpatialFrequency, TotalReflectance, TotalTransmittance
from ..measurement.planned import Planned
from ..predict import predict
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
    values : predicted values of each measurement.
    """

    problem: Problem
    absolute: Knowledge
    relative: Knowledge | None
    stated: str = eqx.field(static=True)
    places: tuple[Step, ...]
    extra: tuple[Step, ...]
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
    solver: Solver | None = None,
    candidates: Sequence[Planned] | None = None,
    choose: int = 6,
) -> Identification:
    """What measurements could tell of a stack, from the slopes of the forward model alone.

    The Fisher information J^T J of the weighted predictions gives the Cramer-Rao bound on every free number, at the stack's own values (or init).

    Arguments
    ---------
    stack, free, ties, solver : as for `Problem`.
    data : planned measurements with their noise, or datasets with sd (their values are not used).
    candidates : what could be measured besides. Left out: totals, spatial frequencies and distances beyond the given ones, with the median relative
        noise of the data.
    choose : how many places and further measurements are named, in the order of what they tell: each the one that shrinks the volume of the
        uncertainty most (greedy D-optimal design).

    Raises InputError where nothing is free, a measurement has no noise, or something does not fit together.

    References
    ----------
    V. V. Fedorov, Theory of Optimal Experiments (1972), section 2.2 (D-optimal design); H. Cramer, Mathematical Methods of Statistics (1946), 32.3.

    >>> import layerfit as lf
    >>> skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.01, sigma_s_prime=1, n=1.4)])
    >>> plan = lf.Planned(lf.RadialReflectance(r=[1, 2, 4, 8]), lf.Noise(relative=0.02))
    >>> found = lf.identify(skin, plan, free={"skin.sigma_a": (1e-3, 1), "skin.sigma_s_prime": (0.1, 10)}, solver=lf.LayeredDiffusion())
    >>> found.absolute.relative.round(3).tolist(), found.relative.determined.tolist()
    ([0.034, 0.01], [True, True, False])
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
    shells = [Dataset(one.geometry, np.ones(one.geometry.size), name=one.name) for one in given]
    start = stack.set({p.name: p.init for p in free_parameters(stack, shells, free) if p.name in stack.names})
    chosen = (Auto() if solver is None else solver).choose(start, [one.geometry for one in given]).solver
    measured = _predicted(start, given, chosen)
    offered = _offered(start, measured, chosen) if candidates is None else list(candidates)
    problem, everything = _problems(stack, measured, _predicted(start, offered, chosen) if offered else [], free, ties, chosen)
    return _assemble(problem, everything, choose)


def _predicted(stack: Stack, plans: Sequence[Dataset | Planned], solver: Solver) -> list[Dataset]:
    """Data that would be measured without an error, with the noise that they would have."""
    found = predict(stack, [plan.geometry for plan in plans], solver=solver)
    return [
        Dataset(p.geometry, p.values, plan.sd, name=plan.name)
        if isinstance(plan, Dataset)
        else Dataset(p.geometry, p.values, noise=plan.noise, name=plan.name)
        for plan, p in zip(plans, found, strict=True)
    ]


def _offered(stack: Stack, measured: Sequence[Dataset], solver: Solver) -> list[Planned]:
    """Further measurements that the solver can predict and that are not among the given ones."""
    relative = float(np.median(np.concatenate([np.asarray(d.sd) / np.maximum(np.abs(d.values), 1e-300) for d in measured])))
    noise = Noise(relative=relative)
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
    return [Planned(offer, noise, names[offer.kind]) for offer in offers if solver.refusal(stack, [offer]) is None]


def _problems(
    stack: Stack, measured: Sequence[Dataset], offered: Sequence[Dataset], free: Mapping[str, Any], ties: Mapping[str, Any] | None, solver: Solver
) -> tuple[Problem, Problem]:
    """The problem as stated, and one with all candidates in which the amplitude of every profile is free as well."""
    stated = Problem(stack, measured, free=free, ties=ties, solver=solver)
    shapes = [d.name for d in measured if isinstance(d.geometry, Radial | SpatialFrequency | Angular) and d.geometry.size > 1]
    amplitudes = {f"{name}.amplitude": (0.5, 2.0) for name in shapes if f"{name}.amplitude" not in stated.names}
    return stated, Problem(stack, [*measured, *offered], free={**free, **amplitudes}, ties=ties, solver=solver)


@eqx.filter_jit
def _slopes(problem: Problem, x: Float[np.ndarray, "p"]) -> tuple[Any, Any]:
    """Predictions and their Jacobian, weighted by the noise."""
    sd = jnp.concatenate([jnp.asarray(s) for s in problem.model.sd])
    predicted, jacobian = value_and_jacobian(lambda x: jnp.concatenate(problem.model.predict(x)), jnp.asarray(x))
    return predicted, jacobian / sd[:, None]


def _assemble(problem: Problem, everything: Problem, choose: int) -> Identification:
    parameters = everything.parameters
    x = np.array([p.init for p in parameters])
    predicted, jacobian = (np.asarray(part) for part in _slopes(everything, x))
    if not np.all(np.isfinite(jacobian)):
        raise InputError(f"identify: the slopes of solver {problem.chosen.name} are not finite at these values; move the start of the free numbers")
    scaled = jacobian * natural_scales(parameters, x)
    rows = sum(d.geometry.size for d in problem.data)
    amplitude = np.array([p.name.endswith(".amplitude") for p in parameters])
    shapes = {f"{d.name}.amplitude" for d in problem.data}
    relative = _knowledge(parameters, x, scaled[:rows]) if amplitude.any() and any(p.name in shapes for p in parameters) else None
    absolute = _knowledge([p for p in parameters if not p.name.endswith(".amplitude")], x[~amplitude], scaled[:rows, ~amplitude])
    asked = np.array([p.name in problem.names for p in parameters])
    mine = [p for p in parameters if p.name in problem.names]
    prior = np.diag(1.0 / np.array([_spread_between(p) for p in mine]) ** 2)
    where = [(d.name, i) for d in everything.data for i in range(d.geometry.size)]
    weights = scaled[:, asked]
    geometries = {d.name: d.geometry for d in everything.data}
    return Identification(
        problem=problem,
        absolute=absolute,
        relative=relative,
        stated="relative" if any(name.endswith(".amplitude") for name in problem.names) else "absolute",
        places=greedy(prior, weights[:rows], where[:rows], geometries, mine, x[asked], choose),
        extra=greedy(prior + weights[:rows].T @ weights[:rows], weights[rows:], where[rows:], geometries, mine, x[asked], choose),
        values=tuple(np.split(predicted, np.cumsum([d.geometry.size for d in everything.data])[:-1])[: len(problem.data)]),
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
    """What is known before any data: the sd of a uniform distribution between the bounds, in the natural scale."""
    low, high = parameter.low, parameter.high
    natural = float(natural_scales([parameter], np.array([parameter.init]))[0])
    return (math.log(high / low) if parameter.log else (high - low) / natural) / math.sqrt(12.0)
