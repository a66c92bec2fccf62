"""A scene file and a cube of data: what the command map does."""

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import InputError
from .inference.maps import fit_map
from .measurement.dataset import Dataset
from .predict import predict
from .scene_file import SceneFile

if TYPE_CHECKING:
    import xarray as xr

    from .inference.problem import Problem


def template(scene: SceneFile, solver: str | None = None) -> "Problem":
    """The problem of one pixel. A measurement without values gets those of the guess, which stand for their size."""
    planned = [m for m in scene.measurements if m.dataset is None]
    found = iter(predict(scene.stack, [m.geometry for m in planned], solver=scene.solver(solver)) if planned else [])
    data = [Dataset(m.geometry, next(found).values, noise=m.noise, name=m.name) if m.dataset is None else m.dataset for m in scene.measurements]
    return scene.problem(solver, data)


def read_cubes(path: Path) -> "xr.Dataset":
    """A zarr store or a netCDF file, read as it is asked for. Raises InputError where it is none."""
    import xarray as xr

    if not path.exists():
        raise InputError(f"{path}: there is no such file or folder")
    if any(find_spec(name) is None for name in ("dask", "zarr")):
        raise InputError("maps from files need the packages dask and zarr: pip install 'layerfit[maps]'")
    try:
        return xr.open_zarr(path) if path.is_dir() else xr.open_dataset(path, engine="h5netcdf", chunks={})
    except Exception as error:
        raise InputError(f"{path}: cannot be read as {'zarr' if path.is_dir() else 'netCDF'} ({type(error).__name__}: {error})") from None


def run_map(
    scene: SceneFile,
    data: Path,
    out: Path,
    *,
    solver: str | None = None,
    starts: int = 5,
    block: int = 4096,
    saturated: float | None = None,
    scheduler: str | None = None,
    on_tiles: Callable[[int, int], None] | None = None,
) -> "tuple[xr.Dataset, Problem]":
    """Fit a scene to all pixels of a cube into a store; by the workers of a dask scheduler where its address is given."""
    cube = read_cubes(data)
    problem = template(scene, solver)
    noise: Any = {m.name: m.noise for m in scene.measurements if m.noise is not None} or None
    client = _connected(scheduler) if scheduler else None
    try:
        options = {"starts": starts, "block": block, "limits": (0.0, saturated), "seed": scene.seed}
        return fit_map(problem, cube, noise=noise, store=out, client=client, on_tiles=on_tiles, **options), problem
    finally:
        if client is not None:
            client.close()


def _connected(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--scheduler needs the package distributed: pip install 'layerfit[maps]'") from None
    try:
        return Client(address, timeout=10)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"--scheduler {address}: no scheduler answers there ({type(error).__name__})") from None
