"""Files of inverse adding-doubling (.rxt): total reflectance and transmittance of a slab between slides."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError

if TYPE_CHECKING:
    import pandas as pd

_HEADER = ("n", "n_slide", "thickness", "slide_thickness", "beam", "standard", "spheres")
_SPHERE = ("diameter", "sample_port", "light_port", "detector_port", "wall")
_COUNTED = ("M_R", "M_T", "M_U", "reflectance_wall", "transmittance_wall", "reflectance_standard", "transmittance_standard")
LETTERS = {
    "L": "wavelength", "r": "M_R", "t": "M_T", "u": "M_U", "g": "g", "n": "n", "N": "n_slide", "d": "thickness", "D": "slide_thickness",
    "i": "incidence", "w": "reflectance_wall", "W": "transmittance_wall", "R": "reflectance_standard", "T": "transmittance_standard",
    "a": "albedo", "A": "sigma_a", "b": "optical_thickness", "B": "beam", "F": "sigma_s", "Q": "unscattered_fraction", "S": "spheres",
    "c": "unscattered_in_M_R", "C": "unscattered_in_M_T", "e": "error", "E": "slide_optical_thickness", "f": "wall_first", "x": "x", "X": "X",
}  # fmt: skip
"""Columns by the letter that names them in a file."""


@dataclass(frozen=True, repr=False)
class RxtFile:
    """What a .rxt file says. Lengths in mm.

    n, n_slide : refractive indices of sample and slides. thickness, slide_thickness : theirs. beam : diameter of the beam. standard : reflectance of
    the standard. spheres : how many integrating spheres were used (0, 1, 2); reflectance_sphere, transmittance_sphere : their numbers as given.
    columns : measured numbers by name, one a row: M_R, M_T (totals, the specular reflection included) and M_U, wavelength [nm] and what else the file
    gives. remarks : the comment behind each row.
    """

    path: str
    n: float
    n_slide: float
    thickness: float
    slide_thickness: float
    beam: float
    standard: float
    spheres: int
    reflectance_sphere: Mapping[str, float]
    transmittance_sphere: Mapping[str, float]
    columns: Mapping[str, np.ndarray]
    remarks: tuple[str, ...] = field(default=())

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def at(self, name: str, row: int) -> float:
        """n, n_slide, thickness, slide_thickness or g of one row: its own where the file gives a column, else the file's; g is 0 if unknown."""
        if name in self.columns:
            return float(self.columns[name][row])
        return 0.0 if name in ("g", "incidence") else float(getattr(self, name))

    @property
    def notes(self) -> tuple[str, ...]:
        """What is not read as it stands."""
        if self.spheres == 0:
            return ()
        what = "one sphere" if self.spheres == 1 else f"{self.spheres} spheres"
        return (f"measured with {what}: M_R and M_T are read as they stand, light lost or gained in spheres is not put right",)

    def impossible(self, row: int) -> str | None:
        """Why no sample can have the values of a row, None where one can."""
        where = f"row {row + 1}"
        wavelength = self.columns.get("wavelength")
        if wavelength is not None:
            where += f" (wavelength {wavelength[row]:g})"
        for name in ("M_R", "M_T", "M_U"):
            if name in self.columns and not 0.0 <= self.columns[name][row] <= 1.0:
                return f"{where}: {name} = {self.columns[name][row]:g}; possible is 0 to 1"
        total = sum(float(self.columns[name][row]) for name in ("M_R", "M_T") if name in self.columns)
        if total > 1.0:
            return f"{where}: M_R + M_T = {total:g}; more than 1 comes back"
        return None

    def to_pandas(self) -> "pd.DataFrame":
        """The columns as a table."""
        import pandas as pd

        return pd.DataFrame(dict(self.columns))

    def __repr__(self) -> str:
        slides = f"slides n {self.n_slide:g}, {self.slide_thickness:g} mm" if self.has_slides else "no slides"
        head = f"{self.path}: {len(self)} rows of {', '.join(self.columns)}; sample n {self.n:g}, {self.thickness:g} mm, {slides}"
        return "\n".join([head, *self.notes])

    @property
    def has_slides(self) -> bool:
        return self.n_slide != 1.0 and self.slide_thickness > 0


def read_rxt(path: str | Path) -> RxtFile:
    """Read a .rxt file of inverse adding-doubling.

    The file begins with IAD1; what follows # is a comment. Then come indices, thicknesses, beam, standard, spheres, and rows: either the number of
    measurements (M_R, M_T, M_U, wall and standard reflectances, in this order) with or without a wavelength first, or a line of letters (`LETTERS`).

    Raises InputError for a file that cannot be read or does not hold that.

    >>> import pathlib, tempfile
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "slab.rxt"
    >>> _ = file.write_text("IAD1 1.4 1.5 1 1 2 1 0  0 0 0 0 0  0 0 0 0 0\\nL r t\\n633 0.30 0.25 # a\\n650 0.31 0.26\\n")
    >>> read_rxt(file).columns["M_T"]
    array([0.25, 0.26])
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="latin-1")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if not text.startswith("IAD1"):
        raise InputError(f"{path}: begins with {text[:4]!r}; allowed is a file of inverse adding-doubling, which begins with IAD1")
    tokens: list[tuple[str, int]] = []
    comments: dict[int, str] = {}
    for number, line in enumerate(text[4:].splitlines(), 1):
        told, _, comment = line.partition("#")
        comments[number] = comment.strip()
        tokens += [(token, number) for token in told.replace(",", " ").split()]
    count = len(_HEADER) + 2 * len(_SPHERE)
    if len(tokens) < count:
        raise InputError(f"{path}: {len(tokens)} numbers before the rows; allowed are {count}")
    head = [_number(path, *token) for token in tokens[:count]]
    rest = tokens[count:]
    if not rest:
        raise InputError(f"{path}: no rows; allowed is at least one")
    names, rest = _names(path, rest)
    if not rest or len(rest) % len(names):
        raise InputError(f"{path}: {len(rest)} numbers in rows of {len(names)} ({', '.join(names)}); the last row is not whole")
    table = np.array([_number(path, *token) for token in rest]).reshape(-1, len(names))
    last = [rest[i][1] for i in range(len(names) - 1, len(rest), len(names))]
    spheres: list[dict[str, float]] = [{name: head[i + j] for j, name in enumerate(_SPHERE)} for i in (7, 12)]
    values: dict[str, Any] = dict(zip(_HEADER, head[:7], strict=True)) | {"spheres": int(head[6])}
    for name in ("n", "n_slide", "thickness"):
        if not values[name] > 0:
            raise InputError(f"{path}: {name} = {values[name]:g}; allowed is a number above 0")
    columns = dict(zip(names, table.T, strict=True))
    remarks = tuple(comments[line] for line in last)
    return RxtFile(str(path), **values, reflectance_sphere=spheres[0], transmittance_sphere=spheres[1], columns=columns, remarks=remarks)


def _names(path: Path, rest: list[tuple[str, int]]) -> tuple[list[str], list[tuple[str, int]]]:
    """Names of the columns, and what is left."""
    first, line = rest[0]
    if first.isalpha():
        letters = [token for token, number in rest if number == line]
        unknown = [letter for letter in letters if letter not in LETTERS]
        if unknown:
            raise InputError(f"{path}, line {line}: column '{unknown[0]}'; allowed: {', '.join(LETTERS)}")
        names = [LETTERS[letter] for letter in letters]
        if len(set(names)) < len(names):
            raise InputError(f"{path}, line {line}: a column is named twice")
        return names, rest[len(letters) :]
    count = _number(path, first, line)
    if count not in range(1, len(_COUNTED) + 1):
        raise InputError(f"{path}, line {line}: {first} measurements; allowed is 1 to {len(_COUNTED)}, or letters that name the columns")
    names: list[str] = list(_COUNTED[: int(count)])
    if len(rest) > 1 and _number(path, *rest[1]) > 1.0:  # a reflectance is not above 1: it is a wavelength
        names = ["wavelength", *names]
    return names, rest[1:]


def _number(path: Path, token: str, line: int) -> float:
    try:
        value = float(token)
    except ValueError:
        raise InputError(f"{path}, line {line}: '{token}'; allowed is a number") from None
    if not np.isfinite(value):
        raise InputError(f"{path}, line {line}: '{token}'; allowed is a finite number")
    return value
