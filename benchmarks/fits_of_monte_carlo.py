"""What comes back from Monte Carlo profiles whose truth is known, by each diffusion solver; writes docs/fits-of-monte-carlo.md.

    python benchmarks/fits_of_monte_carlo.py

The data are the ring averages of the cases in tests/reference/cases beyond one transport mean free path of the first layer (where their own
standard error is below 5 %), thinned to about 25, with their standard error and 2 % added in quadrature for calibration. No noise was added: a
difference from the truth that is larger than the standard error is the solver's bias. Fits start a factor of 1.5 to 2 away.
"""

import sys
import time
from pathlib import Path

import numpy as np
from record import record

import layerfit as lf

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from cases import load

SOLVERS = {
    "layered-diffusion": lf.LayeredDiffusion(),
    "layered-diffusion, textbook": lf.LayeredDiffusion(source="point", boundary="extrapolated", diffusion="transport"),
    "multipole": lf.Multipole(),
    "dipole": lf.Dipole(),
}
CASES = {
    "si_n14_g08_a0980": ("half space", ("sigma_a", "sigma_s_prime")),
    "slab_n14_g08_5mfp": ("slab, R(r) and T(r)", ("sigma_a", "sigma_s_prime", "thickness")),
    "two_thin_low_over_thick_high": ("two layers, the upper one 0.1 mfp' thin", ("sigma_a", "sigma_s_prime", "thickness")),
    "skin_over_fat": ("skin over fat", ("sigma_a", "sigma_s_prime", "thickness")),
}
SPAN = {"sigma_a": 20.0, "sigma_s_prime": 5.0, "thickness": 4.0}


def thinned(case, values, se):
    low, high = case.rings
    chosen = np.flatnonzero((0.5 * (low + high) >= case.mfp) & (se < 0.05 * values) & (values > 0))
    chosen = chosen[np.unique(np.round(np.geomspace(1, len(chosen), 25)).astype(int) - 1)]
    return low[chosen], high[chosen], values[chosen], np.hypot(se[chosen], 0.02 * values[chosen])


def fitted(case, names, solver):
    """The fit of all profiles, and the truth by name."""
    kinds = [(lf.RadialReflectance, case.R, case.R_se, "R")]
    kinds += [] if case.stack.half_space else [(lf.RadialTransmittance, case.T, case.T_se, "T")]
    data = []
    for kind, values, se, name in kinds:
        low, high, value, sd = thinned(case, values, se)
        data.append(lf.Dataset(kind(r_min=low, r_max=high), value, sd, name=name))
    problem, truth = posed(case, names, solver, data)
    return lf.fit(problem), truth


def posed(case, names, solver, data):
    """The problem with these kinds of numbers free, and the truth by name."""
    guess = lf.Stack(  # written with sigma_s_prime, so that it can be free
        [
            lf.HalfSpace(x.name, sigma_a=x.sigma_a, sigma_s_prime=x.sigma_s_prime, g=x.g, n=x.n)
            if isinstance(x, lf.HalfSpace)
            else lf.Layer(x.name, sigma_a=x.sigma_a, sigma_s_prime=x.sigma_s_prime, g=x.g, n=x.n, thickness=x.thickness)
            for x in case.stack.layers
        ],
        n_above=case.stack.n_above,
        n_below=case.stack.n_below,
    )
    truth = {f"{x.name}.{n}": float(getattr(x, n)) for x in guess.layers for n in names if not (n == "thickness" and isinstance(x, lf.HalfSpace))}
    free = {}
    for i, (name, value) in enumerate(truth.items()):
        span = SPAN[name.rsplit(".", 1)[1]]
        low = value / span
        if name.endswith("thickness") and solver.name == "multipole":  # whose layers are at least one mean free path thick
            low = max(low, 1.05 / (0.5 * float(guess.get(name.replace("thickness", "sigma_s_prime")))))
        init = value * (1.6 if i % 2 else 0.6)
        free[name] = {"min": low, "max": value * span, "init": max(init, low)}
    return lf.Problem(guess, data, free=free, solver=solver), truth


def text(estimate):
    if estimate.stderr is None:
        return f"{estimate.value:.3g} (bound)" if estimate.at_bound else f"{estimate.value:.3g}"
    return f"{estimate.value:.3g} ± {estimate.stderr:.1g}"


def main():
    lines = [
        "# What comes back from Monte Carlo data",
        "",
        *__doc__.split("\n\n")[0].split("; ")[:1],
        "",
        " ".join(__doc__.split("\n\n")[2].split()),
        "",
    ]
    rows = []
    for name, (title, free) in CASES.items():
        case = load(name)
        table: dict[str, list[str]] = {}
        heads, foot = ["number", "truth"], ["reduced chi-square", ""]
        for label, solver in SOLVERS.items():
            if (solver.name == "dipole" and len(case.stack.layers) > 1) or (solver.name == "dipole" and not case.stack.half_space):
                continue
            began = time.perf_counter()
            try:
                result, truth = fitted(case, free, solver)
            except lf.InputError:
                continue  # outside the solver's range
            heads.append(label)
            foot.append(f"{result.chi2_reduced:.2g}")
            for key, estimate in result.parameters.items():
                table.setdefault(key, [f"{truth[key]:.4g}"]).append(f"{text(estimate)} ({100 * (estimate.value / truth[key] - 1):+.0f} %)")
                rows.append({"case": name, "solver": label, "number": key, "truth": truth[key], "value": estimate.value, "stderr": estimate.stderr})
            print(f"{title}, {label}: {time.perf_counter() - began:.1f} s, chi2 {result.chi2_reduced:.3g}, {result.warnings}", flush=True)
        lines += [f"## {title} ({name})", "", "| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
        lines += [f"| {key} | " + " | ".join(cells) + " |" for key, cells in table.items()]
        lines += ["| " + " | ".join(foot) + " |", ""]
    path = ROOT / "docs" / "fits-of-monte-carlo.md"
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join(lines).rstrip() + "\n")
    record("fits_of_monte_carlo", rows)
    print("\n".join(lines))


if __name__ == "__main__":
    main()
