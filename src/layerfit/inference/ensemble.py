"""The affine-invariant ensemble of emcee. The only place where emcee is used.

J. Goodman and J. Weare, Comm. App. Math. Comp. Sci. 5, 65 (2010); D. Foreman-Mackey et al., PASP 125, 306 (2013); jumps along differences of
walkers: C. J. F. ter Braak, Stat. Comput. 16, 239 (2006), and B. Nelson et al., ApJS 210, 11 (2014).
"""

import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from .chain import Chain

LogDensities = Callable[[np.ndarray], np.ndarray]  # (m, p) to (m,)

STATE_SIZE = 624 * 4 + 8 + 8 + 8  # of the generator of random numbers: its words, its position, whether a normal number is kept, and that one


def _to_bytes(state: Any) -> bytes:
    _, words, position, kept, normal = state
    return words.astype(np.uint32).tobytes() + np.array([position, kept], np.int64).tobytes() + np.array([normal]).tobytes()


def _from_bytes(state: bytes) -> Any:
    words, numbers, normal = state[: 624 * 4], np.frombuffer(state[624 * 4 : -8], np.int64), np.frombuffer(state[-8:])
    return "MT19937", np.frombuffer(words, np.uint32), int(numbers[0]), int(numbers[1]), float(normal[0])


def run_ensemble(log_densities: LogDensities, begin: np.ndarray, chain: Chain, seed: int) -> Iterator[None]:
    """Walk for as long as it is asked to, each step into the chain; goes on where the chain ends.

    log_densities : of positions (walkers/2, p), minus infinity where they cannot be. begin : (walkers, p), an even number of walkers, at least 2 p,
    all where the density is above 0; counts as the first step of an empty chain.
    """
    import emcee

    walkers, p = begin.shape
    moves = [(emcee.moves.DEMove(), 0.6), (emcee.moves.DEMove(gamma0=1.0), 0.1), (emcee.moves.StretchMove(), 0.3)]
    sampler = emcee.EnsembleSampler(walkers, p, log_densities, moves=moves, vectorize=True)
    still = np.zeros((1, walkers), bool)
    if chain.count == 0:
        start = np.concatenate([log_densities(half) for half in np.split(begin, 2)])
        chain.append(begin[None], start[None], still, _to_bytes(np.random.RandomState(seed).get_state(legacy=True)))
    state = emcee.State(chain.x[-1], chain.log_density[-1], random_state=_from_bytes(chain.state), copy=True)
    endless: Any = None
    for step in sampler.sample(state, iterations=endless, store=False, skip_initial_state_check=True):
        chain.append(step.coords[None], np.asarray(step.log_prob)[None], still, _to_bytes(step.random_state))
        yield


def autocorrelation_time(x: np.ndarray) -> np.ndarray:
    """Integrated autocorrelation time in steps of each number, at least 1/walkers; (steps, walkers, p) to (p,). Infinite where nothing moves.

    Sokal's estimate with an automatic window, the mean over walkers, by emcee. Walkers that stand still are left out of the mean.
    """
    from emcee.autocorr import integrated_time

    found = np.full(x.shape[2], np.inf)
    for i in range(x.shape[2]):
        moving = x[:, np.ptp(x[:, :, i], axis=0) > 0, i]
        if moving.shape[1] and len(x) > 1:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found[i] = max(float(integrated_time(moving, tol=0)[0]), 1.0 / x.shape[1])
    return found
