"""Simulation-based calibration of two-layer posteriors: truths from the prior, data from truths, ranks of truths among draws are uniform.

S. Talts et al., arXiv:1804.06788 (2018). Uniform prior between the bounds, 0.5 % noise. Each set is kept when it is done,
and a run that was stopped goes on. The upper layer is thicker than the depth of the diffusion source: thinner ones give posteriors with several
narrow maxima, on which half of the chains end as "not converged", and say so.

python benchmarks/simulation_based_calibration.py [sets] [--fresh]
"""

import json
import sys
import time

import numpy as np
from record import FOLDER, record
from scipy.stats import chisquare

import layerfit as lf

SETS, RANKS, BINS, NOISE = 200, 99, 10, 0.005  # ranks 0 to 99
STACK = lf.Layer("top", sigma_a=0.02, sigma_s_prime=1.0, n=1.4, thickness=2.5) | lf.HalfSpace("deep", sigma_a=0.02, sigma_s_prime=1.5, n=1.4)
FREE = {
    "top.sigma_a": (0.005, 0.05),
    "top.sigma_s_prime": (0.6, 2.0),
    "top.thickness": (2.0, 4.0),
    "deep.sigma_a": (0.005, 0.05),
    "deep.sigma_s_prime": (0.6, 2.0),
}
GEOMETRY = lf.RadialReflectance(r=np.geomspace(0.8, 15.0, 20))
SOLVER = lf.LayeredDiffusion()


def one(number):
    """Ranks of the truth among RANKS draws far from one another, and how the sampling ended."""
    rng = np.random.default_rng([2024, number])
    truth = {name: float(rng.uniform(low, high)) for name, (low, high) in FREE.items()}
    clean = lf.predict(STACK.set(truth), GEOMETRY, solver=SOLVER)[0].values
    sd = NOISE * clean  # known, as the prior and the noise have to be the posterior's own
    data = lf.Dataset(GEOMETRY, clean + sd * rng.standard_normal(clean.size), sd)
    free = {name: {"min": low, "max": high, "scale": "linear"} for name, (low, high) in FREE.items()}
    stated = lf.Problem(STACK, data, free=free, solver=SOLVER)
    posterior = lf.sample(stated, lf.fit(stated, starts=2), walkers=32, steps=10_000, effective=200, seed=number)
    flat = posterior.x.reshape(-1, len(FREE))
    picked = flat[np.linspace(0, len(flat) - 1, RANKS).astype(int)]
    ranks = {name: int(np.sum(picked[:, i] < truth[name])) for i, name in enumerate(posterior.problem.names)}
    return {
        "ranks": ranks,
        "outcome": posterior.outcome.value,
        "steps": posterior.steps,
        "effective": float(np.min(posterior.judgement.effective)),
        "seconds": posterior.seconds,
    }


def verdict(rows):
    """p-value of uniform ranks for each number, and how often it did not converge."""
    p_values = {}
    for name in FREE:
        counts = np.bincount([row["ranks"][name] * BINS // (RANKS + 1) for row in rows], minlength=BINS)
        p_values[name] = float(chisquare(counts).pvalue)
    return p_values, sum(row["outcome"] != "converged" for row in rows)


def main():
    arguments = [a for a in sys.argv[1:] if a != "--fresh"]
    sets = int(arguments[0]) if arguments else SETS
    kept = FOLDER / "simulation_based_calibration.json"
    found = json.loads(kept.read_text()) if kept.exists() and "--fresh" not in sys.argv else {"sets": []}
    began = time.perf_counter()
    for number in range(len(found["sets"]), sets):
        found["sets"].append(one(number))
        record("simulation_based_calibration", found)
        print(number, found["sets"][-1]["outcome"], f"{time.perf_counter() - began:.0f} s", flush=True)
    found["p"], found["not_converged"] = verdict(found["sets"])
    record("simulation_based_calibration", found)
    for name, p in found["p"].items():
        print(f"{name}: p = {p:.3f}")
    print(f"{len(found['sets'])} sets, {found['not_converged']} of them not converged")


if __name__ == "__main__":
    main()
