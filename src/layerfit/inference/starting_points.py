"""Where samplers begin: around the minima of a fit, as far from them as its covariance says."""

from collections.abc import Callable

import numpy as np

from ..errors import InputError
from .parameters import FreeParameter, shares
from .result import Fit

_NEAR = 18.0  # chi-square above the best one up to which a minimum gets walkers: e^-9 in density
_WIDEST = 0.15  # sd of beginnings of a number that is not determined, in shares of its interval
_AT_BOUND = 0.02  # the same, of a number at its bound
_APART = 3.0  # standard deviations between two minima that are two
_TRIES = 12


def minima(fit: Fit) -> np.ndarray:
    """Distinct minima that the data can hardly tell apart, the best one first (minima, p), physical units."""
    variance = 1.0 if fit.noise is None else fit.noise**2
    spread = np.sqrt(np.maximum(np.diag(share_covariance(fit)), 1e-24))
    found: list[np.ndarray] = []
    for start in fit.starts:
        if not (start.chi2 - fit.starts[0].chi2) / variance <= _NEAR:
            continue
        share = shares(fit.problem.parameters, start.last)
        if all(np.max(np.abs(share - other) / spread) > _APART for other in found):
            found.append(share)
    return np.array([[p.at(s) for p, s in zip(fit.problem.parameters, share, strict=True)] for share in found])


def share_covariance(fit: Fit) -> np.ndarray:
    """Covariance of positions between the bounds (p, p); what is not determined, or at its bound, is spread a little, by itself."""
    parameters = fit.problem.parameters
    slope = np.array([_share_slope(p, float(x)) for p, x in zip(parameters, fit.x, strict=True)])
    covariance = fit.covariance * np.outer(slope, slope)
    sd = np.sqrt(np.diag(covariance))
    wide = np.array([_AT_BOUND if bound else _WIDEST for bound in fit.uncertainty.at_bound])
    wanted = np.where((sd > 0) & np.isfinite(sd), np.minimum(sd, wide), wide)
    shrink = np.where(sd > 0, wanted / np.where(sd > 0, sd, 1.0), 0.0)
    covariance = np.where(np.isfinite(covariance), covariance, 0.0) * np.outer(shrink, shrink)
    covariance[np.diag_indices(len(sd))] = wanted**2
    return covariance


def starting_points(fit: Fit, log_densities: Callable[[np.ndarray], np.ndarray], count: int, batch: int, seed: int) -> np.ndarray:
    """Where to begin (count, p), physical units, inside the bounds and where the density is above 0: in turn around each minimum.

    log_densities : of positions (batch, p).

    Raises InputError where no such place is found.
    """
    rng = np.random.default_rng([seed, 1])
    parameters = fit.problem.parameters
    centers = minima(fit)
    covariance = share_covariance(fit)
    values, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(values, 0.0))
    found = []
    for number, center in enumerate(centers):
        wanted = len(range(number, count, len(centers)))
        share = np.clip(shares(parameters, center), 1e-6, 1.0 - 1e-6)
        good: list[np.ndarray] = []
        near: list[tuple[float, np.ndarray]] = []
        for attempt in range(_TRIES):
            places = _reflected(share + rng.standard_normal((batch, len(parameters))) @ root.T * 0.7**attempt)
            x = np.array([[p.at(s) for p, s in zip(parameters, row, strict=True)] for row in places])
            near += [(float(density), row) for density, row in zip(log_densities(x), x, strict=True) if np.isfinite(density)]
            least = max((density for density, _ in near), default=0.0) - 10.0 - 2.0 * len(parameters)
            good = [row for density, row in near if density >= least]
            if len(good) >= wanted and attempt > 0:
                break
        if len(good) < wanted:
            raise InputError(
                f"around the fitted numbers only {len(good)} of {wanted} places were found where the posterior is above 0; "
                "look at the fit first, its bounds and its warnings"
            )
        found.append(rng.permutation(good)[:wanted])
    return np.array([found[i % len(centers)][i // len(centers)] for i in range(count)])


def _share_slope(parameter: FreeParameter, x: float) -> float:
    """d share/dx."""
    low, high = parameter.ends
    return 1.0 / ((high - low) * (max(x, parameter.low) if parameter.log else 1.0))


def _reflected(shares: np.ndarray) -> np.ndarray:
    """Positions outside 0 to 1 thrown back inside."""
    inside = np.abs(shares) % 2.0
    return np.clip(np.where(inside > 1.0, 2.0 - inside, inside), 1e-9, 1.0 - 1e-9)
