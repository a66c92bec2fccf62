"""Files that keep a comparison of solvers."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files import writable_folder, write
from .html import svg
from .tables import versions

if TYPE_CHECKING:
    from ..comparison import Comparison


def save_comparison(comparison: "Comparison", folder: Any) -> dict[str, Path]:
    """comparison.json, comparison.txt and comparison.svg; returns the paths by file name."""
    folder = writable_folder(folder)
    content = {
        "reference": comparison.reference,
        "rows": comparison.table(),
        "notes": list(comparison.why),
        "stack": repr(comparison.stack),
        "versions": versions(),
    }
    files = {
        "comparison.json": json.dumps(content, indent=1, allow_nan=False) + "\n",
        "comparison.txt": comparison.summary() + "\n",
        "comparison.svg": svg(comparison.plot()),
    }
    return {name: write(folder / name, text) for name, text in files.items()}
