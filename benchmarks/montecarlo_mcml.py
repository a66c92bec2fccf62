"""The Monte Carlo against MCML, ring by ring, and negative controls: ``python benchmarks/montecarlo_mcml.py [--seed 1000]``.

Stores tests/reference/montecarlo/mcml.json. Each case runs for as many photons as MCML did, at most ``--photons``. The family-wise
level of 1 % holds for all cases together: each of the m comparisons is made at 1 - 0.99^(1/m).
"""

from __future__ import annotations

import argparse
import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
from montecarlo_cases import collect, fail_on, judge, mcml, mcml_names, provenance
from scipy import stats

import layerfit.montecarlo as mc


def level(count: int) -> float:
    """Level of each of `count` comparisons for 1 % together (Sidak)."""
    return 1.0 - 0.99 ** (1.0 / count)


def report(comparison: mc.Comparison) -> dict[str, Any]:
    """What is stored of a comparison."""
    judged = comparison.score[comparison.judged]
    return {
        "verdict": comparison.verdict,
        "judged": int(comparison.judged.sum()),
        "bins": int(comparison.judged.size),
        "p_family": comparison.p_family,
        "p_centred": comparison.p_centred,
        "largest": float(np.abs(judged).max()) if judged.size else 0.0,
        "mean": float(judged.mean()) if judged.size else 0.0,
        "sd": float(judged.std(ddof=1)) if judged.size > 1 else math.nan,
        "noticeable_common": comparison.noticeable_common,
        "noticeable_median": float(np.nanmedian(comparison.noticeable)) if judged.size else math.inf,
    }


def run(name: str, most: float, seed: int, threads: int | None = None, each: float = level(22)) -> dict[str, Any]:
    """One case against its MCML profile, in three families: totals, rings, angles."""
    profile = mcml(name)
    result = mc.simulate(profile.medium, None, profile.tallies, photons=min(most, profile.photons), seed=seed, threads=threads)
    entry: dict[str, Any] = {"seed": seed, "photons": result.photons, "seconds": round(result.seconds, 2)}
    entry["mcml_photons"], entry["mcml_cpu_seconds"] = profile.photons, profile.cpu_seconds
    entry["balance"] = float(np.abs(result.balance).max())
    return entry | {family: report(comparison) for family, comparison in judge(result, profile, each).items()}


def main() -> None:
    """Run, store, print, and fail where a profile disagrees or could not have."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photons", type=float, default=2e7)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--fresh", action="store_true")
    options = parser.parse_args()
    names = mcml_names()
    fail_on(None if names else "the MCML cases are not there (../shared/reference/cases beside the repository)")
    command = f"python benchmarks/montecarlo_mcml.py --photons {options.photons:g} --seed {options.seed}"
    header = provenance(command, options.seed, int(options.photons))
    each = level(len(names))
    jobs = [(name, functools.partial(run, name, options.photons, options.seed + index, options.threads, each)) for index, name in enumerate(names)]
    table = collect("mcml", header, jobs, options.out, options.fresh)["results"]
    for family in ("rings", "angles", "totals"):
        p = np.array([entry[family]["p_family"] for entry in table.values()])
        uniform = stats.kstest(p, "uniform").pvalue
        print(f"{family}: {len(p)} cases, least family p {p.min():.3g}, below 1 %: {(p < 0.01).sum()}, uniform: p {uniform:.3g}")
    bad = [name for name, entry in table.items() if any(entry[f]["verdict"] != "agree" for f in ("rings", "angles", "totals"))]
    fail_on(None if not bad else ", ".join(bad))


if __name__ == "__main__":
    main()
