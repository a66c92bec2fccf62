"""Radius of a spot or a fibre as a free number.

The quadratures of a forward model are laid out for one geometry, before anything is traced. So the model is laid out for several radii within the
bounds, and a prediction is the polynomial through them: values are smooth, even functions of a radius, so Chebyshev nodes in its square serve.
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..arrays import AnyArray
from ..errors import InputError
from ..measurement.dataset import Dataset
from ..measurement.geometry import Geometry, Radial
from .parameters import SIZES, FreeParameter

_NODES = 6


class Size(eqx.Module):
    """Of one dataset: the index of its free radius (None: it has none), nodes in the square of the radius and their barycentric weights."""

    index: int | None = eqx.field(static=True)
    nodes: Float[AnyArray, "nodes"]
    weights: Float[AnyArray, "nodes"]

    @property
    def count(self) -> int:
        """Geometries that stand for the dataset."""
        return 1 if self.index is None else self.nodes.size

    def at(self, x: Float[Array, "p"], values: Sequence[Array]) -> Array:
        """Predicted values at free numbers x, from those of each geometry."""
        if self.index is None:
            return values[0]
        gap = x[self.index] ** 2 - self.nodes
        terms = self.weights / jnp.where(jnp.abs(gap) < 1e-14, 1e-14, gap)
        return jnp.tensordot(terms / jnp.sum(terms), jnp.stack(values), axes=1)


def free_size(dataset: Dataset, parameters: Sequence[FreeParameter]) -> tuple[Size, tuple[Geometry, ...]]:
    """The free radius of a dataset, and the geometries to be laid out. Raises InputError for two free radii, or one that a geometry cannot have."""
    free = [(i, p) for i, p in enumerate(parameters) if p.name in {f"{dataset.name}.{name}" for name in SIZES}]
    if not free:
        return Size(None, np.zeros(0), np.zeros(0)), (dataset.geometry,)
    if len(free) > 1:
        raise InputError(f"'{free[0][1].name}' and '{free[1][1].name}' are both free; the data see one spread of both, allowed is one of them")
    index, parameter = free[0]
    angle = np.pi * (np.arange(_NODES) + 0.5) / _NODES
    low, high = parameter.low**2, parameter.high**2
    nodes = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(angle)
    assert isinstance(dataset.geometry, Radial)
    geometries = tuple(dataset.geometry.sized(**{parameter.name.rsplit(".", 1)[1]: float(np.sqrt(node))}) for node in nodes)
    return Size(index, nodes, (-1.0) ** np.arange(_NODES) * np.sin(angle)), geometries
