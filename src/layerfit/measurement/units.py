"""The door where units are converted: millimetres, 1/mm, rad/mm inside, anything with a unit outside."""

import re
from functools import cache
from typing import Any

from ..errors import InputError

# what a column may hold: dimensions as powers of length, whether an angle unit must, or must not, be there; and the unit used inside
_QUANTITIES = {
    "length": (1, False, "mm"),
    "angular frequency": (-1, True, "rad/mm"),
    "cycles": (-1, False, "1/mm"),
    "per area": (-2, False, "1/mm^2"),
    "per length": (-1, False, "1/mm"),
    "number": (0, False, "1"),
}


@cache
def _registry() -> Any:
    import pint  # slow to import, needed for files only

    return pint.UnitRegistry()


def factor_to_internal(unit: str, quantity: str, where: str) -> float:
    """The number by which a value in ``unit`` is multiplied to get the internal unit of a quantity.

    Raises InputError for a text that is no unit, or a unit of another quantity. Nothing is guessed: 1/mm is no angular frequency.

    >>> factor_to_internal("1/cm^2", "per area", "value")
    0.01
    >>> factor_to_internal("%", "number", "value")
    0.01
    """
    power, angular, internal = _QUANTITIES[quantity]
    if unit.strip() == internal:
        return 1.0
    registry = _registry()
    text = re.sub(r"(?<=[A-Za-zµ])(-?\d)", r"^\1", unit.strip())  # mm2, cm-1: as instruments write them
    try:
        parsed = registry.Unit("dimensionless" if text == "1" else text)
        dimensions = dict(parsed.dimensionality)
    except Exception as error:  # pint raises half a dozen kinds, tokenizer errors among them
        raise InputError(f"{where}: '{unit}' is not a unit ({type(error).__name__}); allowed is for example {internal}") from None
    has_angle = "radian" in parsed._units or "degree" in parsed._units or "steradian" in parsed._units
    if dimensions != ({"[length]": power} if power else {}) or has_angle != angular:
        raise InputError(f"{where}: unit '{unit}' does not fit; allowed are units like {internal}{_hint(quantity, has_angle)}")
    factor = (1.0 * parsed).to(registry.Unit("dimensionless" if internal == "1" else internal)).magnitude
    return float(round(factor, 15)) if factor > 1e-3 else float(factor)


def _hint(quantity: str, has_angle: bool) -> str:
    if quantity == "angular frequency" and not has_angle:
        return " (cycles per length are called fx: k = 2 pi fx)"
    if quantity == "cycles" and has_angle:
        return " (radians per length are called k)"
    return ""
