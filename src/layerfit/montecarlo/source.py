"""Where the light comes from. Every source sends unit power down onto the top face, centred at x = y = 0.

Directions are those in the outer medium above; azimuth 0 is the +x direction, in which an oblique beam travels.
Radii are measured in the plane of the top face (an oblique beam's footprint there).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from .checks import number, wrong

POINT, DISK, GAUSSIAN = 0.0, 1.0, 2.0


def _beam(shape: float, radius: float, cosine: float) -> NDArray[np.float64]:
    return np.array([shape, radius, cosine, 0.0, 0.0])


def _cone(radius: float, low: float, high: float) -> NDArray[np.float64]:
    return np.array([DISK if radius > 0.0 else POINT, radius, 0.0, low, high])


@dataclass(frozen=True)
class Pencil:
    """An infinitely thin beam.

    Parameters
    ----------
    cosine : float
        Cosine of the angle of incidence in the outer medium [1], 0 < cosine <= 1.
    """

    cosine: float = 1.0

    def __post_init__(self) -> None:
        number("cosine", self.cosine, 0.0, 1.0, "0 < cosine <= 1", above=True)

    @property
    def symmetric(self) -> bool:
        """True if nothing changes under rotation about the z axis."""
        return float(self.cosine) == 1.0

    def table(self, n_above: float) -> NDArray[np.float64]:
        """Shape, radius, cosine (0: a cone), and the cone's limits in squared sine, shape (5,)."""
        return _beam(POINT, 0.0, float(self.cosine))


@dataclass(frozen=True)
class _Wide:
    """A collimated beam of finite width."""

    radius: float
    cosine: float = 1.0
    shape: ClassVar[float]

    def __post_init__(self) -> None:
        number("radius", self.radius, 0.0, math.inf, "finite and above 0 [mm]", above=True)
        number("cosine", self.cosine, 0.0, 1.0, "0 < cosine <= 1", above=True)

    @property
    def symmetric(self) -> bool:
        """True if nothing changes under rotation about the z axis."""
        return float(self.cosine) == 1.0

    def table(self, n_above: float) -> NDArray[np.float64]:
        """See `Pencil.table`."""
        return _beam(self.shape, float(self.radius), float(self.cosine))


@dataclass(frozen=True)
class Disk(_Wide):
    """A collimated beam, uniform over a disk of `radius` [mm] on the top face; `cosine` as in `Pencil`."""

    shape: ClassVar[float] = DISK


@dataclass(frozen=True)
class Gaussian(_Wide):
    """A collimated Gaussian beam; `radius` [mm] is the 1/e^2 radius: intensity exp(-2 r^2 / radius^2)."""

    shape: ClassVar[float] = GAUSSIAN


@dataclass(frozen=True)
class Fibre:
    """A step-index fibre touching the top face.

    Uniform over the disk of `radius` [mm]; at each point the radiance is the same for all directions with
    n_above sin(theta) < `na` and zero beyond: sin^2(theta) is uniform on (0, (na / n_above)^2), the azimuth uniform.
    """

    radius: float
    na: float

    def __post_init__(self) -> None:
        number("radius", self.radius, 0.0, math.inf, "finite and above 0 [mm]", above=True)
        number("na", self.na, 0.0, math.inf, "finite and above 0 [1]", above=True)

    symmetric = True

    def table(self, n_above: float) -> NDArray[np.float64]:
        """See `Pencil.table`. Raises ValueError if the numerical aperture exceeds the index above."""
        if self.na > n_above:
            raise wrong("na", self.na, f"at most n_above = {n_above!r}")
        return _cone(float(self.radius), 0.0, (float(self.na) / n_above) ** 2)


@dataclass(frozen=True)
class Lambertian:
    """Diffuse light: constant radiance over the directions between two polar angles.

    Parameters
    ----------
    radius : float
        Radius of the lit disk [mm]; 0 lights one point.
    theta : pair of float
        Limits of the polar angle in the outer medium [degrees]; (0, 90) is the whole hemisphere.
    """

    radius: float = 0.0
    theta: tuple[float, float] = (0.0, 90.0)

    def __post_init__(self) -> None:
        number("radius", self.radius, 0.0, math.inf, "finite and not below 0 [mm]")
        if len(self.theta) != 2 or not 0.0 <= self.theta[0] < self.theta[1] <= 90.0:
            raise wrong("theta", self.theta, "0 <= lower < upper <= 90 [degrees]")

    symmetric = True

    def table(self, n_above: float) -> NDArray[np.float64]:
        """See `Pencil.table`."""
        low, high = (math.sin(math.radians(angle)) ** 2 for angle in self.theta)
        return _cone(float(self.radius), low, high)


Source = Pencil | Disk | Gaussian | Fibre | Lambertian
