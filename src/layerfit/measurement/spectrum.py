"""A measurement repeated at many wavelengths."""

from typing import Any, ClassVar

import numpy as np

from ..errors import InputError
from .geometry import Geometry, Side


class Spectrum(Geometry):
    """Another measurement at several wavelengths, all places of the first wavelength first.

    wavelength : [nm], increasing. geometry : what is measured at each.

    Raises InputError for wavelengths that are not increasing numbers above 0.

    >>> import layerfit as lf
    >>> lf.Spectrum([500, 600, 700], lf.TotalReflectance(specular="included")).size
    3
    """

    kind: ClassVar[str] = "spectrum"
    axis: ClassVar[str] = "wavelength [nm]"
    wavelength: np.ndarray
    geometry: Geometry

    def __init__(self, wavelength: Any, geometry: Geometry):
        try:
            self.wavelength = np.atleast_1d(np.asarray(wavelength, dtype=float))
        except (TypeError, ValueError):
            raise InputError("spectrum: a wavelength is not a number; allowed are increasing numbers of nm") from None
        known = self.wavelength
        if known.ndim != 1 or known.size == 0 or not np.all(np.isfinite(known)) or known[0] <= 0 or np.any(np.diff(known) <= 0):
            raise InputError("spectrum: wavelengths; allowed are increasing numbers of nm above 0")
        if not isinstance(geometry, Geometry) or isinstance(geometry, Spectrum):
            raise InputError(f"spectrum: geometry = {geometry!r}; allowed is what is measured at each wavelength, such as lf.TotalReflectance()")
        self.geometry = geometry

    @property
    def side(self) -> Side:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.geometry.side

    @property
    def size(self) -> int:
        return self.wavelength.size * self.geometry.size

    def places(self) -> dict[str, np.ndarray]:
        inner = {name: np.tile(values, self.wavelength.size) for name, values in self.geometry.places().items()}
        return {"wavelength": np.repeat(self.wavelength, self.geometry.size), **inner}

    def centers(self) -> np.ndarray:
        return np.repeat(self.wavelength, self.geometry.size)

    def place(self, index: int) -> str:
        number, inside = divmod(index, self.geometry.size)
        there = self.geometry.place(inside)
        return f"wavelength {self.wavelength[number]:.4g}" + (f", {there}" if there else "")
