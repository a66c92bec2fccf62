"""Levenberg-Marquardt as an optimistix solver.

Optimistix runs the iteration, keeps its outcome and its interface. The solver is ours because the one it ships solves by a QR of the whole
Jacobian and changes its damping by fixed factors: here the step solves the normal equations with Marquardt's scaling (a handful by a handful,
already scaled), the damping follows the ratio of actual to predicted gain continuously (Nielsen 1999), and steps bend with the residuals'
second derivative along them (geodesic acceleration: Transtrum and Sethna, arXiv:1201.5885 (2012)), which takes half the steps in the narrow,
curved valleys of layered samples. Nearly all steps are accepted then, so residuals and Jacobian are taken together, at every trial point.
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
from ..compilation import QUICK
from .model import Model

_LONGEST = 2.0  # largest step in one coordinate; the logistic map turns over on this scale
STALLED = 1e-14  # relative gain below which a step counts as none
_PROBE = 0.1  # share of a step at which its bending is measured
_MOST_BENT = 0.75  # longest correction by the bending, in steps
_FIRST_STEP_SIZE = 100.0
_FASTEST = 5.0  # growth of the step size after a good step, at most
COARSE = 1e4  # how much sooner the descent on logarithms stops, from which the other one goes on


class _State(eqx.Module):
    residual: Float[Array, "n"]
    jacobian: Float[Array, "n p"]
    first: Bool[Array, ""]
    step_size: Float[Array, ""]
    shrink: Float[Array, ""]
    stalled: Int[Array, ""]  # accepted steps in a row that gained nothing
    done: Bool[Array, ""]


class LevenbergMarquardt(optx.AbstractLeastSquaresSolver[Float[Array, "p"], Float[Array, "n"], None, _State]):
    """Stops when a step is small, or when two steps in a row gain nothing.

    rtol, atol : of a step in the coordinates, times options["coarse"]. A step that gains less than options["stalled"] of the sum of squares gains
    nothing. With options["linearise"] it stops where it starts, the Jacobian done.
    """

    rtol: float = 1e-9
    atol: float = 1e-9
    norm: Callable[[Any], Array] = eqx.field(default=optx.max_norm, static=True)

    def init(self, fn: Any, y: Any, args: Any, options: Any, f_struct: Any, aux_struct: Any, tags: Any) -> _State:
        one, no = jnp.array(1.0), jnp.array(False)
        residual = jnp.zeros(f_struct.shape, f_struct.dtype)
        jacobian = jnp.zeros((*f_struct.shape, y.size))
        return _State(residual, jacobian, ~no, _FIRST_STEP_SIZE * one, 2.0 * one, jnp.array(0), no)

    def step(self, fn: Any, y: Any, args: Any, options: Any, state: _State, tags: Any) -> tuple[Any, _State, None]:
        hessian, gradient = state.jacobian.T @ state.jacobian, state.jacobian.T @ state.residual
        scale = jnp.diag(hessian)
        scale = jnp.maximum(scale, 1e-12 * jnp.max(scale) + 1e-300)
        damped = hessian + jnp.diag(scale) / state.step_size
        straight = jnp.where(state.first, 0.0, jnp.linalg.solve(damped, -gradient))
        bend = jax.lax.cond(state.first, jnp.zeros_like, lambda straight: self._bend(fn, y, args, state, damped, scale, straight), straight)
        delta = jnp.clip(straight + bend, -_LONGEST, _LONGEST)
        trial = y + delta
        residual, jacobian = value_and_jacobian(lambda y: fn(y, args)[0], trial)

        before, after = jnp.sum(state.residual**2), jnp.sum(residual**2)
        predicted = before - jnp.sum((state.jacobian @ straight + state.residual) ** 2)
        gain = (before - after) / jnp.where(predicted > 0, predicted, 1.0)
        good = jnp.isfinite(after) & (predicted > 0) & (gain > 1e-4) & ~state.first
        accept = good | state.first

        grow = 1.0 / jnp.maximum(1.0 / _FASTEST, 1.0 - (2.0 * jnp.clip(gain, -1.0, 1.0) - 1.0) ** 3)
        step_size = jnp.where(state.first, state.step_size, state.step_size * jnp.where(good, grow, 1.0 / state.shrink))
        gained_nothing = good & (before - after <= options["stalled"] * before)
        stalled = jnp.where(accept, jnp.where(gained_nothing, state.stalled + 1, 0), state.stalled)
        settled = ~state.first & (self.norm(delta / (self.atol + self.rtol * jnp.abs(trial))) < options["coarse"])
        exhausted = (step_size < 1e-13) | (jnp.isfinite(after) & (after < 1e-24 * residual.size))
        return (
            jnp.where(accept, trial, y),
            _State(
                residual=jnp.where(accept, residual, state.residual),
                jacobian=jnp.where(accept, jacobian, state.jacobian),
                first=jnp.array(False),
                step_size=step_size,
                shrink=jnp.where(accept, 2.0, 2.0 * state.shrink),
                stalled=stalled,
                done=settled | exhausted | (stalled >= 2) | options["linearise"],
            ),
            None,
        )

    def _bend(self, fn: Any, y: Array, args: Any, state: _State, damped: Array, scale: Array, step: Float[Array, "p"]) -> Float[Array, "p"]:
        """Half the second-order correction of a step, 0 where it is too large to be believed."""
        ahead = fn(y + _PROBE * step, args)[0]
        second = 2.0 / _PROBE * ((ahead - state.residual) / _PROBE - state.jacobian @ step)
        correction = jnp.linalg.solve(damped, -state.jacobian.T @ second)
        believed = jnp.sum(scale * correction**2) <= _MOST_BENT**2 * jnp.sum(scale * step**2)
        return jnp.where(believed, 0.5 * correction, 0.0)

    def terminate(self, fn: Any, y: Any, args: Any, options: Any, state: _State, tags: Any) -> tuple[Bool[Array, ""], optx.RESULTS]:
        return state.done, optx.RESULTS.successful

    def postprocess(
        self, fn: Any, y: Any, aux: Any, args: Any, options: Any, state: _State, tags: Any, result: optx.RESULTS
    ) -> tuple[Any, None, dict[str, Any]]:
        return y, aux, {}


def value_and_jacobian(function: Callable[[Array], Array], y: Float[Array, "p"]) -> tuple[Float[Array, "n"], Float[Array, "n p"]]:
    """Value and forward-mode Jacobian of a function, all directions at a time."""
    return jax.vmap(lambda direction: jax.jvp(function, (y,), (direction,)), out_axes=(None, -1))(jnp.eye(y.size))


class Descent(eqx.Module):
    """Where runs ended; one row a run."""

    u: Float[AnyArray, "runs p"]
    x: Float[AnyArray, "runs p"]  # the same in physical units
    first: Float[AnyArray, "runs p"]  # where it began, in physical units
    slope: Float[AnyArray, "runs p"]  # dx/du
    residual: Float[AnyArray, "runs n"]
    jacobian: Float[AnyArray, "runs n p"]  # d residual/du
    steps: Int[AnyArray, "runs"]
    converged: Bool[AnyArray, "runs"]


def _stage(model: Model, u: Float[Array, "p"], logarithmic: Float[Array, ""], linearise: Bool[Array, ""], max_steps: int) -> optx.Solution:
    """One descent on logarithms (1.0) or on the residuals themselves (0.0)."""
    return optx.least_squares(
        lambda u, _: model.residuals(u, logarithmic),
        LevenbergMarquardt(),
        u,
        options={"linearise": linearise, "coarse": jnp.where(logarithmic > 0, COARSE, 1.0), "stalled": STALLED},
        max_steps=max_steps,
        throw=False,
    )


def _descend(model: Model, u: Float[AnyArray, "runs p"], count: Int[AnyArray, ""], linearise: Bool[AnyArray, ""], max_steps: int) -> Descent:
    """Runs from the first `count` rows of u, one after the other; the other rows of the result mean nothing.

    Each goes first for the logarithms of the data, then for the data; with linearise it only takes residuals and Jacobian where it starts.
    One loop around one descent: what costs is to compile it, and so it is compiled once for all uses.
    """

    def stage(number: Int[Array, ""], state: tuple[Array, ...]) -> tuple[Array, ...]:
        begin, start, steps, *_ = state
        begin = jnp.where(jnp.all(jnp.isfinite(begin)), begin, start)
        solution = _stage(model, begin, jnp.where(number == 0, 1.0, 0.0), linearise, max_steps)
        converged = solution.result == optx.RESULTS.successful
        return solution.value, start, steps + solution.stats["num_steps"], solution.state.residual, solution.state.jacobian, converged

    def run(i: Int[Array, ""], rows: tuple[Array, ...]) -> tuple[Array, ...]:
        blank = [jnp.zeros_like(row[0]) for row in rows[1:]]
        done = jax.lax.fori_loop(jnp.where(linearise, 1, 0), 2, stage, (u[i], u[i], *blank))
        return tuple(row.at[i].set(part) for row, part in zip(rows, (done[0], *done[2:]), strict=True))

    u = jnp.asarray(u)
    runs, p = u.shape
    n = model.rows
    empty = (jnp.zeros((runs, p)), jnp.zeros(runs, int), jnp.zeros((runs, n)), jnp.zeros((runs, n, p)), jnp.zeros(runs, bool))
    end, steps, residual, jacobian, converged = jax.lax.fori_loop(0, count, run, empty)
    x, slope = jax.jvp(model.coordinates.physical, (end,), (jnp.ones_like(end),))  # each number has its own coordinate
    return Descent(end, x, model.coordinates.physical(u), slope, residual, jacobian, steps, converged)


descend: Callable[..., Descent] = eqx.filter_jit(_descend, **QUICK)
