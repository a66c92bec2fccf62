"""Slabs between slides, row by row: what inverse adding-doubling does, with standard errors."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, one_of
from ..measurement.dataset import Dataset, Noise
from ..measurement.geometry import Incidence, TotalReflectance, TotalTransmittance
from ..measurement.rxt_file import RxtFile, read_rxt
from ..scene.layer import Layer
from ..scene.stack import Stack
from ..solver import Solver
from ..transport.discrete_ordinates import DiscreteOrdinates
from .many import fit_refined
from .problem import Problem
from .result import Outcome

if TYPE_CHECKING:
    import pandas as pd

NUMBERS = ("sigma_a", "sigma_s_prime")
TOTALS = ("M_R", "M_T")
_COARSE = 16  # streams
_ABSORPTION, _SCATTERING = (1e-6, 100.0), (1e-3, 1000.0)  # bounds of sigma_a and sigma_s' times the thickness


@dataclass(frozen=True, repr=False)
class SlabRows:
    """Fits of the rows of a file.

    x, stderr : sigma_a and sigma_s_prime [1/mm] and their standard errors (rows, 2), NaN where a row was not fitted; the standard error also where a
    number was held, is at its bound or the data say nothing of it. values, sd, fitted : M_R and M_T as measured, their sd and as fitted (rows, 2),
    NaN where they were not measured. said : what is to be said of each row, empty where nothing is.
    """

    file: RxtFile
    x: np.ndarray
    stderr: np.ndarray
    values: np.ndarray
    sd: np.ndarray
    fitted: np.ndarray
    said: tuple[str, ...]

    @property
    def good(self) -> np.ndarray:
        """Rows that were fitted and whose R and T, as far as they were measured, are met within their sd (rows,)."""
        seen = _measured(self.file)
        return np.all(np.abs(self.fitted - self.values)[:, seen] <= self.sd[:, seen], axis=1)

    def to_pandas(self) -> "pd.DataFrame":
        """One row a row of the file: its columns, numbers, standard errors, fitted totals and what is to be said."""
        table = self.file.to_pandas()
        for q, name in enumerate(NUMBERS):
            table[name], table[f"{name}.stderr"] = self.x[:, q], self.stderr[:, q]
        for q in _measured(self.file):
            table[TOTALS[q].removeprefix("M_")] = self.fitted[:, q]
        table["said"] = self.said
        return table

    def __repr__(self) -> str:
        notes = [f"  ! {one}" for one in dict.fromkeys((*self.file.notes, *filter(None, self.said)))]
        return "\n".join([self.to_pandas().drop(columns="said").to_string(float_format="%.4g"), *notes])


def slab(file: RxtFile, row: int = 0, *, sigma_a: float = 0.1, sigma_s_prime: float = 1.0, g: float | None = None) -> Stack:
    """The sample of a file between its slides, which are clear layers.

    g : mean cosine where the file has no column of it (default 0).
    """
    sample = Layer(
        "sample",
        sigma_a=sigma_a,
        sigma_s_prime=sigma_s_prime,
        g=file.at("g", row) if g is None or "g" in file.columns else g,
        n=file.at("n", row),
        thickness=file.at("thickness", row),
    )
    if file.at("n_slide", row) == 1.0 or not file.at("slide_thickness", row) > 0:
        return Stack([sample])
    optics = {"sigma_a": 0.0, "sigma_s_prime": 0.0, "g": 0.0, "n": file.at("n_slide", row), "thickness": file.at("slide_thickness", row)}
    return Stack([Layer("slide above", **optics), sample, Layer("slide below", **optics)])


def fit_slabs(
    file: RxtFile | str | Path,
    *,
    g: float | None = None,
    held: Mapping[str, Any] | None = None,
    noise: Noise | None = None,
    solver: Solver | None = None,
    starts: int = 5,
    on_rows: Callable[[int, int], None] | None = None,
) -> SlabRows:
    """sigma_a and sigma_s' of each row of a .rxt file from M_R and M_T, or one of them from either.

    file : as `read_rxt` gives it, or its path. g : mean cosine where the file has no column of it (default 0). held : sigma_a or sigma_s_prime [1/mm]
    where it is known, ``{"sigma_a": 0.01}``, one for all rows or one each: the other is fitted, which M_R or M_T alone can give. noise : of M_R and
    M_T (default: 1 % and 1e-4). starts : see `fit_many`. on_rows : called with (rows done, rows). Rows that no sample can have are named and left
    out. M_U is read and not used.

    Raises InputError where the file has fewer of M_R and M_T than numbers are to be found, or g, held or noise are out of range.

    >>> import pathlib, tempfile
    >>> import layerfit as lf
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "slab.rxt"
    >>> _ = file.write_text("IAD1 1.4 1.0 1 0 2 1 0  0 0 0 0 0  0 0 0 0 0\\nr t\\n0.30 0.25\\n0.80 0.25\\n")
    >>> lf.fit_slabs(file).said
    ('', 'row 2: M_R + M_T = 1.05; more than 1 comes back')
    """
    file = file if isinstance(file, RxtFile) else read_rxt(file)
    rows, seen = len(file), _measured(file)
    known = _known(held, rows)
    free = [q for q, name in enumerate(NUMBERS) if name not in known]
    if not seen:
        raise InputError(f"{file.path}: no M_R and no M_T; allowed is a file with one of them at least")
    if len(seen) < len(free):
        lacking = next(name for name in TOTALS if name not in file.columns)
        cure = "hold what is known of them, such as held={'sigma_s_prime': 1.0}, and the other is found"
        raise InputError(f"{file.path}: {lacking} is missing; one total of a row cannot give two numbers: {cure}")
    solver = DiscreteOrdinates() if solver is None else solver
    noise = Noise(relative=0.01, absolute=1e-4) if noise is None else noise
    values = np.full((rows, len(TOTALS)), np.nan)
    for q in seen:
        values[:, q] = file.columns[TOTALS[q]]
    sd = noise.sd(values)
    said = [file.impossible(row) or "" for row in range(rows)]
    alike: dict[tuple[float, ...], list[int]] = {}
    for row in range(rows):
        if not said[row]:
            key = tuple(file.at(name, row) for name in ("n", "n_slide", "thickness", "slide_thickness", "g", "incidence"))
            alike.setdefault((*key, *(column[row] for column in known.values())), []).append(row)
    x, stderr, fitted = (np.full((rows, 2), np.nan) for _ in range(3))
    for members in alike.values():
        fixed = {name: float(column[members[0]]) for name, column in known.items()}
        coarse, fine = (_problem(file, members[0], values, sd, g, fixed, one) for one in (_coarse(solver), solver))
        many = fit_refined(coarse, fine, values[members][:, seen], sd[members][:, seen], starts=starts)
        for name, value in fixed.items():
            x[members, NUMBERS.index(name)] = value
        x[np.ix_(members, free)], stderr[np.ix_(members, free)], fitted[np.ix_(members, seen)] = many.x, many.stderr, many.predictions
        for i, row in enumerate(members):
            missed = {TOTALS[q]: abs(fitted[row, q] - values[row, q]) / sd[row, q] for q in seen}
            said[row] = _said(row, many.outcome[i], [NUMBERS[q] for q in free], many.at_bound[i], many.determined[i], missed)
        if on_rows:
            on_rows(int(np.sum(np.any(np.isfinite(fitted), axis=1))), rows)
    return SlabRows(file, x, stderr, values, sd, fitted, tuple(said))


def _measured(file: RxtFile) -> list[int]:
    """Which of M_R and M_T a file has."""
    return [q for q, name in enumerate(TOTALS) if name in file.columns]


def _known(held: Mapping[str, Any] | None, rows: int) -> dict[str, np.ndarray]:
    """Numbers that are held, one a row."""
    known: dict[str, np.ndarray] = {}
    for name, given in (held or {}).items():
        one_of(name, NUMBERS, "held")
        try:
            column = np.asarray(given, dtype=float)
        except (TypeError, ValueError):
            raise InputError(f"held: {name} = {given!r}; allowed is a number, or one a row") from None
        if column.shape not in ((), (rows,)):
            raise InputError(f"held: {name} of shape {column.shape}; allowed is a number, or one for each of the {rows} rows")
        if not np.all(np.isfinite(column) & (column >= 0)):
            raise InputError(f"held: {name} = {given!r}; allowed are finite numbers, at least 0")
        known[name] = np.broadcast_to(column, rows)
    if len(known) == len(NUMBERS):
        raise InputError("held: sigma_a and sigma_s_prime; allowed is one of them, the other is fitted")
    return known


def _coarse(solver: Solver) -> Solver:
    """Near enough to end close to the minimum, in a tenth of the time."""
    if isinstance(solver, DiscreteOrdinates) and (solver.streams is None or solver.streams > _COARSE):
        return DiscreteOrdinates(streams=_COARSE, phase=dict(solver.phase))
    return solver


def _problem(file: RxtFile, row: int, values: np.ndarray, sd: np.ndarray, g: float | None, fixed: Mapping[str, float], solver: Solver) -> Problem:
    thickness = file.at("thickness", row)
    incidence: Incidence = file.at("incidence", row) or "normal"
    guess = {"sigma_a": 0.1 / thickness, "sigma_s_prime": 2.0 / thickness}
    geometries = (TotalReflectance(incidence=incidence, specular="included"), TotalTransmittance(incidence=incidence))
    data = [Dataset(geometries[q], values[row, q : q + 1], sd[row, q : q + 1], name=TOTALS[q]) for q in _measured(file)]
    bounds = zip(NUMBERS, (_ABSORPTION, _SCATTERING), strict=True)
    free = {f"sample.{name}": (low / thickness, high / thickness) for name, (low, high) in bounds if name not in fixed}
    return Problem(slab(file, row, **{**guess, **fixed}, g=g), data, free=free, solver=solver)


def _said(row: int, outcome: Outcome, names: Sequence[str], at_bound: np.ndarray, determined: np.ndarray, missed: Mapping[str, float]) -> str:
    """names : of the free numbers. missed : by how many sd, for each total that was measured."""
    parts = [] if outcome is Outcome.CONVERGED else [f"not converged: {outcome.value}"]
    parts += [f"{name} is at its bound" for name, bound in zip(names, at_bound, strict=True) if bound]
    parts += [f"{name} is not determined" for name, known, bound in zip(names, determined, at_bound, strict=True) if not known and not bound]
    if not all(one <= 1.0 for one in missed.values()):
        totals, by = (" and ".join(words) for words in ([name.removeprefix("M_") for name in missed], [f"{one:.2g}" for one in missed.values()]))
        slabs = "index and thickness" if len(names) == len(NUMBERS) else f"index, thickness and {next(name for name in NUMBERS if name not in names)}"
        gives = "gives both" if len(missed) == len(TOTALS) else "gives it"
        parts.append(f"{totals} {'are' if len(missed) > 1 else 'is'} missed by {by} sd: no slab of this {slabs} {gives}")
    return f"row {row + 1}: {'; '.join(parts)}" if parts else ""
