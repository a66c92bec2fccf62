"""Docstrings are plain text; here they become reStructuredText: sections, lists of arguments, formulas, examples."""

import re
import textwrap

_ENTRY = re.compile(r"^([a-z_][\w, ]*) : (.*)$", re.I | re.S)


def _escaped(text: str) -> str:
    """Marks of reStructuredText in plain text, other than code in backquotes."""
    parts = re.split(r"(``.+?``|`[^`]+`)", text)
    return "".join(f"``{p.strip('`')}``" if i % 2 else re.sub(r"([\\*_|<])", r"\\\1", p) for i, p in enumerate(parts))


def _entries(lines: list[str]) -> list[str]:
    """Lines of a paragraph, those that go on indented joined to the one before."""
    joined: list[str] = []
    for line in lines:
        if joined and line.startswith(" "):
            joined[-1] += " " + line.strip()
        else:
            joined.append(line)
    return joined


def _paragraph(lines: list[str]) -> list[str]:
    if lines[0].startswith(">>>"):
        return lines
    if all(line.startswith("    ") for line in lines):
        return ["::", "", *lines]
    if len(lines) == 2 and set(lines[1]) == {"-"}:
        return [f".. rubric:: {lines[0]}"]
    if len(lines) > 2 and set(lines[1]) == {"-"}:
        return [*_paragraph(lines[:2]), "", *_paragraph(lines[2:])]
    if _ENTRY.match(lines[0]):
        out = []
        for entry in _entries(lines):
            match = _ENTRY.match(entry)
            text = entry if match is None else f"**{match[1]}** : "
            out += [f"- {_escaped(text) if match is None else text + _escaped(match[2])}"]
        return out
    return [_escaped(line.strip()) for line in lines]


def to_rst(lines: list[str]) -> list[str]:
    """A docstring as reStructuredText."""
    text = textwrap.dedent("\n".join(lines)).strip("\n")
    out: list[str] = []
    for paragraph in re.split(r"\n\s*\n", text):
        if paragraph.strip():
            out += [*_paragraph(paragraph.splitlines()), ""]
    return out


def _process(app, what, name, obj, options, lines):
    lines[:] = to_rst(lines)


def setup(app):
    app.connect("autodoc-process-docstring", _process)
    return {"parallel_read_safe": True}
