"""Output files of MCML (.mco): layers, totals and radial profiles of a Monte Carlo run."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..scene.layer import Layer
from ..scene.stack import Stack
from .dataset import Dataset, Noise
from .geometry import RadialReflectance, RadialTransmittance

_CM = 10.0  # mm
_TOTALS: tuple[str, ...] = ("R_specular", "R_diffuse", "absorbed", "T")
_PROFILES = {"R": ("Rd_r",), "T": ("Tt_r", "Td_r")}


@dataclass(frozen=True, repr=False)
class McoFile:
    """What a .mco file says, in mm.

    stack : the layers. photons : how many were sent. totals : R_specular, R_diffuse, absorbed and T, shares of the light that was sent.
    r : edges of the rings [mm] (n + 1,). R, T : light that leaves through the top and the bottom of each ring [1/mm^2] (n,), None where the file has
    none. The last ring holds all light beyond it: `datasets` leaves it out.
    """

    path: str
    stack: Stack
    photons: int
    totals: Mapping[str, float]
    r: np.ndarray
    R: np.ndarray | None
    T: np.ndarray | None

    def datasets(self, noise: Noise | None = None) -> list[Dataset]:
        """R(r) and T(r) as data; without noise one relative noise is estimated by a fit, and rings that nothing has reached are left out."""
        found = []
        for name, values, geometry in (("R", self.R, RadialReflectance), ("T", self.T, RadialTransmittance)):
            if values is None:
                continue
            kept = np.flatnonzero(values[:-1] > 0)
            if kept.size:
                found.append(Dataset(geometry(r_min=self.r[kept], r_max=self.r[kept + 1]), values[kept], noise=noise, name=name))
        return found

    def __repr__(self) -> str:
        totals = ", ".join(f"{name} {value:.6g}" for name, value in self.totals.items())
        return f"{self.path}: {self.photons} photons; {totals}; {self.r.size - 1} rings to {self.r[-1]:g} mm\n{self.stack!r}"


def read_mco(path: str | Path) -> McoFile:
    """Read an output file of MCML, version 1 (A1) or 2 (mcmloA2.0).

    Lengths become mm. Raises InputError for a file that cannot be read or is none.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="latin-1")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    lines = [line.partition("#")[0].split() for line in text.splitlines()]
    rows = [line for line in lines if line]
    if not rows or rows[0][0] not in ("A1", "mcmloA2.0"):
        raise InputError(f"{path}: is no output of MCML; allowed are files that begin with A1 or mcmloA2.0")
    try:
        layers, above, below, photons, dr, rings = (_first if rows[0][0] == "A1" else _second)(rows)
        totals = dict(zip(_TOTALS, _shares(rows), strict=True))
        profiles = {side: next((_numbers(rows, name, rings) for name in names if [name] in rows), None) for side, names in _PROFILES.items()}
    except (ValueError, IndexError, KeyError, StopIteration) as error:
        raise InputError(f"{path}: ends early or holds something unknown ({error or 'a part is missing'})") from None
    stack = Stack(
        [Layer(f"layer{i}", sigma_a=mua / _CM, sigma_s=mus / _CM, g=g, n=n, thickness=d * _CM) for i, (n, mua, mus, g, d) in enumerate(layers, 1)],
        n_above=above,
        n_below=below,
    )
    scaled = {side: None if values is None else np.array(values) / _CM**2 for side, values in profiles.items()}
    return McoFile(str(path), stack, photons, totals, _CM * dr * np.arange(rings + 1), scaled["R"], scaled["T"])


def _numbers(rows: list[list[str]], name: str, count: int) -> list[float]:
    """So many numbers behind a heading."""
    at = next(i for i, row in enumerate(rows) if row == [name]) + 1
    found: list[float] = []
    for row in rows[at:]:
        if len(found) >= count:
            break
        found += [float(token) for token in row]
    if len(found) < count:
        raise ValueError(f"{name}: {len(found)} numbers of {count}")
    return found[:count]


def _shares(rows: list[list[str]]) -> list[float]:
    """R_specular, R_diffuse, absorbed and T. Version 2 has the ballistic light apart: that of R is what the first face mirrors."""
    at = next(i for i, row in enumerate(rows) if row == ["RAT"]) + 1
    if rows[0][0] == "A1":
        return [float(row[0]) for row in rows[at : at + 4]]
    specular, _, diffuse, absorbed, passed, through = (float(row[0]) for row in rows[at : at + 6])
    return [specular, diffuse, absorbed, passed + through]


def _first(rows: list[list[str]]) -> tuple[list[list[float]], float, float, int, float, int]:
    """Layers [cm], indices above and below, photons, ring width [cm] and number of rings, version 1."""
    at = next(i for i, row in enumerate(rows) if row == ["InParam"])
    photons, dr, rings, count = int(rows[at + 2][0]), float(rows[at + 3][1]), int(rows[at + 4][1]), int(rows[at + 5][0])
    above = float(rows[at + 6][0])
    layers = [[float(token) for token in row[:5]] for row in rows[at + 7 : at + 7 + count]]
    return layers, above, float(rows[at + 7 + count][0]), photons, dr, rings


def _second(rows: list[list[str]]) -> tuple[list[list[float]], float, float, int, float, int]:
    """The same, version 2."""
    begin = next(i for i, row in enumerate(rows) if row[0] == "mcmli2.0")
    ends = [i for i, row in enumerate(rows) if row[0] == "end"]
    media = {row[0]: [float(token) for token in row[1:5]] for row in rows[begin + 1 : ends[0]]}
    inner = rows[ends[0] + 2 : ends[1]]
    layers = [[*media[name], float(d)] for name, d in inner[1:-1]]
    dr = float(rows[ends[1] + 3][1])
    rings, photons = int(rows[ends[1] + 4][1]), int(rows[ends[1] + 6][0])
    return layers, media[inner[0][0]][0], media[inner[-1][0]][0], photons, dr, rings
