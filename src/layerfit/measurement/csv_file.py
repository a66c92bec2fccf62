"""Data files: CSV with units in the header."""

import csv
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from .dataset import Dataset, Noise
from .geometry import GEOMETRIES, Angular, Geometry, Radial, RadialReflectance, SpatialFrequency, Total, value_unit
from .source import Detector, Source
from .units import VALUE_QUANTITY, factor_to_internal

_PLACES = {
    "r": "length",
    "r_min": "length",
    "r_max": "length",
    "k": "angular frequency",
    "fx": "cycles",
    "angle": "angle",
}
_COLUMNS = (*_PLACES, "value", "sd")


@dataclass(frozen=True)
class Table:
    """Columns of a file as numbers, with the unit of each and the line of each row."""

    path: Path
    columns: dict[str, np.ndarray]
    units: dict[str, str]
    lines: list[int]

    def place(self, row: int | None) -> str:
        """File, and line of a row."""
        return str(self.path) if row is None else f"{self.path}, line {self.lines[row]}"

    def converted(self, name: str, quantity: str) -> np.ndarray:
        """A column in the internal unit."""
        where = f"{self.path}, column '{name}'"
        return self.columns[name] * factor_to_internal(self.units[name], quantity, where)


def read_table(path: str | Path) -> Table:
    """A CSV file with a header like ``r [mm], value [1/mm^2], sd [1/mm^2]``. Lines that start with # are comments.

    Cells are separated by commas; by semicolons or tabs where the header has those and no comma. Empty columns and rows that a spreadsheet leaves
    at the end are passed over.

    Raises InputError naming file, line and column of what is wrong.
    """
    path = Path(path)
    text = read_text(path)
    numbered = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip(' \t,;"') and not line.lstrip(' \t"').startswith("#")]
    if not numbered:
        raise InputError(f"{path}: the file is empty; allowed is a header line and rows of numbers")
    header_line, header = numbered[0]
    delimiter = "," if "," in header else next((d for d in ";\t" if d in header), ",")
    names, units = [], {}
    for cell in _cells(header, delimiter):
        name, unit = _header_cell(cell, f"{path}, line {header_line}")
        if name in units:
            raise InputError(f"{path}, line {header_line}: column '{name}' is there twice")
        names.append(name)
        units[name] = unit
    if len(numbered) == 1:
        raise InputError(f"{path}: there is a header but no row of numbers")
    rows = []
    for line, content in numbered[1:]:
        cells = _cells(content, delimiter)
        if len(cells) != len(names):
            hint = "; numbers are written with a point (1.5), not a comma" if delimiter == "," and len(cells) == 2 * len(names) else ""
            raise InputError(f"{path}, line {line}: {len(cells)} cells in a table of {len(names)} columns{hint}")
        rows.append([_number(cell, path, line, name) for cell, name in zip(cells, names, strict=True)])
    array = np.array(rows)
    return Table(path, {name: array[:, i] for i, name in enumerate(names)}, units, [line for line, _ in numbered[1:]])


def read_text(path: Path) -> str:
    """The text of a file, without the mark that Windows editors put first. Raises InputError where there is none."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise InputError(f"{path}: this is a folder; allowed is a file in it") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text in UTF-8; allowed is plain text saved as UTF-8 (a spreadsheet: 'CSV UTF-8')") from None
    except (OSError, ValueError) as error:  # a ValueError is a null character in the name
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None


def _cells(line: str, delimiter: str) -> list[str]:
    """Cells of a line, without the empty ones at its end."""
    cells = [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _header_cell(cell: str, where: str) -> tuple[str, str]:
    """Name and unit."""
    match = re.fullmatch(r"(\w+)\s*\[([^][]*)\]", cell)
    if not match:
        raise InputError(f"{where}: header '{cell}' has no unit; allowed is a name and a unit, as in 'r [mm]'")
    name, unit = match.groups()
    if name not in _COLUMNS:
        hint = f"; did you mean {name.lower()}?" if name.lower() in _COLUMNS else ""
        raise InputError(f"{where}: column '{name}' is unknown; allowed: {', '.join(_COLUMNS)}{hint}")
    return name, unit.strip()


def _number(cell: str, path: Path, line: int, column: str) -> float:
    where = f"{path}, line {line}, column '{column}'"
    try:
        value = float(cell.replace("_", "?"))  # Python would read 1_000
    except ValueError:
        hint = "; numbers are written with a point (1.5), not a comma" if re.fullmatch(r"[-+]?\d*,\d+([eE].*)?", cell) else ""
        given = f"'{cell}' is not a number" if cell else "there is no number"
        raise InputError(f"{where}: {given}{hint}") from None
    if not np.isfinite(value):
        raise InputError(f"{where}: {cell} is given; allowed are finite numbers")
    return value


def geometry_from_table(
    table: Table, kind: str | None, *, source: Source | None = None, detector: Detector | None = None, **options: Any
) -> Geometry:
    """The geometry that the columns of a file describe. kind None: R(r) for r, R(k) for k or fx."""
    places = [name for name in table.columns if name in _PLACES]
    frequency = [name for name in places if name in ("k", "fx")]
    if kind is None:
        if not places:
            raise InputError(
                f"{table.path}: columns {', '.join(table.columns)} do not say where it was measured; add r, r_min and r_max, k or fx, or give a kind"
            )
        kind = SpatialFrequency.kind if frequency else RadialReflectance.kind
    cls = GEOMETRIES[kind]
    allowed = (
        [["angle"]]
        if issubclass(cls, Angular)
        else [["k"], ["fx"]]
        if cls is SpatialFrequency
        else [[]]
        if issubclass(cls, Total)
        else [["r"], ["r_min", "r_max"]]
    )
    if sorted(places) not in [sorted(a) for a in allowed]:
        wanted = " or ".join(" and ".join(a) or "value alone" for a in allowed)
        raise InputError(f"{table.path}: columns {', '.join(table.columns)} do not fit {kind}; allowed: {wanted}")
    converted = {name: table.converted(name, _PLACES[name]) for name in places}
    keywords: dict[str, Any] = dict(options)
    if issubclass(cls, Radial):
        keywords |= {"source": source, "detector": detector}
    try:
        return cls(**converted, **keywords)
    except InputError as error:
        raise InputError(f"{table.place(error.row)}: {error}") from None


def dataset_from_table(
    table: Table, geometry: Geometry, *, noise: Noise | None = None, exposure: float | None = None, name: str = "measurement"
) -> Dataset:
    """Values and sd of a file for its geometry. A noise is used where the file has no sd. With an exposure the values are counts, unit 1."""

    if "value" not in table.columns:
        raise InputError(f"{table.path}: there is no column 'value'; allowed is a header like 'r [mm], value [1/mm^2], sd [1/mm^2]'")
    quantity = VALUE_QUANTITY["1" if exposure is not None else value_unit(geometry)]
    values = table.converted("value", quantity)
    if table.units.get("sd") == "%" != table.units["value"]:
        raise InputError(f"{table.path}: sd in % of what? allowed is an sd in a unit of the value, or a relative noise instead")
    sd = table.converted("sd", quantity) if "sd" in table.columns else None
    try:
        return Dataset(geometry, values, sd, noise=noise if sd is None else None, exposure=exposure, name=name)
    except InputError as error:
        raise InputError(f"{table.place(error.row)}: {error}") from None


def read(
    path: str | Path,
    kind: str | None = None,
    *,
    source: Source | None = None,
    detector: Detector | None = None,
    noise: Noise | None = None,
    exposure: float | None = None,
    name: str = "measurement",
    **options: Any,
) -> Dataset:
    """A Dataset from a CSV file with units in its header.

    Columns: ``r`` or ``r_min`` and ``r_max`` [length], ``k`` [rad/length] or ``fx`` [1/length]; ``value``; optionally ``sd`` in a unit of the value.
    kind : as in a scene file; default radial_reflectance for r and spatial_frequency for k or fx. noise : used where the file has no sd.
    exposure : the values are counts, see `Dataset`.
    options : specular and incidence of a total.

    Raises InputError naming file, line and column.
    """
    if kind is not None and kind not in GEOMETRIES:
        raise InputError(f"kind = {kind!r}; allowed: {', '.join(GEOMETRIES)}")
    table = read_table(path)
    geometry = geometry_from_table(table, kind, source=source, detector=detector, **options)
    return dataset_from_table(table, geometry, noise=noise, exposure=exposure, name=name)
