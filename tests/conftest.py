"""Shapes and types of every annotated function are checked in the test run, warnings are errors, nothing is promoted by accident."""

import gc
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

os.environ.setdefault("MPLBACKEND", "svg")
# most of a test's time is compilation: the quick code generator does, and XLA_FLAGS= in the environment brings back the one that users have
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false --xla_backend_optimization_level=0")

import equinox as eqx
import jax
from click.testing import CliRunner
from jaxtyping import install_import_hook

_MODULES = [f"layerfit.{package}" for package in ("optics", "scene.columns", "transport", "inference", "report.tables", "predict")]
_HOOK = install_import_hook(_MODULES, "beartype.beartype")

SHARED = Path(__file__).parent.parent.parent / "shared"


_MAPS = Path("/proc/self/maps")
_MANY = 25_000  # a process may have 65,530 memory maps; every compiled program keeps a few, and without one more the compiler crashes


@pytest.fixture(autouse=True, scope="module")
def _programs_let_go() -> Iterator[None]:
    """Compiled programs are dropped after a file of tests once they fill the process."""
    yield
    if _MAPS.exists() and _MAPS.read_bytes().count(b"\n") > _MANY:
        eqx.clear_caches()
        jax.clear_caches()
        gc.collect()


@pytest.fixture(scope="session")
def fitted_examples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder in which `example` and `fit` were called for each bundled example: NAME/scene.toml ..., NAME/result, NAME/said."""
    from layerfit.cli import main

    folder = tmp_path_factory.mktemp("examples")
    for name in ("two-layer", "slab-totals", "spatial-frequency"):
        assert CliRunner().invoke(main, ["example", name, "--out", str(folder / name)]).exit_code == 0
        result = CliRunner().invoke(main, ["fit", str(folder / name / "scene.toml"), "--out", str(folder / name / "result")])
        assert result.exit_code == 0, result.output
        (folder / name / "said").write_text(result.stdout)
    return folder


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of measured data that is never part of the project."""
    if not (SHARED / "data").is_dir():
        pytest.skip("the folder shared/ with measured data is not beside the project")
    return SHARED
