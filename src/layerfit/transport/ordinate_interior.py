"""Light inside the sample in discrete ordinates: fluence at a depth, power absorbed in each layer."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..compilation import compiled
from ..errors import InputError
from ..measurement.geometry import Incidence, TotalReflectance
from ..scene.columns import Columns, to_columns
from ..scene.stack import Stack
from ..solver import Domain
from .discrete_ordinates import DiscreteOrdinates
from .matrix import Matrix
from .ordinate_stack import Grid, Layout, make_faces, make_grid, medium, pieces
from .response import Response, between, compose, compose_all, over, reflection


class Level(NamedTuple):
    """Light at one depth, per unit power that falls on the sample: fluence [1] and net flux downwards [1]."""

    fluence: Float[Array, ""]
    flux: Float[Array, ""]


def ordinate_fluence(solver: DiscreteOrdinates, stack: Stack, where: Sequence[tuple[int, float]], incidence: Incidence) -> Float[Array, "depths"]:
    """Fluence at depths given as (layer, depth within it), the unscattered beam included."""
    columns = to_columns(stack)
    found = jnp.zeros(len(where))
    for i in sorted({layer for layer, _ in where}):
        here = [j for j, (layer, _) in enumerate(where) if layer == i]
        inside = jnp.asarray([where[j][1] for j in here])
        cut = _cut(columns, i, inside[0])
        layout, cosine = _posed(solver, stack, cut, (*range(i + 1), *range(i, len(stack.layers))), incidence)
        found = found.at[jnp.asarray(here)].set(_fluences(layout, columns, i, inside, cosine))
    return found


def ordinate_absorbed(solver: DiscreteOrdinates, stack: Stack, incidence: Incidence) -> dict[str, float]:
    """Power absorbed in each layer, by layer name: the net flux that enters it less the one that leaves it."""
    columns = to_columns(stack)
    layout, cosine = _posed(solver, stack, columns, range(len(stack.layers)), incidence)
    flux = np.asarray(_fluxes(layout, columns, cosine))
    return {layer.name: float(flux[i] - flux[i + 1]) for i, layer in enumerate(stack.layers)}


def _posed(solver: DiscreteOrdinates, stack: Stack, columns: Columns, rows: Sequence[int], incidence: Incidence) -> tuple[Layout, float | None]:
    """Layout for columns whose rows are those layers of the stack, and the cosine of the beam (None: diffuse light)."""
    geometry = TotalReflectance(incidence=incidence)
    solver.check(stack, geometry)
    (layout,) = solver.layouts(Domain(stack, columns, columns), [geometry], rows)
    return layout, None if incidence == "diffuse" else float(geometry.cosines()[0][0])


def _cut(columns: Columns, i: int, z: Float[Array, ""]) -> Columns:
    """The same sample with layer i cut in two at depth z below its upper face."""

    def twice(values: Float[Array, "layers"]) -> Float[Array, "more"]:
        return jnp.concatenate([values[: i + 1], values[i:]])

    d = columns.thickness
    below = d[i : i + 1] - z  # none of a half space
    return replace(
        columns,
        sigma_a=twice(columns.sigma_a),
        sigma_s_prime=twice(columns.sigma_s_prime),
        g=twice(columns.g),
        n=twice(columns.n),
        thickness=jnp.concatenate([d[:i], z[None], below, d[i + 1 :]]),
        roughness=jnp.insert(columns.roughness, i + 1, 0.0),
        g_unknown=(*columns.g_unknown[: i + 1], *columns.g_unknown[i:]),
        smooth=(*columns.smooth[: i + 1], True, *columns.smooth[i + 1 :]),
    )


@compiled
def _fluences(layout: Layout, columns: Columns, i: int, inside: Float[Array, "depths"], cosine: float | None) -> Float[Array, "depths"]:
    grid, faces, incoming = _optics(layout, _cut(columns, i, inside[0]), cosine)  # the same for all depths

    def at(z: Float[Array, ""]) -> Float[Array, ""]:
        cut = _cut(columns, i, z)
        parts = pieces(layout, cut, medium(layout, cut), grid, faces, int(cosine is not None))
        return _level(compose_all(parts[: 2 * (i + 1)]), reflection(parts[2 * (i + 1) :]), i, grid, incoming).fluence

    return jax.lax.map(at, inside)


@compiled
def _fluxes(layout: Layout, columns: Columns, cosine: float | None) -> Float[Array, "faces"]:
    """Net flux into each layer, and at the lower end of the last one (0 of a half space)."""
    grid, faces, incoming = _optics(layout, columns, cosine)
    parts = pieces(layout, columns, medium(layout, columns), grid, faces, int(cosine is not None))
    upper = list(accumulate(parts, compose))
    lower = [parts[-1].R_above]
    for piece in reversed(parts[:-1]):
        lower.insert(0, over(piece, lower[0]))
    splits = [(2 * i + 1, i) for i in range(columns.count)] + ([] if columns.half_space else [(2 * columns.count, columns.count - 1)])
    flux = [_level(upper[split - 1], lower[split], i, grid, incoming).flux for split, i in splits]
    return jnp.stack([*flux, *([jnp.zeros(())] if columns.half_space else [])])


def _optics(layout: Layout, columns: Columns, cosine: float | None) -> tuple[Grid, tuple[Response[Matrix], ...], Float[Array, "c"]]:
    """Directions, faces, and the light that falls on the sample, of power 1."""
    beams = columns.n_above * np.sqrt([] if cosine is None else [1.0 - cosine**2])
    grid = make_grid(layout, columns, jnp.zeros(0), beams)
    root = grid.root[0]
    incoming = root / jnp.sum(root**2) if cosine is None else jnp.zeros(root.size + 1).at[-1].set(1.0)
    return grid, make_faces(columns, grid, layout, beams.size), incoming


def _level(upper: Response[Matrix], lower: Matrix, i: int, grid: Grid, incoming: Float[Array, "c"]) -> Level:
    """Light in layer i between the sample above it and what reflects below. Ordinates carry sqrt(W) I/n^2, beams their power (both over 2 pi)."""
    down = between(upper, lower).value[0] @ incoming
    up = lower.value[0] @ down
    beams = incoming.size - grid.root.shape[1]
    share = jnp.concatenate([grid.root[i + 1], jnp.ones(beams)])
    return Level(share / grid.mu[i + 1] @ (down + up), share @ (down - up))


def check_no_distance(r: object) -> None:
    """Raise InputError for a distance: there is no lateral resolution."""
    if r is not None:
        raise InputError("fluence: r was given with solver discrete-ordinates; allowed is r with solver layered-diffusion")
