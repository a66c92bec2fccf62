"""Double precision: what importing layerfit changes of JAX (and `compilation`, for calls on the CPU)."""

import os
import sys


def use_double_precision() -> None:
    """Switch JAX to 64 bits, unless the environment variable JAX_ENABLE_X64 has chosen already.

    A 32-bit answer would be a wrong answer here. JAX need not be imported for it, and is not.
    """
    if "JAX_ENABLE_X64" in os.environ:
        return
    if "jax" in sys.modules:
        sys.modules["jax"].config.update("jax_enable_x64", True)
    else:
        os.environ["JAX_ENABLE_X64"] = "1"
