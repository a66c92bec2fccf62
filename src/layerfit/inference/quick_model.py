"""A problem's model made cheap for many evaluations."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..arrays import AnyArray
from ..compilation import compiled
from ..measurement.geometry import Geometry, Radial
from ..transport.fewer_frequencies import fewer_frequencies
from ..transport.spectral import SpectralForward
from .density import Density
from .log_densities import LogDensities
from .model import Model, Sample, Scene
from .parameters import spread_shares
from .problem import Problem

_SAMPLES = 256  # stacks that a model of fewer frequencies is made from
_LOOKED_AT = 31  # of them, at which densities are compared
_NOTICED = 1e-3  # difference of log densities at the fit,
_FAR = 1e-6  # and share of how far below it a place lies


def is_spectral(model: Model) -> bool:
    """Whether all that it predicts is computed at spatial frequencies and brought together by one quadrature."""
    return all(isinstance(sample, Sample) and isinstance(sample.forward, SpectralForward) for sample in model.samples)


@compiled
def _columns(scene: Scene, x: Float[AnyArray, "m p"]) -> Any:
    return jax.lax.map(scene.columns, jnp.asarray(x))


def quick_model(problem: Problem, least: Float[np.ndarray, "n"] | None = None) -> Model:
    """The problem's own model where its solver has no cheaper equal; otherwise one of fewer frequencies.

    That one agrees on stacks between the bounds (see `transport.fewer_frequencies`) to where it matters, a small part of the least of the data.
    least : the smallest size that each value has (default: the problem's own).
    """
    model = problem.model
    if not is_spectral(model) or not any(isinstance(g, Radial) for sample in model.samples for g in _geometries(sample)):
        return model
    least = np.concatenate([np.abs(d.values) for d in problem.data]) if least is None else least
    parts = np.split(least, np.cumsum([d.geometry.size for d in problem.data])[:-1])
    floors = iter(np.maximum(part, 1e-6 * np.max(part)) for part in parts)
    x = _spread(problem, _SAMPLES)
    cheap = []
    for sample in model.samples:
        assert isinstance(sample, Sample) and isinstance(sample.forward, SpectralForward)
        mine = [floor for size in sample.sizes for floor in [next(floors)] * size.count]
        cheap.append(fewer_frequencies(sample.forward, _columns(sample.scene, x), mine))
    return eqx.tree_at(lambda m: [sample.forward for sample in m.samples], model, cheap)


def _geometries(sample: Any) -> tuple[Geometry, ...]:
    """Of a spectral model's sample. Only distances need more frequencies than values."""
    return sample.forward.geometries


def quick_density(problem: Problem, x: Float[np.ndarray, "p"]) -> Density:
    """The posterior density by the quick model, or by the problem's own where the two can be told apart.

    x : numbers of the best fit. Both are compared there and at points between the bounds.
    """
    exact = Density(problem)
    model = quick_model(problem)
    if model is problem.model:
        return exact
    quick = eqx.tree_at(lambda density: density.model, exact, model)
    points = np.concatenate([x[None], _spread(problem, _LOOKED_AT)])
    known, found = LogDensities(exact)(points), LogDensities(quick)(points)
    somewhere = np.isfinite(known)
    allowed = _NOTICED + _FAR * np.abs(known[0] - known[somewhere])
    return quick if somewhere[0] and np.all(np.abs(found - known)[somewhere] <= allowed) else exact


def _spread(problem: Problem, count: int) -> Float[np.ndarray, "m p"]:
    """Points between the bounds."""
    places = spread_shares(len(problem.parameters), count, 0).tolist()
    return np.array([[p.at(s) for p, s in zip(problem.parameters, row, strict=True)] for row in places])
