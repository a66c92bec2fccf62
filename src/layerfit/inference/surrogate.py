"""Draws from a posterior whose model is slow: proposals from one whose predictions are polynomials, each judged by the model itself.

An independence Metropolis chain (L. Tierney, Ann. Stat. 22, 1701 (1994), section 2.3.3): the ratio of both densities decides, so that what is drawn
is the posterior of the model, and a poor surrogate shows itself by proposals refused and long autocorrelation times, not by a wrong answer.
"""

from collections.abc import Iterator
from itertools import combinations_with_replacement
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float
from scipy.stats import norm

from ..arrays import AnyArray
from ..errors import InputError
from .batch import predictions_at
from .chain import Chain, chain_in_memory
from .density import Density
from .ensemble import STATE_SIZE, run_ensemble
from .judgement import judge
from .log_densities import LogDensities
from .model import Model
from .parameters import shares, spread_shares
from .problem import Problem
from .result import Fit
from .starting_points import share_covariance, starting_points

_DEGREES = ((6, 3), (12, 2))  # up to so many numbers, polynomials of this degree
_MORE = 3  # predictions for each coefficient
_WIDER = 2.0  # first predictions lie so much further out than the fit's covariance says
_EDGE = 3.5  # radius within which the polynomials hold, in standard deviations of the predictions made for them
_WALL = 10.0  # steepness of the density beyond it
_ROUNDS = 2
_FLATTER = 0.5  # exponent of the density that proposals are from
_PROPOSALS = 4000.0  # independent ones, from at most
_STEPS = 10_000
_AT_EDGE = 0.002  # share of draws beyond it from which that is said

STATE = 8  # bytes that a chain keeps: nothing


class Emulator(Model):
    """A model whose predictions are polynomials (of their logarithm where they are positive) in the numbers' positions between the bounds."""

    center: Float[AnyArray, "p"]
    whiten: Float[AnyArray, "p p"]
    powers: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    coefficients: tuple[Float[AnyArray, "terms n"], ...]
    logarithmic: tuple[Bool[AnyArray, "n"], ...]

    def __init__(self, model: Model, x: Float[np.ndarray, "m p"], predictions: tuple[Float[np.ndarray, "m n"], ...], degree: int):
        """x, predictions : of the model, at least as many as there are coefficients."""
        for name in ("samples", "coordinates", "scatter", "priors", "nuisance", "error_scale", "priors_join"):
            setattr(self, name, getattr(model, name))
        share = np.asarray(self._shares(jnp.asarray(x)))
        self.center = np.mean(share, axis=0)
        self.whiten = np.linalg.inv(np.linalg.cholesky(np.cov(share.T).reshape(share.shape[1], -1) + 1e-18 * np.eye(share.shape[1])))
        p = x.shape[1]
        self.powers = tuple(chosen for d in range(degree + 1) for chosen in combinations_with_replacement(range(p), d))
        terms = np.asarray(self._terms(jnp.asarray((share - self.center) @ self.whiten.T)))
        self.logarithmic = tuple(np.all(values > 0, axis=0) for values in predictions)
        shapes = [np.where(log, np.log(np.where(log, values, 1.0)), values) for values, log in zip(predictions, self.logarithmic, strict=True)]
        self.coefficients = tuple(np.linalg.lstsq(terms, shape, rcond=None)[0] for shape in shapes)

    def _shares(self, x: Float[Array, "*s p"]) -> Float[Array, "*s p"]:
        c = self.coordinates
        return (jnp.where(c.log, jnp.log(jnp.where(c.log, x, 1.0)), x) - c.low) / (c.high - c.low)

    def _terms(self, w: Float[Array, "*s p"]) -> Float[Array, "*s terms"]:
        rows = []
        for chosen in self.powers:
            term = jnp.ones(w.shape[:-1])
            for i in chosen:
                term = term * w[..., i]
            rows.append(term)
        return jnp.stack(rows, axis=-1)

    def place(self, x: Float[Array, "*s p"]) -> Float[Array, "*s p"]:
        """Coordinates in which the predictions that the polynomials were made from have sd 1."""
        return (self._shares(x) - self.center) @ self.whiten.T

    def predict(self, x: Float[Array, "p"]) -> tuple[Float[Array, "n"], ...]:
        w = self.place(x)
        terms = self._terms(w * jnp.minimum(1.0, _EDGE / jnp.maximum(jnp.linalg.norm(w), 1e-9)))
        shapes = [terms @ coefficients for coefficients in self.coefficients]
        return tuple(jnp.where(log, jnp.exp(jnp.where(log, shape, 0.0)), shape) for log, shape in zip(self.logarithmic, shapes, strict=True))

    def log_likelihood(self, x: Float[Array, "p"], *, estimates_noise: bool) -> Float[Array, ""]:
        beyond = jnp.maximum(jnp.linalg.norm(self.place(x)) - _EDGE, 0.0)
        return super().log_likelihood(x, estimates_noise=estimates_noise) - _WALL * beyond * (1.0 + beyond)


class Surrogate:
    """The way of `walk` that draws through an emulator."""

    warm_up = 1  # the step that is the beginning
    counted_warm_up = 0
    state_size = STATE

    def __init__(self, fit: Fit, density: Density, walkers: int, seed: int):
        self.fit, self.walkers, self.seed = fit, walkers, seed
        self.exact = LogDensities(density)
        self.emulator, self.pool = _made(fit, density, walkers, seed)
        self.guess = LogDensities(_Flattened(density, self.emulator))

    def run(self, chain: Chain) -> Iterator[None]:
        still = np.zeros((1, self.walkers), bool)
        state = bytes(STATE)
        if chain.count == 0:
            begin = self._proposals(0)
            chain.append(begin[None], self.exact(begin)[None], still, state)
        x, density = np.asarray(chain.x[-1]), np.asarray(chain.log_density[-1])
        gain = density - self.guess(x)
        while True:
            number = chain.count
            proposed = self._proposals(number)
            there = self.exact(proposed)
            more = there - self.guess(proposed)
            taken = np.log(np.random.default_rng([self.seed, 3, number]).random(self.walkers)) < more - gain
            x, density, gain = np.where(taken[:, None], proposed, x), np.where(taken, there, density), np.where(taken, more, gain)
            chain.append(x[None], density[None], still, state)
            yield

    def _proposals(self, number: int) -> np.ndarray:
        return self.pool[(number * self.walkers + np.arange(self.walkers)) % len(self.pool)]

    def said(self, x: Float[np.ndarray, "m p"]) -> list[str]:
        """What to keep in mind about draws x."""
        beyond = float(np.mean(np.linalg.norm(np.asarray(self.emulator.place(jnp.asarray(x))), axis=1) > 0.95 * _EDGE))
        if beyond <= _AT_EDGE:
            return []
        return [f"{100 * beyond:.2g} % of the draws lie where the surrogate ends: there may be more beyond; sampler 'emcee' needs none"]


class _Flattened(eqx.Module):
    """A power of the density by an emulator: what is proposed from it reaches further out than the posterior, so that no tail is left out."""

    density: Density

    def __init__(self, density: Density, emulator: Emulator):
        self.density = eqx.tree_at(lambda d: d.model, density, emulator)

    def __call__(self, x: Float[Array, "p"]) -> Float[Array, ""]:
        return _FLATTER * self.density(x)


def _made(fit: Fit, density: Density, walkers: int, seed: int) -> tuple[Emulator, Float[np.ndarray, "m p"]]:
    """An emulator, and draws from its posterior in no order."""
    problem = fit.problem
    p = len(problem.parameters)
    degree = next((degree for most, degree in _DEGREES if p <= most), None)
    if degree is None:
        raise InputError(f"sampler 'surrogate' with {p} free numbers; allowed are at most {_DEGREES[-1][0]}")
    count = _MORE * len([None for d in range(degree + 1) for _ in combinations_with_replacement(range(p), d)])
    x = _around(problem, fit, count, seed)
    draws = x
    for number in range(_ROUNDS + 1):
        predictions = predictions_at(density.model, x)
        emulator = Emulator(density.model, x, predictions, degree)
        draws = _drawn(fit, LogDensities(_Flattened(density, emulator)), walkers, seed + number)
        if number < _ROUNDS:
            x = _wider(problem, draws, count, seed + number)
    return emulator, draws  # pyright: ignore[reportPossiblyUnboundVariable]


def _around(problem: Problem, fit: Fit, count: int, seed: int) -> np.ndarray:
    """Points about the fit."""
    normal = norm.ppf(np.clip(spread_shares(len(fit.x), count, seed), 1e-6, 1.0 - 1e-6))
    root = np.linalg.cholesky(share_covariance(fit))
    return _inside(problem, shares(problem.parameters, fit.x) + _WIDER * normal @ root.T)


def _wider(problem: Problem, draws: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Points like draws, further apart."""
    share = shares(problem.parameters, draws)
    picked = share[np.random.default_rng([seed, 5]).choice(len(share), count, replace=len(share) < count)]
    normal = norm.ppf(np.clip(spread_shares(share.shape[1], count, seed), 1e-6, 1.0 - 1e-6))
    root = np.linalg.cholesky(np.cov(share.T).reshape(share.shape[1], -1) + 1e-18 * np.eye(share.shape[1]))
    return _inside(problem, picked + 0.7 * normal @ root.T)


def _inside(problem: Problem, share: np.ndarray) -> np.ndarray:
    """Physical units of positions, those outside thrown back."""
    folded = np.abs(share) % 2.0
    share = np.clip(np.where(folded > 1.0, 2.0 - folded, folded), 1e-6, 1.0 - 1e-6)
    return np.array([[p.at(float(s)) for p, s in zip(problem.parameters, row, strict=True)] for row in share])


def _drawn(fit: Fit, log_densities: Any, walkers: int, seed: int) -> np.ndarray:
    """Draws by emcee."""
    chain = chain_in_memory(_STEPS, walkers, len(fit.x), STATE_SIZE)
    begin = starting_points(fit, log_densities, walkers, walkers // 2, seed)
    look = 1000
    for _ in run_ensemble(log_densities, begin, chain, seed):
        if chain.count >= look:
            judgement = judge(chain, effective=_PROPOSALS)
            if chain.count >= _STEPS or np.min(judgement.effective) >= _PROPOSALS:
                break
            look = min(2 * look, _STEPS)
    kept = chain.x[judgement.kept].reshape(-1, len(fit.x))  # pyright: ignore[reportPossiblyUnboundVariable]
    return np.random.default_rng([seed, 4]).permutation(kept)
