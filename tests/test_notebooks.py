"""Every notebook of examples/ holds its outputs, ends with a check, and runs from a clean kernel as a user has it."""

import ast
import os
from pathlib import Path

import nbformat
import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"
NOTEBOOKS = sorted(EXAMPLES.glob("*.ipynb"))
IN_A_CELL = 180  # s; a notebook takes less than a minute on two cores that have nothing else to do
OF_THE_TESTS = ("MPLBACKEND", "XLA_FLAGS")  # set for the test run only

each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def code_cells(path: Path) -> list[nbformat.NotebookNode]:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def can_fail(test: ast.expr) -> bool:
    """Whether what is asserted depends on anything."""
    return any(isinstance(node, ast.Name) for node in ast.walk(test))


def test_there_are_notebooks():
    assert len(NOTEBOOKS) >= 1


@each
def test_outputs_are_stored(path):
    cells = code_cells(path)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1)), "not executed from top to bottom in one go"
    outputs = [output for cell in cells for output in cell.outputs]
    assert not [output for output in outputs if output.output_type == "error"]
    assert not [output.text for output in outputs if output.output_type == "stream" and output.name == "stderr"], "a warning was stored"
    assert any("image/png" in output.get("data", {}) for output in outputs), "no figure"
    assert "/home/" not in path.read_text() and "site-packages" not in path.read_text(), "a path of one machine was stored"


@each
def test_it_ends_with_a_check(path):
    checks = [node for node in ast.walk(ast.parse(code_cells(path)[-1].source)) if isinstance(node, ast.Assert)]
    assert checks
    assert all(can_fail(node.test) for node in checks)


@each
def test_it_is_listed(path):
    assert f"({path.name})" in (EXAMPLES / "README.md").read_text()


@pytest.mark.notebooks
@each
def test_it_runs(path):
    from nbclient import NotebookClient
    from nbclient.exceptions import CellTimeoutError

    notebook = nbformat.read(path, as_version=4)
    client = NotebookClient(notebook, timeout=IN_A_CELL, startup_timeout=120, kernel_name="python3", resources={"metadata": {"path": str(EXAMPLES)}})
    environment = {name: value for name, value in os.environ.items() if name not in OF_THE_TESTS}
    try:
        client.execute(env=environment)
    except CellTimeoutError as error:
        pytest.fail(f"{path.name}: a cell ran for more than {IN_A_CELL} s: {str(error)[:300]}")
