"""R(r) and T(r) by discrete ordinates against Monte Carlo (MCML) profiles, ring by ring; writes docs/transport-profiles.md.

    python benchmarks/transport_profiles.py                # all cases, half an hour
    python benchmarks/transport_profiles.py skin slab      # those whose name holds a word; the others stay as stored

Each ring is allowed the larger of 0.5 % and 3 standard errors of the Monte Carlo beyond half a transport mean free path of the first layer, of 2 %
and 3 standard errors from a tenth to a half. "covered": rings whose deviation is below the error that the solver states and 2 standard errors of
the Monte Carlo together. Rings whose standard error is above 10 % are left out. Those out of bounds, some of which are so by chance, are looked at
again with a second Monte Carlo by transport_second_look.py.
"""

import json
import sys
import time
from pathlib import Path

import jax
import numpy as np
from record import FOLDER, record

import layerfit as lf

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from cases import NAMES, load

BANDS = ((0.1, 0.5, 0.02), (0.5, 1.0, 0.005), (1.0, 3.0, 0.005), (3.0, 10.0, 0.005), (10.0, np.inf, 0.005))


def allowed_share(r):
    """Largest relative deviation at distances r, where 3 standard errors are less."""
    return np.select([r < end for _, end, _ in BANDS], [share for _, _, share in BANDS])


def held_against(case, side, solver):
    """Values, stated and true errors of one profile, and seconds: the first call with its error estimate, a warm call."""
    low, high = case.rings
    geometry = (lf.RadialReflectance if side == "R" else lf.RadialTransmittance)(r_min=low, r_max=high)
    start = time.perf_counter()
    found = lf.predict(case.stack, geometry, solver=solver)[0]
    first = time.perf_counter() - start
    reference, se = (case.R, case.R_se) if side == "R" else (case.T, case.T_se)
    r = np.sqrt(0.5 * (low**2 + high**2)) / case.mfp
    use = (r >= 0.1) & (reference > 0.0) & (se < 0.1 * reference)
    return {
        "r": r[use].tolist(),
        "value": found.values[use].tolist(),
        "stated": found.estimated_error[use].tolist(),
        "reference": reference[use].tolist(),
        "se": se[use].tolist(),
        "first_s": first,
    }


def judged(row):
    """One table row: per band the median deviation and the rings out of bounds; then how honest the stated error is."""
    r, value, stated, reference, se = (np.array(row[name]) for name in ("r", "value", "stated", "reference", "se"))
    cells, out, total = [], 0, 0
    for start, end, _ in BANDS:
        m = (r >= start) & (r < end)
        if not m.any():
            cells.append("")
            continue
        allowed = np.maximum(allowed_share(r[m]) * reference[m], 3.0 * se[m])
        beyond = ~(np.abs(value - reference)[m] <= allowed)
        out, total = out + int(beyond.sum()), total + int(m.sum())
        cells.append(f"{100 * np.median(value[m] / reference[m] - 1):+.2f}" + (f" ({beyond.sum()} of {m.sum()} out)" if beyond.any() else ""))
    covered = np.abs(value - reference) <= stated + 2.0 * se
    true = np.median(np.abs(value - reference) / reference)
    return cells, out, total, float(np.mean(covered)), float(np.median(stated / reference)), float(true)


def main():
    words = sys.argv[1:]
    rows = {}
    for name in NAMES:
        if words and not any(word in name for word in words):
            continue
        case = load(name)
        for side in ("R",) if case.stack.half_space else ("R", "T"):
            rows[f"{name} {side}"] = held_against(case, side, lf.DiscreteOrdinates())
            cells, out, total, covered, stated, true = judged(rows[f"{name} {side}"])
            print(f"{name} {side}", *cells, f"out {out}/{total} covered {covered:.2f} stated {stated:.1e} true {true:.1e}", sep=" | ", flush=True)
        jax.clear_caches()
    stored = FOLDER / "transport_profiles.json"
    if words and stored.exists():
        rows = json.loads(stored.read_text()) | rows
    lines = ["# Discrete ordinates against Monte Carlo profiles", "", *__doc__.strip().split("\n\n")[2].splitlines(), ""]
    lines += ["Median deviation [%] by r in transport mean free paths of the first layer. Made by `python benchmarks/transport_profiles.py`.", ""]
    lines += [
        "| profile | 0.1 to 0.5 | 0.5 to 1 | 1 to 3 | 3 to 10 | 10 and more | rings out | covered | median stated, true error [%] |",
        "|---" * 9 + "|",
    ]
    for name, row in rows.items():
        cells, out, total, covered, stated, true = judged(row)
        lines.append(f"| {name} | " + " | ".join(cells) + f" | {out} of {total} | {100 * covered:.0f} % | {100 * stated:.2f}, {100 * true:.2f} |")
    (ROOT / "docs" / "transport-profiles.md").write_text("\n".join(lines) + "\n")
    record("transport_profiles", rows)


if __name__ == "__main__":
    main()
