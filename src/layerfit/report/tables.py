"""Tables: numbers with their uncertainty, derived quantities, settings and versions."""

import math
import platform
from collections.abc import Collection, Sequence
from dataclasses import fields
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..arrays import AnyArray
from ..compilation import compiled
from ..inference.likelihood import Likelihood
from ..inference.model import Scene
from ..inference.parts import Parts
from ..inference.priors import UNIFORM, Prior
from ..inference.uncertainty import UNDETERMINED
from ..solver import Solver

if TYPE_CHECKING:
    from ..inference.result import Fit

_PACKAGES = ("layerfit", "jax", "equinox", "optimistix", "lineax", "numpy", "scipy")


def with_uncertainty(value: float, sd: float | None) -> str:
    """A number with as many digits as its standard deviation carries: 0.0203 ± 0.0012.

    >>> with_uncertainty(0.020312, 0.00118), with_uncertainty(1.5, None)
    ('0.0203 ± 0.0012', '1.5')
    """
    if sd is None or not math.isfinite(sd) or sd <= 0:
        return f"{value:.5g}"
    if sd > abs(value) > 0:  # rounded like its sd it would vanish
        return f"{value:.3g} ± {sd:.3g}"
    digits = 1 - math.floor(math.log10(sd))
    if digits > 12 or abs(value) > 1e6 or digits < -6:
        return f"{value:.6g} ± {sd:.2g}"
    shown = max(digits, 0)
    return f"{round(value, digits):.{shown}f} ± {round(sd, digits):.{shown}f}"


def unit_text(unit: str) -> str:
    """A unit as it is printed: 1/mm² for 1/mm^2."""
    return unit.replace("^2", "²")


def chi_square_text(chi2: float) -> str:
    """A chi-square with 4 digits; 0 where it is only rounding."""
    return f"{chi2 if not chi2 < 1e-9 else 0.0:.4g}"


def solver_text(solver: Solver) -> str:
    """A solver and its settings: layered-diffusion (source mixed, ...)."""
    settings = ", ".join(f"{name} {value}" for name, value in solver.settings.items() if value not in (None, ()))
    return f"{solver.name} ({settings})" if settings else solver.name


def start_rows(fit: "Fit") -> list[str]:
    """Chi-square of each start, on the scale of the fit's own."""
    return [chi_square_text(start.chi2 if fit.noise is None else start.chi2 / fit.noise**2) for start in fit.starts]


def minimum_rows(fit: "Fit") -> list[list[str]]:
    """One row a minimum: chi-square, how many starts, its numbers; best first."""
    return [[chi_square_text(m.chi2), str(m.starts), *(f"{value:.4g}" for value in m.x.tolist())] for m in fit.minima]


def parameter_rows(fit: "Fit") -> list[dict[str, str]]:
    """One row a free number, as text."""
    rows = []
    for parameter, (name, estimate) in zip(fit.problem.parameters, fit.parameters.items(), strict=True):
        note = "at its bound" if estimate.at_bound else ""
        index = fit.problem.names.index(name)
        if not note and fit.uncertainty.relative[index] > UNDETERMINED:
            note = "not determined"
        rows.append(
            {
                "name": name,
                "value": with_uncertainty(estimate.value, estimate.stderr),
                "unit": unit_text(estimate.unit),
                "bounds": f"{parameter.low:g} to {parameter.high:g}",
                "note": note,
                "prior": _prior_text(parameter.prior),
                "parts": _parts_text(estimate.parts),
            }
        )
    return rows


def _prior_text(prior: Prior) -> str:
    """A prior in words, nothing for one that is uniform."""
    if prior == UNIFORM:
        return ""
    numbers = ", ".join(
        f"{name} {value if isinstance(value, str) else f'{value:.4g}'}" for name, value in zip(prior.arguments, prior.numbers, strict=True)
    )
    return f"{prior.kind} ({numbers})" if numbers else prior.kind


def _parts_text(parts: Parts | None) -> str:
    """What a standard error is made of."""
    if parts is None:
        return ""
    named = [("noise", parts.noise), ("model", parts.model), ("priors", parts.prior)]
    return ", ".join(f"{name} {sd:.2g}" for name, sd in named if sd > 1e-3 * max(parts) or name != "priors")


def likelihood_text(likelihood: Likelihood) -> str:
    """How one dataset scatters: student-t (nu 4)."""
    settings = ", ".join(f"{field.name} {getattr(likelihood, field.name)}" for field in fields(likelihood))
    return f"{likelihood.kind} ({settings})" if settings else likelihood.kind


def derived_rows(fit: "Fit") -> list[dict[str, str]]:
    """For each layer mu_eff = sqrt(3 sigma_a sigma_t'), penetration depth 1/mu_eff, transport mean free path 1/sigma_t', albedo sigma_s'/sigma_t'.

    Uncertainties by linear propagation of the covariance.
    """
    if fit.stack.spectral:
        return []
    values, slopes = (np.asarray(a) for a in _derived(fit.problem.model.scene, fit.x))
    sd = np.sqrt(np.maximum(np.einsum("qlp,pr,qlr->ql", slopes, fit.covariance, slopes), 0.0))
    keys = ("mu_eff", "penetration", "mfp", "albedo")
    return [
        {"layer": layer.name} | {key: with_uncertainty(float(values[q, i]), float(sd[q, i]) or None) for q, key in enumerate(keys)}
        for i, layer in enumerate(fit.stack.layers)
    ]


@compiled
def _derived(scene: Scene, x: Float[AnyArray, "p"]) -> tuple[Float[Array, "q layers"], Float[Array, "q layers p"]]:
    """The derived quantities and their slopes."""

    def quantities(x: Float[Array, "p"]) -> Float[Array, "q layers"]:
        columns = scene.columns(x)
        mu_eff = jnp.sqrt(3.0 * columns.sigma_a * columns.sigma_t_prime + 1e-300)
        return jnp.stack([mu_eff, 1.0 / mu_eff, 1.0 / columns.sigma_t_prime, columns.sigma_s_prime / columns.sigma_t_prime])

    return quantities(x), jax.jacfwd(quantities)(x)


def aligned(rows: Sequence[Sequence[str]], left: Collection[int]) -> list[str]:
    """Lines whose columns stand under one another. left : columns flush left, the others are flush right.

    >>> aligned([("a", "1.5"), ("long", "22")], left=[0])
    ['a     1.5', 'long   22']
    """
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    padded = ([f"{text:{'<' if i in left else '>'}{width}}" for i, (text, width) in enumerate(zip(row, widths, strict=True))] for row in rows)
    return ["  ".join(row).rstrip() for row in padded]


def versions() -> dict[str, str]:
    """Versions of everything that decides a result."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def fit_text(fit: "Fit") -> str:
    """A fit as plain text."""
    rows = parameter_rows(fit)
    widths = {key: max(len(row[key]) for row in rows) for key in ("name", "value", "unit")}
    lines = [f"{fit.outcome.value}: chi-square {chi_square_text(fit.chi2)}, {fit.dof} degrees of freedom"]
    lines.append(f"  solver {solver_text(fit.problem.chosen)}")
    for row in rows:
        more = "; ".join(filter(None, (row["note"], row["parts"] and f"of which {row['parts']}", row["prior"] and f"prior {row['prior']}")))
        lines.append(f"  {row['name']:<{widths['name']}}  {row['value']:<{widths['value']}}  {row['unit']:<{widths['unit']}}  {more}".rstrip())
    if len(fit.minima) > 1:
        cells = [("minimum", "chi-square", "starts", *fit.problem.names), *((str(i), *row) for i, row in enumerate(minimum_rows(fit), 1))]
        lines += [f"  {line}" for line in aligned(cells, left=(0,))]
    return "\n".join([*lines, *(f"  ! {warning}" for warning in fit.warnings)])
