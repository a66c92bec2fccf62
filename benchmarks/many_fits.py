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
    for starts in (1, 2, 8):
        began = time.perf_counter()
        lf.fit_many(stated, values, sd, starts=starts)
        first = time.perf_counter() - began
        warm = [lf.fit_many(stated, values, sd, starts=starts) for _ in range(3)]
        many = min(warm, key=lambda result: result.seconds)
        fits = [lf.fit(problem(values[i], sd[i]), starts=starts) for i in range(alone)]
        gap = many.chi2[:alone] - np.array([fit.chi2 for fit in fits])
        rows.append(
            {
                "starts": starts,
                "sets": sets,
                "fits_per_second": sets / many.seconds,
                "first_s": first,
                "converged": int(np.sum(many.converged)),
                "fitted_alone": alone,
                "alone_ms": 1e3 * float(np.median([fit.seconds for fit in fits])),
                "chi2_worse_than_alone_by": float(np.max(gap)),
                "sets_worse_by_0.01": int(np.sum(gap > 0.01)),
                "sets_better_by_0.01": int(np.sum(gap < -0.01)),
            }
        )
        print(rows[-1], flush=True)
    record("many_fits", rows)


if __name__ == "__main__":
    main()
