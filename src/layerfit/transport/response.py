"""The response of a piece of sample, and how two of them compose.

Whatever the solver, a horizontally uniform piece is, at one spatial frequency, four linear operators. Stacking two pieces is the Redheffer
star product; with one channel it is the frequency-space Kubelka-Munk composition of Donner & Jensen 2005, eqs 21 and 22.
"""

from abc import abstractmethod
from collections.abc import Sequence
from functools import reduce
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float


class Operator(eqx.Module):
    """A linear map between the channels of light on two faces, for each spatial frequency."""

    @abstractmethod
    def __matmul__(self, other: Any) -> Any:
        """First other, then self."""

    @abstractmethod
    def __add__(self, other: Any) -> Any: ...

    @abstractmethod
    def __sub__(self, other: Any) -> Any: ...

    @abstractmethod
    def bounce(self, other: Any) -> Any:
        """(1 - self other)^-1: all reflections to and fro."""

    @abstractmethod
    def one(self) -> Any:
        """The identity on the channels of self."""

    @abstractmethod
    def zero(self) -> Any: ...


Op = TypeVar("Op", bound=Operator)


class Scalar(Operator):
    """One channel."""

    value: Float[Array, "*k"]

    def __matmul__(self, other: "Scalar") -> "Scalar":
        return Scalar(self.value * other.value)

    def __add__(self, other: "Scalar") -> "Scalar":
        return Scalar(self.value + other.value)

    def __sub__(self, other: "Scalar") -> "Scalar":
        return Scalar(self.value - other.value)

    def bounce(self, other: "Scalar") -> "Scalar":
        return Scalar(1.0 / (1.0 - self.value * other.value))

    def one(self) -> "Scalar":
        return Scalar(jnp.ones_like(self.value))

    def zero(self) -> "Scalar":
        return Scalar(jnp.zeros_like(self.value))


class Beamed(Operator):
    """A diffuse channel fed by a collimated one: [[diffuse, source], [0, beam]], which broadcast. Diffuse light never becomes a beam again."""

    diffuse: Float[Array, "*#k"]
    source: Float[Array, "*#k"]
    beam: Float[Array, "*#k"]

    def __matmul__(self, other: "Beamed") -> "Beamed":
        return Beamed(
            self.diffuse * other.diffuse,
            self.diffuse * other.source + self.source * other.beam,
            self.beam * other.beam,
        )

    def __add__(self, other: "Beamed") -> "Beamed":
        return Beamed(self.diffuse + other.diffuse, self.source + other.source, self.beam + other.beam)

    def __sub__(self, other: "Beamed") -> "Beamed":
        return Beamed(self.diffuse - other.diffuse, self.source - other.source, self.beam - other.beam)

    def inverse(self) -> "Beamed":
        return Beamed(1.0 / self.diffuse, -self.source / (self.diffuse * self.beam), 1.0 / self.beam)

    def bounce(self, other: "Beamed") -> "Beamed":
        loop = self @ other
        return Beamed(1.0 - loop.diffuse, -loop.source, 1.0 - loop.beam).inverse()

    def one(self) -> "Beamed":
        return Beamed(jnp.ones_like(self.diffuse), jnp.zeros_like(self.source), jnp.ones_like(self.beam))

    def zero(self) -> "Beamed":
        return Beamed(jnp.zeros_like(self.diffuse), jnp.zeros_like(self.source), jnp.zeros_like(self.beam))


class Response(eqx.Module, Generic[Op]):
    """Reflection of light from above and from below, transmission down and up."""

    R_above: Op
    R_below: Op
    T_down: Op
    T_up: Op

    def reversed(self) -> "Response[Op]":
        """The same piece upside down."""
        return Response(self.R_below, self.R_above, self.T_up, self.T_down)

    def identity(self) -> "Response[Op]":
        """The response of nothing, with the channels and frequencies of self."""
        return Response(*_identity(self.R_above))


def _identity(like: Op) -> tuple[Op, Op, Op, Op]:
    one, zero = like.one(), like.zero()
    return zero, zero, one, one


def nothing(like: Op) -> "Nothing[Op]":
    """The response of nothing, with the channels and frequencies of an operator."""
    return Nothing(*_identity(like))


class Nothing(Response[Op]):
    """The response of nothing, known as such before any number is: composing with it costs nothing."""


def compose(upper: Response[Op], lower: Response[Op]) -> Response[Op]:
    """The response of two pieces, one on the other (Redheffer star product). Associative.

    What is not used of the result costs nothing once compiled.
    """
    if isinstance(upper, Nothing) or isinstance(lower, Nothing):
        return lower if isinstance(upper, Nothing) else upper
    down, up = between(upper, lower.R_above), between(lower.reversed(), upper.R_below)
    return Response(
        R_above=upper.R_above + upper.T_up @ lower.R_above @ down,
        R_below=lower.R_below + lower.T_down @ upper.R_below @ up,
        T_down=lower.T_down @ down,
        T_up=upper.T_up @ up,
    )


def between(upper: Response[Op], lower: Op) -> Op:
    """What goes down between a piece and something below it that reflects by ``lower``: (1 - R1_below R2_above)^-1 T1_down."""
    if isinstance(upper, Nothing):
        return upper.T_down
    return upper.R_below.bounce(lower) @ upper.T_down


def over(piece: Response[Op], below: Op) -> Op:
    """R_above of a piece over something that reflects by ``below``."""
    if isinstance(piece, Nothing):
        return below
    return piece.R_above + piece.T_up @ below @ between(piece, below)


def reflection(pieces: Sequence[Response[Op]]) -> Op:
    """R_above of pieces from top to bottom, without the other three operators."""
    there = [piece for piece in pieces if not isinstance(piece, Nothing)] or [*pieces]
    return reduce(lambda below, piece: over(piece, below), reversed(there[:-1]), there[-1].R_above)


def excess_reflection(upper: Response[Op], lower: Op, reference: Op) -> Op:
    """What the reflection from above of (upper over lower) has more than that of (upper over reference).

    lower and reference are reflections from above. Written as a product, it keeps its relative accuracy where both nearly agree.
    """
    returned = lower.bounce(upper.R_below) @ (lower - reference) @ upper.R_below.bounce(reference)
    return upper.T_up @ returned @ upper.T_down


def compose_all(pieces: Sequence[Response[Op]]) -> Response[Op]:
    """Pieces from top to bottom, composed from the bottom up."""
    return reduce(lambda below, piece: compose(piece, below), reversed(pieces))
