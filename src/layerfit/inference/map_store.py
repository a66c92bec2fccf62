"""The zarr store of a map: tiles appear in it one by one, and each is marked when it is whole."""

import json
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .map_tile import Variable, parts

if TYPE_CHECKING:
    import xarray as xr

_WRITTEN = "written"  # one flag a tile, set when all else of it is there
_STATED = "layerfit_map"
Tile = tuple[slice, ...]


def tiles(shape: Sequence[int], size: Sequence[int]) -> list[Tile]:
    """Rectangles of at most ``size`` that cover a shape."""
    steps = [[slice(i, min(i + step, n)) for i in range(0, n, step)] for n, step in zip(shape, size, strict=True)]
    return list(product(*steps))


def tile_size(shape: Sequence[int], block: int) -> tuple[int, ...]:
    """Sides of tiles of about ``block`` pixels, whole rows where they fit."""
    sides, left = [], block
    for n in reversed(shape):
        sides.append(max(1, min(n, left)))
        left //= sides[-1]
    return tuple(reversed(sides))


def unpacked(
    packed: Any, dims: tuple[str, ...], coords: dict[str, Any], variables: Sequence[Variable], names: Sequence[str], attrs: dict
) -> "xr.Dataset":
    """A Dataset from an array of pixels and all their numbers."""
    import xarray as xr

    found = {}
    for v, part in parts(packed, variables):
        if v.width == 1:
            found[v.name] = (dims, part[..., 0].astype(v.dtype), v.attrs)
        else:
            found[v.name] = ((*dims, "number", "other"), part.reshape((*part.shape[:-1], len(names), len(names))), v.attrs)
    more = {"number": list(names), "other": list(names)} if any(v.width > 1 for v in variables) else {}
    return xr.Dataset(found, coords={**coords, **more}, attrs=attrs)


class Store:
    """A map on disk.

    Raises InputError where the folder holds something else, the map of another problem, or cannot be written.
    """

    def __init__(
        self,
        path: Any,
        shape: tuple[int, ...],
        size: tuple[int, ...],
        dims: tuple[str, ...],
        coords: dict[str, Any],
        variables: Sequence[Variable],
        names: Sequence[str],
        attrs: dict[str, Any],
        stated: dict[str, str],
    ):
        try:
            import zarr
        except ImportError:
            raise InputError("a store needs the packages zarr and dask: pip install 'layerfit[maps]'") from None
        self.path, self.shape, self.size, self.variables = Path(path), shape, size, variables
        self._names = len(names)
        stated = {**stated, "tile": str(size), "shape": str(shape)}
        try:
            if not self.path.exists() or not any(self.path.iterdir()):
                self._create(dims, coords, names, attrs, stated)
            elif not (self.path / "zarr.json").is_file():
                raise InputError(f"{self.path}: holds something that is no map of layerfit; allowed is a new folder")
            self.group: Any = zarr.open_group(self.path, mode="r+")
            held = json.loads(self.group.attrs.get(_STATED, "null"))
        except InputError:
            raise
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written ({error.strerror or error})") from None
        except Exception as error:
            raise InputError(f"{self.path}: holds something that is no map ({type(error).__name__}); allowed is a new folder") from None
        if held is None:
            raise InputError(f"{self.path}: holds something that is no map of layerfit; allowed is a new folder")
        other = next((key for key in {**stated, **held} if stated.get(key) != held.get(key)), None)
        if other is not None:
            raise InputError(
                f"{self.path}: holds a map with other settings: {other} = {held.get(other)} there, {stated.get(other)} here; give a new folder"
            )

    def _create(self, dims: tuple[str, ...], coords: dict[str, Any], names: Sequence[str], attrs: dict[str, Any], stated: dict[str, str]) -> None:
        import dask.array as da

        width = sum(v.width for v in self.variables)
        blank = da.full((*self.shape, width), np.nan, chunks=(*self.size, width))
        whole = unpacked(blank, dims, coords, self.variables, names, attrs)
        for v in self.variables:
            if v.dtype != "float64":
                whole[v.name] = (dims, da.full(self.shape, -1, dtype=v.dtype, chunks=self.size), v.attrs)
        counts = [-(-n // step) for n, step in zip(self.shape, self.size, strict=True)]
        whole[_WRITTEN] = (tuple(f"{dim}.tile" for dim in dims), da.zeros(counts, dtype="int8", chunks=1))
        encoding: dict[Any, Any] = {v.name: {"fill_value": np.nan if v.dtype == "float64" else -1} for v in self.variables}
        whole.drop_attrs(deep=False).assign_attrs({**attrs, _STATED: json.dumps(stated)}).to_zarr(
            self.path, mode="w", compute=False, consolidated=False, encoding=encoding
        )

    def todo(self) -> list[Tile]:
        """Tiles that are not there."""
        written = np.asarray(self.group[_WRITTEN][...])
        return [tile for tile in tiles(self.shape, self.size) if not written[self._place(tile)]]

    def _place(self, tile: Tile) -> tuple[int, ...]:
        return tuple(s.start // step for s, step in zip(tile, self.size, strict=True))

    def write(self, tile: Tile, packed: Float[np.ndarray, "*tile q"]) -> None:
        """All variables of a tile, then its flag. Raises InputError where the disk refuses."""
        try:
            for v, part in parts(packed, self.variables):
                shaped = part[..., 0].astype(v.dtype) if v.width == 1 else part.reshape((*part.shape[:-1], self._names, self._names))
                self.group[v.name][tile] = shaped
            self.group[_WRITTEN][self._place(tile)] = 1
        except OSError as error:
            raise InputError(
                f"{self.path}: cannot be written ({error.strerror or error}); what is there is whole, the same call goes on with it"
            ) from None

    def opened(self) -> "xr.Dataset":
        """The map as it is."""
        return open_map(self.path)


def open_map(path: Any) -> "xr.Dataset":
    """A map that was written before, finished or not: read as it is asked for. Raises InputError where there is none.

    Pixels of tiles that are not there yet have outcome -1.
    """
    import xarray as xr

    try:
        found = xr.open_zarr(path, consolidated=False, mask_and_scale=True)
    except Exception as error:
        raise InputError(f"{path}: no map can be read from it ({type(error).__name__})") from None
    if _STATED not in found.attrs:
        raise InputError(f"{path}: no map of layerfit")
    return found.drop_vars(_WRITTEN).drop_attrs(deep=False).assign_attrs({k: v for k, v in found.attrs.items() if k != _STATED})
