"""Whether a chain is long enough, where it begins to count, and how far apart its draws are."""

from enum import StrEnum

import equinox as eqx
import numpy as np

from .chain import Chain
from .ensemble import autocorrelation_time

LENGTHS = 50.0  # length of a chain in autocorrelation times from which their estimate is believed
_BURN_IN = 5.0  # autocorrelation times that are left out at the beginning
_AGREE = 1.01
_DRAWS = 1000  # kept at least where there are as many
_DIVERGENT = 0.01  # share of divergent steps above which draws are not believed


class SamplingOutcome(StrEnum):
    """How sampling ended."""

    CONVERGED = "converged"
    MAX_STEPS = "stopped at the largest number of steps, too early"
    DISAGREE = "not converged: walkers disagree about where they are"
    DIVERGENT = "not converged: steps diverged"


class Judgement(eqx.Module):
    """What a chain is worth.

    tau : integrated autocorrelation time of each number [steps]. effective : number of independent draws. r_hat : of halves of walkers.
    burn_in : steps left out. thinning : of every so many steps one is kept. divergent : share of steps that diverged.
    """

    tau: np.ndarray
    effective: np.ndarray
    r_hat: np.ndarray
    burn_in: int = eqx.field(static=True)
    thinning: int = eqx.field(static=True)
    divergent: float = eqx.field(static=True)
    outcome: SamplingOutcome = eqx.field(static=True)

    @property
    def kept(self) -> slice:
        """The steps that are kept."""
        return slice(self.burn_in, None, self.thinning)


def judge(chain: Chain, *, effective: int | float, warm_up: int = 0) -> Judgement:
    """Judge a chain. effective : number of independent draws asked for. warm_up : steps that are left out in any case.

    Converged: after the burn-in of 5 autocorrelation times it is 50 of them long, it has as many independent draws as asked for, and halves of
    walkers agree as well as their length allows.
    """
    x = chain.x
    warm_up = min(warm_up, len(x) // 2)
    rough = autocorrelation_time(x[warm_up + (len(x) - warm_up) // 2 :])
    burn_in = warm_up
    if warm_up == 0:
        burn_in = int(min(np.ceil(_BURN_IN * np.max(rough)), len(x) // 2))
    kept = x[burn_in:]
    tau = autocorrelation_time(kept)
    independent = kept.shape[0] * kept.shape[1] / tau
    r_hat = split_r_hat(kept)
    divergent = float(np.mean(chain.divergent[burn_in:])) if len(kept) else 0.0
    agree = np.all(r_hat <= _AGREE + 2.0 * np.minimum(tau / len(kept), 1.0 / LENGTHS))
    outcome = SamplingOutcome.CONVERGED
    if divergent > _DIVERGENT:
        outcome = SamplingOutcome.DIVERGENT
    elif not agree:
        outcome = SamplingOutcome.DISAGREE
    elif not (len(kept) >= LENGTHS * np.max(tau) and np.min(independent) >= effective):
        outcome = SamplingOutcome.MAX_STEPS
    thinning = 1
    if warm_up == 0 and np.all(np.isfinite(tau)):
        most = max(len(kept) * kept.shape[1] // _DRAWS, 1)
        thinning = int(np.clip(np.min(tau) // 2, 1, most))
    return Judgement(tau, independent, r_hat, burn_in, thinning, divergent, outcome)


def split_r_hat(x: np.ndarray) -> np.ndarray:
    """Square root of total over inner variance of the halves of all walkers, (steps, walkers, p) to (p,); infinite where none moves.

    A. Gelman et al., Bayesian Data Analysis, 3rd ed. (2013), eq 11.4. The table of a posterior has ArviZ's rank-normalised one.
    """
    half = len(x) // 2
    if half < 2:
        return np.full(x.shape[2], np.inf)
    halves = np.concatenate([x[:half], x[half : 2 * half]], axis=1)
    inner = np.mean(np.var(halves, axis=0, ddof=1), axis=0)
    between = np.var(np.mean(halves, axis=0), axis=0, ddof=1)
    return np.where(inner > 0, np.sqrt((half - 1) / half + between / np.where(inner > 0, inner, 1.0)), np.inf)
