"""The HTML report: one file, nothing fetched, everything escaped."""

import io
from datetime import datetime
from typing import TYPE_CHECKING, Any

import jinja2
from markupsafe import Markup
from matplotlib import rc_context
from matplotlib.figure import Figure

from ..scene.drawing import stack_svg
from .posterior_table import posterior_rows, sampling_text
from .tables import chi_square_text, derived_rows, likelihood_text, minimum_rows, parameter_rows, solver_text, start_rows, versions

if TYPE_CHECKING:
    from ..inference.posterior import Posterior
    from ..inference.result import Fit


def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader("layerfit.report"), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )


def svg(figure: Figure) -> str:
    """A figure as SVG text, the same each time."""
    buffer = io.StringIO()
    with rc_context({"svg.hashsalt": "layerfit"}):  # its names would be random
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def _content(fit: "Fit") -> dict[str, Any]:
    return {
        "fit": fit,
        "drawing": Markup(stack_svg(fit.stack)),  # escapes its own text
        "parameters": parameter_rows(fit),
        "derived": derived_rows(fit),
        "versions": versions(),
        "chi2": chi_square_text(fit.chi2),
        "starts": start_rows(fit),
        "minima": minimum_rows(fit),
        "solver": solver_text(fit.problem.chosen),
        "likelihoods": [likelihood_text(one) for one in fit.problem.likelihoods],
        "references": fit.problem.chosen.references,
    }


def fit_report(fit: "Fit", curve: str, *, title: str = "layerfit") -> str:
    """The whole report as one HTML page that opens offline; curve is the figure of data and fit, from `svg`."""
    return _report(fit, curve, title, posterior=None)


def posterior_report(
    posterior: "Posterior", table: dict[str, dict[str, float]], curve: str, figures: dict[str, str], *, title: str = "layerfit"
) -> str:
    """The report of a fit with a section on the posterior. table : of `Posterior.table`. figures : as SVG text by file name."""
    drawn = {name.removesuffix(".svg"): Markup(figure) for name, figure in figures.items()}
    return _report(posterior.fit, curve, title, **_posterior_content(posterior, table), figures=drawn)


def _posterior_content(posterior: "Posterior", table: dict[str, dict[str, float]]) -> dict[str, Any]:
    return {"posterior": posterior, "posterior_rows": posterior_rows(posterior, table), "sampling": sampling_text(posterior)}


def _report(fit: "Fit", curve: str, title: str, **more: Any) -> str:
    now = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    figure = Markup(curve)  # matplotlib escapes its own text
    return _environment().get_template("report.html").render(title=title, now=now, curve=figure, correlation=_shaded(fit), **_content(fit), **more)


def _shaded(fit: "Fit") -> list[list[tuple[str, str]]]:
    """Correlations as text and colours: red for +1, blue for -1."""

    def style(c: float) -> str:
        return f"background: rgba({'192,57,43' if c > 0 else '31,78,121'},{0.75 * abs(c):.2f}); color: {'white' if abs(c) > 0.6 else 'inherit'}"

    return [[(f"{c:+.2f}", style(c)) for c in row] for row in fit.correlation]


def fit_fragment(fit: "Fit") -> str:
    """The tables of a fit and its stack, for a notebook."""
    return _environment().get_template("fragment.html").render(**_content(fit))


def posterior_fragment(posterior: "Posterior") -> str:
    """The table of a posterior, for a notebook."""
    return _environment().get_template("posterior_fragment.html").render(**_posterior_content(posterior, posterior.table()))
