"""Total reflectance and transmittance by discrete ordinates against the Monte Carlo (MCML) totals of all cases; writes docs/transport-totals.md.

    python benchmarks/transport_totals.py          # five minutes

Each total is allowed the larger of 0.1 % and 3 standard errors of the Monte Carlo (from 20 batches, but not below 0.7 of the binomial one). "striped"
is the second way to R: the sample lit in stripes of a spatial frequency of nearly zero, by the solver that R(r) is made of.
"""

import json
import sys
from pathlib import Path

import jax
import numpy as np
from record import record

import layerfit as lf

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from cases import FOLDER, NAMES, load

FREQUENCY = 1e-4  # rad/mm
SHARE, SIGMAS = 1e-3, 3.0


def rows_of(name):
    """One row a total: what the solver says, and states, and the Monte Carlo with its standard error."""
    case = load(name)
    photons = json.loads((FOLDER / f"{name}.json").read_text())["photons"]
    geometries = {"R": lf.TotalReflectance(), "T": lf.TotalTransmittance(), "R striped": lf.SpatialFrequency(k=[FREQUENCY])}
    rows = []
    for what, geometry in geometries.items():
        if what == "T" and case.stack.half_space:
            continue
        found = lf.predict(case.stack, geometry, solver=lf.DiscreteOrdinates())[0]
        reference = case.totals["T_total" if what == "T" else "R_diffuse"]
        p = reference["value"]
        se = max(reference["se"], 0.7 * np.sqrt(p * (1.0 - p) / photons))
        value, stated = float(found.values[0]), float(found.estimated_error[0])
        met = bool(abs(value - p) <= max(SHARE * p, SIGMAS * se))
        rows.append({"case": name, "what": what, "value": value, "stated": stated, "reference": p, "se": se, "met": met})
    return rows


def main():
    rows = []
    for name in NAMES:
        rows += rows_of(name)
        print(*rows[-2:], sep="\n", flush=True)
        jax.clear_caches()
    lines = ["# Totals by discrete ordinates against Monte Carlo", "", *__doc__.strip().split("\n\n")[2].splitlines(), ""]
    lines += [f"Made by `python benchmarks/transport_totals.py`. Met: {sum(row['met'] for row in rows)} of {len(rows)}.", ""]
    lines += ["| case | total | Monte Carlo | standard error [%] | deviation [%] | in standard errors | stated [%] | met |", "|---" * 8 + "|"]
    for row in rows:
        p, se, off = row["reference"], row["se"], row["value"] - row["reference"]
        numbers = f"{p:.5f} | {100 * se / p:.3f} | {100 * off / p:+.3f} | {off / se:+.1f} | {100 * row['stated'] / p:.2g}"
        lines.append(f"| {row['case']} | {row['what']} | {numbers} | {'yes' if row['met'] else 'no'} |")
    (ROOT / "docs" / "transport-totals.md").write_text("\n".join(lines) + "\n")
    record("transport_totals", rows)
    print("\n".join(lines))


if __name__ == "__main__":
    main()
