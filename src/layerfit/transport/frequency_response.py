"""What a stack sends out at one spatial frequency under a pencil beam, by discrete ordinates."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..arrays import AnyArray
from ..scene.columns import Columns
from .crossing import Crossing, Fine, rays, rays_between
from .discrete_ordinates_layer import Directions, problem, scattering
from .frequency_layer import Closing, Sheet, all_orders, thick_layer, thin_layer
from .matrix import Matrix
from .once_scattered import Path, spectrum_of_ordinates
from .ordinate_stack import Grid, Layout, Medium
from .response import Nothing, Response, between, compose_all, reflection


class Steps(NamedTuple):
    """How often layers are doubled where they are thin, tripled elsewhere. thin : which layers may be clear."""

    thin: tuple[bool, ...]
    of_thin: int
    of_thick: int


class Sample(eqx.Module):
    """All that the spectrum needs of a stack and does not depend on k.

    collected : weight of each outgoing ordinate. faces : see `ordinate_stack.make_faces`. path : of light scattered once. fine : directions between
    the ordinates. open : layers that light crosses unscattered, so that these count.
    """

    sheets: tuple[Sheet, ...]
    faces: tuple[Response[Matrix], ...]
    collected: Float[Array, "n"]
    path: Path
    fine: Fine
    open: tuple[bool, ...] = eqx.field(static=True)
    half_space: bool = eqx.field(static=True)
    above: bool = eqx.field(static=True)


def make_sheets(columns: Columns, grid: Grid, numbers: Medium, layout: Layout) -> tuple[Sheet, ...]:
    """The matrices of all layers, top first, in 1/mm."""
    n = grid.root.shape[1]
    sheets = []
    for i in range(columns.count):
        directions = Directions(grid.mu[i + 1], grid.weight[i + 1], grid.root[i + 1])
        albedo, absorbed, moments, sigma = numbers.albedo[i], numbers.absorbed[i], numbers.moments[i], numbers.extinction[i]

        def posed(legendre, order, directions=directions, albedo=albedo, absorbed=absorbed, moments=moments):
            return problem(scattering(moments, legendre, directions, order, 1), directions, albedo, absorbed, order)

        all_of = jax.vmap(posed)(grid.legendre[i], jnp.arange(layout.orders, dtype=float))
        real, mu = grid.real[i + 1][:n], grid.mu[i + 1][:n]
        g = moments[1]
        sheets.append(
            Sheet(
                P=sigma * all_of.P,
                M=sigma * all_of.M,
                p=sigma * all_of.p[0, :, 0],
                q=sigma * all_of.q[0, :, 0],
                rate=sigma * all_of.rate[0, 0],
                tangent=jnp.where(real, jnp.sqrt(1.0 - jnp.where(real, mu, 0.5) ** 2) / mu, 0.0),
                depth=columns.thickness[i] if i < columns.thickness.shape[0] else jnp.zeros(()),
                decay=sigma**2 * jnp.minimum(3.0 * absorbed * (1.0 - albedo * g), 1.0),
            )
        )
    return tuple(sheets)


def _whole(face: Response[Matrix], orders: int) -> Response[Matrix]:
    """A face over all orders and the beam."""

    def one(operator: Matrix) -> Matrix:
        value = operator.value
        n = value.shape[-1] - 1
        square = all_orders(value[:, :n, :n])
        column = jnp.concatenate([value[0, :n, n], jnp.zeros((orders - 1) * n)])
        row = jnp.concatenate([jnp.zeros(orders * n), value[0, n, n][None]])
        return Matrix(jnp.concatenate([jnp.concatenate([square, column[:, None]], axis=1), row[None]], axis=0))

    return Response(*(one(operator) for operator in (face.R_above, face.R_below, face.T_down, face.T_up)))


def _crossings(sample: Sample, k: Float[Array, ""], closing: Closing) -> list[Crossing]:
    """Of the finite layers, top first."""
    path, orders = sample.path, sample.sheets[0].P.shape[0]
    return [
        Crossing(
            rays(k, path.out[i], path.tangent[i], depth, closing),
            rays_between(sample.fine, i, k, path.beam[i], depth, orders) if sample.open[i] else None,
        )
        for i, depth in enumerate(path.thickness)
    ]


def _layers(sample: Sample, k: Float[Array, ""], share: AnyArray, steps: Steps, crossings: list[Crossing]) -> list[tuple[Matrix, Matrix]]:
    """R and T of all layers, top first; those of a kind side by side."""
    kinds = [np.flatnonzero(np.array(steps.thin) == kind) for kind in (True, False)]
    deep = np.zeros(len(sample.sheets))
    deep[-1] = float(sample.half_space)

    def of(kind: np.ndarray) -> Sheet:
        return jax.tree.map(lambda *rows: jnp.stack(rows), *(sample.sheets[i] for i in kind))

    found: dict[int, tuple[Array, Array]] = {}
    if kinds[0].size:
        R, T = jax.vmap(lambda sheet: thin_layer(sheet, k, share, steps.of_thin))(of(kinds[0]))
        found |= {int(i): (R[j], T[j]) for j, i in enumerate(kinds[0])}
    if kinds[1].size:
        R, T = jax.vmap(lambda sheet, deep: thick_layer(sheet, k, share, steps.of_thick, deep))(of(kinds[1]), deep[kinds[1]])
        found |= {int(i): (R[j], T[j]) for j, i in enumerate(kinds[1])}
    for i, crossing in enumerate(crossings):
        R, T = found[i]
        found[i] = R, T.at[:-1, :-1].add(crossing.lacking())
    return [(Matrix(R), Matrix(T)) for R, T in (found[i] for i in range(len(sample.sheets)))]


def seen(sample: Sample, k: Float[Array, ""], share: AnyArray, steps: Steps, crossings: list[Crossing]) -> Float[Array, "c"]:
    """What a beam of power 1 sends out into all directions, orders and the beam, the first-surface reflection left out.

    From the bottom up, with one loop over faces and layers, all alike: a program of the same length for any number of layers.
    """
    orders = sample.sheets[0].P.shape[0]
    parts = []
    for i, (R, T) in enumerate(_layers(sample, k, share, steps, crossings)):
        if not isinstance(sample.faces[i], Nothing) or i == 0:
            parts.append(_whole(sample.faces[i], orders))
        parts.append(Response(R, R, T, T))
    if not sample.half_space:
        parts.append(_whole(sample.faces[-1], orders))

    def add(state, piece):
        R, T = state
        down = between(piece, R)
        return (piece.R_above + piece.T_up @ R @ down, None if sample.above else T @ down), None

    stacked = jax.tree.map(lambda *rows: jnp.stack(rows), *reversed(parts[:-1]))
    R, T = jax.lax.scan(add, (parts[-1].R_above, None if sample.above else parts[-1].T_down), stacked)[0]
    return (R - parts[0].R_above if T is None else T).value[:, -1]


def scattered_often(sample: Sample, k: Float[Array, ""], closing: Closing, steps: Steps) -> Float[Array, ""]:
    """What leaves one side at spatial frequency k without the beam itself and the light that was scattered once and left straight away."""
    crossings = _crossings(sample, k, closing)
    all_light = sample.collected @ seen(sample, k, closing.share, steps, crossings)[: sample.collected.shape[0]]
    return all_light - spectrum_of_ordinates(sample.path, k, closing, crossings)


def unscattered(sample: Sample) -> Float[Array, ""]:
    """The beam where it leaves: share of it that was never scattered, the first-surface reflection left out."""
    parts = []
    for i, sheet in enumerate(sample.sheets):
        parts.append(beam_face(sample.faces[i]))
        deep = sample.half_space and i == len(sample.sheets) - 1
        T = Matrix((jnp.zeros(()) if deep else jnp.exp(-sheet.rate * sheet.depth))[None, None])
        parts.append(Response(T.zero(), T.zero(), T, T))
    if not sample.half_space:
        parts.append(beam_face(sample.faces[-1]))
    if sample.above:
        return (reflection(parts).value - parts[0].R_above.value)[0, 0]
    return compose_all(parts).T_down.value[0, 0]


def beam_face(face: Response[Matrix]) -> Response[Matrix]:
    """A face for the beam alone."""
    return Response(*(Matrix(operator.value[0, -1:, -1:]) for operator in (face.R_above, face.R_below, face.T_down, face.T_up)))


def at_frequencies(
    value: Callable[[Sample, Float[Array, ""], Closing], Float[Array, ""]], sample: Sample, k: Float[AnyArray, "k"], closing: Closing, block: int
) -> Float[Array, "k"]:
    """A value such as `scattered_often` at many frequencies, a block of them at a time.

    The derivative is taken in reverse, once for each frequency, whatever the number of directions asked for afterwards.
    """
    numbers, fixed = eqx.partition(sample, lambda x: jnp.issubdtype(jnp.result_type(x), jnp.floating) and jnp.size(x) > 0)
    leaves, structure = jax.tree.flatten(numbers)
    others, rest = jax.tree.flatten(fixed)  # constants: no derivative is asked of them, but they may be traced

    def at(leaves: list[Array], others: list[Array], k: tuple[Float[Array, ""], Closing]) -> Float[Array, ""]:
        return value(eqx.combine(jax.tree.unflatten(structure, leaves), jax.tree.unflatten(rest, others)), *k)

    @jax.custom_jvp
    def evaluate(leaves: list[Array], others: list[Array], k: tuple[Float[Array, "k"], Closing]) -> Float[Array, "k"]:
        return jax.lax.map(lambda k: at(leaves, others, k), k, batch_size=block)

    @evaluate.defjvp
    def rule(primals, tangents):
        leaves, others, k = primals
        value, gradient = jax.lax.map(lambda k: jax.value_and_grad(at)(leaves, others, k), k, batch_size=block)
        change = [jnp.tensordot(g, t, np.ndim(t)) for g, t in zip(gradient, tangents[0], strict=True)]
        return value, sum(change, jnp.zeros_like(value))

    return evaluate(leaves, others, jax.lax.stop_gradient((jnp.asarray(k), Closing(*map(jnp.asarray, closing)))))
