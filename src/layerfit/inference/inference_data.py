"""Posteriors as ArviZ's InferenceData. The only place where ArviZ is used; it is imported when first needed."""

import os
import tempfile
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..measurement.geometry import Geometry, value_unit
from .replicates import replicates

if TYPE_CHECKING:
    from .posterior import Posterior

Predicted = tuple[np.ndarray, ...]  # (draws, n) for each dataset


def _arviz() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it announces its next version at each import
        import arviz
    return arviz


def summary_table(posterior: "Posterior") -> dict[str, dict[str, float]]:
    """Mean, sd, median, quantiles, Monte Carlo error, effective size and R-hat of each number."""
    arviz = _arviz()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numbers that do not move
        found = arviz.summary(_draws(posterior), round_to="none")
    rows = {}
    for name, draws in posterior.draws.items():
        low, middle, high = np.quantile(draws, [0.05, 0.5, 0.95])
        row = {"mean": np.mean(draws), "sd": np.std(draws, ddof=1), "median": middle, "q05": low, "q95": high}
        row |= {"mcse": found.loc[name, "mcse_mean"], "ess": found.loc[name, "ess_bulk"], "r_hat": found.loc[name, "r_hat"]}
        rows[name] = {key: float(value) for key, value in row.items()}
    return rows


def _draws(posterior: "Posterior") -> dict[str, np.ndarray]:
    return {name: posterior.x[:, :, i] for i, name in enumerate(posterior.problem.names)}


def inference_data(posterior: "Posterior", predictions: Predicted | None = None, repeated: Predicted | None = None) -> Any:
    """All groups. predictions, repeated : of `Posterior.predictions` and `replicates`, where they are known already."""
    data = posterior.problem.data
    predictions = posterior.predictions() if predictions is None else predictions
    repeated = replicates(posterior, predictions) if repeated is None else repeated
    places = {d.name: _place(d.name, d.geometry) for d in data}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # more walkers than draws
        found = _arviz().from_dict(
            posterior=_draws(posterior),
            sample_stats={"lp": posterior.log_density, "diverging": posterior.divergent},
            posterior_predictive={d.name: values[None] for d, values in zip(data, repeated, strict=True)},
            predictions={d.name: values[None] for d, values in zip(data, predictions, strict=True)},
            observed_data={d.name: d.values for d in data},
            coords=dict(places.values()),
            pred_coords=dict(places.values()),
            dims={name: [place[0]] for name, place in places.items()},
            pred_dims={name: [place[0]] for name, place in places.items()},
            attrs={"outcome": posterior.outcome.value, "sampler": posterior.sampler, "steps": posterior.steps, "seed": posterior.seed},
        )
    for name, unit in posterior.units.items():
        found.posterior[name].attrs["units"] = unit
    for d in data:
        for group in (found.posterior_predictive, found.predictions, found.observed_data):
            group[d.name].attrs["units"] = value_unit(d.geometry)
    return found


def _place(name: str, geometry: Geometry) -> tuple[str, np.ndarray]:
    """Name and values of the axis of a dataset."""
    keys = list(geometry.places())
    return (f"{name}_{keys[0].removesuffix('_min')}" if keys else f"{name}_value"), geometry.centers()


def write_inference_data(found: Any, path: Path) -> Path:
    """Write as netCDF, whole or not at all."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".layerfit.", suffix=".nc")
    os.close(handle)
    try:
        found.to_netcdf(temporary, engine="h5netcdf")
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    finally:
        Path(temporary).unlink(missing_ok=True)
    return path
