"""Levenberg-Marquardt as an optimistix solver.

Optimistix runs the iteration, keeps its outcome and its interface. The solver is ours because the one it ships linearises at every trial point,
rejected ones included, and solves by a QR of the whole Jacobian: here the Jacobian is taken where a step was accepted only, the step solves
the normal equations with Marquardt's scaling (a handful by a handful, already scaled), and the damping follows the ratio of actual to predicted
gain continuously (Nielsen 1999), which needs a third of the steps.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax import Array
from jaxtyping import Bool, Float, Int

from ..arrays import AnyArray
from .model import Model

_LONGEST = 2.0  # largest step in one coordinate; the logistic map turns over on this scale
_STALLED = 1e-9  # relative gain below which a step counts as none


class _State(eqx.Module):
    residual: Float[Array, "n"]
    jacobian: Float[Array, "n p"]
    first: Bool[Array, ""]
    step_size: Float[Array, ""]
    shrink: Float[Array, ""]
    stalled: Int[Array, ""]  # accepted steps in a row that gained nothing
    done: Bool[Array, ""]


class LevenbergMarquardt(optx.AbstractLeastSquaresSolver[Float[Array, "p"], Float[Array, "n"], None, _State]):
    """Stops when a step changes neither coordinates nor residuals, or when two steps in a row gain nothing.

    rtol, atol : of the coordinates and of the residuals. With options["linearise"] it stops where it starts, the Jacobian done.
    """

    rtol: float = 1e-10
    atol: float = 1e-12
    norm: Callable[[Any], Array] = eqx.field(default=optx.max_norm, static=True)

    def init(self, fn: Any, y: Any, args: Any, options: Any, f_struct: Any, aux_struct: Any, tags: Any) -> _State:
        one, no = jnp.array(1.0), jnp.array(False)
        residual = jnp.zeros(f_struct.shape, f_struct.dtype)
        jacobian = jnp.zeros((*f_struct.shape, y.size))
        return _State(residual, jacobian, ~no, one, 2.0 * one, jnp.array(0), no)

    def step(self, fn: Any, y: Any, args: Any, options: Any, state: _State, tags: Any) -> tuple[Any, _State, None]:
        hessian, gradient = state.jacobian.T @ state.jacobian, state.jacobian.T @ state.residual
        scale = jnp.diag(hessian)
        scale = jnp.maximum(scale, 1e-12 * jnp.max(scale) + 1e-300)
        delta = jnp.linalg.solve(hessian + jnp.diag(scale) / state.step_size, -gradient)
        delta = jnp.where(state.first, 0.0, jnp.clip(delta, -_LONGEST, _LONGEST))
        trial = y + delta
        residual = fn(trial, args)[0]

        before, after = jnp.sum(state.residual**2), jnp.sum(residual**2)
        predicted = before - jnp.sum((state.jacobian @ delta + state.residual) ** 2)
        gain = (before - after) / jnp.where(predicted > 0, predicted, 1.0)
        good = jnp.isfinite(after) & (predicted > 0) & (gain > 1e-4) & ~state.first
        accept = good | state.first
        jacobian = jax.lax.cond(accept, lambda trial: jax.jacfwd(lambda y: fn(y, args)[0])(trial), lambda _: state.jacobian, trial)

        grow = 1.0 / jnp.maximum(0.2, 1.0 - (2.0 * jnp.clip(gain, -1.0, 1.0) - 1.0) ** 3)
        step_size = jnp.where(state.first, state.step_size, state.step_size * jnp.where(good, grow, 1.0 / state.shrink))
        gained_nothing = good & (before - after <= _STALLED * before)
        stalled = jnp.where(accept, jnp.where(gained_nothing, state.stalled + 1, 0), state.stalled)
        settled = good & self._small(delta, trial) & self._small(residual - state.residual, residual)
        exhausted = (step_size < 1e-13) | (jnp.isfinite(after) & (after < 1e-24 * residual.size))
        return (
            jnp.where(accept, trial, y),
            _State(
                residual=jnp.where(accept, residual, state.residual),
                jacobian=jacobian,
                first=jnp.array(False),
                step_size=step_size,
                shrink=jnp.where(accept, 2.0, 2.0 * state.shrink),
                stalled=stalled,
                done=settled | exhausted | (stalled >= 2) | options["linearise"],
            ),
            None,
        )

    def _small(self, change: Array, size: Array) -> Bool[Array, ""]:
        return self.norm(change / (self.atol + self.rtol * jnp.abs(size))) < 1.0

    def terminate(self, fn: Any, y: Any, args: Any, options: Any, state: _State, tags: Any) -> tuple[Bool[Array, ""], optx.RESULTS]:
        return state.done, optx.RESULTS.successful

    def postprocess(
        self, fn: Any, y: Any, aux: Any, args: Any, options: Any, state: _State, tags: Any, result: optx.RESULTS
    ) -> tuple[Any, None, dict[str, Any]]:
        return y, aux, {}


class Descent(eqx.Module):
    """Where one run ended."""

    u: Float[Array, "p"]
    x: Float[Array, "p"]  # the same in physical units
    first: Float[Array, "p"]  # where it began, in physical units
    slope: Float[Array, "p"]  # dx/du
    residual: Float[Array, "n"]
    jacobian: Float[Array, "n p"]  # d residual/du
    steps: Int[Array, ""]
    result: optx.RESULTS


@eqx.filter_jit
def _residuals(model: Model, u: Float[Array, "p"], logarithmic: Float[Array, ""]) -> Float[Array, "n"]:
    """Traced once: the solver above asks for it several times."""
    return model.residuals(u, logarithmic)


def _descend(model: Model, u: Float[AnyArray, "p"], logarithmic: Float[AnyArray, ""], max_steps: int, linearise: Bool[AnyArray, ""]) -> Descent:
    """One run from u, on logarithms (1.0) or on the residuals themselves (0.0); with linearise only the residuals and Jacobian at u."""
    options = {"linearise": linearise}
    solution = optx.least_squares(
        lambda u, _: _residuals(model, u, logarithmic), LevenbergMarquardt(), u, options=options, max_steps=max_steps, throw=False
    )
    x, slope = jax.jvp(model.coordinates.physical, (solution.value,), (jnp.ones_like(u),))  # each number has its own coordinate
    return Descent(
        solution.value,
        x,
        model.coordinates.physical(u),
        slope,
        solution.state.residual,
        solution.state.jacobian,
        solution.stats["num_steps"],
        solution.result,
    )


# The older of XLA's two code generators compiles these many small loops in half the time, and they run as fast.
_OPTIONS: dict[str, Any] = {"compiler_options": {"xla_cpu_use_fusion_emitters": False}}
descend: Callable[..., Descent] = eqx.filter_jit(_descend, **_OPTIONS)
