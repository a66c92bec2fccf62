"""A comparison of solvers as a table."""

from typing import TYPE_CHECKING, Any

import numpy as np

from .tables import aligned

if TYPE_CHECKING:
    from ..comparison import Comparison


def comparison_rows(comparison: "Comparison") -> list[dict[str, Any]]:
    """One row a solver: seconds, median and largest relative error, largest stated one."""
    rows = []
    for i, row in enumerate(comparison.rows):
        median, largest = (None, None) if row.errors is None else (_number(np.median(row.errors)), _number(np.max(row.errors)))
        rows.append(
            {
                "solver": row.label,
                "first_seconds": row.first,
                "warm_seconds": row.warm,
                "median_error": median,
                "largest_error": largest,
                "largest_stated_error": None if row.stated is None else _number(np.max(row.stated)),
                "auto": i == comparison.chosen,
                "refused": row.refused,
            }
        )
    return rows


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None


def comparison_text(comparison: "Comparison") -> str:
    """A line a solver, the reference first, Auto's choice marked."""
    cells = [("", "solver", "first [s]", "warm [ms]", "median error", "largest", "stated")]
    refusals = []
    for row in comparison.table():
        if row["refused"]:
            refusals.append(f"  {row['solver']}: {row['refused']}")
            continue
        median, largest, stated = (
            "none" if row[e] is None else f"{100 * row[e]:.2g} %" for e in ("median_error", "largest_error", "largest_stated_error")
        )
        mark = "*" if row["auto"] else ""
        cells.append((mark, row["solver"], f"{row['first_seconds']:.1f}", f"{1e3 * row['warm_seconds']:.3g}", median, largest, stated))
    own = comparison.reference_error[np.isfinite(comparison.reference_error)]
    known = f", itself good to {100 * np.median(own):.2g} % (median)" if own.size else ""
    headline = f"errors against {comparison.reference}{known}; * is what auto takes"
    return "\n".join(
        [headline, *aligned(cells, left=(0, 1)), *(f"  refused: {text.strip()}" for text in refusals), *(f"  ! {note}" for note in comparison.why)]
    )
