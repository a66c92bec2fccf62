"""Numbers that follow others."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx

from ..errors import InputError
from ..scene.stack import Stack
from .parameters import FreeParameter


class Tie(eqx.Module):
    """A number that follows another, value = factor * source, or several by a function of the stack; then source is empty."""

    name: str = eqx.field(static=True)
    source: str = eqx.field(static=True)
    factor: float = eqx.field(static=True)
    function: Callable[[Stack], Any] | None = eqx.field(static=True, default=None)

    def value(self, stack: Stack) -> Any:
        """The value in a stack of which the free numbers are set."""
        return self.factor * stack.get(self.source) if self.function is None else self.function(stack)

    def as_given(self) -> Any:
        """The form in which a Problem takes it."""
        return (self.source, self.factor) if self.function is None else self.function

    @property
    def text(self) -> str:
        """What it is tied to, in words."""
        if self.function is None:
            return f"{self.factor} × {self.source}"
        return f"function {getattr(self.function, '__name__', 'of the stack')}"


def parse_ties(
    stacks: Sequence[Stack], free: Sequence[FreeParameter], ties: Mapping[str, Any], *, calibration: Sequence[str] = (), where: str = "ties"
) -> tuple[Tie, ...]:
    """Ties from ``{name: source}`` or ``{name: (source, factor)}``, both numbers of one stack, or ``{name: function}``.

    A function takes the stack with all free numbers set and returns the value: ``lambda s: 0.5 * s.get("deep.sigma_a") + 0.01``. It must be pure,
    differentiable by JAX and must not read tied numbers; what it gives within the bounds is looked at when the problem is built.

    stacks : the sample's, then those of references. calibration : names of the numbers of measurements, which may follow each other, factor 1.

    Raises InputError for a name that does not exist, is free, or follows itself or another tied number.
    """
    groups = [stacks[0].names, *([name for name in s.names if not name.startswith("scene.")] for s in stacks[1:]), calibration]
    known = [name for group in groups for name in group]
    parsed = []
    for name, spec in ties.items():
        function = spec if callable(spec) else None
        source, factor = ("", 1.0) if function is not None else _tie(spec, f"{where} '{name}'")
        for given in (name, source) if function is None else (name,):
            if given not in known:
                raise InputError(f"{where} '{name}': '{given}' is no number of the scene; allowed: {', '.join(known)}")
        if isinstance(factor, bool) or not isinstance(factor, int | float) or not math.isfinite(factor) or factor <= 0:
            raise InputError(f"{where} '{name}': factor = {factor!r}; allowed is a finite number above 0")
        if any(p.name == name for p in free):
            raise InputError(f"{where} '{name}': it is free as well; allowed is one of both")
        if source == name or source in ties:
            raise InputError(f"{where} '{name}': follows '{source}', which is tied itself; tie both to the same number")
        if function is None and not any(name in group and source in group for group in groups):
            raise InputError(f"{where} '{name}': '{source}' belongs to another sample, or one of both to a measurement; allowed are numbers of one")
        if name in calibration and (function is not None or factor != 1.0 or not any(p.name == source for p in free)):
            raise InputError(f"{where} '{name}': a number of a measurement can only be the same as another's that is free (factor 1, no function)")
        if name in calibration and name.rsplit(".", 1)[1] != source.rsplit(".", 1)[1]:
            raise InputError(f"{where} '{name}': '{source}' is another kind of number")
        parsed.append(Tie(name, source, float(factor), function))
    return tuple(parsed)


def _tie(spec: Any, where: str) -> tuple[str, Any]:
    """Source and factor as given."""
    if isinstance(spec, str):
        return spec, 1.0
    if isinstance(spec, Mapping) and "to" in spec and not set(spec) - {"to", "factor"}:
        spec = (spec["to"], spec.get("factor", 1.0))
    if isinstance(spec, Sequence) and len(spec) == 2 and isinstance(spec[0], str):
        return spec[0], spec[1]
    raise InputError(f"{where} = {spec!r}; allowed is the name of a number, [name, factor], a table with to and factor, or a function of the stack")
