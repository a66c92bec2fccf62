"""Files that keep a validation."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files import writable_folder, write
from .html import svg
from .tables import versions

if TYPE_CHECKING:
    from ..validation import Validation


def validation_dict(validation: "Validation") -> dict[str, Any]:
    """A validation as plain numbers and texts, null where there is no number."""
    return {
        "verdict": validation.verdict.value,
        "solver": validation.solver.name,
        "photons": int(validation.judge.photons),
        "seed": int(validation.judge.seed),
        "level": validation.level,
        "rows": validation.table(),
        "notes": list(validation.notes),
        "stack": repr(validation.stack),
        "settings": repr(validation.solver),
        "versions": versions(),
    }


def save_validation(validation: "Validation", folder: Any) -> dict[str, Path]:
    """validation.json, validation.txt and validation.svg; returns the paths by file name."""
    folder = writable_folder(folder)
    files = {
        "validation.json": json.dumps(validation_dict(validation), indent=1, allow_nan=False) + "\n",
        "validation.txt": validation.summary() + "\n",
        "validation.svg": svg(validation.plot()),
    }
    return {name: write(folder / name, content) for name, content in files.items()}
