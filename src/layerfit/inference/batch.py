"""Descents by the hundred: the model made cheap for them, rows in chunks of one size, two chunks at a time."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from threading import Lock

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..arrays import AnyArray
from ..compilation import compiled
from ..errors import InputError
from .lanes import Rows, descend_many
from .least_squares import Descent
from .model import Model
from .parameters import shares, unbounded
from .problem import Problem
from .quick_model import is_spectral, quick_model

_CHUNK = 512  # rows of a call, at most
_LANES = 32  # more leave the fastest cache, fewer pay for each step alone
_SOLVED = 50_000  # operations of their normal equations; beyond, LAPACK's batches are shared out among threads (see `optics.linear_algebra`)
_ALONE = 64  # rows that are not worth a second thread
_MAX_STEPS = 200
_COMPILING = Lock()


@compiled
def _predict(model: Model, x: Float[AnyArray, "m p"], count: Int[AnyArray, ""]) -> Float[Array, "m n"]:
    """Predictions at the first `count` rows."""
    x = jnp.asarray(x)
    empty = jnp.zeros((len(x), sum(values.size for values in model.values)))
    return jax.lax.fori_loop(0, count, lambda i, found: found.at[i].set(jnp.concatenate(model.predict(x[i]))), empty)


def predictions_at(model: Model, x: Float[np.ndarray, "m p"]) -> tuple[Float[np.ndarray, "m n"], ...]:
    """Predictions of all datasets at many numbers, in two threads; one compilation."""
    with _COMPILING:
        _predict(model, _filled(x[:0]), np.array(0))
    halves = [part for part in np.array_split(x, 2 * -(-len(x) // (2 * _CHUNK))) if len(part)]
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda part: np.asarray(_predict(model, _filled(part), np.array(len(part))))[: len(part)], halves))
    ends = np.cumsum([values.size for values in model.values])[:-1]
    return tuple(np.split(np.concatenate(found), ends, axis=1))


class Batch:
    """Descents of one problem with other data, starts, or numbers held.

    The model is the quick one (see `quick_model`); where that errs by what can be noticed, residuals are put right by the problem's own.
    """

    def __init__(self, problem: Problem, what: str, least: Float[np.ndarray, "n"] | None = None, *, threads: int = 2):
        """what : is asked for. least : the smallest size that each value has in the data. threads : chunks at a time.

        Raises InputError for a problem that is no least squares.
        """
        if not problem.least_squares:
            raise InputError(
                f"{what} takes least squares alone; allowed are likelihoods gaussian and correlated, a model error that is off or on, and priors "
                "whose numbers are given. Sample the posterior instead"
            )
        self.problem, self.what, self.threads = problem, what, threads
        self.sizes = [d.geometry.size for d in problem.data]
        self.count = sum(self.sizes)
        self.model = quick_model(problem, least)
        self.quick = is_spectral(problem.model) or problem.model.cheap

    def require_independent(self) -> None:
        """Raises InputError where errors of a measurement are correlated: other values or sd would need another correlation."""
        scatter = zip(self.problem.data, self.problem.model.scatter, strict=True)
        correlated = next((d.name for d, one in scatter if not one.independent), None)
        if correlated is not None:
            raise InputError(
                f"{self.what}: the errors of measurement '{correlated}' are correlated; allowed are likelihood gaussian and a model error that is off"
            )

    def split(self, values: np.ndarray) -> tuple[np.ndarray, ...]:
        """Values of all datasets, the last axis, one array a dataset."""
        return tuple(np.split(values, np.cumsum(self.sizes)[:-1], axis=-1))

    def exact(self, x: Float[np.ndarray, "m p"]) -> Float[np.ndarray, "m n"]:
        """Predictions of the problem's own model."""
        return self._predicted(self.problem.model, x)

    def _predicted(self, model: Model, x: np.ndarray) -> np.ndarray:
        parts = [x[i : i + _CHUNK] for i in range(0, len(x), _CHUNK)]
        return np.concatenate([np.asarray(_predict(model, _filled(part), np.array(len(part))))[: len(part)] for part in parts])

    def run(
        self,
        u: Float[np.ndarray, "m p"],
        values: Float[np.ndarray, "m n"],
        sd: Float[np.ndarray, "m n"],
        *,
        held: Bool[np.ndarray, "m p"] | None = None,
        logarithms: bool = True,
        linearise: bool = False,
        fine: bool = False,
    ) -> Descent:
        """Descents from u, first on the logarithms of the data where asked for; with linearise only residuals and Jacobians at u.

        fine : to where steps are nothing, not only small beside the noise.
        """
        held = np.zeros(u.shape, bool) if held is None else held
        flags = np.array(0 if logarithms and not linearise else 1), np.array(linearise), np.array(fine)
        lanes = max(1, min(_LANES, _SOLVED // u.shape[1] ** 3)) if self.quick else 1  # a transport model fills the machine alone

        def one(part: slice) -> Descent:
            rows = Rows(_filled(u[part]), _filled(held[part]), self.split(_filled(values[part])), self.split(_filled(sd[part])))
            count = len(u[part])
            done = descend_many(self.model, rows, np.array(count), *flags, _MAX_STEPS, lanes)
            return jax.tree.map(lambda column: np.asarray(column)[:count], done)

        count = -(-len(u) // _CHUNK) if len(u) <= _ALONE or self.threads == 1 else 2 * -(-len(u) // (2 * _CHUNK))
        edges = np.linspace(0, len(u), count + 1).astype(int).tolist()
        with _COMPILING:  # once, not in two threads at a time
            one(slice(0, 0))
        with ThreadPoolExecutor(self.threads) as pool:
            parts = list(pool.map(one, [slice(*pair) for pair in pairwise(edges)]))
        return jax.tree.map(lambda *columns: np.concatenate(columns), *parts)

    def fit(
        self,
        u: Float[np.ndarray, "m p"],
        values: Float[np.ndarray, "m n"],
        sd: Float[np.ndarray, "m n"],
        *,
        held: Bool[np.ndarray, "m p"] | None = None,
        logarithms: bool = True,
        fine: bool = False,
    ) -> Descent:
        """Descents whose residuals are those of the problem's own model, put right where the cheap one errs by what can be noticed."""
        end = self.run(u, values, sd, held=held, logarithms=logarithms, fine=fine)
        if self.model is self.problem.model:
            return end
        for _ in range(3):
            residual = np.array(end.residual)
            exact = self.exact(end.x)
            error = exact - self.predictions(residual, values, sd)
            residual[:, : self.count] = self._weighted(exact - values, sd)
            end = eqx.tree_at(lambda d: d.residual, end, residual)
            wrong = np.flatnonzero(np.max(np.abs(error / sd), axis=1) > 1e-3)
            if wrong.size == 0:
                break
            again = self.run(
                np.asarray(end.u)[wrong],
                (values - error)[wrong],
                sd[wrong],
                held=None if held is None else held[wrong],
                logarithms=False,
                fine=fine,
            )
            end = jax.tree.map(partial(_put, wrong), end, again)
        return end

    def predictions(self, residual: np.ndarray, values: np.ndarray, sd: np.ndarray) -> Float[np.ndarray, "m n"]:
        """What was predicted, from residuals (priors' among them or not)."""
        parts = zip(self.problem.model.scatter, self.split(residual[:, : self.count]), self.split(sd), strict=True)
        return values + np.concatenate([r * s if one.independent else np.asarray(one.unweighted(r.T)).T for one, r, s in parts], axis=1)

    def _weighted(self, difference: np.ndarray, sd: np.ndarray) -> Float[np.ndarray, "m n"]:
        parts = zip(self.problem.model.scatter, self.split(difference), self.split(sd), strict=True)
        return np.concatenate([d / s if one.independent else np.array([one.weighted(row) for row in d]) for one, d, s in parts], axis=1)

    def jacobians(
        self, x: Float[np.ndarray, "q p"], values: Float[np.ndarray, "q n"], sd: Float[np.ndarray, "q n"]
    ) -> tuple[Float[np.ndarray, "q rows"], Float[np.ndarray, "q rows p"]]:
        """Weighted residuals and their Jacobians in physical units at points."""
        there = self.run(unbounded(shares(self.problem.parameters, x)), values, sd, linearise=True)
        return np.asarray(there.residual), physical(np.asarray(there.jacobian), np.asarray(there.slope))


def edge_shares(share: Float[np.ndarray, "*m"]) -> Float[np.ndarray, "*m"]:
    """u at positions between the bounds, the bounds themselves to 1e-9."""
    inside = np.clip(share, 1e-9, 1.0 - 1e-9)
    return np.log(inside) - np.log1p(-inside)


def physical(jacobian: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Jacobians in physical units (..., n, p)."""
    return jacobian / np.maximum(slope, 1e-300)[..., None, :]


def _filled(rows: np.ndarray) -> np.ndarray:
    """Rows of a chunk, filled up with ones to the one number that is compiled."""
    filled = np.ones((_CHUNK, *rows.shape[1:]), rows.dtype)
    filled[: len(rows)] = rows
    return filled


def _put(at: Int[np.ndarray, "k"], column: np.ndarray, new: np.ndarray) -> np.ndarray:
    column = np.array(column)
    column[at] = new
    return column
