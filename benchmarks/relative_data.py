"""Relative two-layer profiles, the amplitude free beside five numbers: is any number that a fit states without a warning wrong?

python benchmarks/relative_data.py [draws]
"""

import sys

import numpy as np
from record import record

import layerfit as lf

TRUTHS = {
    "thin over deep": {"top.sigma_a": 0.01, "top.sigma_s_prime": 1.0, "top.thickness": 1.5, "deep.sigma_a": 0.02, "deep.sigma_s_prime": 1.5},
    "thick over dark": {"top.sigma_a": 0.005, "top.sigma_s_prime": 1.2, "top.thickness": 4.0, "deep.sigma_a": 0.05, "deep.sigma_s_prime": 0.8},
}
BOUNDS = {"sigma_a": (1e-4, 1.0), "sigma_s_prime": (0.1, 20.0), "thickness": (0.1, 20.0)}
GEOMETRY = lf.RadialReflectance(r=np.geomspace(1.0, 20.0, 30))
STACK = lf.Layer("top", sigma_a=0.01, sigma_s_prime=1.0, n=1.4, thickness=2.0) | lf.HalfSpace("deep", sigma_a=0.01, sigma_s_prime=1.0, n=1.4)


def draws(truth, solver, noise, count, seed=0):
    """One row a draw: the warnings, and for each number its name, standardised error and whether a warning names it."""
    clean = lf.predict(STACK.set(truth), GEOMETRY, solver=solver)[0].values
    free = {name: BOUNDS[name.split(".")[1]] for name in truth} | {"probe.amplitude": {"min": 0.1, "max": 10.0, "scale": "log"}}
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(count):
        values = 1.3 * clean * (1.0 + noise * rng.standard_normal(clean.size))
        result = lf.fit(lf.Problem(STACK, lf.Dataset(GEOMETRY, values, noise=lf.Noise(relative=noise), name="probe"), free=free, solver=solver))
        named = {name: any(name in warning or warning.startswith("ill-posed") for warning in result.warnings) for name in result.parameters}
        target = {**truth, "probe.amplitude": 1.3}
        z = {name: None if p.stderr is None else (p.value - target[name]) / p.stderr for name, p in result.parameters.items()}
        rows.append(
            {
                "z": z,
                "named": named,
                "ill-posed": any(w.startswith("ill-posed") for w in result.warnings),
                "says open": any("open" in w for w in result.warnings),
                "chi2": result.chi2,
            }
        )
    return rows


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    table = []
    for name, truth in TRUTHS.items():
        for solver in (lf.LayeredDiffusion(), lf.Multipole()):
            for noise in (0.01, 0.02):
                rows = draws(truth, solver, noise, count)
                silent = [abs(z) for row in rows for number, z in row["z"].items() if z is not None and not row["named"][number]]
                table.append(
                    {
                        "scene": name,
                        "solver": solver.name,
                        "noise": noise,
                        "draws": count,
                        "says_ill_posed": sum(row["ill-posed"] for row in rows),
                        "says_open": sum(row["says open"] for row in rows),
                        "numbers_without_warning": len(silent),
                        "largest_error_without_warning": max(silent, default=0.0),
                        "largest_error": max(abs(z) for row in rows for z in row["z"].values() if z is not None),
                    }
                )
                print(table[-1], flush=True)
    record("relative_data", table)


if __name__ == "__main__":
    main()
