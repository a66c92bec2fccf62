"""Data as they would be measured again."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .posterior import Posterior


def replicates(posterior: "Posterior", predictions: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    """Predictions (draws, n) with the noise of the data drawn anew; where one relative noise is estimated, each draw has its own.

    Given the residuals, with a uniform prior of the logarithm, their sum of squares over that noise squared has a chi-square distribution.
    """
    rng = np.random.default_rng([posterior.seed, 2])
    problem = posterior.problem
    pairs = list(zip(problem.data, predictions, strict=True))
    relative = 1.0
    if problem.estimates_noise:
        square = np.sum([np.sum(((values - d.values) / d.values) ** 2, axis=1) for d, values in pairs], axis=0)
        relative = np.sqrt(square / rng.chisquare(sum(d.values.size for d in problem.data), size=square.size))[:, None]
    sd = [relative * np.abs(d.values) if d.sd is None else d.sd for d, _ in pairs]
    return tuple(values + s * rng.standard_normal(values.shape) for (_, values), s in zip(pairs, sd, strict=True))
