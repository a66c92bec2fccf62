"""Operators between many channels: the directions of discrete ordinates."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ..optics.linear_algebra import inverse
from .response import Operator


class Matrix(Operator):
    """A dense operator, with any leading axes (azimuthal orders)."""

    value: Float[Array, "*b c c"]

    def __matmul__(self, other: "Matrix") -> "Matrix":
        return Matrix(self.value @ other.value)

    def __add__(self, other: "Matrix") -> "Matrix":
        return Matrix(self.value + other.value)

    def __sub__(self, other: "Matrix") -> "Matrix":
        return Matrix(self.value - other.value)

    def bounce(self, other: "Matrix") -> "Matrix":
        return Matrix(inverse(self.one().value - self.value @ other.value))

    def one(self) -> "Matrix":
        return Matrix(jnp.broadcast_to(jnp.eye(self.value.shape[-1]), self.value.shape))

    def zero(self) -> "Matrix":
        return Matrix(jnp.zeros_like(self.value))
