"""Units of files: converted exactly where they fit, refused where they do not, never guessed."""

import math

import pytest

from layerfit.errors import InputError
from layerfit.measurement.units import factor_to_internal

FITTING = {
    "length": {"mm": 1, "cm": 10, "m": 1000, "um": 1e-3, "µm": 1e-3, "μm": 1e-3, "micrometer": 1e-3, "nm": 1e-6, "inch": 25.4},
    "angular frequency": {
        "rad/mm": 1,
        "rad/cm": 0.1,
        "rad mm^-1": 1,
        "rad/m": 1e-3,
        "rad*cm-1": 0.1,
        "deg/mm": math.pi / 180,
        "cycles/mm": 2 * math.pi,
    },
    "cycles": {"1/mm": 1, "mm^-1": 1, "mm-1": 1, "mm⁻¹": 1, "1/cm": 0.1, "cm^-1": 0.1, "1/m": 1e-3, "cycles/mm": 1, "cycle/cm": 0.1, "1/um": 1e3},
    "per area": {
        "1/mm^2": 1,
        "mm^-2": 1,
        "mm-2": 1,
        "1/mm2": 1,
        "1/mm²": 1,
        "1/cm^2": 0.01,
        "cm^-2": 0.01,
        "cm⁻²": 0.01,
        "1/m^2": 1e-6,
        "1/um^2": 1e6,
    },
    "per length": {"1/mm": 1, "1/cm": 0.1, "m^-1": 1e-3},
    "number": {"1": 1, "-": 1, "dimensionless": 1, "%": 0.01, "percent": 0.01, "permille": 1e-3},
}
OTHER = {
    "length": ["1/mm", "mm^2", "s", "rad", "pixel", "%", "1", "mm/mm"],
    "angular frequency": ["1/mm", "1/cm", "mm", "rad", "rad^2/mm", "1/(rad mm)", "rad/mm^2", "Hz"],
    "cycles": ["rad/mm", "deg/mm", "mm", "1/mm^2", "1/s", "cycles"],
    "per area": ["1/mm", "mm^2", "W/mm^2", "1/mm^2/sr", "1", "%", "1/s"],
    "per length": ["1", "mm", "1/mm^2"],
    "number": ["counts", "dB", "a.u.", "V", "mm", "1/mm^2", "rad", "sr", "bit", "0.01", "1e-3", "neper", "nan"],
}
NONE = ["", " ", "?", "mm^", "milimeter", "mm?", "mm!", "lp/mm", "1/cm 2 x", "10 mm", "[mm", "$", "__import__('os')", "a" * 200]


@pytest.mark.parametrize(("quantity", "unit"), [(q, u) for q, units in FITTING.items() for u in units])
def test_fits(quantity, unit):
    assert abs(factor_to_internal(unit, quantity, "here") / FITTING[quantity][unit] - 1) <= 1e-14


@pytest.mark.parametrize(("quantity", "unit"), [(q, u) for q, units in OTHER.items() for u in units] + [(q, u) for q in OTHER for u in NONE])
def test_refused(quantity, unit):
    with pytest.raises(InputError) as caught:
        factor_to_internal(unit, quantity, "file, column 'x'")
    message = str(caught.value)
    assert message.startswith("file, column 'x': ") and "allowed" in message and unit.strip() in message
    assert "\n" not in message


def test_hints():
    """The two frequencies are taken for each other most often."""
    with pytest.raises(InputError, match="cycles per length are called fx"):
        factor_to_internal("1/mm", "angular frequency", "here")
    with pytest.raises(InputError, match="radians per length are called k"):
        factor_to_internal("rad/mm", "cycles", "here")
