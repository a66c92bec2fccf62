"""Time of a posterior: two layers by layered diffusion with emcee, the same with NUTS, and by transport.

python benchmarks/posterior_speed.py [diffusion] [nuts] [transport]      all of them without a name; both cores of a quiet machine
"""

import sys
import time

import numpy as np
from record import FOLDER, record

import layerfit as lf

TRUTH = {"top.sigma_a": 0.01, "top.sigma_s_prime": 1.0, "top.thickness": 1.0, "deep.sigma_a": 0.02, "deep.sigma_s_prime": 1.5}
FREE = {name: (value / 5, value * 5) for name, value in TRUTH.items()}
STACK = lf.Layer("top", sigma_a=0.01, sigma_s_prime=1.0, n=1.4, g=0.8, thickness=1.0) | lf.HalfSpace(
    "deep", sigma_a=0.02, sigma_s_prime=1.5, n=1.4, g=0.8
)


def problem(solver, radii):
    geometry = lf.RadialReflectance(r=radii)
    clean = lf.predict(STACK, geometry, solver=solver)[0].values
    values = clean * (1 + 0.01 * np.random.default_rng(0).standard_normal(clean.size))
    return lf.Problem(STACK, lf.Dataset(geometry, values, noise=lf.Noise(relative=0.01)), free=FREE, solver=solver)


def timed(what, stated, fit, **options):
    """One row; the second of two runs is warm."""
    rows = []
    for _ in range(options.pop("runs", 2)):
        began = time.perf_counter()
        posterior = lf.sample(stated, fit, **options)
        rows.append(time.perf_counter() - began)
    table = posterior.table()
    ess = min(row["ess"] for row in table.values())
    row = {
        "what": what,
        "first_s": rows[0],
        "warm_s": rows[-1],
        "steps": posterior.steps,
        "outcome": posterior.outcome.value,
        "least_ess": ess,
        "warm_s_for_1000_independent": 1000 * rows[-1] / ess,
        "largest_tau": float(np.max(posterior.judgement.tau)),
        "divergent": posterior.judgement.divergent,
        "mean_and_sd": {name: [r["mean"], r["sd"]] for name, r in table.items()},
    }
    print({key: value for key, value in row.items() if key != "mean_and_sd"}, flush=True)
    return row


def diffusion():
    stated = problem(lf.LayeredDiffusion(), np.linspace(0.5, 15.0, 40))
    fit = lf.fit(stated)
    return [
        timed("emcee, 32 walkers x 2000 steps", stated, fit, walkers=32, steps=2000, effective=np.inf),
        timed("emcee, until converged", stated, fit, runs=1),
    ]


def nuts():
    stated = problem(lf.LayeredDiffusion(), np.linspace(0.5, 15.0, 40))
    return [timed("nuts, 4 chains x 1000 steps", stated, lf.fit(stated), sampler="nuts", steps=1000, runs=1)]


def transport():
    """Effective size 400 in at most 10 minutes is asked; emcee alone needs longer."""
    solver = lf.DiscreteOrdinates(streams=12, orders=4, frequencies=16)
    stated = problem(solver, np.geomspace(0.5, 15.0, 16))
    began = time.perf_counter()
    fit = lf.fit(stated, starts=1)
    print(f"fit by transport: {time.perf_counter() - began:.0f} s", flush=True)
    return [timed("transport through a surrogate, effective size 400", stated, fit, runs=1, sampler="surrogate", effective=400)]


def main():
    parts = {"diffusion": diffusion, "nuts": nuts, "transport": transport}
    asked = sys.argv[1:] or list(parts)
    kept = FOLDER / "posterior_speed.json"
    import json

    found = json.loads(kept.read_text()) if kept.exists() else {}
    for name in asked:
        found[name] = parts[name]()
        record("posterior_speed", found)
    if "diffusion" in found and "nuts" in found:
        ratio = found["diffusion"][1]["warm_s_for_1000_independent"] / found["nuts"][0]["warm_s_for_1000_independent"]
        print(f"time for the same effective size, emcee over nuts: {ratio:.2f}")


if __name__ == "__main__":
    main()
