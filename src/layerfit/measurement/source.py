"""How the sample is lit and how light is collected."""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import numpy as np

from ..errors import InputError


def _positive(value: float, what: str) -> float:
    if not (isinstance(value, int | float | np.number) and np.isfinite(value) and value > 0):
        raise InputError(f"{what} = {value!r}: allowed is a finite number above 0")
    return float(value)


class Source(eqx.Module):
    """A pattern of illumination of unit power, perpendicular to the surface."""

    name: ClassVar[str]

    @abstractmethod
    def density(self, r: np.ndarray) -> np.ndarray:
        """Irradiance at distance r [mm] from the centre (a line, an edge: signed distance from it)."""


class Pencil(Source):
    """An infinitely narrow beam. R(r) is per unit power [1/mm^2]."""

    name: ClassVar[str] = "pencil"

    def density(self, r: np.ndarray) -> np.ndarray:
        return np.zeros_like(r)


class Disk(Source):
    """An evenly lit disk.

    radius : [mm], above 0.
    """

    name: ClassVar[str] = "disk"
    radius: float = eqx.field(converter=lambda v: _positive(v, "radius of a disk source"))

    def density(self, r: np.ndarray) -> np.ndarray:
        return np.where(r < self.radius, 1.0, np.where(r == self.radius, 0.5, 0.0)) / (np.pi * self.radius**2)


class Gaussian(Source):
    """A Gaussian beam.

    radius : distance at which the irradiance is 1/e^2 of that at the centre [mm], above 0.
    """

    name: ClassVar[str] = "gaussian"
    radius: float = eqx.field(converter=lambda v: _positive(v, "radius of a Gaussian source"))

    def density(self, r: np.ndarray) -> np.ndarray:
        return 2.0 / (np.pi * self.radius**2) * np.exp(-2.0 * (r / self.radius) ** 2)


class Line(Source):
    """An infinitely narrow line; r is the distance from it and R is per unit power per length [1/mm]."""

    name: ClassVar[str] = "line"

    def density(self, r: np.ndarray) -> np.ndarray:
        return np.zeros_like(r)


class Edge(Source):
    """An evenly lit half plane, irradiance 1; r is the signed distance from its edge, positive on the lit side. R has no unit."""

    name: ClassVar[str] = "edge"

    def density(self, r: np.ndarray) -> np.ndarray:
        return np.where(r > 0, 1.0, np.where(r == 0, 0.5, 0.0))


SOURCES = {cls.name: cls for cls in (Pencil, Disk, Gaussian, Line, Edge)}


class Detector(eqx.Module):
    """A fibre, or whatever collects light at one place.

    radius : over which the value is averaged [mm]; 0 is a point.
    na : numerical aperture; 1 or more collects all directions.
    """

    radius: float = 0.0
    na: float = 1.0

    def __check_init__(self):
        for name, value in (("radius", self.radius), ("na", self.na)):
            number = isinstance(value, int | float | np.number) and np.isfinite(value) and value >= 0
            if not number or (name == "na" and value == 0):
                raise InputError(f"detector {name} = {value!r}: allowed is a finite number {'above' if name == 'na' else 'at least'} 0")
