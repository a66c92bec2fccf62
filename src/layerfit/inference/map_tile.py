"""The fits of one tile of a map: which pixels can be fitted, and what comes of each."""

import hashlib
import os
import pickle
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .batch import Batch
from .many import ManyFits, fit_rows
from .problem import Problem
from .result import Outcome
from .uncertainty import correlation

OUTCOMES = (
    "converged",
    "largest number of steps",
    "residuals not finite",
    "masked",
    "a value is missing",
    "a value is too low",
    "a value is too high",
)
"""What became of a pixel, by its code: fitted (0 to 2), or left out and why."""
_CODES = {Outcome.CONVERGED: 0, Outcome.MAX_STEPS: 1, Outcome.NOT_FINITE: 2}
MASKED, MISSING, LOW, HIGH = 3, 4, 5, 6
_KEPT = 4  # fitters that a process remembers


class Variable(NamedTuple):
    """One variable of a map. width : numbers a pixel. dtype : as it is kept; NaN and -1 (of flags and counts) stand where nothing was fitted."""

    name: str
    width: int
    dtype: str
    attrs: dict[str, Any]


def variables(problem: Problem, *, correlations: bool) -> tuple[Variable, ...]:
    """All variables of a map, in the order in which a tile holds them."""
    found = []
    for p in problem.parameters:
        found += [
            Variable(p.name, 1, "float64", {"units": p.unit}),
            Variable(f"{p.name}.stderr", 1, "float64", {"units": p.unit, "long_name": f"standard error of {p.name}"}),
            Variable(f"{p.name}.at_bound", 1, "int8", {"long_name": f"whether {p.name} is at a bound", "flag_values": [0, 1]}),
            Variable(f"{p.name}.determined", 1, "int8", {"long_name": f"whether the data determine {p.name}", "flag_values": [0, 1]}),
        ]
    meanings = " ".join(text.replace(" ", "_") for text in OUTCOMES)
    found += [
        Variable("chi2", 1, "float64", {"units": "1", "long_name": "chi-square"}),
        Variable("outcome", 1, "int8", {"flag_values": list(range(len(OUTCOMES))), "flag_meanings": meanings}),
        Variable("met", 1, "int16", {"long_name": "runs that ended in the minimum chosen"}),
        Variable("runs", 1, "int16", {"long_name": "runs made"}),
    ]
    if problem.estimates_noise:
        found.append(Variable("noise", 1, "float64", {"units": "1", "long_name": "estimated relative noise"}))
    if correlations:
        found.append(Variable("correlation", len(problem.parameters) ** 2, "float64", {"units": "1"}))
    return tuple(found)


def parts(packed: Any, variables: Sequence[Variable]) -> Iterator[tuple[Variable, Any]]:
    """Each variable of a tile with its numbers, the last axis of both."""
    at = 0
    for v in variables:
        yield v, packed[..., at : at + v.width]
        at += v.width


class Fitter:
    """Fits tiles of one problem. It can be sent to other processes, where it is made once and remembered.

    relative, absolute : of the sd of each value where none are given (n,). limits : values at or below the first, or at or above the second, are no
    measurements (None: no limit). threads : of one tile.
    """

    def __init__(
        self,
        problem: Problem,
        *,
        relative: Float[np.ndarray, "n"],
        absolute: Float[np.ndarray, "n"],
        limits: tuple[int | float | None, int | float | None],
        starts: int,
        seed: int,
        correlations: bool,
        threads: int = 1,
    ):
        self.problem, self.relative, self.absolute, self.limits = problem, relative, absolute, limits
        self.starts, self.seed, self.correlations, self.threads = starts, seed, correlations, threads
        self.variables = variables(problem, correlations=correlations)
        least = np.concatenate([np.abs(d.values) for d in problem.data])
        self.batch = Batch(problem, "fit_map", least, threads=threads)
        self.batch.require_independent()

    @property
    def width(self) -> int:
        """Numbers a pixel."""
        return sum(v.width for v in self.variables)

    @property
    def stated(self) -> dict[str, Any]:
        """What it is made of."""
        names = ("problem", "relative", "absolute", "limits", "starts", "seed", "correlations")
        return {name: getattr(self, name) for name in names}

    def __reduce__(self) -> tuple[Any, ...]:
        content = _pickled(self.stated)
        return _revived, (hashlib.sha256(content).hexdigest(), content)

    def __dask_tokenize__(self) -> str:
        return hashlib.sha256(_pickled(self.stated)).hexdigest()

    def __call__(
        self,
        values: Float[np.ndarray, "*tile n"],
        sd: Float[np.ndarray, "*tile n"] | None = None,
        mask: Bool[np.ndarray, "*tile 1"] | None = None,
        on_sets: Callable[[int, int], None] | None = None,
    ) -> Float[np.ndarray, "*tile q"]:
        """All variables of a tile, one after the other on the last axis. mask : True where a pixel is to be fitted. on_sets : see `fit_rows`."""
        shape, n = values.shape[:-1], values.shape[-1]
        values = np.asarray(values, dtype=float).reshape(-1, n)
        sd = np.hypot(self.relative * np.abs(values), self.absolute) if sd is None else np.asarray(sd, dtype=float).reshape(-1, n)
        outcome = self._left_out(values, sd, None if mask is None else np.asarray(mask).reshape(-1))
        rows = np.flatnonzero(outcome == 0)
        found = np.full((len(values), self.width), np.nan)
        if rows.size:
            fits = fit_rows(self.batch, values[rows], sd[rows], self.starts, self.seed, on_sets)
            found[rows] = self._packed(fits)
            outcome[rows] = [_CODES[one] for one in fits.outcome]
        for v, part in parts(found, self.variables):
            if v.name == "outcome":
                part[:, 0] = outcome
            elif v.dtype != "float64":
                part[np.isnan(part)] = -1
        return found.reshape(*shape, self.width)

    def _left_out(self, values: np.ndarray, sd: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
        """Codes of pixels that cannot be fitted, 0 of those that can."""
        low, high = self.limits
        outcome = np.zeros(len(values), int)
        with np.errstate(invalid="ignore"):
            if high is not None:
                outcome[np.any(values >= high, axis=1)] = HIGH
            if low is not None:
                outcome[np.any(values <= low, axis=1)] = LOW
            outcome[~np.all(np.isfinite(values) & np.isfinite(sd), axis=1)] = MISSING
            outcome[(outcome == 0) & ~np.all(sd > 0, axis=1)] = MISSING
        if mask is not None:
            outcome[~mask.astype(bool)] = MASKED
        return outcome

    def _packed(self, fits: ManyFits) -> np.ndarray:
        columns = []
        for i in range(len(self.problem.parameters)):
            columns += [fits.x[:, i], fits.stderr[:, i], fits.at_bound[:, i], fits.determined[:, i]]
        columns += [fits.chi2, np.zeros(len(fits.x)), fits.met, fits.runs]
        if fits.noise is not None:
            columns.append(fits.noise)
        table = np.stack([np.asarray(c, dtype=float) for c in columns], axis=1)
        if self.correlations:
            between = np.array([correlation(c) for c in fits.covariance]).reshape(len(table), -1)
            table = np.concatenate([table, between], axis=1)
        return table


def _pickled(stated: dict[str, Any]) -> bytes:
    try:
        import cloudpickle  # ties may be functions of a notebook
    except ImportError:
        return pickle.dumps(stated)
    return cloudpickle.dumps(stated)


_READY: dict[str, Fitter] = {}


def _revived(token: str, content: bytes) -> Fitter:
    """The fitter of a process: one thread each, since processes share the cores. Threads within XLA's operations would only wait for one another."""
    if token not in _READY:
        os.environ.setdefault("NPROC", "1")  # read when JAX begins to compute
        while len(_READY) >= _KEPT:
            _READY.pop(next(iter(_READY)))
        _READY[token] = Fitter(**pickle.loads(content))
    return _READY[token]
