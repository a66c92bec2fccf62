"""The error of every diffusion solver and variant against Monte Carlo, case by case; writes docs/diffusion-errors.md.

    python benchmarks/diffusion_errors.py             # all variants, a quarter of an hour
    python benchmarks/diffusion_errors.py default     # those whose name holds the word

Signed relative errors of R(r): median over the rings of a band of r (in transport mean free paths of the first layer) whose own standard
error is below 5 %. Totals without the first-surface reflection. "median" is over all rings beyond 2 mfp' of the cases in which diffusion
claims to hold: layers of 2 mfp' or more, sigma_s'/sigma_a of 10 or more.
"""

import os
import sys
from pathlib import Path

# nearly all the time is compilation, for each case and variant anew
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false --xla_backend_optimization_level=0")

import jax
import numpy as np

import layerfit as lf

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from cases import cases

BANDS = ((0.1, 0.5), (0.5, 1), (1, 2), (2, 4), (4, 8), (8, 16), (16, np.inf))

VARIANTS = {
    "layered-diffusion (default)": lf.LayeredDiffusion(),
    **{
        f"source {source}, boundary {boundary}, D {diffusion}": lf.LayeredDiffusion(source=source, boundary=boundary, diffusion=diffusion)
        for source in ("mixed", "point", "exponential")
        for boundary in ("averaged", "extrapolated", "partial_current")
        for diffusion in ("asymptotic", "transport", "grosjean", "scattering")
        if (source, boundary, diffusion) != ("mixed", "averaged", "asymptotic")
    },
    "multipole": lf.Multipole(),
    "multipole, exponential": lf.Multipole(source="exponential"),
    "multipole, as published": lf.Multipole(reflection="egan-hilgeman"),
}
SHOWN = (
    "layered-diffusion (default)",
    "source mixed, boundary extrapolated, D asymptotic",
    "source mixed, boundary partial_current, D asymptotic",
    "source point, boundary extrapolated, D transport",
    "source exponential, boundary extrapolated, D transport",
    "source exponential, boundary partial_current, D transport",
    "multipole",
    "multipole, exponential",
    "multipole, as published",
)


def errors(solver, case):
    """Signed errors of the rings, R, T; None where the solver refuses the case."""
    low, high = case.rings
    geometries = [lf.RadialReflectance(r_min=low, r_max=high), lf.TotalReflectance()]
    geometries += [] if case.stack.half_space else [lf.TotalTransmittance()]
    try:
        found = lf.predict(case.stack, geometries, solver=solver)
    except lf.InputError:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        profile = found[0].values / case.R - 1
    R = found[1].values[0] - case.totals["R_diffuse"]["value"]
    T = found[2].values[0] - case.totals["T_total"]["value"] if len(found) > 2 else np.nan
    return profile, R, T


def chosen(case, start, end):
    low, high = case.rings
    r = 0.5 * (low + high) / case.mfp
    return (r >= start) & (r < end) & (case.R_se < 0.05 * case.R)


def percent(values):
    return f"{100 * np.median(values):+.1f}" if values.size else ""


def main():
    wanted = {name: solver for name, solver in VARIANTS.items() if all(word in name for word in sys.argv[1:])}
    rows = {}
    for i, (name, solver) in enumerate(wanted.items(), 1):
        rows[name] = {case.name: errors(solver, case) for case in cases()}
        jax.clear_caches()  # compiled programs hold memory maps, of which a process may have 65,000
        print(f"{i} of {len(wanted)}: {name}", file=sys.stderr, flush=True)
    lines = ["# Errors of the diffusion solvers", "", *(__doc__.split("\n\n")[0].split("; ")[0] + ".",), ""]
    lines += ["Made by `python benchmarks/diffusion_errors.py`. " + " ".join(__doc__.split("\n\n")[2].split()), ""]
    lines += [
        "## All variants",
        "",
        "| variant | median of abs. error [%] | worst case's median [%] | all other cases, median [%] |",
        "|---|---|---|---|",
    ]
    summary = []
    for name, found in rows.items():
        inside, outside, medians = [], [], []
        for case in cases():
            if found[case.name] is None:
                continue
            far = np.abs(found[case.name][0][chosen(case, 2, np.inf)])
            if case.diffusive:
                inside.append(far)
                medians.append(np.median(far))
            else:
                outside.append(far)
        summary.append((np.median(np.concatenate(inside)), max(medians), np.median(np.concatenate(outside)), name))
    for inside, worst, outside, name in sorted(summary):
        lines.append(f"| {name} | {100 * inside:.1f} | {100 * worst:.1f} | {100 * outside:.0f} |")
    for case in cases():
        layers = "; ".join(repr(layer) for layer in case.stack.layers)
        lines += ["", f"## {case.name}{'' if case.diffusive else ' (outside the range of diffusion)'}", "", f"`{layers}`", ""]
        lines += ["Errors of R(r) [%] by r/mfp', and of totals [percentage points].", ""]
        lines += ["| variant | " + " | ".join(f"{a:g} to {b:g}" for a, b in BANDS) + " | R | T |", "|---" * (len(BANDS) + 3) + "|"]
        for name in (name for name in SHOWN if name in rows):
            found = rows[name][case.name]
            if found is None:
                lines.append(f"| {name} | refused: outside its range" + " | " * (len(BANDS) + 2) + "|")
                continue
            bands = " | ".join(percent(found[0][chosen(case, a, b)]) for a, b in BANDS)
            T = "" if np.isnan(found[2]) else f"{100 * found[2]:+.2f}"
            lines.append(f"| {name} | {bands} | {100 * found[1]:+.2f} | {T} |")
    path = ROOT / "docs" / "diffusion-errors.md"
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    print("\n".join(lines[:50]))
    print(f"written: {path}")


if __name__ == "__main__":
    main()
