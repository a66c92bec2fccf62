"""Writes the data of the bundled examples from Monte Carlo cases of tests/reference/cases (MCML 1.2.2, see the header of each case).

    python examples/make_examples.py

Noise is drawn from a fixed seed, so that the files come out the same.
"""

import json
from pathlib import Path

import numpy as np
from scipy.special import j1

ROOT = Path(__file__).parent.parent
CASES = ROOT / "tests" / "reference" / "cases"
EXAMPLES = ROOT / "src" / "layerfit" / "examples"


def load(case: str) -> tuple[dict, np.ndarray]:
    return json.loads((CASES / f"{case}.json").read_text()), np.loadtxt(CASES / f"{case}.csv", delimiter=",", skiprows=1)


def write(path: Path, header: str, comments: list[str], columns: list[np.ndarray]) -> None:
    rows = "\n".join(", ".join(f"{v:.6g}" for v in row) for row in zip(*columns, strict=True))
    path.write_text("".join(f"# {c}\n" for c in comments) + f"{header}\n{rows}\n")


def two_layer() -> None:
    """R(r) of skin over fat in rings between 1 and 15 mm, 1 % noise."""
    _, table = load("skin_over_fat")
    rings = table[(table[:, 0] >= 1.0) & (table[:, 1] <= 15.0)]
    noise = 0.01
    values = rings[:, 2] * (1.0 + noise * np.random.default_rng(2).standard_normal(len(rings)))
    comments = [
        "R(r) of skin over fat by Monte Carlo (MCML 1.2.2, 1.72e6 photons, case skin_over_fat), rings between 1 and 15 mm, 1 % noise added (seed 2).",
        "Truth: skin sigma_a 0.02, sigma_s' 2 /mm, 1.5 mm, n 1.4; fat sigma_a 0.005, sigma_s' 1.2 /mm, n 1.44; g 0.9.",
    ]
    write(
        EXAMPLES / "two-layer" / "profile.csv",
        "r_min [mm], r_max [mm], value [1/mm^2], sd [1/mm^2]",
        comments,
        [rings[:, 0], rings[:, 1], values, noise * rings[:, 2]],
    )


def spatial_frequency() -> None:
    """R(fx) of a half space from its R(r), 2 % noise, up to 0.1 /mm: diffusion, the solver of the scene, is biased at higher frequencies."""
    case, table = load("si_n14_g08_a0980")
    low, high, values = table[:, 0], table[:, 1], table[:, 2]
    fx = np.arange(11) / 100.0
    noise = 0.02
    k = 2.0 * np.pi * np.maximum(fx, 1e-9)[:, None]
    reflectance = np.sum(values * 2.0 * np.pi * (high * j1(k * high) - low * j1(k * low)) / k, axis=1)
    reflectance[0] += case["totals"]["R_diffuse_beyond_rmax"]["value"]
    noisy = reflectance * (1.0 + noise * np.random.default_rng(4).standard_normal(fx.size))
    comments = [
        "R at spatial frequencies from R(r) by Monte Carlo (MCML 1.2.2, 5.2e6 photons, case si_n14_g08_a0980), 2 % noise added (seed 4).",
        "Truth: sigma_a 0.02, sigma_s' 1 /mm, g 0.8, n 1.4.",
    ]
    write(EXAMPLES / "spatial-frequency" / "frequencies.csv", "fx [1/mm], value [1], sd [1]", comments, [fx, noisy, noise * reflectance])


if __name__ == "__main__":
    two_layer()
    spatial_frequency()
