"""What sampling gives: draws of the free numbers, what they are worth, and what to keep in mind."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import numpy as np
from jax import Array
from jaxtyping import Float

from ..arrays import AnyArray
from ..compilation import compiled
from .chain import Chain
from .judgement import Judgement, SamplingOutcome
from .model import Model
from .posterior_remarks import remarks
from .problem import Problem
from .result import Fit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BLOCK = 50  # predictions of one compiled call


class Posterior(eqx.Module):
    """The result of `sample`.

    Attributes
    ----------
    fit : from which walkers began. problem : what was sampled, with the solver that the fit ended with.
    x : kept draws in physical units (walkers, draws, p), numbers in the order of problem.names. log_density : at them (walkers, draws).
    divergent : whether the way there diverged (walkers, draws).
    judgement : autocorrelation times, effective size and agreement of walkers, from all steps.
    steps : done by each walker, its beginning included; largest_steps : asked for.
    outcome, warnings : how it ended, and what to keep in mind. seconds : wall time of this run.
    settings : all that decided the draws, as text.
    """

    fit: Fit
    x: np.ndarray
    log_density: np.ndarray
    divergent: np.ndarray
    judgement: Judgement
    steps: int = eqx.field(static=True)
    largest_steps: int = eqx.field(static=True)
    sampler: str = eqx.field(static=True)
    seed: int = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True)
    settings: Mapping[str, str] = eqx.field(static=True)
    seconds: float = eqx.field(static=True)

    @staticmethod
    def from_chain(fit: Fit, chain: Chain, judgement: Judgement, said: Callable[[np.ndarray], list[str]], **more: Any) -> "Posterior":
        """The draws of a chain that a judgement keeps. said : what a sampler says of its draws. more : fields that describe the run."""
        kept = judgement.kept
        x = np.swapaxes(chain.x[kept], 0, 1)
        return Posterior(
            fit=fit,
            x=x,
            log_density=chain.log_density[kept].T,
            divergent=chain.divergent[kept].T,
            judgement=judgement,
            steps=chain.count,
            warnings=(*remarks(fit.problem.parameters, x.reshape(-1, x.shape[2]), judgement, chain.count), *said(x.reshape(-1, x.shape[2]))),
            **more,
        )

    @property
    def problem(self) -> Problem:
        """What was sampled."""
        return self.fit.problem

    @property
    def outcome(self) -> SamplingOutcome:
        """How it ended."""
        return self.judgement.outcome

    @property
    def draws(self) -> dict[str, np.ndarray]:
        """Kept draws by name, all walkers one after the other, physical units."""
        return {name: self.x[:, :, i].ravel() for i, name in enumerate(self.problem.names)}

    @property
    def units(self) -> dict[str, str]:
        """Unit of each number."""
        return {p.name: p.unit for p in self.problem.parameters}

    def table(self) -> dict[str, dict[str, float]]:
        """For each number mean, sd, median, q05 and q95 (5 and 95 % quantiles), mcse (Monte Carlo error of the mean), ess and r_hat, by ArviZ."""
        from .inference_data import summary_table

        return summary_table(self)

    def predictions(self, count: int = 400) -> tuple[np.ndarray, ...]:
        """What the model gives at `count` draws picked evenly, for each dataset (count, n); no noise."""
        flat = self.x.reshape(-1, self.x.shape[2])
        picked = flat[np.linspace(0, len(flat) - 1, min(count, len(flat))).astype(int)]
        blocks = []
        for begin in range(0, len(picked), _BLOCK):
            block = picked[begin : begin + _BLOCK]
            filled = np.concatenate([block, np.repeat(block[-1:], _BLOCK - len(block), axis=0)])
            blocks.append([np.asarray(values)[: len(block)] for values in _predictions(self.problem.model, filled)])
        return tuple(np.concatenate(parts) for parts in zip(*blocks, strict=True))

    def to_arviz(self) -> Any:
        """An ArviZ InferenceData: groups posterior (variables named like the numbers, units as attributes), sample_stats, posterior_predictive (the
        data that would be measured again), predictions of the model alone, and observed_data.
        """
        from .inference_data import inference_data

        return inference_data(self)

    def plot(self) -> "Figure":
        """Every number and every pair of them (corner plot) as a matplotlib figure."""
        from ..report.posterior_plots import plot_corner

        return plot_corner(self)

    def plot_trace(self) -> "Figure":
        """The walkers' ways as a matplotlib figure."""
        from ..report.posterior_plots import plot_trace

        return plot_trace(self)

    def plot_predictive(self) -> "Figure":
        """Data under the bands of the model's predictions as a matplotlib figure."""
        from ..report.posterior_plots import plot_predictive

        return plot_predictive(self)

    def summary(self) -> str:
        """The result as plain text."""
        from ..report.posterior_table import posterior_text

        return posterior_text(self)

    def save(self, folder: Any) -> dict[str, Path]:
        """Write posterior.nc, posterior.json, posterior.txt, figures and report.html (of fit and posterior); returns their paths by name."""
        from ..report.posterior_archive import save_posterior

        return save_posterior(self, folder)

    def __repr__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        from ..report.html import posterior_fragment

        return posterior_fragment(self)


@compiled
def _predictions(model: Model, x: Float[AnyArray, "m p"]) -> tuple[Float[Array, "m n"], ...]:
    return jax.lax.map(model.predict, x)
