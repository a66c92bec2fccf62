"""Draws from the posterior of a problem, from its fit on."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..arrays import AnyArray
from ..errors import InputError, one_of
from ..files import writable_folder
from .chain import FILE, Chain, chain_in_file, chain_in_memory
from .density import Density
from .ensemble import STATE_SIZE, run_ensemble
from .fit import fit as run_fit
from .judgement import Judgement, SamplingOutcome, judge
from .log_densities import LogDensities
from .parameters import FreeParameter, shares, unbounded
from .posterior import Posterior
from .problem import Problem
from .quick_model import quick_density
from .result import Fit
from .settings import problem_settings, solver_settings
from .starting_points import share_covariance, starting_points
from .surrogate import Surrogate

SAMPLERS = ("emcee", "nuts", "surrogate")
EFFECTIVE = 1000.0  # independent draws asked for by default
_STEPS = {"emcee": 20_000, "nuts": 2000, "surrogate": 2000}
_CHAINS = 4
_WALKERS = 32
_LEAST_STEPS = 10
_FIRST_LOOK = 100  # steps until a chain is judged first, and at least between two judgements
_GROWTH = 1.1  # of a chain between two judgements


def sample(
    problem: Problem,
    fit: Fit | None = None,
    *,
    sampler: str = "emcee",
    walkers: int | None = None,
    steps: int | None = None,
    effective: int | float = EFFECTIVE,
    seed: int = 0,
    folder: str | Path | None = None,
    on_step: Callable[[int, int], None] | None = None,
) -> Posterior:
    """Draw from the posterior of a problem's free numbers.

    Walkers begin around the fit, and around other minima that the data can hardly tell from it. They walk until the chain is 50 autocorrelation
    times long, has as many independent draws as asked for, and its walkers agree; at most so many steps.

    Arguments
    ---------
    fit : a fit of this problem (default: it is fitted).
    sampler : "emcee", an ensemble of walkers that needs no derivatives; "nuts", a few chains that follow them (an extra, layerfit[nuts]); or
        "surrogate", for a slow solver and a posterior with one maximum: proposals from polynomials in place of the model, each judged by the model.
    walkers : an even number, at least twice the free numbers (default 32, more for many numbers); for nuts the number of chains (4).
    steps : largest number for each walker (default 20,000; for nuts 2000 after its warm-up, for surrogate 2000).
    effective : number of independent draws to aim at; infinite: all steps are done.
    seed : of random numbers. folder : where the chain is kept in chain.h5, from which a run that ended early goes on, with more steps if asked.
    on_step : called with (steps done, largest number).

    Returns a Posterior also where it did not converge: look at ``outcome`` and ``warnings``.

    Raises InputError for wrong numbers, for a fit of another problem, and for a folder that holds a chain of something else.

    >>> import layerfit as lf
    >>> skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.01, sigma_s_prime=1, n=1.4)])
    >>> data = lf.Dataset(lf.RadialReflectance(r=[1, 2, 4, 8]), [0.0215, 0.00929, 0.00231, 0.000347], noise=lf.Noise(relative=0.02))
    >>> problem = lf.Problem(skin, data, free={"skin.sigma_a": (1e-3, 1), "skin.sigma_s_prime": (0.1, 10)}, solver=lf.LayeredDiffusion())
    >>> posterior = lf.sample(problem, walkers=16)
    >>> posterior.outcome.value, [f"{draws.mean():.2g}" for draws in posterior.draws.values()]
    ('converged', ['0.011', '0.97'])
    """
    walkers, steps = check_request(problem, sampler, walkers, steps, seed)
    if isinstance(effective, bool) or not isinstance(effective, int | float) or not effective > 0:
        raise InputError(f"effective = {effective!r}; allowed is a number above 0")
    began = time.perf_counter()
    fit = _fit_of(problem, fit)
    density = quick_density(fit.problem, fit.x)
    settings = run_settings(problem, sampler, walkers, seed) | solver_settings(fit.problem)
    way = {"emcee": _Ensemble, "nuts": _Nuts, "surrogate": Surrogate}[sampler](fit, density, walkers, seed)
    shape = (steps + way.warm_up, walkers, len(problem.parameters), way.state_size)
    chain = chain_in_memory(*shape) if folder is None else chain_in_file(writable_folder(folder) / FILE, settings, *shape)
    try:
        judgement = walk(way, chain, steps + way.warm_up, effective, on_step)
    finally:
        chain.close()
    seconds = time.perf_counter() - began
    said = way.said if isinstance(way, Surrogate) else lambda _: []
    return Posterior.from_chain(fit, chain, judgement, said, sampler=sampler, seed=seed, largest_steps=steps, settings=settings, seconds=seconds)


def run_settings(problem: Problem, sampler: str, walkers: int, seed: int) -> dict[str, str]:
    """All that two runs need to have in common to be one."""
    return problem_settings(problem) | {"sampler": sampler, "walkers": str(walkers), "seed": str(seed)}


def check_request(problem: Problem, sampler: str, walkers: int | None, steps: int | None, seed: int) -> tuple[int, int]:
    """Numbers of walkers and steps, those that were not given filled in. Raises InputError for what is not allowed."""
    one_of(sampler, SAMPLERS, "sampler")
    p = len(problem.parameters)
    if sampler == "nuts":
        from .nuts import check_installed

        check_installed()
    if walkers is None:
        walkers = _CHAINS if sampler == "nuts" else max(_WALKERS, 4 * p)
    steps = _STEPS[sampler] if steps is None else steps
    least = 2 if sampler == "nuts" else max(2 * p, 4)
    if isinstance(walkers, bool) or not isinstance(walkers, int) or walkers < least or (sampler != "nuts" and walkers % 2):
        even = "an even number, " if sampler != "nuts" else ""
        raise InputError(f"walkers = {walkers!r}; allowed is {even}at least {least} (sampler '{sampler}', free numbers: {p})")
    if isinstance(steps, bool) or not isinstance(steps, int) or steps < _LEAST_STEPS:
        raise InputError(f"steps = {steps!r}; allowed is a whole number, at least {_LEAST_STEPS}")
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**32:
        raise InputError(f"seed = {seed!r}; allowed is a whole number, 0 to 2^32 - 1")
    return walkers, steps


def _fit_of(problem: Problem, fit: Fit | None) -> Fit:
    """A fit of the problem, with numbers to begin from."""
    if fit is None:
        fit = run_fit(problem)
    else:
        here, there = problem_settings(problem), problem_settings(fit.problem)
        other = [name for name in here if here[name] != there.get(name)]
        if other:
            raise InputError(f"the fit is of another problem: {other[0]} = {there.get(other[0])} there, {here[other[0]]} here; give its own")
    if not np.all(np.isfinite(fit.x)) or not math.isfinite(fit.chi2):
        raise InputError("the fit failed, its residuals are not finite; without a place to begin nothing can be sampled")
    return fit


class _Ensemble:
    """Walkers of emcee."""

    warm_up = 1  # the step that is the beginning
    counted_warm_up = 0
    state_size = STATE_SIZE

    def __init__(self, fit: Fit, density: Density, walkers: int, seed: int):
        self.fit, self.walkers, self.seed, self.log_densities = fit, walkers, seed, LogDensities(density)

    def run(self, chain: Chain) -> Iterator[None]:
        half = self.walkers // 2
        begin = chain.x[0] if chain.count else starting_points(self.fit, self.log_densities, self.walkers, half, self.seed)
        return run_ensemble(self.log_densities, np.asarray(begin), chain, self.seed)


class _Sphere(eqx.Module):
    """The density in coordinates w in which the fit's Gaussian is a unit sphere: u = center + root w."""

    density: Density
    center: Float[AnyArray, "p"]
    root: Float[AnyArray, "p p"]

    def __init__(self, density: Density, fit: Fit):
        share = np.clip(shares(fit.problem.parameters, fit.x), 0.02, 0.98)
        slope = 1.0 / (share * (1.0 - share))  # du/dshare
        self.density, self.center = density, unbounded(share)
        covariance = share_covariance(fit) * np.outer(slope, slope)
        scale = np.sqrt(np.diag(covariance))
        self.root = scale[:, None] * np.linalg.cholesky(covariance / np.outer(scale, scale) + 1e-9 * np.eye(len(scale)))

    def log_density(self, w: Float[AnyArray, "p"]) -> Float[AnyArray, ""]:
        return self.density.unbounded(self.center + self.root @ w)

    def physical(self, w: Float[AnyArray, "*s p"]) -> Float[AnyArray, "*s p"]:
        return self.density.model.coordinates.physical(self.center + jnp.asarray(w) @ self.root.T)

    def coordinates(self, parameters: Sequence[FreeParameter], x: np.ndarray) -> np.ndarray:
        """w at numbers x (m, p)."""
        return np.linalg.solve(self.root, (unbounded(shares(parameters, x)) - self.center).T).T


class _Nuts:
    """Chains of NUTS on coordinates without bounds."""

    def __init__(self, fit: Fit, density: Density, walkers: int, seed: int):
        from .nuts import WARM_UP, state_size

        self.fit, self.density, self.walkers, self.seed = fit, density, walkers, seed
        self.sphere = _Sphere(density, fit)
        self.warm_up = self.counted_warm_up = WARM_UP
        self.state_size = state_size(self.sphere.log_density, walkers, len(fit.x))

    def run(self, chain: Chain) -> Iterator[None]:
        from .nuts import run_nuts

        begin = np.zeros((self.walkers, len(self.fit.x)))
        if chain.count == 0:
            points = starting_points(self.fit, LogDensities(self.density), self.walkers, max(self.walkers, 8), self.seed)
            begin = self.sphere.coordinates(self.fit.problem.parameters, points)
        return run_nuts(self.sphere.log_density, self.sphere.physical, begin, chain, self.seed)


def walk(way: Any, chain: Chain, last: int, effective: int | float, on_step: Callable[[int, int], None] | None) -> Judgement:
    """Walk until the chain is judged to be enough, or to the last step."""

    def verdict() -> Judgement:
        return judge(chain, effective=effective, warm_up=way.counted_warm_up)

    def ended(judgement: Judgement) -> bool:
        return chain.count >= last or judgement.outcome is SamplingOutcome.CONVERGED

    look = way.counted_warm_up + _FIRST_LOOK
    if chain.count >= min(look, last) and ended(judgement := verdict()):
        return judgement
    look = max(look, chain.count + _FIRST_LOOK)
    for _ in way.run(chain):
        if on_step:
            on_step(chain.count, last)
        if chain.count >= min(look, last):
            if ended(judgement := verdict()):
                return judgement
            look = max(chain.count + _FIRST_LOOK, int(_GROWTH * chain.count))
    raise AssertionError("a sampler walks on for ever")
