"""One forward model from several, each for some of the geometries."""

from collections.abc import Callable, Sequence
from typing import TypeVar

import equinox as eqx
import numpy as np
from jax import Array
from jaxtyping import Float

from ..scene.columns import Columns
from ..solver import Evaluation, Forward

T = TypeVar("T")


def joined(taken: Sequence[int], make: Callable[[int, tuple[int, ...]], Forward]) -> Forward:
    """The model of geometries of which number j is predicted by part taken[j]. make : a part, from its number and its geometries."""
    places = {i: tuple(j for j, part in enumerate(taken) if part == i) for i in sorted(set(taken))}
    parts = tuple(make(i, mine) for i, mine in places.items())
    return parts[0] if len(parts) == 1 else JointForward(parts, tuple(places.values()))


class JointForward(Forward):
    """See `Forward`. places : which geometries each part predicts."""

    parts: tuple[Forward, ...]
    places: tuple[tuple[int, ...], ...] = eqx.field(static=True)

    @property
    def differentiable(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether all parts are."""
        return all(part.differentiable for part in self.parts)

    def __call__(self, columns: Columns, shifts: Sequence[Float[Array, ""] | None] | None = None) -> tuple[Array, ...]:
        return self._ordered([part(columns, shifts and [shifts[j] for j in mine]) for part, mine in zip(self.parts, self.places, strict=True)])

    def run(self, columns: Columns) -> tuple[Array, ...]:
        return self._ordered([part.run(columns) for part in self.parts])

    def error(self, columns: Columns) -> tuple[np.ndarray | None, ...]:
        return self.evaluate(columns).errors

    def evaluate(self, columns: Columns) -> Evaluation:
        done = [part.evaluate(columns) for part in self.parts]
        notes = tuple(note for one in done for note in one.notes)
        return Evaluation(self._ordered([one.values for one in done]), self._ordered([one.errors for one in done]), notes)

    def _ordered(self, rows: Sequence[Sequence[T]]) -> tuple[T, ...]:
        """What each part gives for its geometries, in the order of all."""
        found = {j: value for mine, row in zip(self.places, rows, strict=True) for j, value in zip(mine, row, strict=True)}
        return tuple(found[j] for j in range(len(found)))
