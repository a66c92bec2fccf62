"""Many descents side by side: other data, other starts, other numbers held, one compilation.

A few lanes step together; a lane whose descent has ended writes its row and takes the next one, so that no lane waits for a slow neighbour.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from ..arrays import AnyArray
from ..compilation import QUICK
from .least_squares import COARSE, Descent, LevenbergMarquardt
from .model import Model

# Steps below these no longer matter beside the noise: a gain of 1e-7 of a chi-square of 100 is 0.003 standard errors.
_COARSE = 1e3
_STALLED = 1e-7
_STALLED_FIRST = 1e-4  # on logarithms
_STALLED_FINE = 1e-15  # 1e-7 standard errors


class Rows(eqx.Module):
    """Descents to be done, one a row.

    u : starts. held : numbers that stay where they start. values, sd : data of each dataset, weights included.
    """

    u: Float[AnyArray, "rows p"]
    held: Bool[AnyArray, "rows p"]
    values: tuple[Float[AnyArray, "rows n"], ...]
    sd: tuple[Float[AnyArray, "rows n"], ...]


class _Lanes(eqx.Module):
    """What runs: the row of each lane (beyond the last where it rests), its stage (0: on logarithms, 1: on the residuals), point, state, steps."""

    row: Int[Array, "lanes"]
    stage: Int[Array, "lanes"]
    y: Float[Array, "lanes p"]
    state: Any
    steps: Int[Array, "lanes"]
    next_row: Int[Array, ""]
    found: tuple[Array, ...]  # u, residual, jacobian, steps, converged of finished rows


def _descend_many(
    model: Model,
    rows: Rows,
    count: Int[AnyArray, ""],
    first_stage: Int[AnyArray, ""],
    linearise: Bool[AnyArray, ""],
    fine: Bool[AnyArray, ""],
    max_steps: int,
    lanes: int,
) -> Descent:
    solver = LevenbergMarquardt()
    total, p = rows.u.shape
    rows = jax.tree.map(jnp.asarray, rows)

    def residuals(row: Int[Array, ""], stage: Int[Array, ""], y: Float[Array, "p"]) -> Float[Array, "n"]:
        mine = jax.tree.map(lambda column: column[jnp.minimum(row, total - 1)], rows)
        data = [part for pair in zip(mine.values, mine.sd, strict=True) for part in pair]
        here = eqx.tree_at(lambda m: [part for one in m.scatter for part in (one.values, one.sd)], model, data)
        return here.residuals(jnp.where(mine.held, mine.u, y), jnp.where(stage == 0, 1.0, 0.0))

    shape = jax.eval_shape(residuals, jnp.array(0), jnp.array(0), rows.u[0])

    def fresh(y: Float[Array, "p"]) -> Any:
        return solver.init(None, y, None, {}, shape, None, frozenset())

    def step(row: Array, stage: Array, y: Array, state: Any) -> tuple[Array, Any]:
        coarse, stalled = (COARSE, jnp.where(fine, 1.0, _COARSE)), (_STALLED_FIRST, jnp.where(fine, _STALLED_FINE, _STALLED))
        options = {"linearise": linearise, "coarse": jnp.where(stage == 0, *coarse), "stalled": jnp.where(stage == 0, *stalled)}
        y, state, _ = solver.step(lambda y, _: (residuals(row, stage, y), None), y, None, options, state, frozenset())
        return y, state

    def advance(lanes: _Lanes) -> _Lanes:
        y, state = jax.vmap(step)(lanes.row, lanes.stage, lanes.y, lanes.state)
        steps = lanes.steps + 1
        over = state.done | (steps >= jnp.where(lanes.stage == 0, 1, 2) * max_steps)
        ended = over & (lanes.stage == 1) & (lanes.row < total)
        at = jnp.where(ended, lanes.row, total)
        parts = (y, state.residual, state.jacobian, steps, state.done)
        found = tuple(column.at[at].set(part, mode="drop") for column, part in zip(lanes.found, parts, strict=True))
        taken = lanes.next_row + jnp.cumsum(ended) - 1
        row = jnp.where(ended, jnp.where(taken < count, taken, total), lanes.row)
        start = rows.u[jnp.minimum(row, total - 1)]
        lost = ~jnp.all(jnp.isfinite(y), axis=-1)
        y = jnp.where((ended | lost)[:, None], start, y)
        blank = jax.vmap(fresh)(y)
        state = jax.tree.map(lambda new, old: jnp.where(over.reshape(-1, *[1] * (old.ndim - 1)), new, old), blank, state)
        stage = jnp.where(ended, first_stage, jnp.where(over, 1, lanes.stage))
        return _Lanes(row, stage, y, state, jnp.where(ended, 0, steps), lanes.next_row + jnp.sum(ended), found)

    n = shape.shape[0]
    found = (jnp.zeros((total, p)), jnp.zeros((total, n)), jnp.zeros((total, n, p)), jnp.zeros(total, int), jnp.zeros(total, bool))
    row = jnp.arange(lanes)
    first = _Lanes(
        row=jnp.where(row < count, row, total),
        stage=jnp.full(lanes, 1) * first_stage,
        y=rows.u[:lanes],
        state=jax.vmap(fresh)(rows.u[:lanes]),
        steps=jnp.zeros(lanes, int),
        next_row=jnp.minimum(count, lanes),
        found=found,
    )
    done = jax.lax.while_loop(lambda lanes: jnp.any(lanes.row < total), advance, first)
    u, residual, jacobian, steps, converged = done.found
    x, slope = jax.jvp(model.coordinates.physical, (u,), (jnp.ones_like(u),))
    return Descent(u, x, model.coordinates.physical(rows.u), slope, residual, jacobian, steps, converged)


descend_many: Callable[..., Descent] = eqx.filter_jit(_descend_many, **QUICK)
"""Descents from the first `count` rows; the other rows of the result mean nothing.

Each begins at first_stage: 0 on logarithms, then on the data; 1 on the data alone. With linearise (and first_stage 1) only residuals and Jacobians
are taken where the rows start. With fine they go on until a step is nothing.
"""
