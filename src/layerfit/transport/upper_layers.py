"""A stack cut off below the layers that can be seen."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..measurement.geometry import Geometry
from ..scene.columns import Columns
from ..scene.layer import HalfSpace
from ..scene.stack import Stack
from ..solver import Domain, Evaluation, Forward
from .layered_diffusion import LayeredDiffusion


class UpperLayersForward(Forward):
    """The model of a stack's upper layers, the last of them endless, as one of the whole stack. See `Forward`."""

    inner: Forward
    count: int = eqx.field(static=True)

    def __call__(self, columns: Columns, shifts: Sequence[Float[Array, ""] | None] | None = None) -> tuple[Array, ...]:
        return self.inner(upper_columns(columns, self.count), shifts)

    def run(self, columns: Columns) -> tuple[Array, ...]:
        return self.inner.run(upper_columns(columns, self.count))

    def error(self, columns: Columns) -> tuple[np.ndarray | None, ...] | None:
        return self.inner.error(upper_columns(columns, self.count))

    def evaluate(self, columns: Columns) -> Evaluation:
        return self.inner.evaluate(upper_columns(columns, self.count))


def upper_columns(columns: Columns, count: int) -> Columns:
    """The uppermost layers, the last of them endless."""
    layers = {name: getattr(columns, name)[:count] for name in ("sigma_a", "sigma_s_prime", "g", "n", "roughness", "g_unknown", "smooth")}
    return Columns(**layers, thickness=columns.thickness[: count - 1], n_above=columns.n_above, n_below=columns.n_below, half_space=True)


def upper_layers(stack: Stack, count: int) -> Stack:
    """The uppermost layers, the last of them endless."""
    last = stack.layers[count - 1]
    numbers = {name: getattr(last, name) for name in ("sigma_a", "sigma_s_prime", "g", "n", "roughness")}
    return Stack([*stack.layers[: count - 1], HalfSpace(last.name, **numbers)], n_above=stack.n_above)


def upper_domain(domain: Domain, count: int) -> Domain:
    """The same of all stacks of a domain."""
    return Domain(upper_layers(domain.stack, count), upper_columns(domain.low, count), upper_columns(domain.high, count))


def visible_layers(domain: Domain, geometries: Sequence[Geometry], share: np.ndarray | float) -> int:
    """How many layers, from the top, a model must hold.

    As few as change no value by more than a share of it, in the clearest and the densest stack of the domain, on whatever it allows beneath.
    Looked at by layered diffusion, which is good at light that has gone deep: all layers, where it cannot do the scene.
    share : of each value, one after the other, or of all.
    """
    stack, solver = domain.stack, LayeredDiffusion()
    total = len(stack.layers)
    if any(geometry.side == "below" for geometry in geometries) or total < 2 or solver.refusal(stack, geometries) is not None:
        return total
    low, high = domain.low, domain.high
    depth = np.cumsum(np.asarray(low.thickness) * np.asarray(low.sigma_tr)[: low.thickness.size])
    deep_enough = [count for count in range(1, total) if 2.0 * depth[count - 1] >= -np.log(np.max(share))]  # there and back
    if not deep_enough:
        return total
    shifts = [(0.0, 0.0)] * len(geometries)
    whole = solver.forward(domain, geometries, shifts)
    tops = (low, eqx.tree_at(lambda c: c.thickness, high, low.thickness))  # clear, and dense: light that goes round an absorbing layer
    for count in deep_enough:
        cut = solver.forward(upper_domain(domain, count), geometries, shifts)
        pairs = [(_values(whole, _joined(top, deep, count)), _values(cut, upper_columns(top, count))) for top in tops for deep in (low, high)]
        if all(np.all(np.abs(all_of - upper) <= share * np.abs(upper)) for all_of, upper in pairs):
            return count
    return total


def _values(forward: Forward, columns: Columns) -> np.ndarray:
    return np.concatenate([np.asarray(values) for values in forward.run(columns)])


def _joined(top: Columns, deep: Columns, count: int) -> Columns:
    """The upper layers of one stack on the lower ones of another."""
    return jax.tree.map(lambda a, b: a if np.ndim(a) == 0 else jnp.concatenate([a[:count], b[count:]]), top, deep)
