"""Where the benchmarks leave their numbers."""

import json
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "results"


def record(name: str, rows: Any) -> None:
    """Write rows as results/NAME.json."""
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / f"{name}.json").write_text(json.dumps(rows, indent=1) + "\n")
