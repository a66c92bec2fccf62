"""Slabs between slides, row by row: what inverse adding-doubling does, with standard errors."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..measurement.dataset import Dataset, Noise
from ..measurement.geometry import Incidence, TotalReflectance, TotalTransmittance
from ..measurement.rxt_file import RxtFile
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
_COARSE = 16  # streams
_ABSORPTION, _SCATTERING = (1e-6, 100.0), (1e-3, 1000.0)  # bounds of sigma_a and sigma_s' times the thickness


@dataclass(frozen=True, repr=False)
class SlabRows:
    """Fits of the rows of a file.

    x, stderr : sigma_a and sigma_s_prime [1/mm] and their standard errors (rows, 2), NaN where a row was not fitted, a number is at its bound or
    the data say nothing of it. values, sd, fitted : M_R and M_T as measured, their sd and as fitted (rows, 2).
    said : what is to be said of each row, empty where nothing is.
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
        """Rows that were fitted and whose R and T are met within their sd (rows,)."""
        return np.all(np.abs(self.fitted - self.values) <= self.sd, axis=1)

    def to_pandas(self) -> "pd.DataFrame":
        """One row a row of the file: its columns, numbers, standard errors, fitted totals and what is to be said."""
        table = self.file.to_pandas()
        for q, name in enumerate(NUMBERS):
            table[name], table[f"{name}.stderr"] = self.x[:, q], self.stderr[:, q]
        table["R"], table["T"] = self.fitted.T
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
    file: RxtFile,
    *,
    g: float | None = None,
    noise: Noise | None = None,
    solver: Solver | None = None,
    starts: int = 5,
    on_rows: Callable[[int, int], None] | None = None,
) -> SlabRows:
    """sigma_a and sigma_s' of each row of a .rxt file from M_R and M_T.

    g : mean cosine where the file has no column of it (default 0). noise : of M_R and M_T (default: 1 % and 1e-4). starts : see `fit_many`.
    on_rows : called with (rows done, rows). Rows that no sample can have are named and left out. M_U is read and not used.

    Raises InputError where the file has not both M_R and M_T, or g or noise are out of range.

    >>> import pathlib, tempfile
    >>> import layerfit as lf
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "slab.rxt"
    >>> _ = file.write_text("IAD1 1.4 1.0 1 0 2 1 0  0 0 0 0 0  0 0 0 0 0\\nr t\\n0.30 0.25\\n0.80 0.25\\n")
    >>> lf.fit_slabs(lf.read_rxt(file)).said
    ('', 'row 2: M_R + M_T = 1.05; more than 1 comes back')
    """
    lacking = [name for name in ("M_R", "M_T") if name not in file.columns]
    if lacking:
        raise InputError(f"{file.path}: {lacking[0]} is missing; two numbers of a row need both M_R and M_T")
    solver = DiscreteOrdinates() if solver is None else solver
    noise = Noise(relative=0.01, absolute=1e-4) if noise is None else noise
    rows = len(file)
    values = np.stack([file.columns["M_R"], file.columns["M_T"]], axis=1)
    sd = noise.sd(values)
    said = [file.impossible(row) or "" for row in range(rows)]
    alike: dict[tuple[float, ...], list[int]] = {}
    for row in range(rows):
        if not said[row]:
            key = tuple(file.at(name, row) for name in ("n", "n_slide", "thickness", "slide_thickness", "g", "incidence"))
            alike.setdefault(key, []).append(row)
    x, stderr, fitted = (np.full((rows, 2), np.nan) for _ in range(3))
    for members in alike.values():
        coarse, fine = (_problem(file, members[0], values, sd, g, one) for one in (_coarse(solver), solver))
        many = fit_refined(coarse, fine, values[members], sd[members], starts=starts)
        x[members], stderr[members], fitted[members] = many.x, many.stderr, many.predictions
        for i, row in enumerate(members):
            said[row] = _said(row, many.outcome[i], many.at_bound[i], many.determined[i], np.abs(many.predictions[i] - values[row]) / sd[row])
        if on_rows:
            on_rows(int(np.sum(np.isfinite(fitted[:, 0]))), rows)
    return SlabRows(file, x, stderr, values, sd, fitted, tuple(said))


def _coarse(solver: Solver) -> Solver:
    """Near enough to end close to the minimum, in a tenth of the time."""
    if isinstance(solver, DiscreteOrdinates) and (solver.streams is None or solver.streams > _COARSE):
        return DiscreteOrdinates(streams=_COARSE, phase=dict(solver.phase))
    return solver


def _problem(file: RxtFile, row: int, values: np.ndarray, sd: np.ndarray, g: float | None, solver: Solver) -> Problem:
    thickness = file.at("thickness", row)
    incidence: Incidence = file.at("incidence", row) or "normal"
    stack = slab(file, row, sigma_a=0.1 / thickness, sigma_s_prime=2.0 / thickness, g=g)
    data = [
        Dataset(TotalReflectance(incidence=incidence, specular="included"), values[row, :1], sd[row, :1], name="M_R"),
        Dataset(TotalTransmittance(incidence=incidence), values[row, 1:], sd[row, 1:], name="M_T"),
    ]
    bounds = zip(NUMBERS, (_ABSORPTION, _SCATTERING), strict=True)
    free = {f"sample.{name}": (low / thickness, high / thickness) for name, (low, high) in bounds}
    return Problem(stack, data, free=free, solver=solver)


def _said(row: int, outcome: Outcome, at_bound: np.ndarray, determined: np.ndarray, misfit: np.ndarray) -> str:
    parts = [] if outcome is Outcome.CONVERGED else [f"not converged: {outcome.value}"]
    parts += [f"{name} is at its bound" for name, bound in zip(NUMBERS, at_bound, strict=True) if bound]
    parts += [f"{name} is not determined" for name, known, bound in zip(NUMBERS, determined, at_bound, strict=True) if not known and not bound]
    if not np.all(misfit <= 1.0):
        parts.append(f"R and T are missed by {misfit[0]:.2g} and {misfit[1]:.2g} sd: no slab of this index and thickness gives both")
    return f"row {row + 1}: {'; '.join(parts)}" if parts else ""
