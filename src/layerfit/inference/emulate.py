"""A problem whose slow model is replaced by Chebyshev polynomials between the bounds, with the largest error seen."""

from collections.abc import Callable, Sequence
from itertools import product
from math import prod
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from ..arrays import AnyArray
from ..errors import InputError
from .batch import predictions_at
from .model import Model
from .parameters import spread_shares
from .problem import Problem

_PROBED = 33  # nodes along each number, on lines through a few places
_LINES = 4
_SAFER = 0.2  # share of the tolerance to which terms are left out
_MORE = 1.35  # growth of the degrees where the error is still too large
_TRIES = 3
_CHECKED = 128  # stacks at which the error is looked at
_LARGEST = 40_000  # predictions that are made at most


class Emulated(Model):
    """A model whose predictions are polynomials in the positions of its numbers between the bounds, or exponentials of them where they are positive.

    coefficients : for each dataset, one axis a number and values last. error : largest relative error seen.
    """

    cheap: ClassVar[bool] = True
    coefficients: tuple[Float[AnyArray, "*degrees n"], ...]
    logarithmic: tuple[Bool[AnyArray, "n"], ...]
    error: float = eqx.field(static=True)

    def __init__(self, model: Model, coefficients: Sequence[np.ndarray], logarithmic: Sequence[np.ndarray], error: float):
        for name in ("samples", "coordinates", "scatter", "priors", "nuisance", "error_scale", "priors_join"):
            setattr(self, name, getattr(model, name))
        self.coefficients, self.logarithmic, self.error = tuple(coefficients), tuple(logarithmic), error

    def predict(self, x: Float[Array, "p"]) -> tuple[Float[Array, "n"], ...]:
        c = self.coordinates
        share = (jnp.where(c.log, jnp.log(jnp.where(c.log, x, 1.0)), x) - c.low) / (c.high - c.low)
        t = jnp.clip(2.0 * share - 1.0, -1.0, 1.0)
        angle = jnp.arccos(jnp.clip(t, -1.0 + 1e-12, 1.0 - 1e-12))
        found = []
        for coefficients, log in zip(self.coefficients, self.logarithmic, strict=True):
            value = jnp.asarray(coefficients)
            for i in range(value.ndim - 1):  # the first axis of what is left
                value = jnp.tensordot(jnp.cos(angle[i] * np.arange(value.shape[0])), value, 1)
            found.append(jnp.where(log, jnp.exp(jnp.where(log, value, 0.0)), value))
        return tuple(found)


def emulate(problem: Problem, *, tolerance: float = 1e-3, on_predictions: Callable[[int, int], None] | None = None) -> Problem:
    """The same problem with predictions by polynomials: for maps, and whatever else asks for them by the hundred thousand.

    Chebyshev polynomials in all numbers together, of degrees that are found along lines between the bounds; predictions are made by the problem's own
    solver at all nodes. The largest relative error at 128 stacks between the bounds is looked at, and kept as ``result.model.error``.

    Arguments
    ---------
    tolerance : relative error that is allowed. on_predictions : called with (made, to be made) as degrees are chosen.

    Raises InputError where that is not reached with 40,000 predictions: narrower bounds or fewer free numbers may do.

    References
    ----------
    L. N. Trefethen, Approximation Theory and Approximation Practice (2013), chapters 3 and 4.

    >>> import layerfit as lf
    >>> skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.01, sigma_s_prime=1, n=1.4)])
    >>> camera = lf.SpatialFrequency(fx=[0, 0.1])
    >>> data = lf.Dataset(camera, [0.6, 0.2], noise=lf.Noise(relative=0.02))
    >>> free = {"skin.sigma_a": (1e-3, 0.1), "skin.sigma_s_prime": (0.5, 5)}
    >>> quick = lf.emulate(lf.Problem(skin, data, free=free, solver=lf.LayeredDiffusion()))
    >>> quick.model.error <= 1e-3
    True
    """
    if not tolerance > 0:
        raise InputError(f"tolerance = {tolerance!r}; allowed is a number above 0")
    p = len(problem.parameters)
    degrees = _degrees(problem, tolerance)
    checks = _points(problem, spread_shares(p, _CHECKED, 3))
    known = predictions_at(problem.model, checks)
    model = None
    for _ in range(_TRIES):
        count = prod(d + 1 for d in degrees)
        if count > _LARGEST:
            break
        if on_predictions:
            on_predictions(0, count)
        model = _made(problem, degrees, checks, known)
        if model.error <= tolerance:
            return eqx.tree_at(lambda one: one.model, problem, model)
        degrees = [int(np.ceil(_MORE * d)) for d in degrees]
    reached = f"polynomials of degrees {', '.join(map(str, degrees))} have too many terms" if model is None else f"they err by {model.error:.2g}"
    raise InputError(f"emulate: tolerance = {tolerance:g} is not reached with {_LARGEST} predictions: {reached}; allowed are narrower bounds")


def _points(problem: Problem, share: np.ndarray) -> np.ndarray:
    return np.array([[q.at(float(s)) for q, s in zip(problem.parameters, row, strict=True)] for row in share])


def _nodes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Chebyshev nodes as shares, and the matrix from values there to coefficients."""
    angle = np.pi * (np.arange(count) + 0.5) / count
    values = np.cos(np.outer(np.arange(count), angle))
    return 0.5 * (1.0 + np.cos(angle)), values * (2.0 - (np.arange(count)[:, None] == 0)) / count


def _logarithms(values: np.ndarray, log: np.ndarray) -> np.ndarray:
    return np.where(log, np.log(np.where(log, values, 1.0)), values)


def _degrees(problem: Problem, tolerance: float) -> list[int]:
    """Degrees beyond which terms along single numbers no longer matter."""
    p = len(problem.parameters)
    nodes, to_terms = _nodes(_PROBED)
    lines = 0.1 + 0.8 * spread_shares(p, _LINES, 7)
    degrees = []
    for i in range(p):
        share = np.repeat(lines, _PROBED, axis=0)
        share[:, i] = np.tile(nodes, _LINES)
        least = 2
        for values in predictions_at(problem.model, _points(problem, share)):
            log = np.all(values > 0, axis=0)
            shape = _logarithms(values, log).reshape(_LINES, _PROBED, -1)
            scale = np.where(log, 1.0, np.max(np.abs(values), axis=0) + 1e-300)
            terms = np.max(np.abs(np.einsum("tn,lnv->ltv", to_terms, shape)) / scale, axis=(0, 2))
            left = np.cumsum(terms[::-1])[::-1]  # of all from each degree on
            least = max(least, int(np.argmax(left <= _SAFER * tolerance)) if np.any(left <= _SAFER * tolerance) else _PROBED - 1)
        degrees.append(least)
    return degrees


def _made(problem: Problem, degrees: Sequence[int], checks: np.ndarray, known: tuple[np.ndarray, ...]) -> Emulated:
    axes = [_nodes(d + 1) for d in degrees]
    x = _points(problem, np.array(list(product(*(nodes for nodes, _ in axes)))))
    coefficients, logarithmic = [], []
    for values, looked_at in zip(predictions_at(problem.model, x), known, strict=True):
        log = np.all(values > 0, axis=0) & np.all(looked_at > 0, axis=0)
        shape = _logarithms(values, log).reshape(*(d + 1 for d in degrees), -1)
        for i, (_, to_terms) in enumerate(axes):
            shape = np.moveaxis(np.tensordot(to_terms, shape, (1, i)), 0, i)
        coefficients.append(shape)
        logarithmic.append(log)
    model = Emulated(problem.model, coefficients, logarithmic, 0.0)
    found = predictions_at(model, checks)
    error = max(float(np.max(np.abs(a - b) / np.where(np.abs(b) > 0, np.abs(b), 1.0))) for a, b in zip(found, known, strict=True))
    return Emulated(problem.model, coefficients, logarithmic, error if np.isfinite(error) else np.inf)
