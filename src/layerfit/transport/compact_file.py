"""One file for a compact form: an npz of its arrays and a text of everything else."""

import io
import json
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import files
from ..errors import InputError
from ..scene.layer import HalfSpace, Layer
from ..scene.stack import SCENE_FIELDS, Stack
from .compact_axis import Axis
from .ordinate_stack import Layout

if TYPE_CHECKING:
    from .compact import CompactForm

_FORMAT = "layerfit compact form"


def write(path: str | Path, version: int, arrays: dict[str, np.ndarray], text: str) -> None:
    """Write arrays and text; the path is used as it is given. Raises InputError where it cannot be written."""
    content: dict[str, Any] = {"format": np.array(_FORMAT), "version": np.array(version), "text": np.array(text), **arrays}
    file = io.BytesIO()
    np.savez_compressed(file, **content)
    files.write(files.writable_file(path), file.getvalue())


def read(path: str | Path, version: int, names: tuple[str, ...]) -> tuple[dict[str, np.ndarray], str]:
    """The arrays of these names, and text. Raises InputError for a file that is missing, something else, or of another version."""
    try:
        with np.load(Path(path), allow_pickle=False) as file:
            content = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise InputError(f"{path} does not exist; allowed is a file written by CompactForm.save") from None
    except (OSError, ValueError, EOFError, AttributeError, TypeError, zipfile.BadZipFile):
        raise InputError(f"{path} is no npz file; allowed is a file written by CompactForm.save") from None
    if str(content.pop("format", "")) != _FORMAT or "version" not in content or "text" not in content:
        raise InputError(f"{path} holds no compact form; allowed is a file written by CompactForm.save")
    found = int(content.pop("version"))
    if found != version:
        raise InputError(f"{path} is a compact form of version {found}; this layerfit reads version {version}")
    lacking = [name for name in names if name not in content]
    if lacking:
        raise InputError(f"{path} lacks {', '.join(lacking)} of a compact form; allowed is a file written by CompactForm.save")
    return {name: content[name] for name in names}, str(content["text"])


def to_json(form: "CompactForm") -> str:
    """All of a form that is no array."""
    layers = [
        {"name": layer.name, "half_space": isinstance(layer, HalfSpace)} | {field: float(getattr(layer, field)) for field in layer.written_fields}
        for layer in form.stack.layers
    ]
    around = {field: float(getattr(form.stack, field)) for field in SCENE_FIELDS}
    return json.dumps(
        {
            "layers": layers,
            "around": around,
            "axes": [axis._asdict() for axis in form.axes],
            "layout": asdict(form.layout),
            "rough": form.rough,
            "grazing": form.grazing,
            "errors": asdict(form.errors),
        }
    )


def from_json(text: str, path: str | Path) -> dict[str, Any]:
    """Parts of a form from their text; its errors are called ``said``. Raises InputError for a text that lacks some."""
    try:
        given = json.loads(text)
        layers = [(HalfSpace if layer.pop("half_space") else Layer)(**layer) for layer in given["layers"]]
        layout = given["layout"]
        tables = tuple(None if table is None else tuple(table) for table in layout["tables"])
        return {
            "stack": Stack(layers, **given["around"]),
            "axes": tuple(Axis(**axis) for axis in given["axes"]),
            "layout": Layout(tuple(layout["groups"]), tuple(layout["counts"]), layout["terms"], layout["orders"], tables),
            "rough": tuple(given["rough"]),
            "grazing": tuple(given["grazing"]),
            "said": {name: tuple(value) if isinstance(value, list) else value for name, value in given["errors"].items()},
        }
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: the text of the compact form cannot be read ({error}); allowed is a file written by CompactForm.save") from None
