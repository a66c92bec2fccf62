"""Many fits as text."""

from typing import TYPE_CHECKING

import numpy as np

from .tables import aligned, unit_text

if TYPE_CHECKING:
    from ..inference.many import ManyFits


def many_text(many: "ManyFits") -> str:
    """Medians and spread of each number over the sets, and how many sets are not to be trusted, and why."""
    cells = [("number", "median", "16 %", "84 %", "unit", "median se", "not determined", "at a bound")]
    for i, p in enumerate(many.problem.parameters):
        low, middle, high = np.percentile(many.x[:, i], [16, 50, 84])
        known = many.stderr[:, i][np.isfinite(many.stderr[:, i])]
        size = f"{np.median(known):.2g}" if known.size else ""
        weak = int(np.sum(~many.determined[:, i] & ~many.at_bound[:, i]))
        numbers = (f"{middle:.4g}", f"{low:.4g}", f"{high:.4g}", unit_text(p.unit), size)
        cells.append((p.name, *numbers, str(weak), str(int(np.sum(many.at_bound[:, i])))))
    sets = len(many.x)
    failed = sets - int(np.sum(many.converged))
    head = f"{sets} sets fitted in {many.seconds:.3g} s: {sets - failed} converged" + (f", {failed} did not" if failed else "")
    ratio = many.chi2 / many.dof if many.dof > 0 else np.full(sets, np.nan)
    alone = int(np.sum((many.met < 2) & (many.runs > 1)))
    lines = [head, f"chi-square over degrees of freedom: median {np.median(ratio):.3g}, largest {np.max(ratio):.3g}", *aligned(cells, left=(0, 4))]
    if alone:
        lines.append(f"  ! in {alone} sets only one start reached the best minimum: another one may be better; more starts would tell")
    return "\n".join(lines)
