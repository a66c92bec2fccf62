"""What a simulation returns: named tallies with their errors, from the stored sums of every batch."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .checks import wrong
from .medium import Medium
from .source import Source
from .statistics import Estimate
from .tallies import FIRST_LAYER, R_SPECULAR, ROULETTE, Layout, R, T, Tallies


@dataclass(frozen=True, eq=False)
class Result:
    """Tallies of one run.

    All values are per unit incident power. Names, with shape and unit (m rings, K frequencies, F fibres, N layers):

    ================================ ============= =====================================================================
    R, T                             ()            left through the top after entering, left through the bottom [1]
    R_unscattered, T_unscattered     ()            of these, without a scattering in any layer [1]
    R_specular                       ()            reflected by the first surface, not in R [1]
    A, A_total                       (N,), ()      absorbed in each layer, in all [1]
    path                             (N,)          length travelled in each layer by all light [mm]
    roulette                         ()            ended minus added weight [1]: mean 0, exactly 0 unless a walk is endless
    R_rings, T_rings                 (m,)          mean over the ring [1/mm^2]
    R_beyond, T_beyond               ()            outside the largest ring edge [1]
    R_k, T_k                         (K,)          sum of weights times J0(k r) [1]; these and the rings within Tallies.na
    R_fibres, T_fibres               (F,)          mean over the fibre's face, within its aperture [1/mm^2]
    R_angle, T_angle                 (theta, phi)  radiance in the outer medium [1/sr]: power over projected solid angle
    R_specular_angle                 (theta, phi)  the same for R_specular
    ================================ ============= =====================================================================

    Attributes
    ----------
    medium, source, tallies
        As given.
    seed : int
    photons_per_batch : int
    sums : array, shape (batches, rows, columns)
        Raw sums, in the order of `tallies.Layout`.
    outcome : str
        "done", "interrupted", "time limit" or "relative error reached".
    seconds : float
        Wall time of this call [s], without compilation.
    compile_seconds : float
        Time for compiling or loading the engine [s].
    """

    medium: Medium
    source: Source
    tallies: Tallies
    seed: int
    photons_per_batch: int
    sums: NDArray[np.float64]
    outcome: str = "done"
    seconds: float = math.nan
    compile_seconds: float = math.nan

    def __post_init__(self) -> None:
        self.sums.setflags(write=False)

    @property
    def layout(self) -> Layout:
        """Where each tally lies in `sums`."""
        return Layout(self.tallies, self.medium.layers, self.medium.n_above, self.medium.n_below)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all tallies of this run."""
        return self.layout.names()

    @property
    def batches(self) -> int:
        """Number of batches."""
        return self.sums.shape[0]

    @property
    def photons(self) -> int:
        """Number of photons followed."""
        return self.batches * self.photons_per_batch

    def _samples(self, name: str, column: int) -> NDArray[np.float64]:
        rows, measure, shape = self.layout.matrix(name)
        scale = 1.0 / (self.photons_per_batch * measure)
        columns = [self.sums[:, row, column].sum(axis=1) for row in rows]
        return (np.stack(columns, axis=1) * scale).reshape((self.batches, *shape))

    def estimate(self, name: str) -> Estimate:
        """A tally with its standard error and its batches.

        Raises
        ------
        ValueError
            If the tally does not exist or was not asked for.
        """
        _, measure, shape = self.layout.matrix(name)
        signed = name in ("R_k", "T_k", "roulette")
        quantum = None if signed else (np.ones(1) / (self.photons * measure)).reshape(shape)
        return Estimate.from_samples(self._samples(name, 0), quantum)

    def value(self, name: str) -> NDArray[np.float64]:
        """Mean of a tally; shape and unit as listed in `Result`."""
        return self.estimate(name).value

    def standard_error(self, name: str) -> NDArray[np.float64]:
        """Standard error of a tally, from the scatter of the batches."""
        return self.estimate(name).standard_error

    def _column(self, name: str, parameter: str, layer: int) -> int:
        if not self.tallies.derivatives:
            raise wrong("derivatives", "a run without them", "runs with Tallies(derivatives=True)")
        if name in ("path", "roulette"):
            raise wrong("name", repr(name), "all tallies but path and roulette")
        if parameter not in ("sigma_a", "sigma_s"):
            raise wrong("parameter", repr(parameter), "sigma_a or sigma_s")
        if not 0 <= layer < self.medium.layers:
            raise wrong("layer", layer, f"0 to {self.medium.layers - 1}")
        if parameter == "sigma_s" and self.medium.sigma_s[layer] == 0.0:
            # no path scatters in a clear layer, so its paths say nothing about scattering there
            raise wrong("layer", f"{layer}, a clear layer", "layers with sigma_s above 0")
        return 1 + layer + (self.medium.layers if parameter == "sigma_s" else 0)

    def derivative(self, name: str, parameter: str, layer: int) -> Estimate:
        """Derivative of a tally from the paths.

        Parameters
        ----------
        name : str
            Any tally but path and roulette.
        parameter : str
            "sigma_a" or "sigma_s" (at fixed g).
        layer : int
            From 0 at the top.

        Returns
        -------
        Estimate
            Shape of the tally; its unit times [mm].

        Raises
        ------
        ValueError
            If derivatives were not asked for, or there is no such one.
        """
        return Estimate.from_samples(self._samples(name, self._column(name, parameter, layer)))

    def mean_path(self, name: str, layer: int) -> Estimate:
        """Mean length [mm] travelled in a layer by the light in a tally of leaving light, weighted by its power.

        It is minus the logarithmic derivative in sigma_a. The error is that of a ratio (first order). nan where the tally is 0.

        Raises
        ------
        ValueError
            If derivatives were not asked for, or the tally is not of light that left after entering.
        """
        if name.startswith(("A", "R_specular")):
            raise wrong("name", repr(name), "tallies of light that has left after entering")
        top, bottom = self._samples(name, self._column(name, "sigma_a", layer)), self._samples(name, 0)
        mean = bottom.mean(axis=0)
        safe = np.where(mean != 0.0, mean, math.nan)
        ratio = -top.mean(axis=0) / safe
        residual = (top + ratio * bottom) / safe
        error = residual.std(axis=0, ddof=1) / math.sqrt(self.batches)
        return Estimate(ratio, np.where(np.isfinite(error), error, math.inf), self.batches - 1)

    @property
    def balance(self) -> NDArray[np.float64]:
        """R_specular + R + T + A + roulette - 1 of each batch [1], shape (batches,): 0 to rounding."""
        rows = [R, T, R_SPECULAR, ROULETTE, *range(FIRST_LAYER, FIRST_LAYER + self.medium.layers)]
        sums = self.sums[:, rows, 0]
        return np.array([(math.fsum(batch) - self.photons_per_batch) / self.photons_per_batch for batch in sums])

    def __str__(self) -> str:
        lines = [f"{self.photons} photons in {self.batches} batches, seed {self.seed}: {self.outcome}"]
        for name in ("R_specular", "R", "T", "A_total"):
            if name in self.names:
                lines.append(f"  {name:10} {float(self.value(name)):.6f} +- {float(self.standard_error(name)):.1e}")
        return "\n".join(lines)
