"""Phase functions: how the direction changes at one scattering event, as plain numbers.

`mu` is the cosine of the scattering angle. A phase function p(mu) is normalised here to
``integral of p(mu) dmu over (-1, 1) = 1``; the azimuth is uniform.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .checks import number, wrong


@dataclass(frozen=True)
class HenyeyGreenstein:
    """Henyey-Greenstein phase function.

    Parameters
    ----------
    g : float
        Mean cosine [1], -1 < g < 1.

    Raises
    ------
    ValueError
        If g is outside (-1, 1).

    References
    ----------
    Henyey and Greenstein, Astrophys. J. 93, 70 (1941), eq. 2.
    """

    g: float

    def __post_init__(self) -> None:
        value = number("g", self.g, -1.0, 1.0, "-1 < g < 1", above=True)
        if value == 1.0:
            raise wrong("g", self.g, "-1 < g < 1")
        object.__setattr__(self, "g", value)

    @property
    def mean_cosine(self) -> float:
        """Mean of mu [1]."""
        return self.g


@dataclass(frozen=True)
class TabulatedPhase:
    """Phase function given at nodes, linear in mu between them.

    It is sampled exactly as given: no smoothing, no truncation of the forward peak. Put the nodes
    where the function bends.

    Parameters
    ----------
    cosine : array, shape (m,), m >= 2
        Nodes mu [1], strictly increasing from exactly -1 to exactly 1.
    value : array, shape (m,)
        Values at the nodes, any common factor, none negative, not all zero.

    Raises
    ------
    ValueError
        If the nodes or the values are not as stated.
    """

    cosine: tuple[float, ...]
    value: tuple[float, ...]

    def __init__(self, cosine: ArrayLike, value: ArrayLike):
        mu = np.asarray(cosine, dtype=np.float64)
        p = np.asarray(value, dtype=np.float64)
        if mu.ndim != 1 or mu.size < 2 or p.shape != mu.shape:
            raise wrong("cosine, value", f"shapes {mu.shape}, {p.shape}", "one length of at least 2 for both")
        if not (mu[0] == -1.0 and mu[-1] == 1.0 and np.all(np.diff(mu) > 0.0)):
            raise wrong("cosine", f"{mu[0]!r} ... {mu[-1]!r}", "strictly increasing from -1 to 1")
        if not (np.all(np.isfinite(p)) and np.all(p >= 0.0) and np.any(p > 0.0)):
            raise wrong("value", "negative, non-finite or only zero values", "finite, none negative, one above 0")
        object.__setattr__(self, "cosine", tuple(mu.tolist()))
        object.__setattr__(self, "value", tuple(p.tolist()))

    def table(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Nodes, normalised density and cumulative probability, each of shape (m,)."""
        mu = np.asarray(self.cosine)
        p = np.asarray(self.value)
        piece = 0.5 * (p[1:] + p[:-1]) * np.diff(mu)
        total = piece.sum()
        cumulative = np.concatenate(([0.0], np.cumsum(piece) / total))
        cumulative[-1] = 1.0
        return mu, p / total, cumulative

    @property
    def mean_cosine(self) -> float:
        """Mean of mu [1], exact for the piecewise linear function."""
        mu, p, _ = self.table()
        a, b, u, v = mu[:-1], mu[1:], p[:-1], p[1:]
        return float(np.sum((b - a) * (u * (2.0 * a + b) + v * (a + 2.0 * b)) / 6.0))


Phase = HenyeyGreenstein | TabulatedPhase
