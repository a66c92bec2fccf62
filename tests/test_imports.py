"""Who imports whom, read from the source: the house keeps one direction."""

import ast
from pathlib import Path

import pytest

import layerfit

ROOT = Path(layerfit.__file__).parent
SHARED = {"layerfit.arrays", "layerfit.errors", "layerfit.files"}  # a name for arrays, the one exception, writing files: no physics, used everywhere


def module_name(path):
    parts = path.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(tree, name, package):
    """Modules that a tree imports anywhere in it: absolute dotted names, of their members too."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = (name if package else name.rpartition(".")[0]).split(".")
            base = ".".join([*base[: len(base) - node.level + 1], *([node.module] if node.module else [])]) if node.level else node.module
            found |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    return found


def at_run_time(tree):
    """Without what is there for type checkers only."""
    return ast.Module([node for node in tree.body if not (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test))], [])


def at_import(tree):
    """What is imported when the module is: nothing within functions."""
    return ast.Module([node for node in at_run_time(tree).body if isinstance(node, ast.Import | ast.ImportFrom)], [])


def everything(part=lambda tree: tree):
    """Imports of each of our modules, in a part of it."""
    paths = sorted(ROOT.rglob("*.py"))
    return {module_name(p): imports(part(ast.parse(p.read_text())), module_name(p), p.stem == "__init__") for p in paths}


ALL = everything()
RUNNING = everything(at_run_time)


def within(name, *packages):
    return any(name == p or name.startswith(f"{p}.") for p in packages)


def ours(*names):
    return [f"layerfit.{name}" for name in names]


def test_reading_imports():
    """The reader itself: all ways to write an import, within functions and for type checkers too."""
    source = "import a.b\nfrom . import c\nfrom .d import e\nfrom ..f import g as h\nif TYPE_CHECKING:\n    from i import j\ndef k():\n    import l\n"
    tree = ast.parse(source)
    begin, types, later = {"a.b", "top.mid", "top.mid.c", "top.mid.d", "top.mid.d.e", "top.f", "top.f.g"}, {"i", "i.j"}, {"l"}
    assert imports(tree, "top.mid.leaf", False) == begin | types | later
    assert imports(at_run_time(tree), "top.mid.leaf", False) == begin | later
    assert imports(at_import(tree), "top.mid.leaf", False) == begin
    assert imports(ast.parse("from .x import y"), "top.mid", True) == {"top.mid.x", "top.mid.x.y"}
    assert "layerfit.errors" in ALL["layerfit.scene.layer"] and len(ALL) >= 50


# who: never
FORBIDDEN = {
    "optics": ["scene", "measurement", "transport", "inference", "report", "montecarlo", "solver", "predict", "scene_file", "cli"],
    "scene": ["measurement", "optics", "transport", "inference", "report", "montecarlo", "solver", "predict", "scene_file", "cli"],
    "measurement": ["transport", "inference", "report", "montecarlo", "solver", "predict", "scene_file", "cli"],
    "transport": ["inference", "report", "montecarlo", "scene_file", "cli"],
    "inference": ["montecarlo", "scene_file", "cli"],
    "montecarlo": ["optics", "transport", "inference", "report", "measurement", "scene", "solver", "predict", "scene_file", "cli"],
    "report": ["cli", "scene_file"],
    "solver": ["transport", "inference", "report", "montecarlo", "cli", "scene_file"],
    "predict": ["inference", "report", "montecarlo", "cli", "scene_file"],
    "scene_file": ["report", "cli", "montecarlo"],
}


@pytest.mark.parametrize("package", FORBIDDEN)
def test_direction(package):
    modules = {name: found for name, found in ALL.items() if within(name, *ours(package))}
    assert modules
    for name, found in modules.items():
        wrong = sorted(i for i in found if within(i, *ours(*FORBIDDEN[package])))
        assert not wrong, f"{name} imports {wrong}"


def test_optics_are_pure():
    """Formulas could be lifted into a textbook: nothing of ours but each other and the name for arrays."""
    for name, found in ALL.items():
        if within(name, *ours("optics")):
            wrong = sorted(i for i in found if within(i, "layerfit") and not within(i, *ours("optics"), *SHARED) and i != "layerfit")
            assert not wrong, f"{name} imports {wrong}"


def test_the_judge_is_independent():
    """Monte Carlo shares no formula with the solvers, in either direction, and needs no JAX."""
    for name, found in ALL.items():
        if within(name, *ours("montecarlo")):
            wrong = sorted(i for i in found if within(i, "jax", "equinox", *ours("optics", "transport")))
            assert not wrong, f"{name} imports {wrong}"
        if within(name, *ours("optics", "transport")):
            assert not any(within(i, *ours("montecarlo")) for i in found), name


# library: where alone it may be imported
HOMES = {
    "matplotlib": ours("report"),
    "jinja2": ours("report"),
    "markupsafe": ours("report"),
    "numba": ours("montecarlo"),
    "pint": ours("measurement.units"),
    "pydantic": ours("scene_tables"),
    "tomllib": ours("scene_file"),
    "click": ours("cli"),
    "optimistix": ours("inference"),
    "lineax": ours("inference"),
    "jaxopt": ours("inference.maximum"),
}


@pytest.mark.parametrize("library", HOMES)
def test_home_of_a_library(library):
    users = sorted(name for name, found in RUNNING.items() if any(within(i, library) for i in found))
    assert all(within(user, *HOMES[library]) for user in users), f"{library} is imported by {users}"


@pytest.mark.parametrize("library", ["emcee", "jaxopt", "colour", "arviz", "numpyro", "h5py"])
def test_one_module_at_most(library):
    users = sorted(name for name, found in RUNNING.items() if any(within(i, library) for i in found))
    assert len(users) <= 1, f"{library} is imported by {users}"


def test_nothing_private_of_others():
    """No private module of JAX, no equinox.internal."""
    for name, found in ALL.items():
        wrong = sorted(i for i in found if within(i, "equinox.internal", "jax._src") or (not within(i, "layerfit") and "._" in i))
        assert not wrong, f"{name} imports {wrong}"


def test_no_circle():
    """No module needs itself at import: within functions and for type checkers a module may look back."""
    graph = {name: found & set(ALL) - {"layerfit"} for name, found in everything(at_import).items()}
    done: set[str] = set()

    def visit(name, trail):
        assert name not in trail, " -> ".join([*trail[trail.index(name) :], name])
        if name not in done:
            for other in sorted(graph[name]):
                if not within(name, other):  # a package names its own parts
                    visit(other, [*trail, name])
            done.add(name)

    for name in sorted(graph):
        visit(name, [])


def test_public_names():
    """The stub names every export once, each exists, and each has a docstring."""
    lines = (ROOT / "__init__.pyi").read_text().splitlines()
    names = [line.split(" as ")[1] for line in lines if " as " in line]
    assert sorted(names) == sorted(set(names)) == sorted(layerfit.__all__)
    for name in names:
        assert getattr(layerfit, name).__doc__, name
