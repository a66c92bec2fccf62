"""What comes back from Monte Carlo profiles by transport theory and by diffusion; writes docs/recovery.md.

    python benchmarks/recovery.py                # a quarter of an hour
    python benchmarks/recovery.py skin           # cases whose name holds the word; the others stay as stored

Absolute R(r) in 20 rings of the case file between 0.5 and 15 mm, 1 % relative sd with the standard error of the Monte Carlo added in quadrature;
sigma_a, sigma_s' and thickness free, each fit from one start a factor of 0.6 or 1.6 off the truth. Bias: from the profile as it is. Inside 2 sd: of
all numbers in fits of five profiles with 1 % of noise drawn.
"""

import json
import sys
import time
from pathlib import Path

import jax
import numpy as np
from fits_of_monte_carlo import posed, text
from record import FOLDER, record

import layerfit as lf

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from cases import load

CASES = ("skin_over_fat", "absorbing_top", "two_thick_low_over_thin_high")
SOLVERS = {"discrete-ordinates": lf.DiscreteOrdinates(), "layered-diffusion": lf.LayeredDiffusion(), "multipole": lf.Multipole()}
NUMBERS = ("sigma_a", "sigma_s_prime", "thickness")
NOISE, DRAWS = 0.01, 5


def profile(case):
    """Rings, values and sd."""
    low, high = case.rings
    inside = np.flatnonzero((low >= 0.5) & (high <= 15.0) & (case.R > 0.0))
    wanted = np.geomspace(*(0.5 * (low + high))[inside[[0, -1]]], 20)
    chosen = inside[np.unique(np.round(np.interp(wanted, 0.5 * (low + high)[inside], np.arange(inside.size))).astype(int))]
    rest = np.setdiff1d(inside, chosen)  # rings are wider than the steps near the source: fill up from the outside
    chosen = np.sort(np.append(chosen, rest[::-1][: 20 - chosen.size]))
    return low[chosen], high[chosen], case.R[chosen], np.hypot(case.R_se, NOISE * case.R)[chosen]


def main():
    words = sys.argv[1:]
    stored = FOLDER / "recovery.json"
    for name in CASES:
        if words and not any(word in name for word in words):
            continue
        rows, case, table, heads, inside, chi2 = [], load(name), {}, [], [], []
        low, high, values, sd = profile(case)
        geometry = lf.RadialReflectance(r_min=low, r_max=high)
        for label, solver in SOLVERS.items():
            began = time.perf_counter()
            random = np.random.default_rng(1)
            try:
                problem, truth = posed(case, NUMBERS, solver, [lf.Dataset(geometry, values, sd)])
            except lf.InputError as error:
                print(f"{name}, {label}: refused: {error}")
                continue
            result = lf.fit(problem, starts=1)
            within = total = 0
            for _ in range(DRAWS):
                drawn = lf.Dataset(geometry, values * (1.0 + NOISE * random.standard_normal(values.size)), sd)
                noisy = lf.fit(posed(case, NUMBERS, solver, [drawn])[0], starts=1)
                for key, estimate in noisy.parameters.items():
                    total += 1
                    within += estimate.stderr is not None and abs(estimate.value - truth[key]) <= 2.0 * estimate.stderr
            heads.append(label)
            inside.append(f"{within} of {total}")
            chi2.append(f"{result.chi2_reduced:.2g}")
            for key, estimate in result.parameters.items():
                table.setdefault(key, [f"{truth[key]:.4g}"]).append(f"{text(estimate)} ({100 * (estimate.value / truth[key] - 1):+.1f} %)")
                rows.append({"solver": label, "number": key, "truth": truth[key], "value": estimate.value, "stderr": estimate.stderr})
            print(f"{name}, {label}: {time.perf_counter() - began:.0f} s, {within} of {total} inside, {result}", flush=True)
        jax.clear_caches()
        lines = [f"## {name}", "", "| number | truth | " + " | ".join(heads) + " |", "|---" * (len(heads) + 2) + "|"]
        lines += [f"| {key} | " + " | ".join(cells) + " |" for key, cells in table.items()]
        lines += ["| inside 2 sd | | " + " | ".join(inside) + " |", "| reduced chi-square | | " + " | ".join(chi2) + " |", ""]
        pages = json.loads(stored.read_text()) if stored.exists() else {}
        pages[name] = {"rows": rows, "lines": lines}
        record("recovery", pages)
        page = ["# Recovery", "", *__doc__.strip().split("\n\n")[2].splitlines(), "", "Made by `python benchmarks/recovery.py`.", ""]
        page += [line for known in CASES if known in pages for line in pages[known]["lines"]]
        (ROOT / "docs" / "recovery.md").write_text("\n".join(page).rstrip() + "\n")


if __name__ == "__main__":
    main()
