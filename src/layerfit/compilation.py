"""How programs are compiled."""

from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer

P = ParamSpec("P")
T = TypeVar("T")

# The older of XLA's two code generators, with little optimisation, compiles many small loops in less than half the time; they run as fast
# (transport within a sixth).
QUICK: dict[str, Any] = {"compiler_options": {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 1}}


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """A function compiled quickly where it is called by itself, and as a part of the program or the transformation that calls it elsewhere."""
    alone, inside = eqx.filter_jit(function, **QUICK), eqx.filter_jit(function)

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        traced = any(isinstance(x, Tracer) for x in (jnp.zeros(()), *jax.tree.leaves((args, kwargs))))  # all that is made in a program is traced
        return inside(*args, **kwargs) if traced else alone(*args, **kwargs)  # a program with options cannot be part of another

    return call
