"""Where and how light is measured: what a forward model must predict, without any values."""

from abc import abstractmethod
from typing import Any, ClassVar, Literal, Self

import equinox as eqx
import numpy as np

from ..errors import InputError
from ..optics.gauss import unit_gauss
from ..optics.hankel import Kernel, Term
from .overlap import enclosed, under_fibre
from .source import Detector, Disk, Edge, Gaussian, Line, Pencil, Source

Side = Literal["above", "below"]


def _array(values: Any, what: str, *, increasing: bool = True) -> np.ndarray:
    try:
        array = np.atleast_1d(np.asarray(values, dtype=float))
    except (TypeError, ValueError):
        raise InputError(f"{what}: {values!r} was given; allowed are numbers") from None
    if array.ndim != 1 or array.size == 0:
        raise InputError(f"{what}: an array of shape {array.shape} was given; allowed is a list of one number or more")
    if not np.all(np.isfinite(array)):
        i = int(np.flatnonzero(~np.isfinite(array))[0])
        raise InputError(f"{what}: number {i + 1} is {array[i]}; allowed are finite numbers", row=i)
    if increasing and np.any(np.diff(array) <= 0):
        i = int(np.flatnonzero(np.diff(array) <= 0)[0])
        raise InputError(f"{what} is not increasing: number {i + 2} is {array[i + 1]:g} after {array[i]:g}; allowed are numbers that rise", row=i + 1)
    return array


class Geometry(eqx.Module):
    """One kind of measurement at given places."""

    kind: ClassVar[str]
    side: ClassVar[Side]
    axis: ClassVar[str] = ""

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of values."""

    @abstractmethod
    def places(self) -> dict[str, np.ndarray]:
        """Columns that say where: {} for a total, {"r": ...}, {"r_min": ..., "r_max": ...} [mm] or {"k": ...} [rad/mm]."""

    def centers(self) -> np.ndarray:
        """One abscissa a value, for plots; rings by the radius that halves their area."""
        places = self.places()
        if len(places) == 2:
            low, high = places.values()
            return np.sqrt(0.5 * (low**2 + high**2))
        return next(iter(places.values()), np.zeros(self.size))

    def place(self, index: int) -> str:
        """Where one value is, in words: "r 2.5", "r 1 to 2"; "" for a total."""
        values = [f"{values[index]:.4g}" for values in self.places().values()]
        return f"{next(iter(self.places())).removesuffix('_min')} {' to '.join(values)}" if values else ""


class Radial(Geometry):
    """Light leaving at distances r, or averaged over rings, per unit incident power and area."""

    axis: ClassVar[str] = "r [mm]"
    r: np.ndarray | None
    r_min: np.ndarray | None
    r_max: np.ndarray | None
    source: Source
    detector: Detector

    def __init__(
        self,
        r: Any = None,
        *,
        r_min: Any = None,
        r_max: Any = None,
        source: Source | None = None,
        detector: Detector | None = None,
    ):
        self.source = Pencil() if source is None else source
        self.detector = Detector() if detector is None else detector
        what = self.kind
        if (r is None) == (r_min is None or r_max is None):
            raise InputError(f"{what}: give r, or r_min and r_max")
        if r is not None:
            self.r, self.r_min, self.r_max = _array(r, f"{what}: r"), None, None
            if not isinstance(self.source, Edge) and np.any(self.r < 0):
                raise InputError(f"{what}: r = {self.r.min():g}; allowed is 0 or more (below 0 only beside an edge)")
            if isinstance(self.source, Pencil | Line) and self.detector.radius == 0.0 and np.any(self.r == 0):
                raise InputError(
                    f"{what}: r = 0 under a {self.source.name} beam, where the value is infinite; give a ring, or a source or detector with a radius"
                )
        else:
            self.r, self.r_min, self.r_max = None, _array(r_min, f"{what}: r_min"), _array(r_max, f"{what}: r_max")
            self._check_rings(what)

    def _check_rings(self, what: str) -> None:
        assert self.r_min is not None and self.r_max is not None
        low, high = self.r_min, self.r_max
        if low.shape != high.shape:
            raise InputError(f"{what}: {low.size} values of r_min and {high.size} of r_max; allowed is one pair a ring")
        if low[0] < 0:
            raise InputError(f"{what}: r_min = {low[0]:g}; allowed is 0 or more")
        if np.any(high <= low):
            i = int(np.flatnonzero(high <= low)[0])
            raise InputError(f"{what}: ring {i + 1} goes from {low[i]:g} to {high[i]:g}; r_max must be above r_min", row=i)
        if np.any(low[1:] < high[:-1] * (1 - 1e-12)):
            i = int(np.flatnonzero(low[1:] < high[:-1] * (1 - 1e-12))[0])
            text = f"{what}: r not increasing: ring {i + 2} starts at {low[i + 1]:g}, before ring {i + 1} ends at {high[i]:g}"
            raise InputError(f"{text}; allowed are rings that follow each other", row=i + 1)
        if isinstance(self.source, Line | Edge):
            raise InputError(f"{what}: rings with source {self.source.name}; allowed with it are distances r")
        if self.detector.radius > 0:
            raise InputError(f"{what}: rings with a detector radius; allowed is one of them")

    @property
    def size(self) -> int:
        return int(next(iter(self.places().values())).size)

    @property
    def value_unit(self) -> str:
        return {"line": "1/mm", "edge": "1"}.get(self.source.name, "1/mm^2")

    def places(self) -> dict[str, np.ndarray]:
        if self.r is not None:
            return {"r": self.r}
        assert self.r_min is not None and self.r_max is not None
        return {"r_min": self.r_min, "r_max": self.r_max}

    def shifted(self, offset: float) -> Self:
        """The same with all distances larger by offset [mm]. Raises InputError where one would become negative."""
        places = {name: values + offset for name, values in self.places().items()}
        return type(self)(**places, source=self.source, detector=self.detector)

    def sized(self, *, source_radius: float | None = None, detector_radius: float | None = None) -> Self:
        """The same with another radius [mm] of a disk or Gaussian source, or of a fibre. Raises InputError for one that is not above 0."""
        source = self.source
        if source_radius is not None:
            assert isinstance(source, Disk | Gaussian)
            source = type(source)(source_radius)
        detector = self.detector if detector_radius is None else Detector(detector_radius, self.detector.na)
        return type(self)(**self.places(), source=source, detector=detector)

    def kernel(self) -> Kernel:
        """How the values follow from the response in spatial frequency (see `optics.hankel`)."""
        disks = [self.detector.radius] if self.detector.radius > 0 else []
        if isinstance(self.source, Disk):
            disks.append(self.source.radius)
        gaussian = self.source.radius if isinstance(self.source, Gaussian) else 0.0
        if self.r is None:
            assert self.r_min is not None and self.r_max is not None
            low, high = self.r_min, self.r_max
            area = np.pi * (high**2 - low**2)
            terms = (Term(high / area, high, "J1", 0), Term(-low / area, low, "J1", 0))
            return Kernel(terms, tuple(disks), gaussian)
        one = np.ones_like(self.r)
        if isinstance(self.source, Line):
            return Kernel((Term(one / np.pi, self.r, "cos", 0),), tuple(disks))
        if isinstance(self.source, Edge):
            return Kernel((Term(one / np.pi, self.r, "sin", -1),), tuple(disks), at_zero=0.5)
        return Kernel((Term(one / (2.0 * np.pi), self.r, "J0", 1),), tuple(disks), gaussian)

    def direct(self) -> np.ndarray:
        """The value that light leaving exactly where it entered would give: the source's pattern seen through the detector."""
        if self.r is None:
            assert self.r_min is not None and self.r_max is not None
            low, high = self.r_min, self.r_max
            return (enclosed(self.source, high) - enclosed(self.source, low)) / (np.pi * (high**2 - low**2))
        if self.detector.radius == 0.0:
            return self.source.density(self.r)
        return np.array([under_fibre(self.source, self.detector.radius, float(r)) for r in self.r])


class RadialReflectance(Radial):
    """R(r): light leaving through the top, per unit incident power and area [1/mm^2], specular reflection left out.

    Arguments
    ---------
    r : distances from the beam's axis [mm], increasing; or
    r_min, r_max : rings [mm]; a value is the average over its ring. The first may start at 0; gaps are allowed.
    source : Pencil (default), Disk, Gaussian, Line or Edge.
    detector : Detector(radius, na); a point that collects all directions by default.

    Raises InputError for distances that are not increasing, negative, or 0 where the value is infinite.
    """

    kind: ClassVar[str] = "radial_reflectance"
    side: ClassVar[Side] = "above"

    def __init__(self, r: Any = None, *, r_min: Any = None, r_max: Any = None, source: Source | None = None, detector: Detector | None = None):
        super().__init__(r, r_min=r_min, r_max=r_max, source=source, detector=detector)


class RadialTransmittance(Radial):
    """T(r): light leaving through the bottom; arguments as for `RadialReflectance`. Unscattered light is in the ring at 0."""

    kind: ClassVar[str] = "radial_transmittance"
    side: ClassVar[Side] = "below"

    def __init__(self, r: Any = None, *, r_min: Any = None, r_max: Any = None, source: Source | None = None, detector: Detector | None = None):
        super().__init__(r, r_min=r_min, r_max=r_max, source=source, detector=detector)


class SpatialFrequency(Geometry):
    """R(k): reflectance of a sinusoidal pattern, specular reflection left out [1].

    k : [rad/mm], 0 or more; or fx : the same as cycles [1/mm], k = 2 pi fx.
    """

    kind: ClassVar[str] = "spatial_frequency"
    side: ClassVar[Side] = "above"
    axis: ClassVar[str] = "k [rad/mm]"
    k: np.ndarray

    def __init__(self, k: Any = None, *, fx: Any = None):
        if (k is None) == (fx is None):
            raise InputError("spatial_frequency: give k or fx")
        self.k = _array(k, "spatial_frequency: k") if k is not None else 2.0 * np.pi * _array(fx, "spatial_frequency: fx")
        if np.any(self.k < 0):
            raise InputError(f"spatial_frequency: k = {self.k.min():g}; allowed is 0 or more")

    @property
    def size(self) -> int:
        return int(self.k.size)

    def places(self) -> dict[str, np.ndarray]:
        return {"k": self.k}


Incidence = float | Literal["normal", "diffuse"]


class Incident(Geometry):
    """Wide, even light from a direction, or from all of them."""

    incidence: Incidence

    def __check_init__(self):
        angle = 0.0 if self.incidence == "normal" else self.incidence
        if angle != "diffuse" and not (isinstance(angle, int | float) and 0 <= angle < 90):
            raise InputError(f'{self.kind}: incidence = {self.incidence!r}; allowed: "normal", "diffuse", or degrees from 0 to below 90')

    def cosines(self) -> tuple[np.ndarray, np.ndarray]:
        """Cosines of incidence in the medium above and their weights (sum 1)."""
        if self.incidence == "diffuse":
            mu, w = unit_gauss(16)
            return mu, 2.0 * mu * w
        return np.array([1.0 if self.incidence == "normal" else float(np.cos(np.radians(self.incidence)))]), np.ones(1)


class Total(Incident):
    @property
    def size(self) -> int:
        return 1

    def places(self) -> dict[str, np.ndarray]:
        return {}


class TotalReflectance(Total):
    """All light leaving through the top, per unit incident power [1].

    specular : "excluded" (default) leaves out the first-surface reflection, "included" counts it. Unscattered light returned by deeper faces
        is in both.
    incidence : "normal" (default), "diffuse" (Lambertian), or an angle in degrees.
    """

    kind: ClassVar[str] = "total_reflectance"
    side: ClassVar[Side] = "above"
    incidence: Incidence = "normal"
    specular: Literal["excluded", "included"] = "excluded"

    def __check_init__(self):
        if self.specular not in ("excluded", "included"):
            raise InputError(f'total_reflectance: specular = {self.specular!r}; allowed: "excluded", "included"')


class TotalTransmittance(Total):
    """All light leaving through the bottom, the unscattered beam included, per unit incident power [1].

    incidence : "normal" (default), "diffuse" (Lambertian), or an angle in degrees.
    """

    kind: ClassVar[str] = "total_transmittance"
    side: ClassVar[Side] = "below"
    incidence: Incidence = "normal"


class Angular(Incident):
    """Radiance of what leaves, in the outer medium, per unit incident power [1/sr]: its integral with cos(angle) over the hemisphere is the total.

    Light that was never scattered and leaves as a beam is not in it.
    """

    axis: ClassVar[str] = "angle [deg]"
    angle: np.ndarray
    incidence: Incidence
    azimuth: float | None

    def __init__(self, angle: Any, *, incidence: Incidence = "normal", azimuth: float | None = None):
        self.angle = _array(angle, f"{self.kind}: angle")
        self.incidence = incidence
        self.azimuth = None if azimuth is None else float(azimuth)
        if self.angle[0] < 0 or self.angle[-1] >= 90:
            raise InputError(f"{self.kind}: angle from {self.angle[0]:g} to {self.angle[-1]:g}; allowed: degrees from 0 to below 90")
        if self.azimuth is not None and not np.isfinite(self.azimuth):
            raise InputError(f"{self.kind}: azimuth = {azimuth}; allowed: degrees, or left out for the average")

    @property
    def size(self) -> int:
        return int(self.angle.size)

    def places(self) -> dict[str, np.ndarray]:
        return {"angle": self.angle}


class AngularReflectance(Angular):
    """Radiance through the top, the first-surface reflection left out [1/sr].

    angle : polar angles in the medium above [deg], 0 to below 90, increasing.
    incidence : "normal" (default), "diffuse" (Lambertian), or an angle in degrees.
    azimuth : of the detector, in degrees from the direction in which the incident light travels (0: the side of the mirror reflection, 180: back
        towards the source). Left out: the average over azimuth.

    Raises InputError for angles outside the range or not increasing.
    """

    kind: ClassVar[str] = "angular_reflectance"
    side: ClassVar[Side] = "above"

    def __init__(self, angle: Any, *, incidence: Incidence = "normal", azimuth: float | None = None):
        super().__init__(angle, incidence=incidence, azimuth=azimuth)


class AngularTransmittance(Angular):
    """Radiance through the bottom [1/sr]; angles in the medium below, arguments as for `AngularReflectance`."""

    kind: ClassVar[str] = "angular_transmittance"
    side: ClassVar[Side] = "below"

    def __init__(self, angle: Any, *, incidence: Incidence = "normal", azimuth: float | None = None):
        super().__init__(angle, incidence=incidence, azimuth=azimuth)


GEOMETRIES: dict[str, type[Geometry]] = {
    cls.kind: cls
    for cls in (
        RadialReflectance,
        RadialTransmittance,
        SpatialFrequency,
        TotalReflectance,
        TotalTransmittance,
        AngularReflectance,
        AngularTransmittance,
    )
}


def value_unit(geometry: Geometry) -> str:
    """Unit of the values."""
    geometry = getattr(geometry, "geometry", geometry)  # of a spectrum: what is measured at each wavelength
    if isinstance(geometry, Angular):
        return "1/sr"
    return geometry.value_unit if isinstance(geometry, Radial) else "1"
