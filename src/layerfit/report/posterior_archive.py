"""Files that keep a posterior."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files import writable_folder, write
from .html import posterior_report, svg
from .plots import plot_fit
from .posterior_plots import plot_corner, plot_predictive, plot_trace
from .posterior_table import posterior_dict, posterior_text
from .tables import versions

if TYPE_CHECKING:
    from ..inference.posterior import Posterior


def save_posterior(posterior: "Posterior", folder: Any, *, title: str = "layerfit") -> dict[str, Path]:
    """posterior.nc, posterior.txt, three figures, report.html and, last, posterior.json; returns the paths by file name."""
    from ..inference.inference_data import inference_data, write_inference_data
    from ..inference.replicates import replicates

    folder = writable_folder(folder)
    table, predictions = posterior.table(), posterior.predictions()
    repeated = replicates(posterior, predictions)
    figures = {
        "predictive.svg": svg(plot_predictive(posterior, predictions, repeated)),
        "corner.svg": svg(plot_corner(posterior)),
        "trace.svg": svg(plot_trace(posterior)),
    }
    files = {
        **figures,
        "posterior.txt": posterior_text(posterior, table) + "\n",
        "report.html": posterior_report(posterior, table, svg(plot_fit(posterior.fit)), figures, title=title),
        "posterior.json": json.dumps(posterior_dict(posterior, table) | {"versions": versions()}, indent=1, allow_nan=False) + "\n",
    }
    paths = {"posterior.nc": write_inference_data(inference_data(posterior, predictions, repeated), folder / "posterior.nc")}
    return paths | {name: write(folder / name, content) for name, content in files.items()}


def finished(folder: Path, settings: Mapping[str, str], steps: int) -> tuple[str, str] | None:
    """Outcome and text of a run that was kept in a folder with these settings and that has nothing left to do; None where there is none."""
    from ..inference.judgement import SamplingOutcome

    try:
        found = json.loads((folder / "posterior.json").read_text())
        text = (folder / "posterior.txt").read_text().rstrip()
        enough = found["outcome"] == SamplingOutcome.CONVERGED.value or found["largest_number_of_steps"] >= steps
        whole = (folder / "posterior.nc").is_file() and (folder / "report.html").is_file()
        same = all(found["settings"].get(name) == value for name, value in settings.items())
        return (found["outcome"], text) if enough and whole and same else None
    except (OSError, ValueError, KeyError):
        return None
