"""How programs are compiled."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
from jax.extend.core import get_opaque_trace_state

P = ParamSpec("P")
T = TypeVar("T")

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
