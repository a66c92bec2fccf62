"""Spatial frequencies at which a smooth spectrum is computed, and its values in between.

In s = sqrt(k^2 + nu^2) - nu the branch point of a half space, k = i nu, is taken away: at frequency k its modes decay as sqrt(k^2 + nu^2), which the
spectrum depends on smoothly. In t = s/(s + c) the whole axis becomes 0 to 1, on which a spectrum without the light scattered once or never is smooth:
Chebyshev points in t converge as fast as its singularities, all off the real axis, allow. Halving a number of points leaves every other one.
"""

import numpy as np

_FIRST = 1e-6  # k/c in place of 0, where a half space without absorption has a branch point


def chebyshev_frequencies(count: int, scale: float, decay: float = 0.0) -> np.ndarray:
    """The points without the last one, k = inf, where spectra are 0: (count,) [rad/mm].

    scale : c [rad/mm]. decay : nu, not above the true one [1/mm].

    >>> chebyshev_frequencies(4, 1.0).round(3).tolist()
    [0.0, 0.172, 1.0, 5.828]
    """
    t = 0.5 * (1.0 - np.cos(np.pi * np.arange(count) / count))
    s = scale * t / (1.0 - t)
    k = np.sqrt(s * (s + 2.0 * decay))
    k[0] = _FIRST * scale
    return k


def interpolation(count: int, k: np.ndarray, scale: float, decay: float = 0.0) -> np.ndarray:
    """Values at any k [rad/mm] from those at the points of the same count, scale and decay: (k, points).

    References
    ----------
    J.-P. Berrut, L. N. Trefethen, SIAM Rev. 46, 501 (2004), eq 5.4.
    """
    nodes = np.append(chebyshev_frequencies(count, scale, decay), np.inf)
    weights = (-1.0) ** np.arange(count + 1)
    weights[[0, -1]] *= 0.5
    # 1/(t - t_j) without the cancellation of 1 - t at large k
    x, scaled = _along(k, decay)[:, None] / scale, np.append(_along(nodes[:-1], decay) / scale, 0.0)
    gap = np.where(np.isinf(nodes), -1.0 / (1.0 + x), (x - scaled) / ((1.0 + x) * (1.0 + scaled)))
    on = np.asarray(np.abs(gap) < 1e-15)
    terms = np.where(np.any(on, axis=1, keepdims=True), on, weights / np.where(on, 1.0, gap))
    return (terms / terms.sum(axis=1, keepdims=True))[:, :-1]


def _along(k: np.ndarray, decay: float) -> np.ndarray:
    """s [rad/mm], without the cancellation at small k, 0 at k = 0."""
    return k**2 / np.maximum(np.sqrt(k**2 + decay**2) + decay, 1e-300)
