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
    "angle": (0, True, "deg"),
    "per solid angle": (0, False, "1/sr"),
}
VALUE_QUANTITY = {"1/mm^2": "per area", "1/mm": "per length", "1": "number", "1/sr": "per solid angle"}  # of measured values
NM = 1e6  # in a millimetre: wavelengths are in nm inside
_ANGLES = ("radian", "degree", "turn")
_SHARES = ("percent", "permille", "ppm")


@cache
def _registry() -> Any:
    import pint  # slow to import, needed for files only

    return pint.UnitRegistry()


def factor_to_internal(unit: str, quantity: str, where: str) -> float:
    """The number by which a value in ``unit`` is multiplied to get the internal unit of a quantity.

    Raises InputError for a text that is no unit, or a unit of another quantity. Nothing is guessed: 1/mm is no angular frequency, counts and
    decibels are no reflectance.

    >>> factor_to_internal("1/cm^2", "per area", "value")
    0.01
    >>> factor_to_internal("%", "number", "value")
    0.01
    """
    power, angular, internal = _QUANTITIES[quantity]
    unit = unit.strip()
    if unit == internal or (quantity == "number" and unit in ("-", "dimensionless")):
        return 1.0
    if not unit:
        raise InputError(f"{where}: the unit is empty; allowed is for example {internal}")
    registry = _registry()
    text = re.sub(r"(?<=[A-Za-zµμ])(-?\d)", r"^\1", unit)  # mm2, cm-1: as instruments write them
    if quantity == "cycles":
        text = re.sub(r"\bcycles?\b", "1", text)  # which counts the periods; to pint it is an angle of 2 pi
    try:
        if not re.fullmatch(r"[\w\s%^*/().·⁻-]+", text):  # pint passes over what it does not know
            raise ValueError
        parsed = registry.Quantity(text)
        units = parsed._units
        powers = {name: registry.Unit(name).dimensionality for name in units}
    except Exception:  # pint raises half a dozen kinds, tokenizer errors among them
        raise InputError(f"{where}: '{unit}' is not a unit; allowed is for example {internal}") from None
    has_angle = any(name in _ANGLES for name in units)
    known = all(units[name] == 1 if name in _ANGLES else name in _SHARES or dict(power) == {"[length]": 1} for name, power in powers.items())
    plain = parsed.magnitude == 1 and (bool(units) or text == "1")
    if not (known and plain) or dict(parsed.dimensionality) != ({"[length]": power} if power else {}) or has_angle != angular:
        raise InputError(f"{where}: unit '{unit}' does not fit; allowed are units like {internal}{_hint(quantity, has_angle)}")
    return float(f"{parsed.to(registry.Unit('dimensionless' if internal == '1' else internal)).magnitude:.15g}")


def _hint(quantity: str, has_angle: bool) -> str:
    if quantity == "angular frequency" and not has_angle:
        return " (cycles per length are called fx: k = 2 pi fx)"
    if quantity == "cycles" and has_angle:
        return " (radians per length are called k)"
    return ""
