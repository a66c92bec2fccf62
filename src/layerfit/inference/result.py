"""What comes of a fit."""

import math
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np

from ..scene.stack import Stack
from .parts import Parts
from .problem import Problem
from .uncertainty import Uncertainty, correlation

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from .profile_likelihood import ProfileLikelihood


class Outcome(StrEnum):
    """How a fit, or one start of it, ended."""

    CONVERGED = "converged"
    MAX_STEPS = "stopped at the largest number of steps"
    NOT_FINITE = "residuals are not finite"


class Start(eqx.Module):
    """One run of the fit: where it began and ended (physical units), its chi-square, and how often it stepped."""

    first: np.ndarray
    last: np.ndarray
    chi2: float = eqx.field(static=True)
    steps: int = eqx.field(static=True)
    outcome: Outcome = eqx.field(static=True)


class Minimum(eqx.Module):
    """One minimum that runs ended in: its numbers (physical units), its chi-square, and how many runs."""

    x: np.ndarray
    chi2: float = eqx.field(static=True)
    starts: int = eqx.field(static=True)


class Estimate(eqx.Module):
    """One fitted number.

    stderr : 1 standard deviation, None at a bound or where the data do not depend on it. parts : what of it comes from the noise, the model's error
    and the priors (their squares add up), None where the model error is off.
    """

    value: float = eqx.field(static=True)
    stderr: float | None = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    at_bound: bool = eqx.field(static=True)
    parts: Parts | None = eqx.field(static=True, default=None)


class Fit(eqx.Module):
    """The result of `fit`. Nothing of the problem was changed.

    Attributes
    ----------
    stack : the fitted stack, of the same structure as the guess.
    x, covariance : numbers in the order of problem.names and their covariance (p, p), physical units.
    residuals, predictions : for each dataset (prediction - value)/sd and the prediction; the sd holds correlated noise and the model's error too.
    chi2, dof, chi2_reduced : sum of squares of all residuals (whitened where they are correlated, the deviance of Student's t and of counts), values
        minus free numbers, and their ratio. Priors are no data: they count in neither.
    noise : the relative noise estimated from the fit, None where sd were given. The covariance uses it, and chi2_reduced is then 1.
    outcome, warnings : how it ended, and what to keep in mind.
    starts : all runs, best first. minima : the distinct ones that they ended in, best first, chi-square on the scale of chi2. seconds : wall time.
    """

    problem: Problem
    stack: Stack
    x: np.ndarray
    uncertainty: Uncertainty
    residuals: tuple[np.ndarray, ...]
    predictions: tuple[np.ndarray, ...]
    chi2: float = eqx.field(static=True)
    dof: int = eqx.field(static=True)
    noise: float | None = eqx.field(static=True)
    outcome: Outcome = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True)
    starts: tuple[Start, ...]
    minima: tuple[Minimum, ...]
    seconds: float = eqx.field(static=True)
    parts: tuple[Parts | None, ...] = eqx.field(static=True)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance in physical units (p, p); 0 beside numbers at a bound."""
        return self.uncertainty.covariance

    @property
    def references(self) -> tuple[Stack, ...]:
        """The fitted stacks of reference samples."""
        return tuple(sample.scene.stack(self.x) for sample in self.problem.model.samples[1:])

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix (p, p)."""
        return correlation(self.covariance)

    @property
    def chi2_reduced(self) -> float:
        """chi2/dof; NaN without degrees of freedom."""
        return self.chi2 / self.dof if self.dof > 0 else math.nan

    @property
    def parameters(self) -> dict[str, Estimate]:
        """Fitted numbers by name."""
        u = self.uncertainty
        rows = zip(self.problem.parameters, self.x, u.stderr, u.at_bound, self.parts, strict=True)
        return {p.name: Estimate(float(x), stderr, p.unit, bound, parts) for p, x, stderr, bound, parts in rows}

    def to_pandas(self) -> "pd.DataFrame":
        """Fitted numbers as a table: value, stderr (NaN at a bound or where the data say nothing), unit and at_bound, by name."""
        import pandas as pd

        rows = [[e.value, math.nan if e.stderr is None else e.stderr, e.unit, e.at_bound] for e in self.parameters.values()]
        columns = pd.Index(["value", "stderr", "unit", "at_bound"])
        return pd.DataFrame(rows, index=pd.Index(list(self.parameters), name="number"), columns=columns)

    def to_xarray(self) -> "xr.Dataset":
        """Fitted numbers by name with units and ``.stderr``, covariance and correlation, and each dataset's values and ``.fitted``."""
        import xarray as xr

        columns: dict[str, Any] = {}
        for name, e in self.parameters.items():
            columns[name] = ((), e.value, {"units": e.unit})
            columns[f"{name}.stderr"] = ((), math.nan if e.stderr is None else e.stderr, {"units": e.unit})
        square = ("number", "other")
        columns |= {"covariance": (square, self.covariance), "correlation": (square, self.correlation)}
        for d, fitted in zip(self.problem.data, self.predictions, strict=True):
            dim = f"{d.name}.place"
            columns |= {d.name: (dim, d.values), f"{d.name}.fitted": (dim, np.asarray(fitted))}
            columns |= {f"{d.name}.{column}": (dim, places) for column, places in d.geometry.places().items()}
        names = list(self.parameters)
        attrs = {"chi2": self.chi2, "degrees_of_freedom": self.dof, "outcome": self.outcome.value}
        return xr.Dataset(columns, coords={"number": names, "other": names}, attrs=attrs)

    def plot(self) -> "Figure":
        """Data, fit and residuals as a matplotlib figure."""
        from ..report.plots import plot_fit

        return plot_fit(self)

    def profile(self, name: str) -> "ProfileLikelihood":
        """Chi-square against one number, minimised over all others: see `profile_likelihood`."""
        from .profile_likelihood import profile_likelihood

        return profile_likelihood(self, name)

    def plot_correlation(self) -> "Figure":
        """The correlation matrix as a matplotlib figure."""
        from ..report.plots import plot_correlation

        return plot_correlation(self)

    def summary(self) -> str:
        """The result as plain text."""
        from ..report.tables import fit_text

        return fit_text(self)

    def save(self, folder: Any) -> dict[str, Any]:
        """Write fit.json, the fitted curves as CSV, figures and report.html into a folder; returns their paths by name."""
        from ..report.archive import save_fit

        return save_fit(self, folder)

    def __repr__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        from ..report.html import fit_fragment

        return fit_fragment(self)
