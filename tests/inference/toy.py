"""Densities in two dimensions whose marginals a dense grid gives, and samplers run on them to their verdict."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np

from layerfit.inference.chain import chain_in_memory
from layerfit.inference.ensemble import STATE_SIZE, run_ensemble
from layerfit.inference.sampling import walk


def banana(x):
    """A ridge bent so far that its ends are at right angles to its middle."""
    return -0.5 * (x[0] ** 2 + ((x[1] - x[0] ** 2) / 0.5) ** 2)


def two_hills(apart):
    """Two equal round hills of unit width."""

    def density(x):
        return jnp.logaddexp(-0.5 * ((x[0] - apart / 2) ** 2 + x[1] ** 2), -0.5 * ((x[0] + apart / 2) ** 2 + (x[1] - 1.0) ** 2))

    return density


GRID = np.linspace(-10.0, 24.0, 1701)
_FIRST = 1001  # the first number stays below 10


def grid_marginals(density):
    """Distribution functions of both numbers at GRID."""
    first, second = np.meshgrid(GRID[:_FIRST], GRID, indexing="ij")
    weights = np.exp(np.asarray(jax.vmap(density)(jnp.stack([first.ravel(), second.ravel()], axis=1)).reshape(first.shape)))
    totals = [np.concatenate([weights.sum(axis=1), np.zeros(GRID.size - _FIRST)]), weights.sum(axis=0)]
    return [(np.cumsum(total) - 0.5 * total) / np.sum(total) for total in totals]


def kolmogorov(draws, exact):
    """Largest distance between the distribution functions of draws and of the grid."""
    found = np.searchsorted(np.sort(draws), GRID, side="right") / len(draws)
    return float(np.max(np.abs(found - exact)))


def with_emcee(density, begin, *, steps=20_000, effective=3000.0, seed=0):
    """Kept draws (n, 2) and the judgement."""
    batched = jax.jit(jax.vmap(density))
    chain = chain_in_memory(steps, len(begin), 2, STATE_SIZE)
    way = SimpleNamespace(run=lambda chain: run_ensemble(lambda x: np.asarray(batched(x)), begin, chain, seed), counted_warm_up=0)
    judgement = walk(way, chain, steps, effective, None)
    return chain.x[judgement.kept].reshape(-1, 2), judgement


def with_nuts(density, begin, *, steps=8000, effective=3000.0, seed=0):
    """Kept draws (n, 2) and the judgement."""
    from layerfit.inference.nuts import WARM_UP, run_nuts, state_size

    chain = chain_in_memory(steps, len(begin), 2, state_size(density, len(begin), 2))
    way = SimpleNamespace(run=lambda chain: run_nuts(density, lambda u: u, begin, chain, seed), counted_warm_up=WARM_UP)
    judgement = walk(way, chain, steps, effective, None)
    return chain.x[judgement.kept].reshape(-1, 2), judgement
