"""The chain of a sampler, in memory or in a file that survives a kill at any moment."""

import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError

FILE = "chain.h5"
_LAYOUT = 1  # of the file; one of another layout is refused


class Chain:
    """Steps of a sampler, and the state from which it goes on.

    In a file all arrays have their place in an HDF5 file from the beginning, and steps are stored into them through a memory map: nothing of the
    file's structure ever changes, so that it can be read whenever the program ends. Steps count from the moment when the head, one aligned number
    (twice their count, plus the place of the state), is stored, which happens last. Of the state there are two places, used in turn, so that the
    one that the head names is whole. What is stored belongs to the operating system at once: a kill loses nothing but the step in the making.
    """

    def __init__(self, arrays: Mapping[str, np.ndarray], lock: int | None = None):
        self._arrays, self._lock = dict(arrays), lock

    @property
    def _head(self) -> int:
        return int(self._arrays["head"][0])

    @property
    def count(self) -> int:
        """Number of steps done."""
        return self._head // 2

    @property
    def capacity(self) -> int:
        """Number of steps for which there is room."""
        return len(self._arrays["x"])

    @property
    def x(self) -> np.ndarray:
        """Positions of all steps done in physical units (steps, walkers, p)."""
        return self._arrays["x"][: self.count]

    @property
    def log_density(self) -> np.ndarray:
        """Log density at them (steps, walkers)."""
        return self._arrays["log_density"][: self.count]

    @property
    def divergent(self) -> np.ndarray:
        """Whether the way there diverged (steps, walkers)."""
        return self._arrays["divergent"][: self.count] > 0

    @property
    def state(self) -> bytes:
        """The sampler's state after the last step."""
        return self._arrays["state"][self._head % 2].tobytes()

    def append(self, x: np.ndarray, log_density: np.ndarray, divergent: np.ndarray, state: bytes) -> None:
        """Add steps, (new, walkers, p) and (new, walkers), with the sampler's state after them; all of them count, or none."""
        begin, place = self.count, 1 - self._head % 2
        end = begin + len(x)
        for name, new in (("x", x), ("log_density", log_density), ("divergent", divergent)):
            self._arrays[name][begin:end] = new
        self._arrays["state"][place] = np.frombuffer(state, np.uint8)
        self._arrays["head"][0] = 2 * end + place

    def close(self) -> None:
        """Give the file back; the steps stay in memory."""
        self._arrays = {name: np.array(values) for name, values in self._arrays.items()}
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def chain_in_memory(steps: int, walkers: int, p: int, state_size: int) -> Chain:
    """An empty chain with room for so many steps."""
    return Chain({name: np.zeros(shape, kind) for name, (shape, kind) in _places(steps, walkers, p, state_size).items()})


def chain_in_file(path: Path, settings: Mapping[str, str], steps: int, walkers: int, p: int, state_size: int) -> Chain:
    """The chain that a file holds, with room for at least so many steps; an empty one where there is no file.

    settings : what decides the distribution and the way through it, as text by name.

    Raises InputError where the file is that of other settings (naming the first that differs), no such file, or in use.
    """
    lock = _locked(path)
    try:
        if path.exists():
            _check(path, read_settings(path), settings)
            found = _mapped(path, "r+")
            if len(found["x"]) < steps:
                _create(path, settings, _places(steps, walkers, p, state_size), found)
        else:
            _create(path, settings, _places(steps, walkers, p, state_size), {})
        return Chain(_mapped(path, "r+"), lock)
    except BaseException:
        if lock is not None:
            os.close(lock)
        raise


def read_chain(path: Path) -> Chain:
    """What a file holds now, for looking at it; whoever writes it may go on."""
    return Chain({name: np.array(values) for name, values in _mapped(path, "r").items()})


def read_settings(path: Path) -> dict[str, str]:
    """Settings that a file was made with. Raises InputError where it is no chain."""
    import h5py

    try:
        with h5py.File(path, "r", locking=False) as file:
            if file.attrs.get("layout") != _LAYOUT:
                raise InputError(f"{path}: not a chain that this version of layerfit can go on with; give another folder")
            return json.loads(file["settings"][()])  # pyright: ignore[reportIndexIssue, reportArgumentType]
    except (OSError, KeyError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: not a chain of layerfit ({error}); give another folder") from None


def check_settings(path: Path, wanted: Mapping[str, str]) -> None:
    """Raise InputError where there is a file already, and one of these settings is another one in it."""
    if path.exists():
        found = read_settings(path)
        _check(path, {name: found[name] for name in wanted if name in found}, wanted)


def _places(steps: int, walkers: int, p: int, state_size: int) -> dict[str, tuple[tuple[int, ...], Any]]:
    """Shape and type of each array."""
    return {
        "head": ((1,), np.int64),
        "x": ((steps, walkers, p), np.float64),
        "log_density": ((steps, walkers), np.float64),
        "divergent": ((steps, walkers), np.uint8),
        "state": ((2, state_size), np.uint8),
    }


def _create(path: Path, settings: Mapping[str, str], places: Mapping[str, tuple[tuple[int, ...], Any]], content: Mapping[str, np.ndarray]) -> None:
    """Write a file with room for all arrays, all of it on the disk, and put it in place whole. content : what they begin with."""
    import h5py

    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".layerfit.")
    os.close(handle)
    try:
        with h5py.File(temporary, "w") as file:
            file.attrs["layout"] = _LAYOUT
            file["settings"] = json.dumps(dict(settings))
            for name, (shape, kind) in places.items():
                begun = np.zeros(shape, kind)
                if name in content:
                    begun[: len(content[name])] = content[name]
                file.create_dataset(name, data=begun)
        os.chmod(temporary, 0o644)
        with open(temporary, "rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    finally:
        Path(temporary).unlink(missing_ok=True)


def _mapped(path: Path, mode: Any) -> dict[str, np.ndarray]:
    """The file's arrays through memory maps."""
    import h5py

    found = {}
    with h5py.File(path, "r", locking=False) as file:
        for name in _places(0, 0, 0, 0):
            data: Any = file[name]
            found[name] = (data.id.get_offset(), data.shape, data.dtype)
    return {name: np.memmap(path, kind, mode, offset, shape) for name, (offset, shape, kind) in found.items()}


def _locked(path: Path) -> int | None:
    """A lock beside the file, which ends with the process, so that two do not write one chain; None where the system has none."""
    try:
        import fcntl
    except ImportError:
        return None
    try:
        lock = os.open(path.with_name(f".{path.name}.lock"), os.O_CREAT | os.O_RDWR, 0o644)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        raise InputError(f"{path}: another program is writing it; wait for its end or give another folder") from None
    return lock


def _check(path: Path, found: Mapping[str, str], wanted: Mapping[str, str]) -> None:
    different = [name for name in sorted({*found, *wanted}) if found.get(name) != wanted.get(name)]
    if different:
        name = different[0]
        more = f" (and {len(different) - 1} more: {', '.join(different[1:4])}{', ...' if len(different) > 4 else ''})" if len(different) > 1 else ""
        raise InputError(
            f"{path}: this chain was made with {name} = {found.get(name, 'none')}, now it is {wanted.get(name, 'none')}{more}; "
            "give another folder, or what it was made with"
        )
