"""A rough interface alone: ``python benchmarks/montecarlo_interface.py [--photons 1e6] [--seed 2000]``.

Five roughnesses, five angles, from both sides of an interface between 1 and 1.4: hemispherical reflection and transmission, whose sum must
be 1 to 1e-12; the same with a roughness of 1e-3 against Fresnel; and reciprocity between five bins of the polar angle on each side:
radiance r_ij out of bin j for light in bin i, with n^2 r_ij symmetric. Stores tests/reference/montecarlo/interface.json.
"""

from __future__ import annotations

import argparse
import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
from montecarlo_cases import collect, fail_on, provenance
from scipy import stats

import layerfit.montecarlo as mc

ROUGHNESS = (0.05, 0.1, 0.2, 0.4, 0.8)
DEGREES = (0.0, 30.0, 50.0, 70.0, 85.0)
BINS = (0.0, 20.0, 40.0, 55.0, 70.0, 90.0)
SIDES = {"from 1 to 1.4": (1.0, 1.4), "from 1.4 to 1": (1.4, 1.0)}


def interface(n_above: float, n_below: float, roughness: float) -> mc.Medium:
    """Nothing but an interface."""
    return mc.Medium([], n_above=n_above, n_below=n_below, roughness=roughness)


def fresnel(n_in: float, n_out: float, cosine: float) -> float:
    """Unpolarised reflectance, by sines and tangents of the angles: not the form that the walk uses."""
    angle = math.acos(cosine)
    if n_in * math.sin(angle) >= n_out:
        return 1.0
    if angle < 1e-6:
        return ((n_in - n_out) / (n_in + n_out)) ** 2
    other = math.asin(n_in * math.sin(angle) / n_out)
    s = math.sin(angle - other) / math.sin(angle + other)
    p = math.tan(angle - other) / math.tan(angle + other)
    return 0.5 * (s * s + p * p)


def totals(roughness: float, side: str, degrees: float, photons: float, seed: int) -> dict[str, Any]:
    """Reflection and transmission for one direction of incidence."""
    cosine = math.cos(math.radians(degrees))
    result = mc.simulate(interface(*SIDES[side], roughness), mc.Pencil(cosine), photons=photons, seed=seed, threads=1)
    reflected, error = float(result.value("R_specular")), float(result.standard_error("R_specular"))
    return {
        "R": reflected,
        "T": float(result.value("T")),
        "standard_error": error,
        "smooth": fresnel(*SIDES[side], cosine),
        "balance": float(np.abs(result.balance).max()),
    }


def reciprocity(roughness: float, photons: float, seed: int) -> dict[str, Any]:
    """Scores of n^2 r_ij - n^2 r_ji over all pairs of bins on either side, and across."""
    tallies = mc.Tallies(theta=BINS)
    count = len(BINS) - 1
    value, error = np.empty((2 * count, 2 * count)), np.empty((2 * count, 2 * count))
    for side, (n_in, n_out) in enumerate(SIDES.values()):
        for place in range(count):
            light = mc.Lambertian(theta=BINS[place : place + 2])
            result = mc.simulate(
                interface(n_in, n_out, roughness),
                light,
                tallies,
                photons=photons,
                seed=seed + 10 * side + place,
                threads=1,
            )
            row = side * count + place
            near, far = (result.estimate(name) for name in ("R_specular_angle", "T_angle"))
            halves = (near, far) if side == 0 else (far, near)
            value[row] = np.concatenate([half.value.ravel() for half in halves]) * n_in**2
            error[row] = np.concatenate([half.standard_error.ravel() for half in halves]) * n_in**2
    upper = np.triu_indices(2 * count, 1)
    one = mc.Estimate(value[upper], error[upper], 99)
    other = mc.Estimate(value.T[upper], error.T[upper], 99)
    comparison = mc.compare(one, other, limit=0.05)
    judged = comparison.score[comparison.judged]
    return {
        "verdict": comparison.verdict,
        "pairs": int(judged.size),
        "largest": float(np.abs(judged).max()),
        "mean": float(judged.mean()),
        "sd": float(judged.std(ddof=1)),
        "p_family": comparison.p_family,
        "p_spread": float(stats.chi2.sf(float(np.sum(judged**2)), judged.size)),
        "noticeable_common": comparison.noticeable_common,
    }


def main() -> None:
    """Run, store, print, and fail where a sum, a limit or a pair is off."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photons", type=float, default=1e6)
    parser.add_argument("--seed", type=int, default=2000)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--fresh", action="store_true")
    options = parser.parse_args()
    command = f"python benchmarks/montecarlo_interface.py --photons {options.photons:g} --seed {options.seed}"
    header = provenance(command, options.seed, int(options.photons))
    jobs = []
    for index, roughness in enumerate((*ROUGHNESS, 1e-3)):
        for side in SIDES:
            for degrees in DEGREES:
                seed = options.seed + 100 * index + len(jobs)
                label = f"{roughness:g} {side} {degrees:g} degrees"
                jobs.append((label, functools.partial(totals, roughness, side, degrees, options.photons, seed)))
        if roughness in ROUGHNESS:
            seed = options.seed + 1000 + 100 * index
            jobs.append((f"{roughness:g} reciprocity", functools.partial(reciprocity, roughness, options.photons, seed)))
    table = collect("interface", header, jobs, options.out, options.fresh)["results"]
    balance = max(entry["balance"] for entry in table.values() if "balance" in entry)
    limits = [entry for label, entry in table.items() if label.startswith("0.001 ")]
    # the error of a fraction near 0 or 1 is not known from so few events; the change with roughness is of second order
    z = [abs(e["R"] - e["smooth"]) / (max(e["standard_error"], 1.0 / options.photons) + 1e-5) for e in limits]
    print(f"balance {balance:.1e}; roughness 0.001 against Fresnel: largest score {max(z):.2f}")
    fail_on(None if balance <= 1e-12 else f"balance {balance}")
    fail_on(None if max(z) <= 3.5 else f"limit of small roughness, score {max(z)}")
    bad = [label for label, entry in table.items() if entry.get("verdict", "agree") != "agree"]
    fail_on(None if not bad else ", ".join(bad))


if __name__ == "__main__":
    main()
