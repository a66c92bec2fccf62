"""Speed against error on ten scenes, each solver against Monte Carlo (MCML) rings; writes docs/speed-vs-error.md and its figure.

    python benchmarks/speed_vs_error.py                # a quarter of an hour
    python benchmarks/speed_vs_error.py skin           # scenes whose name holds the word, nothing written

R(r) in the case file's own rings from half a transport mean free path of the first layer on whose standard error is below 5 %. Error: median of the
relative deviations, in which the Monte Carlo's own noise is contained. Time: a warm prediction, median of five. MCML at equal error: the CPU
seconds of the reference run, scaled by the square of the ratio of its median standard error to the solver's error; and, in brackets, to the larger
of that and what the solver states, which is what a user knows without a reference.
"""

import json
import sys
from pathlib import Path

import jax
import numpy as np
from matplotlib.figure import Figure
from record import record

import layerfit as lf
from layerfit.comparison import timed_run

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from cases import FOLDER, TEN_KINDS, load

TOLERANCES = (0.05, 0.01, 0.005)
BETWEEN = lf.DiscreteOrdinates(streams=16, orders=4, frequencies=32)  # no rung of Auto's, a setting that a user may choose
TEXT = (
    "Rungs: 0 layered-diffusion, 1 to 3 discrete ordinates from coarse to fine. Judged by the rings whose standard error is below 2 %: met where no",
    "ring is off by more than the tolerance and three standard errors. Where no rung is good enough Auto takes the best there is, and says so.",
    "16 streams, 4 orders, 32 frequencies are no rung but a setting that one may choose, between 1 and 2.",
)


def rows_of(name):
    """Solvers' speed and error on a scene, and the rung that Auto takes beside the cheapest that would have done."""
    case = load(name)
    low, high = case.rings
    use = (np.sqrt(0.5 * (low**2 + high**2)) >= 0.5 * case.mfp) & (case.R > 0.0) & (case.R_se < 0.05 * case.R)
    reference, se = case.R[use], case.R_se[use]
    geometry = lf.RadialReflectance(r_min=low[use], r_max=high[use])
    seconds = json.loads((FOLDER / f"{name}.json").read_text())["cpu_seconds"]
    noise = float(np.median(se / reference))
    rows, beyond = [], {}
    for solver in (lf.Dipole(), lf.Multipole(), *lf.Auto.ladder(), BETWEEN):
        if solver.refusal(case.stack, [geometry]) is not None:
            continue
        run = timed_run(solver, case.stack, [geometry])
        deviation = np.abs(run.values / reference - 1.0)
        beyond[solver] = float(np.max((deviation - 3.0 * se / reference)[se < 0.02 * reference]))
        error = float(np.median(deviation))
        stated = None if run.stated is None else float(np.median(run.stated / reference))
        rows.append({"solver": solver.label, "first_s": run.first, "warm_ms": 1e3 * run.warm, "error": error, "stated": stated})
        rows[-1] |= {"mcml_s": seconds * (noise / error) ** 2, "mcml_stated_s": seconds * (noise / max(error, stated or 0.0)) ** 2}
    auto = []
    for tolerance in TOLERANCES:
        choice = lf.Auto(tolerance=tolerance).choose(case.stack, [geometry])
        would_do = [rung for rung, solver in enumerate(lf.Auto.ladder()) if beyond.get(solver, np.inf) <= tolerance]
        auto.append({"tolerance": tolerance, "rung": choice.rung, "cheapest": min(would_do, default=None), "beyond": beyond[choice.solver]})
    jax.clear_caches()
    return {"noise": noise, "rows": rows, "auto": auto}


def figure(found):
    drawn = Figure(figsize=(7.2, 4.6), layout="constrained")
    axis = drawn.subplots()
    for colour, solver in zip(
        ("#999999", "#b8860b", "#2e7d32", "#5b8fc7", "#1f4e79"),
        ("dipole", "multipole", "layered-diffusion", "12 streams", "discrete-ordinates"),
        strict=True,
    ):
        rows = [
            row
            for scene in found.values()
            for row in scene["rows"]
            if solver in row["solver"] and ("12 streams" in row["solver"]) == ("12" in solver)
        ]
        axis.plot([row["warm_ms"] for row in rows], [100 * row["error"] for row in rows], "o", ms=5, color=colour, label=solver)
    axis.axhline(
        100 * np.median([scene["noise"] for scene in found.values()]), color="#999999", ls="--", lw=0.8, label="noise of the reference (median)"
    )
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xlabel("one prediction, warm [ms]")
    axis.set_ylabel("median deviation from Monte Carlo [%]")
    axis.grid(alpha=0.25)
    axis.legend(frameon=False, fontsize="small")
    return drawn


def main():
    names = [name for name in TEN_KINDS if all(word in name for word in sys.argv[1:])]
    found = {}
    lines = ["# Speed against error", "", *__doc__.strip().split("\n\n")[2].splitlines(), ""]
    lines += ["![](speed-vs-error.svg)", "", "Made by `python benchmarks/speed_vs_error.py`.", ""]
    lines += ["| scene | solver | first [s] | warm [ms] | error [%] | stated [%] | MCML at equal error [s] | times faster |", "|---" * 8 + "|"]
    for name in names:
        found[name] = rows_of(name)
        for row in found[name]["rows"]:
            stated = "" if row["stated"] is None else f"{100 * row['stated']:.2g}"
            numbers = (f"{row['first_s']:.1f}", f"{row['warm_ms']:.3g}", f"{100 * row['error']:.2g}", stated, f"{row['mcml_s']:.3g}")
            faster, known = (1e3 * row[key] / row["warm_ms"] for key in ("mcml_s", "mcml_stated_s"))
            lines.append(f"| {name} | {row['solver']} | {' | '.join(numbers)} | {faster:,.0f} ({known:,.0f}) |")
            print(lines[-1], flush=True)
    lines += ["", "## What Auto takes", "", *TEXT, ""]
    lines += ["| scene | tolerance [%] | rung taken | cheapest that would have done | largest error beyond 3 se [%] | met |", "|---" * 6 + "|"]
    for name, scene in found.items():
        for one in scene["auto"]:
            cheapest, met = "none" if one["cheapest"] is None else one["cheapest"], "yes" if one["beyond"] <= one["tolerance"] else "no"
            lines.append(f"| {name} | {100 * one['tolerance']:g} | {one['rung']} | {cheapest} | {max(0.0, 100 * one['beyond']):.2g} | {met} |")
            print(lines[-1], flush=True)
    if len(sys.argv) > 1:
        return
    (ROOT / "docs" / "speed-vs-error.md").write_text("\n".join(lines) + "\n")
    figure(found).savefig(ROOT / "docs" / "speed-vs-error.svg", metadata={"Date": None})
    record("speed_vs_error", found)


if __name__ == "__main__":
    main()
