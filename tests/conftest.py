"""Shapes and types of every annotated function are checked in the test run, warnings are errors, nothing is promoted by accident."""

import os
from pathlib import Path

import pytest

os.environ.setdefault("MPLBACKEND", "svg")

from jaxtyping import install_import_hook

_MODULES = [f"layerfit.{package}" for package in ("optics", "scene.columns", "transport", "inference", "report.tables", "predict")]
_HOOK = install_import_hook(_MODULES, "beartype.beartype")

SHARED = Path(__file__).parent.parent.parent / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of measured data that is never part of the project."""
    if not (SHARED / "data").is_dir():
        pytest.skip("the folder shared/ with measured data is not beside the project")
    return SHARED
