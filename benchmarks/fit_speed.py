"""A five-parameter two-layer fit, warm, against SciPy's least_squares with differences on the same forward model: time beside error, one core.

python benchmarks/fit_speed.py
"""

import os

os.sched_setaffinity(0, {0})

import time

import jax
import jax.numpy as jnp
import numpy as np
from record import record
from scipy.optimize import least_squares

import layerfit as lf

TRUTH = {"top.sigma_a": 0.01, "top.sigma_s_prime": 1.0, "top.thickness": 1.0, "deep.sigma_a": 0.02, "deep.sigma_s_prime": 1.5}
BOUNDS = {name: (1e-4, 1.0) if "sigma_a" in name else (0.1, 20.0) if "sigma_s" in name else (0.1, 10.0) for name in TRUTH}
STACK = lf.Layer("top", sigma_a=0.01, sigma_s_prime=1.0, n=1.4, thickness=1.0) | lf.HalfSpace("deep", sigma_a=0.02, sigma_s_prime=1.5, n=1.4)
GEOMETRY = lf.RadialReflectance(r=np.linspace(0.5, 15.0, 40))


def main():
    solver = lf.LayeredDiffusion()
    clean = lf.predict(STACK, GEOMETRY, solver=solver)[0].values
    data = lf.Dataset(GEOMETRY, clean, noise=lf.Noise(relative=0.01))
    rng = np.random.default_rng(1)
    guesses = [{name: float(value * np.exp(rng.uniform(-0.35, 0.35))) for name, value in TRUTH.items()} for _ in range(12)]

    def problem(guess):
        return lf.Problem(STACK, data, free={n: {"min": BOUNDS[n][0], "max": BOUNDS[n][1], "init": v} for n, v in guess.items()}, solver=solver)

    began = time.perf_counter()
    lf.fit(problem(guesses[0]), starts=1)
    first = time.perf_counter() - began
    rows = []
    truth = np.array(list(TRUTH.values()))
    for what, starts in (("layerfit, one start 30 % off", 1), ("layerfit, default starts", 8)):
        seconds, errors, problems = [], [], [problem(g) for g in guesses]
        for stated in problems:
            began = time.perf_counter()
            result = lf.fit(stated, starts=starts)
            seconds.append(time.perf_counter() - began)
            errors.append(float(np.max(np.abs(result.x / truth - 1))))
        rows.append(
            {
                "what": what,
                "ms": 1e3 * float(np.median(seconds)),
                "ms_least": 1e3 * min(seconds),
                "first_s": first,
                "truth_to_1e-6": int(np.sum(np.array(errors) <= 1e-6)),
            }
        )
    stated = problem(guesses[0])
    predict = jax.jit(lambda x: stated.model.predict(x))
    seconds, errors = [], []
    for guess in guesses[:4]:
        began = time.perf_counter()
        found = least_squares(lambda u: np.log(np.asarray(predict(jnp.exp(u))[0]) / clean) / 0.01, np.log(list(guess.values())), method="lm")
        seconds.append(time.perf_counter() - began)
        errors.append(float(np.max(np.abs(np.exp(found.x) / truth - 1))))
    rows.append(
        {
            "what": "SciPy least_squares, differences, same jitted model",
            "ms": 1e3 * float(np.median(seconds)),
            "first_s": 0.0,
            "truth_to_1e-6": int(np.sum(np.array(errors) <= 1e-6)),
        }
    )
    print("| what | time of a fit, warm [ms] | first, compilation included [s] | truth to 1e-6 |\n|---|---|---|---|")
    for row, count in zip(rows, (12, 12, 4), strict=True):
        print(f"| {row['what']} | {row['ms']:.1f} | {row['first_s']:.1f} | {row['truth_to_1e-6']} of {count} |")
    record("fit_speed", rows)


if __name__ == "__main__":
    main()
