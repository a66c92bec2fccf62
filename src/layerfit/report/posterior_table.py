"""A posterior as tables and text."""

import math
from typing import TYPE_CHECKING, Any

from .tables import aligned, solver_text, unit_text, with_uncertainty

if TYPE_CHECKING:
    from ..inference.posterior import Posterior


def posterior_rows(posterior: "Posterior", table: dict[str, dict[str, float]]) -> list[dict[str, str]]:
    """One row a free number, as text. table : of `Posterior.table`."""
    rows = []
    for name, row in table.items():
        digits = 3 if row["sd"] == 0 else max(2, min(8, 2 + math.floor(math.log10(max(abs(row["median"]), row["sd"]) / row["sd"]))))
        rows.append(
            {
                "name": name,
                "value": with_uncertainty(row["mean"], row["sd"]),
                "median": f"{row['median']:.{digits}g}",
                "range": f"{row['q05']:.{digits}g} to {row['q95']:.{digits}g}",
                "unit": unit_text(posterior.units[name]),
                "ess": f"{row['ess']:.0f}",
                "r_hat": f"{row['r_hat']:.3f}",
            }
        )
    return rows


def sampling_text(posterior: "Posterior") -> str:
    """How it was sampled, in one line."""
    walkers, kept = posterior.x.shape[:2]
    every = f", every {posterior.judgement.thinning}th" if posterior.judgement.thinning > 1 else ""
    return (
        f"{posterior.sampler}, {walkers} {'chains' if posterior.sampler == 'nuts' else 'walkers'}, {posterior.steps} steps, "
        f"the first {posterior.judgement.burn_in} left out{every}: {walkers * kept} draws; seed {posterior.seed}"
    )


def posterior_text(posterior: "Posterior", table: dict[str, dict[str, float]] | None = None) -> str:
    """A posterior as plain text. table : of `Posterior.table`, where it is known already."""
    rows = posterior_rows(posterior, posterior.table() if table is None else table)
    head = {"name": "", "value": "mean ± sd", "unit": "", "median": "median", "range": "5 to 95 %", "ess": "ess", "r_hat": "r_hat"}
    lines = aligned([[row[key] for key in head] for row in [head, *rows]], left=range(5))
    text = [f"{posterior.outcome.value}: {sampling_text(posterior)}", f"  solver {solver_text(posterior.problem.chosen)}"]
    return "\n".join([*text, *(f"  {line}" for line in lines), *(f"  ! {warning}" for warning in posterior.warnings)])


def posterior_dict(posterior: "Posterior", table: dict[str, dict[str, float]]) -> dict[str, Any]:
    """A posterior as plain numbers and texts, physical units, null where there is no number."""
    judgement = posterior.judgement

    def number(value: float) -> float | None:
        return float(value) if math.isfinite(value) else None

    return {
        "outcome": posterior.outcome.value,
        "parameters": {name: {key: number(v) for key, v in row.items()} | {"unit": posterior.units[name]} for name, row in table.items()},
        "warnings": list(posterior.warnings),
        "sampler": posterior.sampler,
        "steps": posterior.steps,
        "largest_number_of_steps": posterior.largest_steps,
        "draws": int(posterior.x.shape[0] * posterior.x.shape[1]),
        "burn_in": judgement.burn_in,
        "thinning": judgement.thinning,
        "autocorrelation_time": {name: number(v) for name, v in zip(posterior.problem.names, judgement.tau, strict=True)},
        "effective": {name: number(v) for name, v in zip(posterior.problem.names, judgement.effective, strict=True)},
        "divergent": judgement.divergent,
        "seconds": posterior.seconds,
        "settings": dict(posterior.settings),
    }
