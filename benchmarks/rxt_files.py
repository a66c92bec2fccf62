"""Files of inverse adding-doubling: constructed ones against their known answers, measured ones without spheres against their own totals.

python benchmarks/rxt_files.py [--data FOLDER]

Writes docs/rxt-files.md. FOLDER holds the .rxt files of scottprahl/iad (tests/rxt), MIT licence, (c) 2020 Scott Prahl.
"""

import argparse
import time
from pathlib import Path

import numpy as np
from record import record

import layerfit as lf

ROOT = Path(__file__).parent.parent
G = {"basic_C": 0.9, "basic_E": 0.9}  # stated in the files' comments, not in a column
COEFFICIENTS = ("basic_B", "basic_C", "basic_E")  # mus and mua [1/mm] behind each row
ALBEDOS = ("basic_D",)  # albedo and optical thickness


def answers(file, name, g):
    """sigma_a and sigma_s' behind each row, and what errors are shares of: the number, or (where that may be 0) the sum of both."""
    told = np.array([[float(part) for part in remark.split()[:2]] for remark in file.remarks])
    if name in ALBEDOS:
        total = told[:, 1] / np.array([file.at("thickness", row) for row in range(len(file))])
        known = np.stack([total * (1.0 - told[:, 0]), total * told[:, 0] * (1.0 - g)], axis=1)
        return known, np.sum(known, axis=1, keepdims=True)
    known = np.stack([told[:, 1], told[:, 0] * (1.0 - g)], axis=1)
    return known, known


def against_monte_carlo(file, known):
    """How far R and T of a file lie from those of its own answers."""
    off, standard_errors = 0.0, 0.0
    for i, (sigma_a, sigma_s) in enumerate(known):
        sample = lf.Layer("sample", sigma_a=sigma_a, sigma_s_prime=sigma_s, g=0.0, n=file.at("n", i), thickness=file.at("thickness", i))
        both = [lf.TotalReflectance(specular="included"), lf.TotalTransmittance()]
        for name, one in zip(("M_R", "M_T"), lf.predict(lf.Stack([sample]), both, solver=lf.MonteCarlo(photons=4_000_000)), strict=True):
            difference = abs(file.columns[name][i] - one.values[0])
            off = max(off, difference / one.values[0])
            standard_errors = max(standard_errors, difference / max(one.estimated_error[0], 1e-12))
    return (
        f"R and T in the file are up to {100 * off:.1f} % off its own answers by Monte Carlo ({standard_errors:.0f} of its standard errors): "
        "so are the numbers"
    )


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data" / "iad-rxt")
    folder = parser.parse_args().data
    rows = []
    for path in sorted((folder / "0_sphere").glob("*.rxt")):
        file = lf.read_rxt(path)
        if "M_T" not in file.columns:
            rows.append({"file": path.name, "rows": len(file), "said": "M_T is missing: one number of a row cannot give two"})
            continue
        g = G.get(path.stem)
        began = time.perf_counter()
        found = lf.fit_slabs(file, g=g)
        row = {"file": path.name, "rows": len(file), "seconds": time.perf_counter() - began, "met": int(np.sum(found.good))}
        row["impossible"] = sum("comes back" in one or "possible is" in one for one in found.said)
        row["missed"] = sum("missed" in one for one in found.said)
        if path.stem in COEFFICIENTS + ALBEDOS:
            known, size = answers(file, path.stem, g or 0.0)
            row["largest_error"] = np.max(np.abs(found.x - known) / size, axis=0).tolist()
        row["said"] = next((one for one in found.said if "missed" in one), "")
        if path.stem in ALBEDOS:
            row["said"] = against_monte_carlo(file, answers(file, path.stem, 0.0)[0])
        rows.append(row)
        print(row, flush=True)
        (ROOT / "docs" / "rxt-files.md").write_text(page(rows))
    record("rxt_files", rows)


def page(rows):
    lines = ["# Files of inverse adding-doubling", "", " ".join(__doc__.split("\n\n")[0].split()), ""]
    lines += ["Made by `python benchmarks/rxt_files.py`, three minutes on two cores. Data: S. Prahl, iad, tests/rxt (MIT).", ""]
    lines += [
        "R and T are met where both are within 1 % and 1e-4. Inverse adding-doubling states 0.5 % for its answers. "
        "Errors are shares of the number; of sigma_a + sigma_s' in basic_D, where either may be 0.",
        "",
    ]
    lines += [
        "| file | rows | R and T met | impossible | missed by every slab | largest error of sigma_a, sigma_s' | |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        error = ", ".join(f"{100 * e:.3f} %" for e in row.get("largest_error", [])) or "answer not known"
        numbers = [str(row.get(key, "-")) for key in ("met", "impossible", "missed")]
        lines.append(f"| {row['file']} | {row['rows']} | {' | '.join(numbers)} | {error} | {row['said']} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
