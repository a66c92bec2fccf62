"""Measured values with their uncertainty."""

from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np

from ..errors import InputError
from .geometry import Geometry, value_unit

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


class Noise(eqx.Module):
    """A standard deviation made of a relative and an absolute part, added in quadrature.

    relative : share of the value. absolute : in the unit of the value.
    """

    relative: float = 0.0
    absolute: float = 0.0

    def __check_init__(self):
        for name in ("relative", "absolute"):
            value = getattr(self, name)
            if not (isinstance(value, int | float) and np.isfinite(value) and value >= 0):
                raise InputError(f"noise {name} = {value!r}; allowed is a finite number, at least 0")
        if self.relative == 0 and self.absolute == 0:
            raise InputError("noise: relative and absolute are both 0; allowed is at least one above 0")

    def sd(self, values: np.ndarray) -> np.ndarray:
        """Standard deviation of values."""
        return np.hypot(self.relative * np.abs(values), self.absolute)


def check_measurement_name(name: object) -> None:
    """Raise InputError for a name that cannot be the prefix of a parameter and part of a file's name."""
    if not isinstance(name, str) or not name or name != name.strip() or not name.isprintable() or any(c in name for c in "./\\") or name == "scene":
        raise InputError(f"measurement name {name!r}: allowed is a non-empty text without dots and slashes, other than 'scene'")


class Dataset(eqx.Module):
    """What was measured.

    Arguments
    ---------
    geometry : where and how.
    values : one a place, in the internal unit of the geometry (1/mm^2 for R(r)).
    sd : standard deviations, above 0; or
    noise : Noise(relative, absolute), from which they follow. With neither, one relative noise is assumed for all values and its size is
        estimated from the fit.
    exposure : the values are counts (whole numbers, at least 0) and this, one number or one a place, is the count expected for a value of 1 in the
        unit of the geometry: photons sent times the detector's area and efficiency. Values and sd = sqrt(count) are kept in that unit.
    name : prefix of the nuisance parameters (``name.amplitude``, ``name.offset``, ``name.background``).

    Raises InputError for counts that do not agree, values that are not finite, or an sd that is not above 0.

    >>> import layerfit as lf
    >>> lf.Dataset(lf.RadialReflectance(r=[1, 2]), [0.02, 0.008], noise=lf.Noise(relative=0.02)).sd
    array([0.0004 , 0.00016])
    """

    geometry: Geometry
    values: np.ndarray
    sd: np.ndarray | None
    name: str
    exposure: np.ndarray | None

    def __init__(
        self, geometry: Geometry, values: Any, sd: Any = None, *, noise: Noise | None = None, exposure: Any = None, name: str = "measurement"
    ):
        check_measurement_name(name)
        self.geometry, self.name = geometry, name
        self.values = self._column(values, "value")
        self.sd = self.exposure = None
        if exposure is not None:
            if sd is not None or noise is not None:
                raise InputError(f"measurement '{name}': an exposure beside sd or noise; the sd of counts are known, allowed is one of them")
            self._take_counts(exposure)
        elif sd is not None:
            self.sd = self._column(sd, "sd")
            if np.any(self.sd <= 0):
                i = int(np.flatnonzero(self.sd <= 0)[0])
                raise InputError(f"measurement '{name}': sd {i + 1} is {self.sd[i]:g}; allowed is a number above 0", row=i)
        elif noise is not None:
            self.sd = noise.sd(self.values)
            if np.any(self.sd == 0):
                i = int(np.flatnonzero(self.sd == 0)[0])
                raise InputError(
                    f"measurement '{name}': value {i + 1} is 0 and its noise relative; allowed with it is an absolute noise or an sd", row=i
                )
        elif np.any(self.values <= 0):
            i = int(np.flatnonzero(self.values <= 0)[0])
            raise InputError(
                f"measurement '{name}': value {i + 1} is {self.values[i]:g} and has neither sd nor noise; without them allowed are values above 0, "
                "whose relative noise is estimated",
                row=i,
            )

    def to_xarray(self) -> "xr.Dataset":
        """Values and, where known, sd over the places, with units: one dimension, named as its first place column ("place" for a total)."""
        import xarray as xr

        places = self.geometry.places()
        dim = next(iter(places), "place")
        unit = {"units": value_unit(self.geometry)}
        columns: dict[str, Any] = {self.name: (dim, self.values, unit)}
        if self.sd is not None:
            columns[f"{self.name}.sd"] = (dim, self.sd, unit)
        units = {"k": "rad/mm", "angle": "deg", "wavelength": "nm"}
        return xr.Dataset(columns, coords={name: (dim, places[name], {"units": units.get(name, "mm")}) for name in places})

    def to_pandas(self) -> "pd.DataFrame":
        """The same as a table, one row a value: places, value and, where known, sd."""
        import pandas as pd

        columns = {**self.geometry.places(), "value": self.values}
        return pd.DataFrame(columns if self.sd is None else {**columns, "sd": self.sd})

    def _take_counts(self, exposure: Any) -> None:
        counts = self.values
        self.exposure = self._column(np.broadcast_to(exposure, counts.shape) if np.ndim(exposure) == 0 else exposure, "exposure")
        for wrong, what, given, allowed in (
            ((counts < 0) | (counts != np.round(counts)), "count", counts, "whole numbers, at least 0"),
            (self.exposure <= 0, "exposure", self.exposure, "numbers above 0"),
        ):
            if np.any(wrong):
                i = int(np.flatnonzero(wrong)[0])
                raise InputError(f"measurement '{self.name}': {what} {i + 1} is {given[i]:g}; allowed are {allowed}", row=i)
        self.values = counts / self.exposure
        self.sd = np.sqrt(np.maximum(counts, 1.0)) / self.exposure

    def _column(self, values: Any, what: str) -> np.ndarray:
        try:
            array = np.atleast_1d(np.asarray(values, dtype=float))
        except (TypeError, ValueError):
            raise InputError(f"measurement '{self.name}': {what} holds something that is not a number") from None
        if array.shape != (self.geometry.size,):
            raise InputError(f"measurement '{self.name}': {array.size} numbers of {what} for {self.geometry.size} places; allowed is one each")
        if not np.all(np.isfinite(array)):
            i = int(np.flatnonzero(~np.isfinite(array))[0])
            raise InputError(f"measurement '{self.name}': {what} {i + 1} is {array[i]}; allowed are finite numbers", row=i)
        return array
