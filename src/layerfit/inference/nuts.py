"""The No-U-Turn sampler of NumPyro. The only place where NumPyro is used; it is an extra.

M. D. Hoffman and A. Gelman, J. Mach. Learn. Res. 15, 1593 (2014); the multinomial kind of M. Betancourt, arXiv:1701.02434 (2017).
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..arrays import AnyArray
from ..compilation import compiled
from ..errors import InputError
from .chain import Chain

WARM_UP = 400  # steps that adapt step size and mass matrix; they do not count
_BLOCK = 20  # steps of one compiled call, and between two that are stored
_ACCEPT = 0.95  # aimed at: in narrow, curved valleys steps of the usual 0.8 diverge

LogDensity = Callable[[Float[AnyArray, "p"]], Float[AnyArray, ""]]
Physical = Callable[[Float[AnyArray, "*s p"]], Float[AnyArray, "*s p"]]


def _library() -> Any:
    try:
        from numpyro.infer import hmc
    except ImportError:
        raise InputError("sampler 'nuts' needs NumPyro, which is not installed; pip install layerfit[nuts], or take sampler 'emcee'") from None
    return hmc


def check_installed() -> None:
    """Raise InputError, saying what to install, where NumPyro is missing."""
    _library()


class _Block(eqx.Module):
    u: Float[Array, "steps p"]
    potential: Float[Array, "steps"]
    divergent: Float[Array, "steps"]
    state: Any


@compiled
def _slope(log_density: LogDensity, u: Float[AnyArray, "p"]) -> tuple[Float[Array, ""], Float[Array, "p"]]:
    """The potential and its gradient."""
    return jax.value_and_grad(lambda u: -log_density(u))(u)


def _kernel(log_density: LogDensity, u: Any, slope: Any, key: Any) -> tuple[Any, Any]:
    """First state of a chain, and the step from one state to the next."""
    library = _library()
    begin, step = library.hmc(potential_fn=lambda u: -log_density(u), algo="NUTS")
    first = begin(
        library.ParamInfo(u, *slope),
        WARM_UP,
        step_size=0.5,
        dense_mass=True,
        target_accept_prob=_ACCEPT,
        rng_key=key,
    )
    return first, step


@compiled
def _first(log_density: LogDensity, u: Any, slope: Any, key: Any) -> Any:
    return _kernel(log_density, u, slope, key)[0]


@compiled
def _walk(log_density: LogDensity, state: Any) -> _Block:
    """One block of steps of one chain."""
    _, step = _kernel(log_density, state.z, (state.potential_energy, state.z_grad), state.rng_key)

    def body(state: Any, _: None) -> tuple[Any, tuple[Array, Array, Array]]:
        state = step(state)
        return state, (state.z, state.potential_energy, state.diverging.astype(float))

    state, (u, potential, divergent) = jax.lax.scan(body, state, None, length=_BLOCK)
    return _Block(u, potential, divergent, state)


def _pack(states: list[Any]) -> bytes:
    return b"".join(np.asarray(leaf).tobytes() for state in states for leaf in jax.tree.leaves(state))


def _unpack(content: bytes, like: Any, chains: int) -> list[Any]:
    """The states of which `content` is made; like : one state, as shapes and types."""
    leaves, structure = jax.tree.flatten(like)
    states, at = [], 0
    for _ in range(chains):
        parts = []
        for leaf in leaves:
            size = leaf.size * leaf.dtype.itemsize
            parts.append(np.frombuffer(content[at : at + size], leaf.dtype).reshape(leaf.shape))
            at += size
        states.append(jax.tree.unflatten(structure, parts))
    return states


def _like(log_density: LogDensity, p: int) -> Any:
    """A chain's state as shapes and types."""
    u = jnp.zeros(p)
    return eqx.filter_eval_shape(_first, log_density, u, (jnp.zeros(()), u), jax.random.PRNGKey(0))


def state_size(log_density: LogDensity, chains: int, p: int) -> int:
    """Bytes of the state of all chains."""
    return chains * sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(_like(log_density, p)))


def run_nuts(log_density: LogDensity, physical: Physical, begin: np.ndarray, chain: Chain, seed: int) -> Iterator[None]:
    """Walk for as long as it is asked to, some steps at a time into the chain; goes on where the chain ends. Two chains run at once.

    log_density : of unbounded coordinates u (p,), in which the density is about a unit sphere; the mass matrix, and the step size, are adapted in the
    first WARM_UP steps. physical : what the chain keeps of u. begin : u of each chain (chains, p), where the density is above 0.
    """
    chains, p = begin.shape
    if chain.count == 0:
        keys = jax.random.split(jax.random.PRNGKey(seed), chains)
        states = [_first(log_density, u, _slope(log_density, u), key) for u, key in zip(begin, keys, strict=True)]
    else:
        states = _unpack(chain.state, _like(log_density, p), chains)
    with ThreadPoolExecutor(2) as pool:
        first = [_walk(log_density, states[0])]  # alone, so that it compiles once
        while True:
            blocks = [*first, *pool.map(lambda state: jax.block_until_ready(_walk(log_density, state)), states[len(first) :])]
            first, states = [], [block.state for block in blocks]
            u = np.stack([np.asarray(block.u) for block in blocks], axis=1)
            density = -np.stack([np.asarray(block.potential) for block in blocks], axis=1)
            divergent = np.stack([np.asarray(block.divergent) for block in blocks], axis=1)
            room = chain.capacity - chain.count
            chain.append(np.asarray(physical(jnp.asarray(u)))[:room], density[:room], divergent[:room], _pack(states))
            yield
