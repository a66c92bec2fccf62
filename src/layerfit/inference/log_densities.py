"""The log density of many positions: one compiled call, or two at once where a position costs much."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from ..arrays import AnyArray
from ..compilation import QUICK

LogDensity = Callable[[Float[Array, "p"]], Float[Array, ""]]

_WORTH_IT = 3e-3  # seconds of half a call above which two threads take one half each


@partial(jax.jit, static_argnums=0, **QUICK)
def _log_densities(
    rest: tuple[Any, ...], arrays: list[Any], x: Float[AnyArray, "m p"], first: Int[AnyArray, ""], last: Int[AnyArray, ""]
) -> Float[Array, "m"]:
    """Of positions first to last - 1, one after the other: as quick as in a batch, and solvers with small matrices are slow in batches."""
    structure, fixed = rest
    given = iter(arrays)
    density = jax.tree.unflatten(structure, [next(given) if leaf is None else leaf for leaf in fixed])
    return jax.lax.fori_loop(first, last, lambda i, found: found.at[i].set(density(x[i])), jnp.zeros(len(x)))


class LogDensities:
    """Log density of positions, (m, p) to (m,), the same m each time, so that it is compiled once."""

    def __init__(self, density: LogDensity):
        leaves, structure = jax.tree.flatten(density)
        self.rest = structure, tuple(None if eqx.is_array(leaf) else leaf for leaf in leaves)
        self.arrays = jax.device_put([leaf for leaf in leaves if eqx.is_array(leaf)])  # once, not in every call
        self.parts: int | None = None

    def __call__(self, x: np.ndarray) -> np.ndarray:
        if self.parts is None:
            self._some(x, 0, 0)  # compiles
            self.parts = 2 if min(self._seconds(x) for _ in range(3)) > _WORTH_IT else 1
        if self.parts == 1:
            return self._some(x, 0, len(x))
        half = len(x) // 2
        return np.concatenate(list(_POOL.map(lambda ends: self._some(x, *ends), [(0, half), (half, len(x))])))

    def _seconds(self, x: np.ndarray) -> float:
        began = time.perf_counter()
        self._some(x, 0, len(x) // 2)
        return time.perf_counter() - began

    def _some(self, x: np.ndarray, first: int, last: int) -> np.ndarray:
        return np.asarray(_log_densities(self.rest, self.arrays, x, np.asarray(first), np.asarray(last)))[first:last]


_POOL = ThreadPoolExecutor(2)
