"""Which of several models the data speak for."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc

from ..errors import InputError
from .fit import jacobians_at
from .result import Fit, Outcome
from .uncertainty import linear_covariance, natural_scales

_STRENGTH = ((2.0, "weak"), (6.0, "moderate"), (10.0, "strong"), (math.inf, "decisive"))  # by the difference of AICc
_DECIDES = 0.9  # leverage from which one value alone holds a number


class Candidate(eqx.Module):
    """One model.

    numbers : how many are free, an estimated noise included. log_likelihood : at the fit. aic, aicc, bic : the lower the better. weight : Akaike
    weight from aicc. elpd, elpd_se : expected log predictive density by leave-one-out and its standard error, the higher the better. pointwise : its
    terms, one a value.
    """

    name: str = eqx.field(static=True)
    fit: Fit
    numbers: int = eqx.field(static=True)
    log_likelihood: float = eqx.field(static=True)
    aic: float = eqx.field(static=True)
    aicc: float = eqx.field(static=True)
    bic: float = eqx.field(static=True)
    weight: float = eqx.field(static=True)
    elpd: float = eqx.field(static=True)
    elpd_se: float = eqx.field(static=True)
    pointwise: np.ndarray


class ModelComparison(eqx.Module):
    """The result of `compare_models`. candidates : best AICc first. sentence : what they say. notes : what to keep in mind."""

    candidates: tuple[Candidate, ...]
    sentence: str = eqx.field(static=True)
    notes: tuple[str, ...] = eqx.field(static=True)

    @property
    def best(self) -> Candidate:
        """The model with the lowest AICc."""
        return self.candidates[0]

    def table(self) -> list[dict[str, Any]]:
        """One row a model, plain numbers, null where there is none."""
        from ..report.model_comparison_table import model_rows

        return model_rows(self)

    def summary(self) -> str:
        """The comparison as plain text."""
        from ..report.model_comparison_table import model_text

        return model_text(self)

    def __repr__(self) -> str:
        return self.summary()


def compare_models(fits: Mapping[str, Fit], *, pointwise: Mapping[str, Any] | None = None) -> ModelComparison:
    """Compare fits of the same data: information criteria, and how well each predicts a value that was left out.

    Left out by linearisation: with the weighted residual r and the leverage h of a value (the diagonal of the hat matrix), the value is predicted by
    all others with residual r/(1 - h) and variance 1/(1 - h).

    Arguments
    ---------
    fits : by the name of the model. pointwise : by the same names, log predictive densities (n,) from posteriors instead, as
        ``arviz.loo(..., pointwise=True).loo_i`` gives them (PSIS-LOO).

    Raises InputError for fewer than two fits, fits of different data, a fit without finite residuals, or (where pointwise is not given)
    one whose errors are not independent and normal.

    References
    ----------
    K. P. Burnham, D. R. Anderson, Sociol. Methods Res. 33, 261 (2004); G. Schwarz, Ann. Stat. 6, 461 (1978); A. Vehtari, A. Gelman, J. Gabry, Stat.
    Comput. 27, 1413 (2017), eqs 4, 23.

    >>> import layerfit as lf
    >>> data = lf.Dataset(lf.RadialReflectance(r=[1, 2, 4, 8]), [0.0215, 0.00929, 0.00231, 0.000347], noise=lf.Noise(relative=0.02))
    >>> skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.02, sigma_s_prime=1, n=1.4)])
    >>> both = {"skin.sigma_a": (1e-3, 1), "skin.sigma_s_prime": (0.1, 10)}
    >>> one = lf.fit(lf.Problem(skin, data, free={"skin.sigma_a": (1e-3, 1)}, solver=lf.LayeredDiffusion()))
    >>> two = lf.fit(lf.Problem(skin, data, free=both, solver=lf.LayeredDiffusion()))
    >>> lf.compare_models({"scattering held": one, "both free": two}).best.name
    'scattering held'
    """
    if len(fits) < 2:
        raise InputError(f"compare_models: {len(fits)} fit was given; allowed are two or more")
    names = list(fits)
    for name, fit in fits.items():
        if not isinstance(fit, Fit):
            raise InputError(f"compare_models: '{name}' is a {type(fit).__name__}; allowed are results of lf.fit")
        if fit.outcome is Outcome.NOT_FINITE:
            raise InputError(f"compare_models: '{name}' has no finite residuals; fit it again")
        different = _difference(fits[names[0]], fit)
        if different:
            raise InputError(
                f"compare_models: '{name}' and '{names[0]}' are fits of different data ({different}); only fits of the same can be compared"
            )
    scores = {} if pointwise is None else {name: np.asarray(score, dtype=float).ravel() for name, score in pointwise.items()}
    size = sum(d.geometry.size for d in next(iter(fits.values())).problem.data)
    for name, score in scores.items():
        if name not in fits or score.shape != (size,) or not np.all(np.isfinite(score)):
            raise InputError(
                f"compare_models: pointwise '{name}' with {score.size} numbers; allowed are names of the fits and {size} finite numbers each"
            )
    if scores and set(scores) != set(names):
        raise InputError("compare_models: pointwise for some fits only; allowed is for all, or for none")
    candidates = [_candidate(name, fit, scores.get(name)) for name, fit in fits.items()]
    aicc = np.array([c.aicc for c in candidates])
    if not np.any(np.isfinite(aicc)):
        raise InputError("compare_models: every model has as many free numbers as there are values; more values would tell")
    weights = np.exp(-0.5 * (aicc - np.min(aicc)))
    weights = weights / np.sum(weights)
    candidates = [_weighted(c, float(w)) for c, w in zip(candidates, weights, strict=True)]
    candidates.sort(key=lambda c: c.aicc)
    return ModelComparison(tuple(candidates), _sentence(candidates), tuple(_notes(candidates)))


def _weighted(candidate: Candidate, weight: float) -> Candidate:
    values = {name: getattr(candidate, name) for name in candidate.__dataclass_fields__}
    return Candidate(**{**values, "weight": weight})


def _difference(one: Fit, other: Fit) -> str:
    """What differs between the data of two fits, "" where nothing does."""
    first, second = one.problem.data, other.problem.data
    if len(first) != len(second):
        return f"{len(first)} and {len(second)} measurements"
    for a, b in zip(first, second, strict=True):
        if a.geometry.kind != b.geometry.kind or not eqx.tree_equal(a.geometry, b.geometry):
            return f"'{a.name}' and '{b.name}' are measured differently"
        if not np.array_equal(a.values, b.values):
            return f"values of '{a.name}'"
        if (a.sd is None) != (b.sd is None) or (a.sd is not None and b.sd is not None and not np.array_equal(a.sd, b.sd)):
            return f"sd of '{a.name}'"
    return ""


def _candidate(name: str, fit: Fit, score: np.ndarray | None) -> Candidate:
    n = sum(d.geometry.size for d in fit.problem.data)
    numbers = fit.x.size + (1 if fit.problem.estimates_noise else 0)
    if fit.noise is None:
        scale = 1.0 if fit.problem.model.error_scale is None else float(fit.x[fit.problem.model.error_scale])
        pairs = zip(fit.problem.model.scatter, fit.predictions, strict=True)
        likelihood = sum(float(one.log_density(predicted, scale)) for one, predicted in pairs)
    else:
        variance = max(fit.chi2 * fit.noise**2 / n, 1e-300)  # the most likely one, not the unbiased
        weights = np.concatenate([np.asarray(sd) for sd in fit.problem.model.sd])
        likelihood = -0.5 * n * (math.log(2.0 * math.pi * variance) + 1.0) - float(np.sum(np.log(weights)))
    aic = 2.0 * numbers - 2.0 * likelihood
    aicc = aic + 2.0 * numbers * (numbers + 1) / (n - numbers - 1) if n > numbers + 1 else math.inf
    pointwise = _left_out(name, fit) if score is None else score
    return Candidate(
        name=name,
        fit=fit,
        numbers=numbers,
        log_likelihood=likelihood,
        aic=aic,
        aicc=aicc,
        bic=numbers * math.log(n) - 2.0 * likelihood,
        weight=0.0,
        elpd=float(np.sum(pointwise)),
        elpd_se=float(np.sqrt(n * np.var(pointwise))),
        pointwise=pointwise,
    )


def _left_out(name: str, fit: Fit) -> Float[np.ndarray, "n"]:
    """Log predictive density of each value from all others, by linearisation."""
    if not (fit.problem.least_squares and all(one.independent for one in fit.problem.model.scatter)):
        raise InputError(
            f"compare_models: '{name}': values left out one by one are predicted for independent normal errors alone; "
            "give pointwise, from samples of the posteriors (arviz.loo)"
        )
    residual = np.concatenate(fit.residuals)
    weights = np.concatenate([np.asarray(sd) for sd in fit.problem.model.sd])
    free = ~np.array(fit.uncertainty.at_bound)
    noise = 1.0 if fit.noise is None else fit.noise
    jacobian = jacobians_at(fit.problem, fit.x[None])[0] / noise  # priors are rows too
    scaled = (jacobian * natural_scales(fit.problem.parameters, fit.x))[:, free]
    leverage = np.zeros(len(scaled))
    if scaled.shape[1]:
        leverage = np.einsum("np,pq,nq->n", scaled, linear_covariance(scaled[None], np.ones(1))[0], scaled)
    rest = np.clip(1.0 - leverage[: residual.size], 1e-9, 1.0)
    return 0.5 * np.log(rest / (2.0 * math.pi)) - 0.5 * residual**2 / rest - np.log(weights * noise)


def _sentence(candidates: Sequence[Candidate]) -> str:
    best, second = candidates[0], candidates[1]
    gap = second.aicc - best.aicc
    strength = next(word for limit, word in _STRENGTH if gap < limit or limit == math.inf)
    if math.isinf(gap):
        return f"{best.name}: {second.name} has as many free numbers as there are values, and cannot be judged"
    head = f"'{best.name}' describes the data better than '{second.name}': AICc lower by {gap:.3g}, the evidence is {strength}"
    if strength == "weak":
        head = f"the data hardly tell '{best.name}' from '{second.name}': AICc lower by {gap:.2g} for the first, the evidence is weak"
    by_bic = min(candidates, key=lambda c: c.bic)
    difference = best.pointwise - second.pointwise
    se = float(np.sqrt(difference.size * np.var(difference)))
    bic = "BIC agrees" if by_bic is best else f"BIC prefers {by_bic.name} by {best.bic - by_bic.bic:.3g}"
    better = "better" if np.sum(difference) >= 0 else "worse"
    return f"{head}; {bic}; it predicts values left out {better} by {abs(float(np.sum(difference))):.3g} ± {se:.2g} (log density)"


def _notes(candidates: Sequence[Candidate]) -> list[str]:
    notes = []
    best = candidates[0].fit
    if best.noise is None and best.dof > 0 and chdtrc(best.dof, best.chi2) < 1e-3:
        notes.append(
            f"even {candidates[0].name} does not describe the data within their sd: chi-square {best.chi2:.4g} for {best.dof} degrees of freedom"
        )
    for c in candidates:
        if c.fit.outcome is not Outcome.CONVERGED:
            notes.append(f"{c.name}: the fit did not converge ({c.fit.outcome.value})")
        if any(c.fit.uncertainty.at_bound):
            notes.append(f"{c.name}: numbers at a bound are counted as free all the same")
        if any(not sd <= 0.3 for sd in c.fit.uncertainty.relative):
            notes.append(f"{c.name}: some numbers are not determined; they cost as much as those that are")
    return notes
