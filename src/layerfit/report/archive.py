"""Files that keep a result. Each appears whole or not at all."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files import writable_folder, write
from ..measurement.geometry import Angular, Geometry, SpatialFrequency, value_unit
from ..measurement.spectrum import Spectrum
from ..predict import Prediction
from .html import fit_report, svg
from .plots import plot_fit
from .tables import likelihood_text, versions

if TYPE_CHECKING:
    from ..inference.result import Estimate, Fit


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _estimate_dict(estimate: "Estimate") -> dict[str, Any]:
    entry = {"value": _finite(estimate.value), "stderr": _finite(estimate.stderr), "unit": estimate.unit, "at_bound": estimate.at_bound}
    return entry if estimate.parts is None else entry | {"stderr_from": estimate.parts._asdict()}


def fit_dict(fit: "Fit") -> dict[str, Any]:
    """A fit as plain numbers and texts, physical units, null where there is no number."""
    return {
        "outcome": fit.outcome.value,
        "chi2_reduced": _finite(fit.chi2_reduced),
        "solver": fit.problem.chosen.name,
        "parameters": {name: _estimate_dict(estimate) for name, estimate in fit.parameters.items()},
        "covariance": [[_finite(v) for v in row] for row in fit.covariance.tolist()],
        "warnings": list(fit.warnings),
        "chi2": _finite(fit.chi2),
        "degrees_of_freedom": fit.dof,
        "estimated_relative_noise": fit.noise,
        "settings": {
            "solver": repr(fit.problem.chosen),
            "guess": repr(fit.problem.stack),
            "free": {
                p.name: {"min": p.low, "max": p.high, "init": p.init, "scale": p.scale, "prior": {p.prior.kind: list(p.prior.numbers)}}
                for p in fit.problem.parameters
            },
            "ties": {t.name: {"to": t.source, "factor": t.factor} if t.function is None else {"to": t.text} for t in fit.problem.ties},
            "likelihoods": {d.name: likelihood_text(one) for d, one in zip(fit.problem.data, fit.problem.likelihoods, strict=True)},
            "model_error": fit.problem.model_error,
        },
        "stack": repr(fit.stack),
        "starts": [{"chi2": _finite(s.chi2), "steps": s.steps, "outcome": s.outcome.value} for s in fit.starts],
        "minima": [{"x": dict(zip(fit.problem.names, m.x.tolist(), strict=True)), "chi2": m.chi2, "starts": m.starts} for m in fit.minima],
        "seconds": fit.seconds,
        "versions": versions(),
    }


def save_fit(fit: "Fit", folder: Any, *, title: str = "layerfit") -> dict[str, Path]:
    """fit.json, report.html, fit.svg and one CSV of the fitted curve a dataset; returns the paths by file name."""
    folder = writable_folder(folder)
    files = {"fit.json": json.dumps(fit_dict(fit), indent=1, allow_nan=False), "fit.svg": svg(plot_fit(fit))}
    rows = zip(fit.problem.data, fit.problem.model.scatter, fit.predictions, fit.residuals, strict=True)
    for dataset, scatter, predicted, residuals in rows:
        unit = value_unit(dataset.geometry)
        sd = dataset.sd if dataset.sd is not None else (fit.noise or 0.0) * np.abs(dataset.values)
        columns = {f"value [{unit}]": dataset.values, f"sd [{unit}]": sd, f"fit [{unit}]": predicted, "residual [1]": -residuals}
        if getattr(scatter, "error", None) is not None:
            columns[f"model_error [{unit}]"] = np.sqrt(np.diag(scatter.error))  # pyright: ignore[reportAttributeAccessIssue]
        files[f"curve_{dataset.name}.csv"] = _csv(dataset.geometry, columns)
    files["report.html"] = fit_report(fit, files["fit.svg"], title=title)
    return {name: write(folder / name, content) for name, content in files.items()}


def _csv(geometry: Geometry, columns: dict[str, np.ndarray]) -> str:
    unit = (
        "nm"
        if isinstance(geometry, Spectrum)
        else "rad/mm"
        if isinstance(geometry, SpatialFrequency)
        else "deg"
        if isinstance(geometry, Angular)
        else "mm"
    )
    table = {f"{name} [{unit}]": values for name, values in geometry.places().items()} | columns
    rows = zip(*table.values(), strict=True)
    return "\n".join([", ".join(table), *(", ".join(f"{v:.10g}" for v in row) for row in rows)]) + "\n"


def data_csv(geometry: Geometry, values: np.ndarray, sd: np.ndarray | None) -> str:
    """Values in the data file format."""
    unit = value_unit(geometry)
    return _csv(geometry, {f"value [{unit}]": values} | ({} if sd is None else {f"sd [{unit}]": sd}))


def prediction_dict(solver: str, named: list[tuple[str, Prediction]]) -> dict[str, Any]:
    """Predictions as plain numbers: value and estimated_error are lists of equal length, the error null where unknown."""
    rename = {"r": "x", "k": "x", "angle": "x", "r_min": "x_min", "r_max": "x_max"}
    measurements = []
    for name, p in named:
        errors = [None] * len(p.values) if p.estimated_error is None else [_finite(float(e)) for e in p.estimated_error]
        places = {rename[key]: place.tolist() for key, place in p.geometry.places().items()}
        measurements.append({"name": name, "kind": p.geometry.kind, **places, "value": p.values.tolist(), "estimated_error": errors})
    notes = list(dict.fromkeys(note for _, p in named for note in p.notes))
    return {"solver": solver, "measurements": measurements, "notes": notes}
