"""The Monte Carlo against exact totals: ``python benchmarks/montecarlo_exact.py [--photons 1e7] [--seed 1] [--threads 1]``.

Stores tests/reference/montecarlo/exact.json. A file of the same settings is completed, not repeated; ``--fresh`` repeats.
"""

from __future__ import annotations

import argparse
import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
from montecarlo_cases import EXACT, Exact, collect, fail_on, provenance
from scipy import stats

import layerfit.montecarlo as mc


def run(case: Exact, photons: float, seed: int, threads: int | None = None) -> dict[str, Any]:
    """One case: value, error, z-score of each total, and the energy balance."""
    result = mc.simulate(case.medium, case.source, photons=photons, seed=seed, threads=threads)
    entry: dict[str, Any] = {"seed": seed, "photons": result.photons, "seconds": round(result.seconds, 2)}
    for name, expected in case.expected.items():
        value, error = float(result.value(name)), float(result.standard_error(name))
        entry[name] = {"exact": expected, "value": value, "standard_error": error, "z": (value - expected) / error}
    entry["balance"] = float(np.abs(result.balance).max())
    return entry


def scores(results: dict[str, Any]) -> np.ndarray:
    """All z-scores of a stored table."""
    return np.array([entry[name]["z"] for entry in results.values() for name in ("R", "T") if name in entry])


def summary(results: dict[str, Any]) -> dict[str, float]:
    """Mean and standard deviation of the scores, with their two-sided probabilities under N(0, 1).

    R and T of one slab share photons and are not independent; the probabilities therefore use R alone.
    """
    z = scores(results)
    alone = np.array([entry["R"]["z"] for entry in results.values()])
    tail = float(stats.chi2.cdf(float(np.sum(alone**2)), alone.size))
    return {
        "scores": z.size,
        "mean": float(z.mean()),
        "sd": float(z.std(ddof=1)),
        "largest": float(np.abs(z).max()),
        "R_scores": alone.size,
        "R_mean": float(alone.mean()),
        "R_sd": float(alone.std(ddof=1)),
        "p_mean": float(2.0 * stats.norm.sf(abs(alone.mean()) * math.sqrt(alone.size))),
        "p_spread": 2.0 * min(tail, 1.0 - tail),
        "balance": max(entry["balance"] for entry in results.values()),
    }


def main() -> None:
    """Run, store, print, and fail where a score is above 3 or the scores together are not those of N(0, 1)."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photons", type=float, default=1e7)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--fresh", action="store_true")
    options = parser.parse_args()
    command = f"python benchmarks/montecarlo_exact.py --photons {options.photons:g} --seed {options.seed}"
    header = provenance(command, options.seed, int(options.photons))
    # consecutive seeds, so that the scores are independent
    jobs = [(case.name, functools.partial(run, case, options.photons, options.seed + index, options.threads)) for index, case in enumerate(EXACT)]
    table = collect("exact", header, jobs, options.out, options.fresh)
    found = summary(table["results"])
    print(found)
    # 46 true scores exceed 3 somewhere with probability 0.12; that is asked for all the same
    fail_on(None if found["largest"] <= 3.0 else f"a z-score of {found['largest']:.2f}")
    fail_on(None if min(found["p_mean"], found["p_spread"]) >= 0.01 else "the scores are not those of N(0, 1)")


if __name__ == "__main__":
    main()
