"""A fit for every pixel."""

import os
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from threading import Event
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..measurement.dataset import Noise
from .emulate import Emulated
from .map_cube import Cube, read_cube
from .map_store import Store, Tile, tile_size, tiles, unpacked
from .map_tile import Fitter
from .problem import Problem
from .settings import problem_settings

if TYPE_CHECKING:
    import xarray as xr

_AHEAD = 3  # tiles for each worker that wait or run
_RETRIES = 3


def fit_map(
    problem: Problem,
    data: Any,
    sd: Any = None,
    *,
    noise: Noise | Mapping[str, Noise] | None = None,
    mask: Any = None,
    limits: tuple[int | float | None, int | float | None] = (0.0, None),
    starts: int = 5,
    seed: int = 0,
    correlations: bool = False,
    block: int = 4096,
    store: Any = None,
    client: Any = None,
    on_tiles: Callable[[int, int], None] | None = None,
) -> "xr.Dataset":
    """Fit a problem to every pixel of a cube.

    Pixels are fitted as by `fit_many`, tile by tile, and then followed until their steps are nothing. Memory is that of a tile. Under a client of
    dask.distributed (given, or the current one) the tiles are fitted by its workers; where one dies its tile is fitted again.

    Arguments
    ---------
    problem : the measurements of one pixel, what is free, the solver. Its values stand for the size of those of a pixel. For slow solvers:
        `emulate(problem)`.
    data : DataArray, or Dataset with one variable a measurement, named as these. The dimensions of a profile are called r [mm], k [rad/mm] or
        fx [1/mm], angle [deg], wavelength [nm] and have the problem's places in its order; all others are pixels. Units in ``attrs["units"]``.
    sd : the same for standard deviations; dimensions may be missing. In a Dataset of data: variables ``name.sd``. Left out: noise (one for all or
        ``{measurement: noise}``), or else the relative sd of the problem's data at each place; where they have none, one relative noise is estimated
        for each pixel.
    mask : DataArray over the pixels, True where one is to be fitted.
    limits : values at or below the first (dead) or at or above the second (saturated) are no measurements; their pixels are left out. None: no limit.
    starts, seed : as for `fit_many`, neighbours are pixels of the same tile that measured alike. correlations : whether they are kept.
    block : pixels of a tile; data that are dask arrays keep their own chunks.
    store : folder of a zarr store. Each tile is written when it is done, and the same call goes on where another has ended.
    on_tiles : called with (tiles done, tiles to do).

    Returns a Dataset over the pixels: each number, ``.stderr``, ``.at_bound`` and ``.determined`` (-1 where nothing was fitted), ``chi2``,
    ``outcome`` (with its meanings), ``met`` of ``runs`` that ended in the chosen minimum, ``noise`` where it is estimated. Lazily where data are
    dask arrays and there is no store. Raises InputError where data and problem do not agree, or a store cannot be written or is another map's.

    >>> import layerfit as lf, numpy as np, xarray as xr
    >>> skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.01, sigma_s_prime=1, n=1.4)])
    >>> camera = lf.SpatialFrequency(fx=[0, 0.1, 0.2])
    >>> one = lf.Dataset(camera, lf.predict(skin, camera)[0].values, noise=lf.Noise(relative=0.02))
    >>> problem = lf.Problem(skin, one, free={"skin.sigma_a": (1e-3, 1), "skin.sigma_s_prime": (0.1, 10)}, solver=lf.LayeredDiffusion())
    >>> image = xr.DataArray(np.tile(one.values, (2, 3, 1)), dims=("y", "x", "fx"))
    >>> lf.fit_map(problem, image)["skin.sigma_s_prime"].values.round(3).tolist()
    [[1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]
    """
    _check(starts, block, limits)
    cube = read_cube(problem, data, sd, mask)
    relative, absolute = _spread(problem, noise)
    size = _own_tiles(cube) or tile_size(cube.shape, block)
    threads = 1 if len(tiles(cube.shape, size)) > 1 else _cores()
    fitter = Fitter(
        problem, relative=relative, absolute=absolute, limits=limits, starts=starts, seed=seed, correlations=correlations, threads=threads
    )
    attrs = {
        "degrees_of_freedom": cube.values.shape[-1] - len(problem.parameters),
        "solver": problem.chosen.name,
        "limits": str(limits),
    }
    error = problem.model.error if isinstance(problem.model, Emulated) else None
    if error is not None:
        attrs["emulator_error"] = error
    if store is None and cube.lazy:
        return unpacked(_lazily(fitter, cube), cube.dims, cube.coords, fitter.variables, problem.names, attrs)
    client = _current() if client is None else client
    if store is None:
        packed = np.empty((*cube.shape, fitter.width))
        for tile, found in _fitted(fitter, cube, tiles(cube.shape, size), client, on_tiles):
            packed[tile] = found
        return unpacked(packed, cube.dims, cube.coords, fitter.variables, problem.names, attrs)
    stated = problem_settings(problem) | {k: str(v) for k, v in fitter.stated.items() if k != "problem"} | _checksum(cube)
    stated["emulator"] = str(error)
    kept = Store(store, cube.shape, size, cube.dims, cube.coords, fitter.variables, problem.names, attrs, stated)
    for tile, found in _fitted(fitter, cube, kept.todo(), client, on_tiles):
        kept.write(tile, found)
    return kept.opened()


def _check(starts: int, block: int, limits: tuple[int | float | None, int | float | None]) -> None:
    for name, value in (("starts", starts), ("block", block)):
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise InputError(f"{name} = {value!r}; allowed is a whole number, at least 1")
    low, high = limits if isinstance(limits, tuple) and len(limits) == 2 else (1.0, 0.0)
    if low is not None and high is not None and not low < high:
        raise InputError(f"limits = {limits!r}; allowed are two numbers that rise, or None for no limit")


def _spread(problem: Problem, noise: Noise | Mapping[str, Noise] | None) -> tuple[np.ndarray, np.ndarray]:
    """Relative and absolute part of the sd of each value."""
    relative, absolute = [], []
    unknown = set(noise) - {d.name for d in problem.data} if isinstance(noise, Mapping) else set()
    if unknown:
        raise InputError(f"noise of '{min(unknown)}', which is no measurement; allowed: {', '.join(d.name for d in problem.data)}")
    for d in problem.data:
        one = noise.get(d.name) if isinstance(noise, Mapping) else noise
        if one is not None:
            relative.append(np.full(d.geometry.size, one.relative))
            absolute.append(np.full(d.geometry.size, one.absolute))
        else:
            relative.append(np.ones(d.geometry.size) if d.sd is None else d.sd / np.maximum(np.abs(d.values), 1e-300))
            absolute.append(np.zeros(d.geometry.size))
    return np.concatenate(relative), np.concatenate(absolute)


def _own_tiles(cube: Cube) -> tuple[int, ...] | None:
    """Sides of the chunks of lazy data, where they are all alike but the last."""
    if not cube.lazy:
        return None
    sides = cube.values.chunks[:-1]
    return tuple(s[0] for s in sides) if all(len(set(s[:-1])) <= 1 and s[-1] <= s[0] for s in sides) else None


def _checksum(cube: Cube) -> dict[str, str]:
    """Of data that are at hand."""
    import hashlib

    parts = {"data": cube.values, "sd of data": cube.sd, "mask": cube.mask}
    return {
        name: hashlib.sha256(np.ascontiguousarray(part).tobytes()).hexdigest()[:12] for name, part in parts.items() if isinstance(part, np.ndarray)
    }


def _lazily(fitter: Fitter, cube: Cube) -> Any:
    """All numbers of all pixels as one dask array."""
    import dask.array as da

    chunks = cube.values.chunks
    aligned = [None if a is None else da.asarray(a).rechunk((*chunks[:-1], -1)) for a in (cube.sd, cube.mask)]
    given = [a for a in aligned if a is not None]
    return da.map_blocks(
        _tile,
        cube.values,
        *given,
        fitter=fitter,
        with_sd=cube.sd is not None,
        dtype=float,
        chunks=(*chunks[:-1], (fitter.width,)),
        meta=np.empty((0,) * cube.values.ndim),
    )


def _tile(values: np.ndarray, *more: np.ndarray, fitter: Fitter, with_sd: bool) -> np.ndarray:
    sd = more[0] if with_sd else None
    mask = more[-1] if len(more) > with_sd else None
    return fitter(values, sd, mask)


def _current() -> Any:
    """The client of dask.distributed in whose reach this runs, None where there is none."""
    if "distributed" not in sys.modules:
        return None
    from distributed import default_client

    try:
        return default_client()
    except ValueError:
        return None


def _fitted(
    fitter: Fitter, cube: Cube, todo: list[Tile], client: Any, on_tiles: Callable[[int, int], None] | None
) -> Iterator[tuple[Tile, np.ndarray]]:
    """Tiles as they are done."""
    if on_tiles:
        on_tiles(0, len(todo))
    source = _here(fitter, cube, todo) if client is None else _there(fitter, cube, todo, client)
    for done, (tile, found) in enumerate(source, 1):
        yield tile, found
        if on_tiles:
            on_tiles(done, len(todo))


def _here(fitter: Fitter, cube: Cube, todo: list[Tile]) -> Iterator[tuple[Tile, np.ndarray]]:
    """By threads, a tile for each core."""
    over = Event()

    def go_on(done: int, to_do: int) -> None:
        if over.is_set():
            raise CancelledError

    def fit(tile: Tile) -> tuple[Tile, np.ndarray]:
        parts = [None if a is None else np.asarray(a[tile]) for a in (cube.values, cube.sd, cube.mask)]
        return tile, fitter(*parts, on_sets=go_on)  # pyright: ignore[reportArgumentType]

    waiting, running = list(reversed(todo)), set[Future[tuple[Tile, np.ndarray]]]()
    with ThreadPoolExecutor(_cores()) as pool:
        try:
            while waiting or running:
                running |= {pool.submit(fit, waiting.pop()) for _ in range(min(len(waiting), _cores() + 1 - len(running)))}
                done, running = wait(running, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in done)
        finally:  # an error, an interrupt, or nobody who takes more: tiles end with the round that they are in
            over.set()
            pool.shutdown(wait=False, cancel_futures=True)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _there(fitter: Fitter, cube: Cube, todo: list[Tile], client: Any) -> Iterator[tuple[Tile, np.ndarray]]:
    """By workers, a few tiles ahead of what is taken."""
    from distributed import as_completed

    waiting = list(reversed(todo))
    where: dict[Any, Tile] = {}
    running = as_completed(with_results=True)

    def send() -> None:
        tile = waiting.pop()
        parts = [a if a is None else a[tile] if isinstance(a, np.ndarray) else client.compute(a[tile]) for a in cube[-3:]]
        future = client.submit(fitter, *parts, pure=False, retries=_RETRIES)
        where[future.key] = tile
        running.add(future)

    workers = max(1, sum(client.nthreads().values()))
    for _ in range(min(len(waiting), _AHEAD * workers)):
        send()
    for future, found in running:
        yield where.pop(future.key), found
        if waiting:
            send()
