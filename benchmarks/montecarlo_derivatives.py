"""Derivatives from the paths against differences: ``python benchmarks/montecarlo_derivatives.py [--photons 2.4e7] [--seed 3000]``.

Two layers with an index step on both sides; every tally, sigma_a and sigma_s of both layers. The differences are of fourth order, from
four independent runs at +-20 % and +-40 % of the coefficient: their own error of that order is below 1e-3 of a derivative. Stores
tests/reference/montecarlo/derivatives.json.
"""

from __future__ import annotations

import argparse
import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
from montecarlo_cases import collect, fail_on, provenance

import layerfit.montecarlo as mc

COEFFICIENTS = {"sigma_a": (0.1, 0.05), "sigma_s": (10.0, 5.0)}
STEP = 0.2
STENCIL = {-2: 1.0 / 12.0, -1: -8.0 / 12.0, 1: 8.0 / 12.0, 2: -1.0 / 12.0}
NAMES = (
    "R",
    "T",
    "A",
    "R_unscattered",
    "T_unscattered",
    "R_rings",
    "T_rings",
    "R_k",
    "T_k",
    "R_fibres",
    "R_angle",
    "T_angle",
)


def scene(**coefficients: tuple[float, float]) -> mc.Medium:
    """The two layers, with other coefficients where given."""
    return mc.Medium(
        [1.4, 1.33],
        **(COEFFICIENTS | coefficients),
        g=0.5,
        thickness=[0.3, 0.5],
        n_below=1.2,
        roughness=[0.0, 0.2, 0.0],
    )


def tallies(derivatives: bool) -> mc.Tallies:
    """All kinds of tallies."""
    return mc.Tallies(
        rings=[0.0, 0.1, 0.3, 0.6, 1.0, 2.0],
        k=[0.2, 1.0, 3.0],
        theta=[0.0, 30.0, 60.0, 90.0],
        phi=[0.0, 90.0, 180.0],
        fibres=[mc.CollectingFibre(0.5, 0.2, 0.6)],
        derivatives=derivatives,
    )


LIGHT = mc.Pencil(0.8)


def varied(parameter: str, layer: int, steps: int) -> mc.Medium:
    """The scene with one coefficient changed by `steps` of 20 %."""
    values = list(COEFFICIENTS[parameter])
    values[layer] *= 1.0 + STEP * steps
    return scene(**{parameter: (values[0], values[1])})


def compare(base: mc.Result, parameter: str, layer: int, photons: float, seed: int) -> mc.Comparison:
    """All tallies of one coefficient, both ways."""
    width = STEP * COEFFICIENTS[parameter][layer]
    value: dict[str, Any] = dict.fromkeys(NAMES, 0.0)
    variance: dict[str, Any] = dict.fromkeys(NAMES, 0.0)
    for steps, weight in STENCIL.items():
        run = mc.simulate(varied(parameter, layer, steps), LIGHT, tallies(False), photons=photons, seed=seed + steps, threads=1)
        for name in NAMES:
            found = run.estimate(name)
            value[name] = value[name] + weight / width * found.value
            variance[name] = variance[name] + (weight / width * found.standard_error) ** 2
    batches = round(photons / base.photons_per_batch)
    differences = mc.Estimate.join([mc.Estimate(value[n], np.sqrt(variance[n]), max(batches, 100) - 1) for n in NAMES])
    paths = mc.Estimate.join([base.derivative(name, parameter, layer) for name in NAMES])
    return mc.compare(paths, differences, reliable=math.inf)


def entry(base: dict[str, mc.Result], parameter: str, layer: int, photons: float, seed: int) -> dict[str, Any]:
    """What is stored of one coefficient."""
    if not base:
        base["run"] = mc.simulate(scene(), LIGHT, tallies(True), photons=photons, seed=seed - 500, threads=1)
    found = compare(base["run"], parameter, layer, photons, seed)
    judged = found.score[found.judged]
    sharp = found.noticeable[found.judged]
    return {
        "verdict": found.verdict,
        "bins": int(judged.size),
        "largest": float(np.abs(judged).max()),
        "mean": float(judged.mean()),
        "sd": float(judged.std(ddof=1)),
        "p_family": found.p_family,
        "p_centred": found.p_centred,
        "noticeable_best": float(np.nanmin(sharp)),
        "noticeable_median": float(np.nanmedian(sharp)),
    }


def main() -> None:
    """Run, store, print, and fail where a derivative disagrees."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photons", type=float, default=2.4e7)
    parser.add_argument("--seed", type=int, default=3000)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--fresh", action="store_true")
    options = parser.parse_args()
    command = f"python benchmarks/montecarlo_derivatives.py --photons {options.photons:g} --seed {options.seed}"
    header = provenance(command, options.seed, int(options.photons))
    base: dict[str, mc.Result] = {}
    jobs = []
    for index, (parameter, layer) in enumerate((p, layer) for p in COEFFICIENTS for layer in (0, 1)):
        seed = options.seed + 10 * (index + 1)
        label = f"d/d{parameter} of layer {layer}"
        jobs.append((label, functools.partial(entry, base, parameter, layer, options.photons, seed)))
    table = collect("derivatives", header, jobs, options.out, options.fresh)["results"]
    bad = [label for label, found in table.items() if found["verdict"] == "disagree"]
    fail_on(None if not bad else ", ".join(bad))
    wide = max(found["noticeable_best"] for found in table.values())
    fail_on(None if wide <= 0.05 else f"the differences are too noisy to tell: {wide:.2f}")


if __name__ == "__main__":
    main()
