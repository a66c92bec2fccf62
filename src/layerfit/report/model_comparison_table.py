"""A comparison of models as a table."""

import math
from typing import TYPE_CHECKING, Any

from .tables import aligned

if TYPE_CHECKING:
    from ..inference.model_comparison import ModelComparison


def model_rows(comparison: "ModelComparison") -> list[dict[str, Any]]:
    """One row a model, best first."""
    keys = ("name", "numbers", "log_likelihood", "aic", "aicc", "bic", "weight", "elpd", "elpd_se")
    rows = []
    for c in comparison.candidates:
        row = {key: getattr(c, key) for key in keys} | {"chi2": c.fit.chi2}
        rows.append({key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in row.items()})
    return rows


def model_text(comparison: "ModelComparison") -> str:
    """The sentence, then a line a model: criteria as differences from the best."""
    best = comparison.best
    lowest = min(c.bic for c in comparison.candidates)
    cells = [("model", "free", "chi-square", "dAICc", "dBIC", "weight", "elpd", "se")]
    for c in comparison.candidates:
        gap = f"{c.aicc - best.aicc:.2f}" if math.isfinite(c.aicc) else "none"
        cells.append(
            (c.name, str(c.numbers), f"{c.fit.chi2:.4g}", gap, f"{c.bic - lowest:.2f}", f"{c.weight:.3f}", f"{c.elpd:.2f}", f"{c.elpd_se:.2f}")
        )
    return "\n".join([comparison.sentence, *(f"  {line}" for line in aligned(cells, left=(0,))), *(f"  ! {note}" for note in comparison.notes)])
