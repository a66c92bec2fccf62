"""Stored R(r) and T(r) of samples with clear layers, by the project's Monte Carlo: ``python tests/reference/make_clear_layers.py`` (some minutes).

Films between scattering layers, far from the source, where the light came along the film; a thin sample between thick slides, near it.
"""

from pathlib import Path

import numpy as np
from ring_rows import ring_rows

import layerfit as lf

PHOTONS = 20_000_000


def _clear(name: str, n: float, thickness: float) -> lf.Layer:
    return lf.Layer(name, sigma_a=0.0, sigma_s=0.0, g=0.0, n=n, thickness=thickness)


SAMPLES = {
    "film": (
        lf.Stack(
            [
                lf.Layer("top", sigma_a=0.02, sigma_s=5.0, g=0.8, n=1.4, thickness=1.0),
                _clear("film", 1.33, 0.3),
                lf.HalfSpace("low", sigma_a=0.02, sigma_s=10.0, g=0.9, n=1.4),
            ]
        ),
        np.geomspace(12.0, 30.0, 8),
    ),
    "thin_film_thin": (
        lf.Stack(
            [
                lf.Layer("top", sigma_a=0.02, sigma_s=10.0, g=0.9, n=1.4, thickness=0.5),
                _clear("film", 1.33, 0.3),
                lf.Layer("low", sigma_a=0.02, sigma_s=10.0, g=0.9, n=1.4, thickness=0.5),
            ]
        ),
        np.geomspace(5.0, 20.0, 8),
    ),
    "between_slides": (
        lf.Stack(
            [
                _clear("above", 1.5, 1.0),
                lf.Layer("sample", sigma_a=0.05, sigma_s=10.0, g=0.9, n=1.4, thickness=0.5),
                _clear("below", 1.5, 1.0),
            ]
        ),
        np.geomspace(0.1, 1.0, 9),
    ),
}


def main() -> None:
    lines = [
        f"# R(r) and T(r) [1/mm^2] of rings [mm] at the samples of make_clear_layers.py, Monte Carlo of {PHOTONS} photons, standard error",
        "sample,side,r_min,r_max,value,se",
    ]
    for name, (stack, edges) in SAMPLES.items():
        kinds = {"R": lf.RadialReflectance} | ({} if stack.half_space else {"T": lf.RadialTransmittance})
        geometries = [kind(r_min=edges[:-1], r_max=edges[1:]) for kind in kinds.values()]
        for side, found in zip(kinds, lf.predict(stack, geometries, solver=lf.MonteCarlo(photons=PHOTONS, seed=5)), strict=True):
            lines += ring_rows(f"{name},{side}", edges, found)
    (Path(__file__).parent / "clear_layers.csv").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
