"""The Monte Carlo cases of tests/reference/cases as one table: name, stack, profiles with standard errors, totals."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import layerfit as lf

FOLDER = Path(__file__).parent / "reference" / "cases"


@dataclass(frozen=True)
class Case:
    """One MCML run. Profiles are ring averages per area and unit incident power; errors from 20 batches."""

    name: str
    stack: lf.Stack
    rings: tuple[np.ndarray, np.ndarray]
    R: np.ndarray
    R_se: np.ndarray
    T: np.ndarray
    T_se: np.ndarray
    totals: dict

    @property
    def optical_thickness(self) -> list[float]:
        """Transport optical thickness of the finite layers."""
        return [float(layer.thickness / layer.transport_mfp) for layer in self.stack.layers if isinstance(layer, lf.Layer)]

    @property
    def scattering_ratio(self) -> float:
        """Smallest sigma_s'/sigma_a."""
        return min(float(layer.sigma_s_prime / layer.sigma_a) for layer in self.stack.layers)

    @property
    def diffusive(self) -> bool:
        """Whether diffusion claims to hold: layers of 2 mfp' or more, sigma_s'/sigma_a of 10 or more. (A clear gap is thinner than that.)"""
        return min(self.optical_thickness, default=np.inf) >= 2.0 - 1e-9 and self.scattering_ratio >= 10.0 - 1e-9

    @property
    def mfp(self) -> float:
        """Transport mean free path of the first layer [mm]."""
        return float(self.stack.layers[0].transport_mfp)


@cache
def load(name: str) -> Case:
    content = json.loads((FOLDER / f"{name}.json").read_text())
    layers = []
    for i, row in enumerate(content["layers"]):
        numbers = {"sigma_a": row["mua_per_mm"], "sigma_s": row["mus_per_mm"], "g": row["g"], "n": row["n"]}
        if row["thickness_mm"] == "semi-infinite":
            layers.append(lf.HalfSpace(f"layer{i + 1}", **numbers))
        else:
            layers.append(lf.Layer(f"layer{i + 1}", thickness=row["thickness_mm"], **numbers))
    table = np.loadtxt(FOLDER / f"{name}.csv", delimiter=",", skiprows=1)
    stack = lf.Stack(layers, n_above=content["n_above"], n_below=content["n_below"])
    return Case(name, stack, (table[:, 0], table[:, 1]), table[:, 2], table[:, 3], table[:, 4], table[:, 5], content["totals"])


TEN_KINDS = (
    "si_match_g0_a0990",
    "si_n14_g09_a0990",
    "si_n14_g08_a0667",
    "si_n14_g098",
    "two_thick_low_over_thin_high",
    "skin_over_fat",
    "head_scalp_skull_csf_brain",
    "absorbing_top",
    "slab_n14_g08_5mfp",
    "skin3_dj_R",
)
NAMES = sorted(path.stem for path in FOLDER.glob("*.json"))


def cases() -> list[Case]:
    """All open cases."""
    return [load(name) for name in NAMES]
