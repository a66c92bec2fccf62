"""The pages of the documentation: their examples run, their links and the files that they name are there."""

import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from layerfit.cli import main
from layerfit.scene_file import read_scene

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs").glob("*.md"))
BLOCK = re.compile(r"(^% not run: [^\n]+\n)?^```(python|sh|toml)\n(.*?)^```", re.M | re.S)


def blocks(page: Path) -> list[tuple[str, str]]:
    """Language and text of each example that is to run."""
    return [(language, text) for unrun, language, text in BLOCK.findall(page.read_text()) if not unrun]


def anchors(page: Path) -> set[str]:
    """Of the headings, as the site names them."""
    headings = re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S), re.M)
    return {re.sub(r"[^\w\- ]", "", h.strip().lower()).replace(" ", "-") for h in headings}


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p)], ids=lambda p: p.stem)
def test_examples_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for language, text in blocks(page):
        if language == "python":
            exec(text, names)
        elif language == "toml":
            (tmp_path / "page.toml").write_text(text)
            read_scene("page.toml")
        else:
            for line in text.strip().splitlines():
                program, *arguments = shlex.split(line, comments=True)
                assert program == "layerfit", line
                result = CliRunner().invoke(main, arguments)
                assert result.exit_code == 0, result.output


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md", ROOT / "CONTRIBUTING.md"], ids=lambda p: p.stem)
def test_links(page):
    for target in re.findall(r"\]\(([^)\s]*)\)", page.read_text()):
        if "://" in target:
            assert re.fullmatch(r"https://[\w.-]+\.\w+(/\S*)?", target), target
            continue
        name, _, anchor = target.partition("#")
        file = page.parent / name if name else page
        assert file.is_file(), f"{page.name}: {target}"
        assert not anchor or anchor in anchors(file), f"{page.name}: {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_files_that_are_named_exist(page):
    for name in re.findall(r"`((?:tests|benchmarks|examples)/[\w/]+\.py)", page.read_text()):
        assert (ROOT / name).is_file(), f"{page.name}: {name}"
