"""What to keep in mind about draws, in words."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import gaussian_kde

from .judgement import LENGTHS, Judgement, SamplingOutcome
from .parameters import FreeParameter

_PILED = 0.2  # distance of the 5 % quantile from a bound, in units of the way from there to the median, below which draws are piled up at it
_VALLEY = 0.5  # height of the valley between two maxima, in units of the lower one, below which they are two
_SMALLEST = 0.05  # height of a maximum that counts, in units of the highest
_POINTS = 200


def remarks(parameters: Sequence[FreeParameter], x: np.ndarray, judgement: Judgement, steps: int) -> list[str]:
    """Sentences about draws x (draws, p) of free numbers, physical units."""
    found = _convergence([p.name for p in parameters], judgement, steps)
    for parameter, draws in zip(parameters, x.T, strict=True):
        low, middle, high = np.quantile(draws, [0.05, 0.5, 0.95])
        at_low = low - parameter.low <= _PILED * (middle - low)
        at_high = parameter.high - high <= _PILED * (high - middle)
        if at_low and at_high:
            found.append(f"{parameter.name} fills its bounds: they decide its posterior, not the data")
        elif at_low or at_high:
            side, bound = ("lower", parameter.low) if at_low else ("upper", parameter.high)
            found.append(
                f"{parameter.name} is piled up at its {side} bound ({bound:g} {parameter.unit}): its posterior says where it ends on one side only"
            )
        count = modes(draws)
        if count > 1:
            found.append(f"{parameter.name} has {count} separate likely ranges: look at its distribution, mean and sd do not describe it")
    return found


def _convergence(names: Sequence[str], judgement: Judgement, steps: int) -> list[str]:
    if judgement.outcome is SamplingOutcome.CONVERGED:
        return []
    if judgement.outcome is SamplingOutcome.DIVERGENT:
        share = 100.0 * judgement.divergent
        return [f"{share:.2g} % of the steps diverged: the posterior has corners that were not reached; narrower bounds or sampler 'emcee' may help"]
    if judgement.outcome is SamplingOutcome.DISAGREE:
        worst = int(np.argmax(judgement.r_hat))
        return [
            f"walkers disagree about {names[worst]} (split R-hat {judgement.r_hat[worst]:.3g}): the chain is too short, or there are several maxima "
            "between which they do not move; give more steps, then narrower bounds"
        ]
    worst = int(np.argmax(judgement.tau))
    needed = LENGTHS * judgement.tau[worst]
    return [
        f"{steps} steps are too few: the autocorrelation time of {names[worst]} is {judgement.tau[worst]:.3g} steps, of which {LENGTHS:g} are needed "
        f"after the beginning ({needed:.2g} steps), and the least number of independent draws is {np.min(judgement.effective):.3g}"
    ]


def modes(draws: np.ndarray) -> int:
    """Number of maxima of a distribution that are parted by a deep valley; draws (n,).

    >>> rng = np.random.default_rng(0)
    >>> modes(rng.standard_normal(1000)), modes(np.concatenate([rng.standard_normal(500), 6 + rng.standard_normal(500)]))
    (1, 2)
    """
    some = draws[:: max(len(draws) // 4000, 1)]
    if not np.ptp(some) > 0:
        return 1
    density = gaussian_kde(some)(np.linspace(np.min(some), np.max(some), _POINTS))
    peaks = [i for i in range(_POINTS) if density[i] == np.max(density[max(i - 1, 0) : i + 2]) and density[i] >= _SMALLEST * np.max(density)]
    count, last = 1, peaks[0]
    for peak in peaks[1:]:
        if np.min(density[last : peak + 1]) <= _VALLEY * min(density[last], density[peak]):
            count, last = count + 1, peak
        elif density[peak] > density[last]:
            last = peak
    return count
