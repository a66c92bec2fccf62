"""What the light walks in: layers between two outer media, as plain numbers.

The z axis points down, the top face is z = 0, lengths are in mm and coefficients in 1/mm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .checks import wrong
from .phase import HenyeyGreenstein, Phase, TabulatedPhase


class MediumTable(NamedTuple):
    """The same medium as arrays, one entry a layer (`n`: outer media at both ends; `slope`: one an interface)."""

    top: NDArray[np.float64]
    bottom: NDArray[np.float64]
    sigma_a: NDArray[np.float64]
    sigma_s: NDArray[np.float64]
    kind: NDArray[np.int64]
    g: NDArray[np.float64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    n: NDArray[np.float64]
    slope: NDArray[np.float64]
    node: NDArray[np.float64]
    density: NDArray[np.float64]
    cumulative: NDArray[np.float64]


ISOTROPIC, HENYEY_GREENSTEIN, TABULATED = 0, 1, 2


def _numbers(name: str, given: ArrayLike, count: int, low: float, allowed: str, *, high: float = math.inf) -> tuple[float, ...]:
    """`count` floats from `low` to below `high`, from one number or a sequence of them."""
    try:
        values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise wrong(name, repr(given), allowed) from None
    if values.ndim == 0:
        values = np.full(count, float(values))
    if values.shape != (count,):
        raise wrong(name, f"{values.size} values", f"one number or {count} of them")
    for index, value in enumerate(values.tolist()):
        if not (low <= value and not value >= high):
            raise wrong(f"{name}[{index}]", value, allowed)
    return tuple(values.tolist())


@dataclass(frozen=True, init=False)
class Medium:
    """A stack of N homogeneous layers, top to bottom, between two outer media.

    N = 0 is a bare interface between the outer media.

    Parameters
    ----------
    n : sequence of float, shape (N,)
        Refractive index of each layer [1], above 0.
    sigma_a : float or sequence of float, shape (N,)
        Absorption coefficient [1/mm], not negative.
    sigma_s : float or sequence of float, shape (N,)
        Scattering coefficient [1/mm], not negative. 0 is a clear layer.
    g : float or sequence of float, shape (N,), optional
        Mean cosine of a Henyey-Greenstein phase function [1]; default 0. Give `g` or `phase`, not both.
    phase : sequence of float, `HenyeyGreenstein` or `TabulatedPhase`, shape (N,), optional
        Phase function of each layer; a number is the mean cosine of Henyey-Greenstein.
    thickness : float or sequence of float, shape (N,)
        Thickness [mm], not negative; ``math.inf`` in the last layer makes it a half space.
    n_above, n_below : float
        Indices of the outer media [1]. `n_below` has no effect under a half space.
    roughness : float or sequence of float, shape (N + 1,), (N,) over a half space
        RMS slope per axis of each interface from the top [1] (0 is smooth); a Beckmann surface of alpha = sqrt(2) roughness.
        A rough interface between equal indices has no effect.

    Raises
    ------
    ValueError
        Names the argument, what was given and what is allowed.
    """

    n: tuple[float, ...]
    sigma_a: tuple[float, ...]
    sigma_s: tuple[float, ...]
    phase: tuple[Phase, ...]
    thickness: tuple[float, ...]
    n_above: float
    n_below: float
    roughness: tuple[float, ...]

    def __init__(
        self,
        n: Sequence[float],
        sigma_a: ArrayLike = (),
        sigma_s: ArrayLike = (),
        g: ArrayLike | None = None,
        thickness: ArrayLike = (),
        *,
        phase: Sequence[float | Phase] | None = None,
        n_above: float = 1.0,
        n_below: float = 1.0,
        roughness: ArrayLike = 0.0,
    ):
        count = len(n)
        index, coefficient = "finite numbers above 0", "finite numbers not below 0 [1/mm]"
        lengths = _numbers("thickness", thickness, count, 0.0, "numbers not below 0 [mm], inf in the last layer", high=math.nan)
        fields = {
            "n": _numbers("n", n, count, 1e-3, index),
            "sigma_a": _numbers("sigma_a", sigma_a, count, 0.0, coefficient),
            "sigma_s": _numbers("sigma_s", sigma_s, count, 0.0, coefficient),
            "phase": self._phases(g, phase, count),
            "thickness": lengths,
            "n_above": _numbers("n_above", n_above, 1, 1e-3, index)[0],
            "n_below": _numbers("n_below", n_below, 1, 1e-3, index)[0],
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)
        faces = count if self.half_space else count + 1
        object.__setattr__(self, "roughness", _numbers("roughness", roughness, faces, 0.0, "finite numbers not below 0"))
        if math.inf in lengths[:-1]:
            raise wrong(f"thickness[{lengths.index(math.inf)}]", math.inf, "inf in the last layer only")
        if self.half_space and self.sigma_a[-1] == 0.0 and self.sigma_s[-1] == 0.0:
            raise wrong(
                "thickness[-1]",
                "inf for a layer that neither absorbs nor scatters",
                "a finite thickness; a clear medium without end is what n_below describes",
            )

    @staticmethod
    def _phases(g: ArrayLike | None, phase: Sequence[float | Phase] | None, count: int) -> tuple[Phase, ...]:
        if g is not None and phase is not None:
            raise wrong("g, phase", "both", "one of them")
        if phase is None:
            phase = _numbers("g", 0.0 if g is None else g, count, -1.0, "-1 < g < 1", high=1.0)
        if len(phase) != count:
            raise wrong("phase", f"{len(phase)} values", f"{count} of them, one a layer")
        phases: list[Phase] = []
        for index, item in enumerate(phase):
            if isinstance(item, (HenyeyGreenstein, TabulatedPhase)):
                phases.append(item)
            elif isinstance(item, (int, float)):
                phases.append(HenyeyGreenstein(item))
            else:
                raise wrong(f"phase[{index}]", repr(item), "a number, HenyeyGreenstein or TabulatedPhase")
        return tuple(phases)

    @property
    def layers(self) -> int:
        """Number of layers N."""
        return len(self.n)

    @property
    def half_space(self) -> bool:
        """True where the last layer has no lower face."""
        return self.layers > 0 and math.isinf(self.thickness[-1])

    def flipped(self) -> Medium:
        """The same stack upside down, so that light from above is light from below.

        Raises
        ------
        ValueError
            If the last layer is a half space.
        """
        if self.half_space:
            raise wrong("flipped", "a half space", "layers of finite thickness")
        return Medium(
            self.n[::-1],
            self.sigma_a[::-1],
            self.sigma_s[::-1],
            None,
            self.thickness[::-1],
            phase=self.phase[::-1],
            n_above=self.n_below,
            n_below=self.n_above,
            roughness=self.roughness[::-1],
        )

    def table(self) -> MediumTable:
        """The arrays that the simulation reads."""
        bottom = np.cumsum(np.asarray(self.thickness, dtype=np.float64))
        top = np.concatenate(([0.0], bottom))[: self.layers]
        kind, first, last = (np.zeros(self.layers, np.int64) for _ in range(3))
        g = np.zeros(self.layers)
        nodes, densities, cumulatives = [np.zeros(1)], [np.zeros(1)], [np.zeros(1)]
        used = 1
        for index, phase in enumerate(self.phase):
            if isinstance(phase, TabulatedPhase):
                node, density, cumulative = phase.table()
                nodes.append(node)
                densities.append(density)
                cumulatives.append(cumulative)
                kind[index], first[index], last[index] = TABULATED, used, used + node.size - 1
                used += node.size
            else:
                kind[index], g[index] = (HENYEY_GREENSTEIN if phase.g != 0.0 else ISOTROPIC), phase.g
        faces = list(self.roughness) + [0.0] * (self.layers + 1 - len(self.roughness))
        return MediumTable(
            top,
            bottom,
            np.asarray(self.sigma_a, dtype=np.float64),
            np.asarray(self.sigma_s, dtype=np.float64),
            kind,
            g,
            first,
            last,
            np.array([self.n_above, *self.n, self.n_below]),
            np.array(faces),
            np.concatenate(nodes),
            np.concatenate(densities),
            np.concatenate(cumulatives),
        )
