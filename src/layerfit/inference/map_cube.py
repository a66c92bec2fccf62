"""Measured cubes: named dimensions laid over the places of a problem's measurements."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..errors import InputError
from ..measurement.geometry import Angular, Geometry, Radial, SpatialFrequency, value_unit
from ..measurement.spectrum import Spectrum
from ..measurement.units import NM, VALUE_QUANTITY, factor_to_internal
from .problem import Problem

if TYPE_CHECKING:
    import xarray as xr

_SAME = 1e-6


class _Axis(NamedTuple):
    """One dimension of a measurement. names : those it may have; under each its places, their quantity, and how many of the places' unit are in the
    internal one of that quantity."""

    names: dict[str, tuple[np.ndarray, str, float]]
    size: int


class Cube(NamedTuple):
    """dims, shape, coords : of the pixels. values, sd (*shape, n), mask (*shape, 1) : numpy or dask arrays, internal units; None where not given."""

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    coords: dict[str, Any]
    values: Any
    sd: Any
    mask: Any

    @property
    def lazy(self) -> bool:
        """Whether values are computed when they are asked for."""
        return not isinstance(self.values, np.ndarray)


def axes(geometry: Geometry) -> tuple[_Axis, ...]:
    """The dimensions of a measurement, outermost first."""
    if isinstance(geometry, Spectrum):
        return (_Axis({"wavelength": (geometry.wavelength, "length", NM)}, geometry.wavelength.size), *axes(geometry.geometry))
    if isinstance(geometry, SpatialFrequency):
        k = geometry.k
        return (_Axis({"k": (k, "angular frequency", 1.0), "fx": (k / (2.0 * np.pi), "cycles", 1.0)}, k.size),)
    if isinstance(geometry, Radial):
        return (_Axis({"r": (geometry.centers(), "length", 1.0)}, geometry.size),)
    if isinstance(geometry, Angular):
        return (_Axis({"angle": (geometry.angle, "angle", 1.0)}, geometry.size),)
    return ()


def read_cube(problem: Problem, data: Any, sd: Any, mask: Any) -> Cube:
    """Values of all measurements at all pixels. Raises InputError where dimensions, coordinates or units do not agree with the problem."""
    import xarray as xr

    given = _by_name(problem, data, "data", xr)
    spread = None if sd is None else _by_name(problem, sd, "sd", xr)
    if spread is None and isinstance(data, xr.Dataset) and all(f"{one.name}.sd" in data for one in given.values()):
        spread = {name: data[f"{one.name}.sd"] for name, one in given.items()}
    profile = {d.name: _profile(d.name, d.geometry, given[d.name]) for d in problem.data}
    inner = {dim for dims in profile.values() for dim in dims}
    outer: dict[str, int] = {}
    for name, one in given.items():
        for dim, size in one.sizes.items():
            if dim not in profile[name]:
                if dim in inner:
                    raise InputError(f"data '{name}': dimension '{dim}' is a profile of another measurement; give it another name here")
                if outer.setdefault(str(dim), size) != size:
                    raise InputError(f"data '{name}': {size} along '{dim}', {outer[str(dim)]} in another measurement; allowed is one size")
    if not outer:
        raise InputError(f"data has the dimensions {', '.join(map(str, inner)) or '(none)'} alone; allowed is one more at least, of pixels")
    dims = tuple(outer)
    coords = {str(name): c for one in given.values() for name, c in one.coords.items() if set(c.dims) <= set(dims)}
    parts, deviations = [], []
    for d in problem.data:
        one = given[d.name]
        _check_places(d.name, d.geometry, one, profile[d.name])
        parts.append(_flat(one * _factor(d.name, d.geometry, one), dims, outer, profile[d.name]))
        if spread is not None:
            unit = spread[d.name] if "units" in spread[d.name].attrs else one
            deviations.append(_flat(spread[d.name] * _factor(d.name, d.geometry, unit), dims, outer, profile[d.name], like=one))
    if mask is not None:
        if not isinstance(mask, xr.DataArray) or not set(map(str, mask.dims)) <= set(dims):
            raise InputError(f"mask; allowed is a DataArray over {', '.join(dims)}, True where a pixel is to be fitted")
        mask = _flat(mask, dims, outer, ())
    values = _joined(parts)
    return Cube(dims, tuple(outer.values()), coords, values, _joined(deviations) if deviations else None, mask)


def _by_name(problem: Problem, data: Any, what: str, xr: Any) -> "dict[str, xr.DataArray]":
    names = [d.name for d in problem.data]
    if isinstance(data, xr.DataArray):
        if len(names) > 1:
            raise InputError(f"{what} is one DataArray for {len(names)} measurements; allowed is a Dataset with {', '.join(names)}")
        return {names[0]: data}
    if not isinstance(data, xr.Dataset):
        raise InputError(f"{what} is a {type(data).__name__}; allowed is an xarray DataArray or Dataset")
    own = [name for name in data.data_vars if not str(name).endswith(".sd")]
    if len(names) == len(own) == 1:
        return {names[0]: data[own[0]]}
    lacking = [name for name in names if name not in data]
    if lacking:
        held = ", ".join(map(str, data.data_vars))
        raise InputError(f"{what}: no variable '{lacking[0]}', the name of a measurement; it holds {held}")
    return {name: data[name] for name in names}


def _profile(name: str, geometry: Geometry, data: "xr.DataArray") -> tuple[str, ...]:
    """The dimensions that are a measurement's own."""
    found = []
    for axis in axes(geometry):
        dim = next((known for known in axis.names if known in data.dims), None)
        if dim is None:
            raise InputError(f"data '{name}': no dimension {' or '.join(axis.names)} among {', '.join(map(str, data.dims))}")
        if data.sizes[dim] != axis.size:
            raise InputError(f"data '{name}': {data.sizes[dim]} along '{dim}'; the problem has {axis.size} places")
        found.append(dim)
    return tuple(found)


def _check_places(name: str, geometry: Geometry, data: "xr.DataArray", dims: tuple[str, ...]) -> None:
    for axis, dim in zip(axes(geometry), dims, strict=True):
        if dim not in data.coords:
            continue
        places, quantity, per = axis.names[dim]
        where = f"data '{name}', coordinate '{dim}'"
        factor = 1.0
        if "units" in data[dim].attrs:
            factor = per * factor_to_internal(str(data[dim].attrs["units"]), quantity, where)
        there = factor * np.asarray(data[dim].values, dtype=float)
        if not np.all(np.abs(there - places) <= _SAME * np.max(np.abs(places))):
            i = int(np.argmax(np.abs(there - places)))
            raise InputError(f"{where}: number {i + 1} is {there[i]:g}; the problem has {places[i]:g} there")


def _factor(name: str, geometry: Geometry, data: "xr.DataArray") -> float:
    if "units" not in data.attrs:
        return 1.0
    return factor_to_internal(str(data.attrs["units"]), VALUE_QUANTITY[value_unit(geometry)], f"data '{name}'")


def _flat(one: "xr.DataArray", dims: tuple[str, ...], sizes: dict[str, int], profile: tuple[str, ...], like: "xr.DataArray | None" = None) -> Any:
    """As (*pixels, places); what does not depend on a dimension is spread over it."""
    whole = {dim: size for dim, size in sizes.items() if dim not in one.dims}
    if like is not None:
        whole |= {dim: like.sizes[dim] for dim in profile if dim not in one.dims}
    array = one.expand_dims(whole).transpose(*dims, *profile).data
    if hasattr(array, "rechunk"):
        array = array.rechunk(dict.fromkeys(range(len(dims), array.ndim), -1))
    return array.reshape((*sizes.values(), -1))


def _joined(parts: list[Any]) -> Any:
    if len(parts) == 1:
        return parts[0]
    if all(isinstance(part, np.ndarray) for part in parts):
        return np.concatenate(parts, axis=-1)
    import dask.array as da

    return da.concatenate(parts, axis=-1).rechunk({parts[0].ndim - 1: -1})
