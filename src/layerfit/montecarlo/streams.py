"""Random numbers: one independent xoshiro256++ stream for each batch, so that no result depends on the number of threads.

The four words of a stream's state are the output of splitmix64 started from a mix of the seed and the batch number; streams
of different batches are then independent random points of a cycle of length 2^256 - 1.

References
----------
Blackman and Vigna, ACM Trans. Math. Softw. 47, 36 (2021): xoshiro256++. Steele, Lea and Flood, OOPSLA 2014: splitmix64.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

# Division by zero gives inf or nan, as in NumPy: the checks of the other model cost time in every division of the walk.
# Of fast mathematics only the fused multiply-add is allowed, which rounds once instead of twice.
OPTIONS = {"error_model": "numpy", "nogil": True, "fastmath": {"contract"}}
compiled = njit(**OPTIONS)

_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)
_U12, _U17, _U19, _U23, _U27, _U30, _U31, _U41, _U45 = (np.uint64(b) for b in (12, 17, 19, 23, 27, 30, 31, 41, 45))


@compiled
def _finish(z):
    z = (z ^ (z >> _U30)) * _FIRST
    z = (z ^ (z >> _U27)) * _SECOND
    return z ^ (z >> _U31)


@compiled
def stream(seed, batch) -> NDArray[np.uint64]:
    """State of the stream of one batch, shape (4,)."""
    # the seed is scrambled before the batch enters: (seed, batch + 1) and (seed + 1, batch) must not share words
    z = _finish(np.uint64(seed) + _GAMMA) ^ _finish(np.uint64(batch) * _GAMMA + _SECOND)
    state = np.empty(4, np.uint64)
    for index in range(4):
        z += _GAMMA
        state[index] = _finish(z)
    return state


@compiled
def draw(words):
    """The next state of four words, and a number in (0, 1), both ends excluded: (j + 1/2) 2^-52 for a 52-bit j.

    For loops in which the state should stay in registers; `uniform` does the same to a state in memory.
    """
    a, b, c, d = words
    word = a + d
    word = ((word << _U23) | (word >> _U41)) + a
    shifted = b << _U17
    c ^= a
    d ^= b
    b ^= c
    a ^= d
    c ^= shifted
    return (a, b, c, (d << _U45) | (d >> _U19)), (np.float64(word >> _U12) + 0.5) * 2.220446049250313e-16


@compiled
def uniform(state):
    """A number in (0, 1), both ends excluded; changes the state."""
    words, number = draw((state[0], state[1], state[2], state[3]))
    state[0], state[1], state[2], state[3] = words
    return number


@compiled
def exponential(state):
    """An exponential deviate of mean 1; changes the state."""
    return -math.log(uniform(state))
