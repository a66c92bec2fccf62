"""What a user should keep in mind beside a fit's numbers, in sentences."""

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc

from ..errors import InputError
from ..scene.stack import Stack
from ..wavelengths import posed
from .parameters import FreeParameter
from .problem import Problem
from .result import Minimum
from .scatter import StudentScatter
from .uncertainty import UNDETERMINED, Uncertainty, verdicts

_NEAR = 9.0  # difference of chi-square below which two minima are hardly told apart
_APART = 2.0  # standard errors by which a number in another minimum must differ to be named


def on_starts(best: float, others: Sequence[float], count: int) -> list[str]:
    """Of starts that ended elsewhere. best, others : chi-squares. count : of all starts."""
    if not others:
        return []
    rival = min(others)
    near = ", which the data can hardly tell apart" if rival - best < _NEAR else ""
    reached = f"{count - len(others)} of {count} starts reached the best minimum (chi-square {best:.4g})"
    return [f"{reached}; the next one has {rival:.4g}{near}"]


def rivals(parameters: Sequence[FreeParameter], minima: Sequence[Minimum], known: Uncertainty) -> list[str]:
    """What other minima, nearly as good, say of the numbers, where it is beyond the standard error."""
    said = []
    for other in minima[1:]:
        if other.chi2 - minima[0].chi2 < _NEAR:
            rows = zip(parameters, minima[0].x.tolist(), other.x.tolist(), known.stderr, strict=True)
            apart = [f"{p.name} = {there:.4g}" for p, x, there, sd in rows if sd is None or abs(there - x) > _APART * sd]
            if apart:
                more = other.chi2 - minima[0].chi2
                said.append(f"another minimum, its chi-square higher by only {more:.2g}, has {', '.join(apart)}: beyond the standard errors given")
    return said


def on_numbers(parameters: Sequence[FreeParameter], x: np.ndarray, known: Uncertainty, *, rivalled: bool) -> list[str]:
    """Of numbers at a bound or not determined, and of combinations left open. rivalled : whether another minimum is nearly as good."""
    said = []
    for parameter, bound, value in zip(parameters, known.at_bound, x, strict=True):
        if bound:
            side = "lower" if value - parameter.low < parameter.high - value else "upper"
            where = f"{parameter.name} is at its {side} bound ({value:.4g} {parameter.unit})"
            said.append(f"{where}; it has no standard error, and those of the others allow for its moving inside")
    beyond = any(not sd <= UNDETERMINED for sd in known.relative)
    if (beyond or rivalled) and any(p.name.endswith(".amplitude") for p in parameters):
        said.append("ill-posed: these data are relative (the amplitude is free) and do not determine all numbers; rely on none of them alone")
    return [*said, *verdicts(parameters, known.relative), *known.directions]


def on_quality(problem: Problem, chi2: float, dof: int, noise: float | None) -> list[str]:
    """Of the fit as a whole, and of what is part of its uncertainty."""
    said, contradicted = [], False
    if noise is not None:
        said.append(f"the data have no sd: one relative noise was estimated from the fit, {noise:.2g}")
    elif not any(isinstance(one, StudentScatter) for one in problem.model.scatter) and chdtrc(max(dof, 1), chi2) < 1e-3:
        contradicted = True
        said.append(
            f"chi-square {chi2:.4g} for {dof} degrees of freedom: the model does not describe the data within their sd, or the sd are too small"
        )
    if dof <= 0 and not contradicted:
        said.append("as many free parameters as values: the quality of the fit cannot be judged")
    if problem.model_error != "off":
        for dataset, one in zip(problem.data, problem.model.scatter, strict=True):
            if getattr(one, "error", None) is None:
                said.append(f"solver {problem.chosen.name} states no error of {dataset.name}: its model error is not part of the uncertainty")
    if problem.model.priors.hierarchical:
        said.append("priors depend on free numbers: the maximum of the density is no summary of such a hierarchy; sample it")
    return said


def on_solver(problem: Problem, stack: Stack) -> list[str]:
    """Of the solver at the fitted stack."""
    said = []
    for dataset in problem.data[: problem.model.samples[0].count]:
        for one in posed(stack, dataset.geometry):
            try:
                problem.chosen.check(*one)
            except InputError as error:
                said.append(f"at the fitted values: {error}")
            said.extend(problem.chosen.notes(*one))
    return [*dict.fromkeys(said), *problem.choice.notes]
