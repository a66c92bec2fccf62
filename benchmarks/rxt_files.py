"""Files of inverse adding-doubling: constructed ones against their known answers, measured ones without spheres against their own totals.

python benchmarks/rxt_files.py [--data FOLDER]

Writes docs/rxt-files.md. FOLDER holds the .rxt files of scottprahl/iad (tests/rxt), MIT licence, (c) 2020 Scott Prahl.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from record import record

import layerfit as lf

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests" / "reference"))

from make_mismatched import four_directions, totals

G = {"basic_C": 0.9, "basic_E": 0.9}  # stated in the files' comments, not in a column
COEFFICIENTS = ("basic_B", "basic_C", "basic_E")  # mus and mua [1/mm] behind each row
ALBEDOS = ("basic_D",)  # albedo and optical thickness
HALVES = ("basic_A",)  # M_R alone; mua and mus [1/mm]
THICK = 100.0  # [mm]: basic_A in another copy (iadpython, tests/data/basic-A.rxt), whose rows and answers are the same


def answers(file, name, g):
    """sigma_a and sigma_s' behind each row, and what errors are shares of: the number, or (where that may be 0) the sum of both."""
    told = np.array([[float(part) for part in remark.split()[:2]] for remark in file.remarks])
    if name in HALVES:
        known = told * [1.0, 1.0 - g]
        return known, known
    if name in ALBEDOS:
        total = told[:, 1] / np.array([file.at("thickness", row) for row in range(len(file))])
        known = np.stack([total * (1.0 - told[:, 0]), total * told[:, 0] * (1.0 - g)], axis=1)
        return known, np.sum(known, axis=1, keepdims=True)
    known = np.stack([told[:, 1], told[:, 0] * (1.0 - g)], axis=1)
    return known, known


def in_turn(file, known):
    """Each number of a file with one total, the other held at its answer, as if one fit had found both."""
    first, second = (lf.fit_slabs(file, held={name: known[:, 1 - q]}) for q, name in enumerate(("sigma_s_prime", "sigma_a")))
    x = np.stack([first.x[:, 0], second.x[:, 1]], axis=1)
    said = tuple(one or other for one, other in zip(first.said, second.said, strict=True))
    return replace(first, x=x, fitted=np.where(second.good[:, None], first.fitted, np.nan), said=said)


def by_doubling(file, known, *how):
    """M_R and M_T of samples without slides whose answers are known, by adding and doubling that shares nothing with the package."""
    table = []
    for i, (sigma_a, sigma_s) in enumerate(known):
        tau = (sigma_a + sigma_s) * file.at("thickness", i)
        table.append(totals(file.at("n", i), 0.0, sigma_s / (sigma_a + sigma_s), tau, *how)[:2])
    return np.array(table)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data" / "iad-rxt")
    folder = parser.parse_args().data
    rows = []
    for path in sorted((folder / "0_sphere").glob("*.rxt")):
        file = lf.read_rxt(path)
        if "M_T" not in file.columns and path.stem not in HALVES:
            rows.append({"file": path.name, "rows": len(file), "said": "M_R alone: gives one number where the other is known, which here neither is"})
            continue
        g = G.get(path.stem)
        known, size = answers(file, path.stem, g or 0.0) if path.stem in COEFFICIENTS + ALBEDOS + HALVES else (None, None)
        rows.append(judged(path.name, file, known, size, g))
        if path.stem in HALVES:
            rows[-1]["said"] = "M_R alone: each number with the other held at its answer. The answers are not those of the 1 mm that the file says"
            rows.append(judged(f"{path.stem}, {THICK:g} mm", replace(file, thickness=THICK), known, size, g))
            rows[-1]["said"] = "the thickness in another copy of the file, from which nothing is transmitted"
        if path.stem in ALBEDOS:
            columns = np.stack([file.columns["M_R"], file.columns["M_T"]], axis=1)
            few, many = by_doubling(file, known, four_directions, 1 / 32), by_doubling(file, known)
            same, off = np.max(np.abs(columns / few - 1.0)), np.max(np.abs(columns / many - 1.0))
            how = f"adding and doubling with 4 directions gives them to {same:.0e}, with 200 they are up to {100 * off:.1f} % other"
            rows[-1]["said"] = f"R and T are not exact: {how}"
            exact = replace(file, columns=dict(zip(("M_R", "M_T"), many.T, strict=True)))
            rows.append(judged(f"{path.stem}, 200 directions", exact, known, size, g))
            rows[-1]["said"] = "the same samples, R and T with 200 directions in place of the file's"
        print(rows[-1], flush=True)
        (ROOT / "docs" / "rxt-files.md").write_text(page(rows))
    record("rxt_files", rows)


def judged(name, file, known, size, g):
    """A row of the table. known, size : the answers and what errors are shares of, None where they are not known."""
    began = time.perf_counter()
    found = lf.fit_slabs(file, g=g) if "M_T" in file.columns else in_turn(file, known)
    row = {"file": name, "rows": len(file), "seconds": time.perf_counter() - began, "met": int(np.sum(found.good))}
    row["impossible"] = sum("comes back" in one or "possible is" in one for one in found.said)
    row["missed"] = sum("missed" in one for one in found.said)
    row["said"] = next((one for one in found.said if "missed" in one), "")
    if known is not None:
        row["largest_error"] = np.max(np.abs(found.x - known) / size, axis=0).tolist()
    return row


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
