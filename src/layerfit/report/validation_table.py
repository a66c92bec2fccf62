"""A validation as a table."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from .tables import aligned

if TYPE_CHECKING:
    from ..validation import Validation


def validation_rows(validation: "Validation") -> list[dict[str, Any]]:
    """One row a value. place : the abscissa as text. finding : "", "differs", "overstated error" or "too few photons"."""
    rows = []
    for check in validation.checks:
        for i in range(check.geometry.size):
            finding = "differs" if check.beyond[i] else "overstated error" if check.overstated[i] else "" if check.judged[i] else "too few photons"
            if not check.judged[i] and check.standard_error[i] == 0.0 and not check.beyond[i]:
                finding = ""  # both are exact, and equal
            rows.append(
                {
                    "measurement": check.name,
                    "place": check.geometry.place(i),
                    "value": float(check.values[i]),
                    "stated_error": _or_none(check.stated_error, i),
                    "monte_carlo": float(check.reference[i]),
                    "standard_error": float(check.standard_error[i]),
                    "deviation": float(check.ratio[i] - 1.0) if math.isfinite(check.ratio[i]) else None,
                    "z": float(check.z[i]),
                    "finding": finding,
                }
            )
    return rows


def _or_none(errors: np.ndarray | None, i: int) -> float | None:
    return None if errors is None or not math.isfinite(errors[i]) else float(errors[i])


def validation_text(validation: "Validation") -> str:
    """A validation as plain text: one line a value, the verdict first."""
    rows = validation.table()
    cells = [("measurement", "where", validation.solver.name, "stated error", "monte-carlo", "se", "deviation", "z", "")]
    for row in rows:
        deviation = "" if row["deviation"] is None else f"{100.0 * row['deviation']:+.2f} %"
        stated = "none" if row["stated_error"] is None else f"{row['stated_error']:.2g}"
        numbers = (f"{row['value']:.5g}", stated, f"{row['monte_carlo']:.5g}", f"{row['standard_error']:.2g}", deviation, f"{row['z']:+.1f}")
        cells.append((row["measurement"], row["place"], *numbers, row["finding"]))
    table = [f"  {line}" for line in aligned(cells, left=(0, 1, len(cells[0]) - 1))]
    return "\n".join([_headline(validation, rows), *table, *(f"  ! {note}" for note in validation.notes)])


def _headline(validation: "Validation", rows: list[dict[str, Any]]) -> str:
    judged = [row for row in rows if row["finding"] != "too few photons"]
    text = f"{validation.verdict.value}: solver {validation.solver.name} against monte-carlo, {len(judged)} of {len(rows)} values judged"
    for finding in ("differs", "overstated error"):
        count = sum(row["finding"] == finding for row in rows)
        if count:
            text += f", {finding}: {count}"
    deviations = [abs(row["deviation"]) for row in judged if row["deviation"] is not None]
    if deviations:
        text += f"; largest deviation {100.0 * max(deviations):.2g} %"
    if math.isfinite(validation.noticeable):
        text += f"; beyond the stated error {100.0 * validation.noticeable:.2g} % (median) would have been noticed"
    return text + f"; level {validation.level:g}"
