"""A run on disk: written whole or not at all, and continued only with the scene that it was made with."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import zipfile
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import source as sources
from .checks import wrong
from .medium import Medium
from .phase import HenyeyGreenstein, Phase, TabulatedPhase
from .result import Result
from .source import Source
from .tallies import CollectingFibre, Tallies

FORMAT = 1


def version() -> str:
    """Version of layerfit that is installed."""
    try:
        return metadata.version("layerfit")
    except metadata.PackageNotFoundError:
        return "unknown"


def _named(item: Any) -> dict[str, Any]:
    return {"type": type(item).__name__, **asdict(item)}


def describe(medium: Medium, source: Source, tallies: Tallies) -> dict[str, Any]:
    """The scene as plain numbers, from which it can be rebuilt exactly."""
    parts: dict[str, Any] = {"medium": {}, "source": _named(source), "tallies": asdict(tallies)}
    for name in ("n", "sigma_a", "sigma_s", "thickness", "n_above", "n_below", "roughness"):
        parts["medium"][name] = getattr(medium, name)
    parts["medium"]["phase"] = [_named(phase) for phase in medium.phase]
    return json.loads(json.dumps(parts))  # tuples become lists, as they will be when read back


def scene_hash(scene: dict[str, Any]) -> str:
    """SHA-256 of a description."""
    return hashlib.sha256(json.dumps(scene, sort_keys=True).encode()).hexdigest()


def _rebuild(scene: dict[str, Any]) -> tuple[Medium, Source, Tallies]:
    def phase(fields: dict[str, Any]) -> Phase:
        if fields["type"] == "HenyeyGreenstein":
            return HenyeyGreenstein(fields["g"])
        return TabulatedPhase(fields["cosine"], fields["value"])

    parts = dict(scene["medium"])
    phases = [phase(fields) for fields in parts.pop("phase")]
    medium = Medium(phase=phases, **parts)
    fields = dict(scene["source"])
    kind = getattr(sources, fields.pop("type"))
    light = kind(**{name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()})
    wanted = dict(scene["tallies"])
    fibres = [CollectingFibre(**fibre) for fibre in wanted.pop("fibres")]
    optional = {name: wanted[name] or None for name in ("rings", "theta", "phi")}
    return (
        medium,
        light,
        Tallies(k=wanted["k"], fibres=fibres, na=wanted["na"], derivatives=wanted["derivatives"], **optional),
    )


def save(path: str | os.PathLike[str], result: Result, settings: dict[str, Any]) -> None:
    """Write a run to `path` (npz), replacing it in one step.

    Parameters
    ----------
    path : path
    result : Result
    settings : dict
        What else decides the numbers: engine, analogue_below, roulette_after.
    """
    scene = describe(result.medium, result.source, result.tallies)
    header = {
        "format": FORMAT,
        "version": version(),
        "seed": result.seed,
        "photons_per_batch": result.photons_per_batch,
        "batches": result.batches,
        "photons": result.photons,
        "settings": settings,
        "scene_hash": scene_hash(scene),
        "scene": scene,
    }
    target = Path(path)
    handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=target.name, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, header=np.array(json.dumps(header)), sums=result.sums)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def read(path: str | os.PathLike[str]) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Header and sums of a stored run.

    Raises
    ------
    ValueError
        If the file is not a stored run of a known format.
    """
    given, allowed = repr(os.fspath(path)), "a file that simulate wrote"
    try:
        with open(path, "rb") as handle, np.load(handle, allow_pickle=False) as file:
            header = json.loads(str(file["header"]))
            sums = file["sums"]
    except FileNotFoundError:
        raise
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise wrong("store", f"{given}, which is no stored run ({error})", allowed) from None
    if header["format"] != FORMAT:
        raise wrong("store", f"{given} of format {header['format']!r}", f"format {FORMAT}")
    return header, sums


def load(path: str | os.PathLike[str]) -> Result:
    """A stored run as a `Result`.

    Raises
    ------
    ValueError
        If the file is not a stored run.
    """
    header, sums = read(path)
    medium, source, tallies = _rebuild(header["scene"])
    return Result(medium, source, tallies, header["seed"], header["photons_per_batch"], sums)


def check(path: str | os.PathLike[str], header: dict[str, Any], scene: dict[str, Any], seed: int, settings: dict[str, Any]) -> None:
    """Refuse to continue a run that was made with another scene, seed or engine.

    Raises
    ------
    ValueError
        Names what differs.
    """
    given, allowed = repr(os.fspath(path)), ", or another file"
    if header["scene_hash"] != scene_hash(scene):
        different = [
            f"{part}.{name}"
            for part in scene
            for name in sorted({*scene[part], *header["scene"].get(part, {})})
            if scene[part].get(name) != header["scene"].get(part, {}).get(name)
        ]
        raise wrong("store", f"{given} of another scene ({', '.join(different)} differ)", "the same scene" + allowed)
    if header["seed"] != seed:
        raise wrong("store", f"{given} of seed {header['seed']}", f"seed {seed} as asked for" + allowed)
    for name, value in settings.items():
        if header["settings"].get(name) != value:
            raise wrong("store", f"{given} with {name} = {header['settings'].get(name)!r}", f"{name} = {value!r}" + allowed)
