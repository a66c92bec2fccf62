"""One name for the two kinds of array: NumPy's before anything is traced, JAX's from then on."""

from typing import TYPE_CHECKING, Any

import jax
import numpy as np

if TYPE_CHECKING:
    AnyArray = Any  # both do the same here; their stubs do not know
else:
    AnyArray = jax.Array | np.ndarray
