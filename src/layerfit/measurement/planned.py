"""A measurement that has not been made yet."""

import equinox as eqx

from ..errors import InputError
from .dataset import Noise, check_measurement_name
from .geometry import Geometry


class Planned(eqx.Module):
    """Where a measurement would be made, and with what noise.

    Arguments
    ---------
    geometry : where and how. noise : Noise(relative, absolute) that its values would have.
    name : prefix of its nuisance parameters (``name.amplitude`` ...).

    Raises InputError where no noise is given, or the name cannot be one.

    >>> import layerfit as lf
    >>> lf.Planned(lf.RadialReflectance(r=[1, 2]), lf.Noise(relative=0.02)).geometry.size
    2
    """

    geometry: Geometry
    noise: Noise
    name: str = "measurement"

    def __check_init__(self):
        check_measurement_name(self.name)
        if not isinstance(self.noise, Noise):
            raise InputError(
                f"measurement '{self.name}': noise = {self.noise!r}; what can be known depends on it: allowed is Noise(relative, absolute)"
            )
