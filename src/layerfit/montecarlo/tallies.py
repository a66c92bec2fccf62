"""What is counted, and where each count lies in the raw table of sums.

The raw table of one batch has one row a slot and, with derivatives, 1 + 2 N columns: the sum of the weights, then the same
weights times the score of sigma_a of every layer, then of sigma_s. `Layout` turns rows into named tallies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .checks import number, wrong

# Fixed rows; the absorption of layer 0 follows, then the rest in the order of `Layout.start`.
R, R_UNSCATTERED, T, T_UNSCATTERED, R_SPECULAR, ROULETTE, FIRST_LAYER = 0, 1, 2, 3, 4, 5, 6


@dataclass(frozen=True)
class CollectingFibre:
    """A fibre that collects light at the top face (tally R_fibres) and at the bottom face (T_fibres).

    It neither reflects nor changes the index outside: it only selects what has left the sample.

    Parameters
    ----------
    distance : float
        From the axis of the source to the fibre's centre [mm], not below 0.
    radius : float
        Of the fibre's face [mm], above 0.
    na : float
        Numerical aperture [1]: light with n_outer sin(theta) < na is collected.
    azimuth : float
        Of the centre [degrees], 0 is the direction in which an oblique beam travels. Of no effect for a source with rotational
        symmetry, whose light is averaged over the full circle.
    """

    distance: float
    radius: float
    na: float
    azimuth: float = 0.0

    def __post_init__(self) -> None:
        number("distance", self.distance, 0.0, math.inf, "finite and not below 0 [mm]")
        number("radius", self.radius, 0.0, math.inf, "finite and above 0 [mm]", above=True)
        number("na", self.na, 0.0, math.inf, "finite and above 0", above=True)
        number("azimuth", self.azimuth, -math.inf, math.inf, "a finite angle [degrees]")


def _edges(name: str, given: ArrayLike | None, low: float, high: float, unit: str) -> tuple[float, ...]:
    if given is None:
        return ()
    values = np.asarray(given, dtype=np.float64)
    good = values.ndim == 1 and values.size >= 2 and bool(np.all(np.diff(values) > 0.0))
    if not (good and values[0] >= low and values[-1] <= high):
        raise wrong(name, values.tolist(), f"2 or more increasing edges from {low:g} to {high:g} [{unit}]")
    return tuple(values.tolist())


@dataclass(frozen=True, init=False)
class Tallies:
    """Which results to collect beside the totals and the absorption in each layer.

    Parameters
    ----------
    rings : array of float, shape (m + 1,) or (m, 2), optional
        Ring edges [mm], increasing; or inner and outer radius of each ring, where gaps and overlaps are allowed.
    k : sequence of float, optional
        Spatial frequencies [rad/mm], not negative.
    theta : sequence of float, optional
        Edges of bins in the polar angle in the outer medium [degrees], from 0 to 90; 0 is along the normal.
    phi : sequence of float, optional
        Edges of bins in the azimuth [degrees], from 0 to 180, where 0 is the direction in which the beam travels (forward,
        specular side) and 180 is back towards the source; +phi and -phi are averaged. Default one bin (0, 180).
    fibres : sequence of CollectingFibre, optional
        Collecting fibres.
    na : float, optional
        Numerical aperture [1] of whatever sees the rings and the spatial frequencies: only light with n_outer sin(theta) < na counts
        there. Default: all light.
    derivatives : bool
        Also the derivative of every tally with respect to sigma_a and sigma_s of every layer. Costs time.

    Raises
    ------
    ValueError
        Names the argument, what was given and what is allowed.
    """

    rings: tuple[tuple[float, float], ...]
    k: tuple[float, ...]
    theta: tuple[float, ...]
    phi: tuple[float, ...]
    fibres: tuple[CollectingFibre, ...]
    na: float | None
    derivatives: bool

    def __init__(
        self,
        rings: ArrayLike | None = None,
        k: ArrayLike | None = None,
        theta: ArrayLike | None = None,
        phi: ArrayLike | None = None,
        fibres: Sequence[CollectingFibre] = (),
        na: float | None = None,
        derivatives: bool = False,
    ):
        frequencies = np.asarray([] if k is None else k, dtype=np.float64)
        if frequencies.ndim != 1 or not np.all(np.isfinite(frequencies) & (frequencies >= 0.0)):
            raise wrong("k", frequencies.tolist(), "finite numbers not below 0 [rad/mm]")
        if phi is not None and theta is None:
            raise wrong("phi", "without theta", "only with edges of theta")
        for index, fibre in enumerate(fibres):
            if not isinstance(fibre, CollectingFibre):
                raise wrong(f"fibres[{index}]", repr(fibre), "CollectingFibre")
        whole = None if theta is None else (0.0, 180.0)
        fields = {
            "rings": self._rings(rings),
            "k": tuple(frequencies.tolist()),
            "theta": _edges("theta", theta, 0.0, 90.0, "degrees"),
            "phi": _edges("phi", whole if phi is None else phi, 0.0, 180.0, "degrees"),
            "fibres": tuple(fibres),
            "na": None if na is None else number("na", na, 0.0, math.inf, "finite and above 0", above=True),
            "derivatives": bool(derivatives),
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    @staticmethod
    def _rings(given: ArrayLike | None) -> tuple[tuple[float, float], ...]:
        if given is None:
            return ()
        values = np.asarray(given, dtype=np.float64)
        if values.ndim == 1 and values.size >= 2:
            values = np.stack((values[:-1], values[1:]), axis=1)
        good = values.ndim == 2 and values.shape[1] == 2 and bool(np.all(np.isfinite(values)))
        if not (good and np.all(values[:, 0] >= 0.0) and np.all(values[:, 1] > values[:, 0])):
            raise wrong("rings", values.tolist(), "increasing edges, or pairs with 0 <= inner < outer [mm]")
        return tuple((float(a), float(b)) for a, b in values)


class TallyTable(NamedTuple):
    """What the scoring reads: `start` is the first row of each block, see `Layout.start`."""

    start: NDArray[np.int64]
    radius2: NDArray[np.float64]
    k: NDArray[np.float64]
    bessel: NDArray[np.float64]
    hankel: NDArray[np.float64]
    sine2: NDArray[np.float64]
    minus_cosine: NDArray[np.float64]
    fibre: NDArray[np.float64]
    aperture: NDArray[np.float64]
    symmetric: bool
    derivatives: bool


BESSEL_CELL, BESSEL_END = 0.25, 32.0


def bessel_tables() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coefficients for J0: a polynomial of degree 9 in each cell of 0.25 below 32, and the asymptotic series above.

    Returns
    -------
    cells : array, shape (128, 10)
        Powers of t in (-1, 1) over the cell, error below 1e-15.
    series : array, shape (2, 8)
        P and Q of J0 = sqrt(2 / (pi x)) (P cos(x - pi/4) - Q sin(x - pi/4)) in powers of 1/x^2 and 1/x times those
        (Abramowitz and Stegun 9.2.5, 9.2.9 and 9.2.10); the first term left out is below 1e-17 at 32.
    """
    from scipy.special import j0

    node = np.cos(np.pi * (np.arange(20) + 0.5) / 20)
    count = round(BESSEL_END / BESSEL_CELL)
    cells = np.empty((count, 10))
    for index in range(count):
        x = BESSEL_CELL * (index + 0.5 + 0.5 * node)
        cells[index] = np.polynomial.chebyshev.cheb2poly(np.polynomial.chebyshev.chebfit(node, j0(x), 9))
    term = [1.0]
    for m in range(1, 16):
        term.append(-term[-1] * (2 * m - 1) ** 2 / (8.0 * m))
    sign = [(-1.0) ** (m // 2) for m in range(16)]
    signed = np.array(term) * np.array(sign)
    return cells, np.stack((signed[0::2], signed[1::2]))


class Layout:
    """Rows of the raw table for one medium and one set of tallies.

    Parameters
    ----------
    tallies : Tallies
    layers : int
        Number of layers N.
    n_above, n_below : float
        Indices of the outer media [1].
    """

    def __init__(self, tallies: Tallies, layers: int, n_above: float, n_below: float):
        self.tallies = tallies
        self.layers = layers
        self.index_outside = (n_above, n_below)
        radii = sorted({0.0, *(edge for ring in tallies.rings for edge in ring)}) if tallies.rings else []
        self.cell_edges = np.array(radii)
        cells = len(radii)  # the last cell is all beyond the last edge
        bins = (len(tallies.theta) - 1) * (len(tallies.phi) - 1) if tallies.theta else 0
        sizes = {
            "A": layers,
            "path": layers,
            "R_cells": cells,
            "T_cells": cells,
            "R_k": len(tallies.k),
            "T_k": len(tallies.k),
            "R_fibres": len(tallies.fibres),
            "T_fibres": len(tallies.fibres),
            "R_angle": bins,
            "T_angle": bins,
            "R_specular_angle": bins,
        }
        first = FIRST_LAYER
        self.start: dict[str, int] = {}
        self.size = sizes
        for name, size in sizes.items():
            self.start[name] = first
            first += size
        self.rows = first
        self.columns = 1 + 2 * layers if tallies.derivatives else 1

    def table(self, symmetric: bool) -> TallyTable:
        """The arrays that the scoring reads; `symmetric`: the source has rotational symmetry."""
        tallies = self.tallies
        cells, series = bessel_tables() if tallies.k else (np.zeros((1, 10)), np.zeros((2, 8)))
        fibre = np.array(
            [
                [
                    f.distance,
                    f.radius,
                    f.distance * math.cos(math.radians(f.azimuth)),
                    f.distance * math.sin(math.radians(f.azimuth)),
                    *((f.na / n) ** 2 for n in self.index_outside),
                ]
                for f in tallies.fibres
            ]
        ).reshape(-1, 6)
        return TallyTable(
            np.array(list(self.start.values()), dtype=np.int64),
            self.cell_edges**2,
            np.array(tallies.k),
            cells,
            series,
            np.sin(np.radians(tallies.theta)) ** 2,
            -np.cos(np.radians(tallies.phi)),
            fibre,
            np.array([2.0 if tallies.na is None else (tallies.na / n) ** 2 for n in self.index_outside]),
            symmetric,
            tallies.derivatives,
        )

    def matrix(self, name: str) -> tuple[list[NDArray[np.int64]], NDArray[np.float64], tuple[int, ...]]:
        """How a named tally is read: the rows summed for each entry, the measure it is divided by, and its shape.

        Raises
        ------
        ValueError
            If the tally does not exist or was not asked for.
        """
        single = {"R": R, "R_unscattered": R_UNSCATTERED, "T": T, "T_unscattered": T_UNSCATTERED}
        single |= {"R_specular": R_SPECULAR, "roulette": ROULETTE}
        if name in single:
            return [np.array([single[name]])], np.ones(1), ()
        if name == "A_total":
            return [np.arange(self.layers) + self.start["A"]], np.ones(1), ()
        if name in ("R_beyond", "T_beyond") and self.tallies.rings:
            block = name[0] + "_cells"
            return [np.array([self.start[block] + self.size[block] - 1])], np.ones(1), ()
        if name in ("R_rings", "T_rings") and self.tallies.rings:
            edges = self.cell_edges
            rows = [np.flatnonzero((edges >= a) & (edges < b)) + self.start[name[0] + "_cells"] for a, b in self.tallies.rings]
            area = np.array([math.pi * (b - a) * (b + a) for a, b in self.tallies.rings])
            return rows, area, (len(rows),)
        if name in self.size and not name.endswith("_cells") and self.size[name] > 0:
            rows = [np.array([self.start[name] + index]) for index in range(self.size[name])]
            return rows, self._measure(name), self._shape(name)
        raise wrong("name", repr(name), ", ".join(self.names()))

    def _shape(self, name: str) -> tuple[int, ...]:
        if name.endswith("_angle"):
            return len(self.tallies.theta) - 1, len(self.tallies.phi) - 1
        return (self.size[name],)

    def _measure(self, name: str) -> NDArray[np.float64]:
        """Area of a fibre's face [mm^2] or projected solid angle of a bin [sr]; 1 for the others."""
        if name.endswith("_fibres"):
            return np.array([math.pi * f.radius**2 for f in self.tallies.fibres])
        if name.endswith("_angle"):
            # integral of cos(theta) over the bin; both halves, +phi and -phi, are in it
            polar = np.diff(np.sin(np.radians(self.tallies.theta)) ** 2)
            return np.outer(polar, np.diff(np.radians(self.tallies.phi))).ravel()
        return np.ones(self.size[name])

    def names(self) -> tuple[str, ...]:
        """Names of all tallies of this run."""
        names = ["R", "R_unscattered", "T", "T_unscattered", "R_specular", "roulette"]
        if self.layers:
            names += ["A_total", "A", "path"]
        if self.tallies.rings:
            names += ["R_rings", "T_rings", "R_beyond", "T_beyond"]
        blocks = ("R_k", "T_k", "R_fibres", "T_fibres", "R_angle", "T_angle", "R_specular_angle")
        return tuple(names + [name for name in blocks if self.size[name]])
