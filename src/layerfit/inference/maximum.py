"""The maximum of a posterior density that is no sum of squares: box-bounded L-BFGS-B by jaxopt, its only home.

What is maximised is the likelihood times the density of each number per unit of it, or of its logarithm where its prior is flat or normal in that: as
in least squares, a normal prior pulls to its centre and a flat one nowhere. Slopes are taken forward (a handful of numbers), so that every solver
which can be fitted will do; the Hessian is the central difference of the slopes.
"""

import warnings
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..arrays import AnyArray
from ..compilation import compiled
from .model import Model
from .problem import Problem

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # that it is no longer developed
    from jaxopt import ScipyBoundedMinimize

_EDGE = 1e-5  # share of an interval that is left out at its ends
_STEP = 0.1  # of differences, in conditional standard deviations
_LARGEST = 1e-3  # of them, in shares
_NONE = 1e30  # value of what is not finite


class Maximum(NamedTuple):
    """Where a search ended: shares between the bounds, twice the negative logarithm of the density, steps, and whether it converged."""

    share: np.ndarray
    value: float
    steps: int
    converged: bool


@compiled
def _value_and_slope(model: Model, estimates_noise: bool, share: Float[AnyArray, "p"]) -> tuple[Float[Array, ""], Float[Array, "p"]]:
    """Negative logarithm of the density and its slope in shares."""

    def value(share: Float[Array, "p"]) -> Float[Array, ""]:
        x = model.coordinates.between(share)
        return -model.log_likelihood(x, estimates_noise=estimates_noise) - model.priors.log_mode(x)

    found, slope = jax.vmap(lambda t: jax.jvp(value, (jnp.asarray(share),), (t,)), out_axes=(None, 0))(jnp.eye(share.size))
    good = jnp.isfinite(found) & jnp.all(jnp.isfinite(slope))
    return jnp.where(good, found, _NONE), jnp.where(good, slope, 0.0)


def maximise(problem: Problem, share: np.ndarray, max_steps: int) -> Maximum:
    """Climb from a point, given in shares between the bounds."""
    function = partial(_value_and_slope, problem.model, problem.estimates_noise)
    options: dict[str, Any] = {"ftol": 1e-13, "gtol": 1e-7, "maxcor": 20, "maxls": 50}
    search = ScipyBoundedMinimize(method="L-BFGS-B", fun=function, value_and_grad=True, jit=False, maxiter=max_steps, options=options)
    ends = (np.full(share.size, _EDGE), np.full(share.size, 1.0 - _EDGE))
    found, state = search.run(jnp.clip(jnp.asarray(share), *ends), bounds=ends)
    # a line search that can gain nothing more within rounding is no failure
    done = bool(state.success) or int(state.iter_num) < max_steps
    value = float(state.fun_val)
    return Maximum(np.asarray(found), 2.0 * value if value < _NONE else np.inf, int(state.iter_num), done)


def root_of_hessian(problem: Problem, share: np.ndarray) -> np.ndarray:
    """A matrix (p, p) whose square, transposed from the left, is the Hessian of the negative log density in physical units: a Jacobian in its place.

    A direction along which the density hardly falls counts as open over the whole interval of its numbers.
    """
    share = np.clip(share, _EDGE, 1.0 - _EDGE)
    rough = _differences(problem, share, np.full(share.size, _LARGEST * _STEP))
    step = np.clip(_STEP / np.sqrt(np.maximum(np.diag(rough), 1e-300)), 1e-7, _LARGEST)
    values, axes = np.linalg.eigh(_differences(problem, share, step))
    slope = jax.jvp(problem.model.coordinates.between, (jnp.asarray(share),), (jnp.ones(share.size),))[1]
    return np.sqrt(np.maximum(values, 1.0))[:, None] * axes.T / np.asarray(slope)


def _differences(problem: Problem, share: np.ndarray, step: np.ndarray) -> np.ndarray:
    rows = []
    for i, h in enumerate(step):
        ends = [np.clip(share + sign * h * np.eye(share.size)[i], 0.0, 1.0) for sign in (1.0, -1.0)]
        slopes = [np.asarray(_value_and_slope(problem.model, problem.estimates_noise, end)[1]) for end in ends]
        rows.append((slopes[0] - slopes[1]) / (ends[0][i] - ends[1][i]))
    matrix = np.array(rows)
    return 0.5 * (matrix + matrix.T)
