"""Files that keep an identification."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files import writable_folder, write
from .html import svg
from .tables import versions

if TYPE_CHECKING:
    from ..inference.design import Step
    from ..inference.identify import Identification, Knowledge


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _knowledge(knowledge: "Knowledge") -> dict[str, Any]:
    rows = zip(
        knowledge.parameters, knowledge.x.tolist(), knowledge.sd.tolist(), knowledge.relative.tolist(), knowledge.determined.tolist(), strict=True
    )
    known = [math.isfinite(sd) for sd in knowledge.sd.tolist()]
    return {
        "parameters": {
            p.name: {"value": x, "sd": _finite(sd), "relative_sd": _finite(share), "unit": p.unit, "determined": determined}
            for p, x, sd, share, determined in rows
        },
        "covariance": [
            [v if a and b else None for v, b in zip(row, known, strict=True)] for row, a in zip(knowledge.covariance.tolist(), known, strict=True)
        ],
        "correlation": knowledge.correlation.tolist(),
        "sentences": list(knowledge.sentences),
    }


def _step(step: "Step", names: tuple[str, ...]) -> dict[str, Any]:
    return {
        "measurement": step.measurement,
        "place": step.place,
        "index": step.index,
        "bits": step.bits,
        "sd": dict(zip(names, step.sd.tolist(), strict=True)),
    }


def identification_dict(found: "Identification") -> dict[str, Any]:
    """An identification as plain numbers and texts, null where nothing is known."""
    names = found.problem.names
    return {
        "solver": found.problem.chosen.name,
        "stated": found.stated,
        "absolute": _knowledge(found.absolute),
        "relative": None if found.relative is None else _knowledge(found.relative),
        "places": [_step(step, names) for step in found.places],
        "extra": [_step(step, names) for step in found.extra],
        "stack": repr(found.problem.stack),
        "versions": versions(),
    }


def save_identification(found: "Identification", folder: Any) -> dict[str, Path]:
    """identify.json, identify.txt and identify.svg; returns the paths by file name."""
    folder = writable_folder(folder)
    files = {
        "identify.json": json.dumps(identification_dict(found), indent=1, allow_nan=False) + "\n",
        "identify.txt": found.summary() + "\n",
        "identify.svg": svg(found.plot()),
    }
    return {name: write(folder / name, content) for name, content in files.items()}
