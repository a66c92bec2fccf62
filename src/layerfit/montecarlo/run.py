"""The entry point: run batches until enough photons, an error small enough, the time limit, or Ctrl-C."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import closing, nullcontext
from typing import Self

import numpy as np
from numpy.typing import NDArray

from . import store as storage
from .checks import number, whole, wrong
from .medium import Medium
from .result import Result
from .source import Pencil, Source
from .statistics import Estimate
from .tallies import Tallies

# Below this weight absorption is decided whole (see engine). Chosen for the least variance times time over half spaces and slabs
# of albedo 0.67 to 0.999; lower values pay only where light is followed through many absorption lengths.
ANALOGUE_BELOW = 0.3
ROULETTE_AFTER = 1_000_000
_BATCH, _BATCHES = 10_000, 100
_LEAST_BATCHES, _EVERY = 20, 10  # before an error is trusted enough to stop at it, and how often it is looked at
_SAVE_SECONDS = 30.0


def simulate(
    medium: Medium,
    source: Source | None = None,
    tallies: Tallies | None = None,
    *,
    photons: float = 1_000_000,
    seed: int = 0,
    photons_per_batch: int | None = None,
    threads: int | None = None,
    store: str | os.PathLike[str] | None = None,
    progress: bool = False,
    max_seconds: float | None = None,
    relative_error: Mapping[str, float] | None = None,
    analogue_below: float = ANALOGUE_BELOW,
) -> Result:
    """Follow photons through a layered medium.

    The numbers depend on the scene, the seed, the photons in a batch and their number of batches; not on the threads, nor on whether
    the run was made in one piece or continued.

    Parameters
    ----------
    medium : Medium
    source : source, optional
        `Pencil` (default: at normal incidence), `Disk`, `Gaussian`, `Fibre` or `Lambertian`.
    tallies : Tallies, optional
        Beside the totals; default none.
    photons : int
        How many; rounded up to whole batches. With `relative_error` or `max_seconds`, at most so many.
    seed : int
        0 <= seed < 2^64.
    photons_per_batch : int, optional
        Default: 10,000, or fewer so that there are 100 batches. Errors have (number of batches - 1) degrees of freedom. All batches
        are kept in memory and in the store: with many bins and derivatives choose fewer, larger ones.
    threads : int, optional
        Default: the processors this process may use.
    store : path, optional
        File (npz) of the run. If it exists, the run is continued: it must hold the same scene and seed, its batch size is kept, and
        only the photons that are missing are followed. Written about every 30 s and at the end.
    progress : bool
        Show a progress bar on standard error.
    max_seconds : float, optional
        Stop after this wall time [s] (without compilation). Batches begun are dropped, unless fewer than 2 are complete.
    relative_error : mapping of str to float, optional
        Stop once every entry of each named tally has this relative standard error; looked at every 10 batches from 20 on.
    analogue_below : float
        Weight below which absorption is decided whole. Lower it (1e-3) to follow light over many absorption lengths.

    Returns
    -------
    Result
        With `outcome` "done", "interrupted" (Ctrl-C: the whole batches that are complete), "time limit" or "relative error reached".

    Raises
    ------
    ValueError
        If an argument is wrong, or the store belongs to another run.
    KeyboardInterrupt
        If interrupted before 2 batches are complete.

    Examples
    --------
    The transmittance of a slab (van de Hulst 1980: 0.66096):

    >>> import layerfit.montecarlo as mc
    >>> slab = mc.Medium(n=[1.0], sigma_a=[0.1], sigma_s=[0.9], g=[0.75], thickness=[2.0])
    >>> result = mc.simulate(slab, mc.Pencil(), mc.Tallies(rings=[0.0, 1.0, 2.0]), photons=20_000, seed=1, threads=1)
    >>> mc.compare(result.estimate("T"), 0.66096).verdict
    'agree'
    """
    source = Pencil() if source is None else source
    tallies = Tallies() if tallies is None else tallies
    for name, value, kind in (("medium", medium, Medium), ("source", source, Source), ("tallies", tallies, Tallies)):
        if not isinstance(value, kind):
            raise wrong(name, repr(value), getattr(kind, "__name__", "Pencil, Disk, Gaussian, Fibre or Lambertian"))
    wanted, seed = whole("photons", photons, 2), whole("seed", seed, 0)
    largest = min(_BATCH, -(-wanted // _BATCHES))
    size = largest if photons_per_batch is None else whole("photons_per_batch", photons_per_batch, 1)
    if seed >= 2**64:
        raise wrong("seed", seed, "below 2^64")
    workers = _processors() if threads is None else whole("threads", threads, 1)
    if max_seconds is not None:
        number("max_seconds", max_seconds, 0.0, 1e300, "above 0 [s]", above=True)
    number("analogue_below", analogue_below, 0.0, 1.0, "0 to 1")
    if store is not None and not os.access(os.path.dirname(os.path.abspath(store)), os.W_OK):
        raise wrong("store", repr(os.fspath(store)), "a file in a folder that exists and can be written")

    from . import engine  # starts numba

    light = source.table(medium.n_above)
    empty = Result(medium, source, tallies, seed, size, np.empty((0, 0, 0)))
    targets = dict(relative_error or {})
    for name, value in targets.items():
        empty.layout.matrix(name)
        number(f"relative_error[{name!r}]", value, 0.0, 1.0, "above 0, at most 1", above=True)
    settings = {"engine": engine.ENGINE, "analogue_below": float(analogue_below), "roulette_after": ROULETTE_AFTER}
    done: list[NDArray[np.float64]] = []
    if store is not None and os.path.exists(store):
        header, sums = storage.read(store)
        storage.check(store, header, storage.describe(medium, source, tallies), seed, settings)
        size, done = header["photons_per_batch"], list(sums)
    total = max(-(-wanted // size), 2)

    layout = empty.layout
    shape = (layout.rows, layout.columns)
    tables = (medium.table(), light, layout.table(source.symmetric))
    stop = np.zeros(1, np.int64)

    def one(batch: int, count: int = size) -> NDArray[np.float64] | None:
        return engine.run_batch(*tables, seed, batch, count, float(analogue_below), ROULETTE_AFTER, *shape, stop)

    def result(outcome: str, seconds: float) -> Result:
        return Result(medium, source, tallies, seed, size, np.array(done), outcome, seconds, compiled - started)

    started = time.perf_counter()
    one(0, 0)
    compiled = saved = time.perf_counter()
    outcome = _reached(empty, done, targets) or "done"
    monitor = _Progress(total, len(done)) if progress else None
    try:
        with monitor or nullcontext(), closing(_in_order(one, len(done), total, workers, stop)) as batches:
            for sums in batches if outcome == "done" else ():
                if sums is not None:
                    done.append(sums)
                    outcome = _reached(empty, done, targets) or outcome
                    if monitor is not None:
                        monitor.update(len(done))
                seconds = time.perf_counter() - compiled
                if max_seconds is not None and seconds > max_seconds and 2 <= len(done) < total and outcome == "done":
                    outcome = "time limit"
                if outcome != "done":
                    break
                if store is not None and time.perf_counter() - saved > _SAVE_SECONDS and len(done) >= 2:
                    storage.save(store, result(outcome, seconds), settings)
                    saved = time.perf_counter()
    except KeyboardInterrupt:
        if len(done) < 2:
            raise
        outcome = "interrupted"
    final = result(outcome, time.perf_counter() - compiled)
    if store is not None:
        storage.save(store, final, settings)
    return final


def _in_order(
    one: Callable[[int], NDArray[np.float64] | None], first: int, total: int, workers: int, stop: NDArray[np.int64]
) -> Generator[NDArray[np.float64] | None, None, None]:
    """Batches `first` to `total` - 1, one after the other whatever thread ends first; None each time 0.1 s pass without one.

    When closed, or left by an exception, it stops the batches in progress.
    """
    with ThreadPoolExecutor(workers) as pool:
        waiting: deque[Future[NDArray[np.float64] | None]] = deque()
        following = first
        try:
            while waiting or following < total:
                while len(waiting) < 2 * workers and following < total:
                    waiting.append(pool.submit(one, following))
                    following += 1
                wait([waiting[0]], timeout=0.1)
                yield waiting.popleft().result() if waiting[0].done() else None
        finally:
            stop[0] = 1
            for future in waiting:
                future.cancel()


def _processors() -> int:
    """Processors that this process may use (not every system can tell them from those that exist)."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _reached(empty: Result, done: list[NDArray[np.float64]], targets: dict[str, float]) -> str | None:
    """Whether all named tallies have reached their relative error."""
    if not targets or len(done) < _LEAST_BATCHES or len(done) % _EVERY:
        return None
    for name, target in targets.items():
        rows, measure, _ = empty.layout.matrix(name)
        samples = np.stack([[sums[row, 0].sum() for row in rows] for sums in done]) / measure
        if not np.all(Estimate.from_samples(samples).relative_error <= target):
            return None
    return "relative error reached"


class _Progress:
    """A progress bar over batches."""

    def __init__(self, total: int, done: int):
        from rich import console, progress

        columns = (
            progress.BarColumn(),
            progress.MofNCompleteColumn(),
            progress.TimeElapsedColumn(),
            progress.TimeRemainingColumn(),
        )
        self._bar = progress.Progress("batches", *columns, console=console.Console(stderr=True))
        self._task = self._bar.add_task("batches", total=total, completed=done)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def update(self, done: int) -> None:
        self._bar.update(self._task, completed=done)
