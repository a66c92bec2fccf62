"""The error that a solver states of itself, as a systematic part of the data's uncertainty.

A solver says how far off each value may be, on the safe side; it is off in the same way at neighbouring distances. So the covariance of the data
grows by s^2 e_i e_j rho(x_i, x_j) with e = 0.7 times the stated error (the ratio of true to stated errors of diffusion over the Monte Carlo cases has
a root mean square of 0.68, and 5 % of the ratios are above 0.9), s its scale (1: as stated) and rho Matern's correlation of order 3/2 (Rasmussen and
Williams, Gaussian Processes for Machine Learning, eq 4.17) in the logarithm of the distance: the errors of diffusion are smooth functions of the
distance in transport mean free paths that change their sign within a factor of about 3. Against Monte Carlo neighbours agree more than an exponential
would let them, and the tails fall more slowly than those of a squared exponential, which would also claim to know that the error has no fine
structure at all. How often intervals hold the truth: docs/model-error.md.

Errors of different measurements, and of one solver on both sides of a sample, are taken as independent.
"""

from collections.abc import Sequence

import numpy as np

from ..measurement.geometry import Angular, Geometry, Radial, SpatialFrequency
from ..scene.columns import Columns
from ..solver import Forward, relative_errors

LENGTH = 0.6  # of the correlation, in the logarithm of the distance (angles: in radians)
_NEAREST, _FURTHEST = 0.05, 20.0  # transport mean free paths between which distance matters
SD = 0.7  # standard deviation of the error, as a share of that stated
_LARGEST = 3.0  # relative error above which a value says nothing any more


def stated_errors(forward: Forward, columns: Columns) -> list[np.ndarray | None]:
    """Relative error of each value that a solver states for a stack; None for a measurement of which it states none."""
    found = forward.evaluate(columns)
    shares: list[np.ndarray | None] = []
    for values, errors in zip(found.values, found.errors, strict=True):
        if errors is None:
            shares.append(None)
            continue
        shares.append(np.minimum(relative_errors(errors, values), _LARGEST))
    return shares


def abscissa(geometry: Geometry, columns: Columns) -> np.ndarray:
    """Coordinate in which errors are correlated: the logarithm of the distance (of its inverse), which ends near the source and far from it."""
    x = geometry.centers()
    mfp = 1.0 / float(np.asarray(columns.sigma_t_prime)[0])
    if isinstance(geometry, Radial):
        return np.arcsinh(x / (2.0 * _NEAREST * mfp))
    if isinstance(geometry, SpatialFrequency):
        return np.arcsinh(x * _FURTHEST * mfp / 2.0)
    return np.deg2rad(x) if isinstance(geometry, Angular) else x


def correlation(x: np.ndarray) -> np.ndarray:
    """Correlation (n, n) of the errors at coordinates x (n,)."""
    away = np.sqrt(3.0) * np.abs(x[:, None] - x) / LENGTH
    return (1.0 + away) * np.exp(-away)


def error_covariances(
    geometries: Sequence[Geometry], columns: Columns, shares: Sequence[np.ndarray | None], sizes: Sequence[np.ndarray]
) -> list[np.ndarray | None]:
    """Covariance of the model's error (n, n) for each measurement. shares : relative errors. sizes : the values that they are shares of."""
    out: list[np.ndarray | None] = []
    for geometry, share, size in zip(geometries, shares, sizes, strict=True):
        if share is None:
            out.append(None)
            continue
        error = SD * share * np.abs(size)
        out.append(np.outer(error, error) * correlation(abscissa(geometry, columns)))
    return out
