"""1,000 different two-layer profiles, five numbers each, 1 % noise: fits a second with covariance on two cores, and whether any is worse than alone.

python benchmarks/many_fits.py [sets] [how many of them are fitted alone]
"""

import os

os.sched_setaffinity(0, {0, 1})

import sys
import time

import numpy as np
from record import record

import layerfit as lf
from layerfit.inference.batch import Batch

TRUTH = {"top.sigma_a": 0.01, "top.sigma_s_prime": 1.0, "top.thickness": 1.0, "deep.sigma_a": 0.02, "deep.sigma_s_prime": 1.5}
BOUNDS = {name: (1e-4, 1.0) if "sigma_a" in name else (0.1, 20.0) if "sigma_s" in name else (0.1, 10.0) for name in TRUTH}
STACK = lf.Layer("top", sigma_a=0.01, sigma_s_prime=1.0, n=1.4, thickness=1.0) | lf.HalfSpace("deep", sigma_a=0.02, sigma_s_prime=1.5, n=1.4)
GEOMETRY = lf.RadialReflectance(r=np.linspace(0.5, 15.0, 40))
NOISE = 0.01


def problem(values, sd):
    return lf.Problem(STACK, lf.Dataset(GEOMETRY, values, sd), free=BOUNDS, solver=lf.LayeredDiffusion())


def main():
    sets, alone = (int(sys.argv[i]) if len(sys.argv) > i else default for i, default in ((1, 1000), (2, 100)))
    rng = np.random.default_rng(0)
    truth = np.array(list(TRUTH.values())) * np.exp(rng.uniform(-0.7, 0.7, (sets, 5)))  # a factor of 2 up and down
    clean = Batch(problem(np.ones(40), np.ones(40)), "this benchmark").exact(truth)
    sd = NOISE * clean
    values = clean * (1.0 + NOISE * rng.standard_normal(clean.shape))
    stated = problem(values[0], sd[0])
    rows = []
    fits = [lf.fit(problem(values[i], sd[i])) for i in range(alone)]
    chi2 = np.array([fit.chi2 for fit in fits])
    results = {}
    for starts in (1, 2, 5, 8):
        began = time.perf_counter()
        lf.fit_many(stated, values, sd, starts=starts)
        first = time.perf_counter() - began
        results[starts] = (first, min((lf.fit_many(stated, values, sd, starts=starts) for _ in range(3)), key=lambda result: result.seconds))
    patient = lf.fit_many(stated, values, sd, starts=10)
    least = np.min([patient.chi2, *(many.chi2 for _, many in results.values())], axis=0)
    least[:alone] = np.minimum(least[:alone], chi2)  # the best that is known of each
    for starts, (first, many) in results.items():
        gap = many.chi2[:alone] - chi2
        rows.append(
            {
                "starts": starts,
                "sets": sets,
                "fits_per_second": sets / many.seconds,
                "first_s": first,
                "converged": int(np.sum(many.converged)),
                "fitted_alone": alone,
                "alone_ms": 1e3 * float(np.median([fit.seconds for fit in fits])),
                "sets_worse_than_alone_by_0.01": int(np.sum(gap > 0.01)),
                "sets_better_by_0.01": int(np.sum(gap < -0.01)),
                "worst_above_best_known": float(np.max((many.chi2 - least)[:alone])),
                "worst_alone_above_best_known": float(np.max(chi2 - least[:alone])),
                "above_best_known_by_0.01": int(np.sum((many.chi2 - least)[:alone] > 0.01)),
                "alone_above_best_known_by_0.01": int(np.sum(chi2 - least[:alone] > 0.01)),
                "worst_of_all_above_best_known": float(np.max(many.chi2 - least)),
            }
        )
        print(rows[-1], flush=True)
    record("many_fits", rows)


if __name__ == "__main__":
    main()
