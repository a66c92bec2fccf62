"""How programs are compiled, and where they run."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.extend.core import get_opaque_trace_state

P = ParamSpec("P")
T = TypeVar("T")

# Programs for the CPU run where they are called. In a thread of their own, as JAX would have it, they only start later: a solver is called for its
# numbers, and waits for them. A small program takes 6 microseconds of 20 less. Where JAX has run something before, this changes nothing.
if "JAX_CPU_ENABLE_ASYNC_DISPATCH" not in os.environ:
    jax.config.update("jax_cpu_enable_async_dispatch", False)

# The older of XLA's two code generators compiles many small loops in half the time, and they run as fast.
_OLDER: dict[str, Any] = {"compiler_options": {"xla_cpu_use_fusion_emitters": False}}
# With little optimisation it is quicker still, and they run a tenth to a sixth slower: that pays where a program is compiled anew for each problem.
QUICK: dict[str, Any] = {"compiler_options": {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 1}}

with ThreadPoolExecutor(1) as _pool:  # no program is traced in a new thread, wherever this module is first imported
    _ALONE = _pool.submit(get_opaque_trace_state, convention="nnx").result()


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """A function compiled quickly where it is called by itself, and as a part of the program or the transformation that calls it elsewhere."""
    alone, inside = eqx.filter_jit(function, **_OLDER), eqx.filter_jit(function)

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        traced = get_opaque_trace_state(convention="nnx") != _ALONE  # a program with options cannot be part of another
        return inside(*args, **kwargs) if traced else alone(*args, **kwargs)

    return call


def at_once(*arrays: Array) -> list[Array]:
    """The same arrays, of any shapes, computed by one kernel: of small ones each kernel's start takes longer than its work.

    >>> import jax.numpy as jnp
    >>> [x.tolist() for x in at_once(jnp.ones(()), jnp.arange(4.0).reshape(2, 2))]
    [1.0, [[0.0, 1.0], [2.0, 3.0]]]
    """
    flat = jax.lax.optimization_barrier(jnp.concatenate([jnp.ravel(a) for a in arrays]))
    ends = np.cumsum([a.size for a in arrays])
    return [flat[end - a.size : end].reshape(a.shape) for end, a in zip(ends, arrays, strict=True)]
