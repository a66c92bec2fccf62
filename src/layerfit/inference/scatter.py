"""How the values of one dataset scatter about a prediction, as functions of it: what is compiled."""

import math
from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.scipy.linalg import solve_triangular
from jax.scipy.special import gammaln
from jaxtyping import Float

from ..arrays import AnyArray

_LOG_2PI = math.log(2.0 * math.pi)


class Scatter(eqx.Module):
    """The measured values (n,) and their sd, which for least squares and figures every kind has."""

    square: ClassVar[bool] = False  # whether the logarithm of its density is a sum of squares
    values: Float[AnyArray, "n"]
    sd: Float[AnyArray, "n"]

    @property
    def independent(self) -> bool:
        """Whether each value scatters by itself."""
        return True

    def weighted(self, difference: Float[AnyArray, "n"]) -> Float[AnyArray, "n"]:
        """Prediction minus value as independent numbers of sd 1: residuals of a least-squares fit."""
        return difference / self.sd

    def unweighted(self, residual: Float[AnyArray, "n *p"]) -> Float[AnyArray, "n *p"]:
        """The inverse of `weighted`, column by column."""
        return self.sd.reshape(-1, *[1] * (residual.ndim - 1)) * residual

    def informative(self, slopes: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "n p"]:
        """Rows whose square is the Fisher information, from slopes of the predictions."""
        return np.stack([np.asarray(self.weighted(column)) for column in slopes.T], axis=1)

    @property
    def spread(self) -> Float[AnyArray, "n"]:
        """Standard deviation of each value, all parts together."""
        return self.sd

    @abstractmethod
    def misfit(self, predicted: Float[AnyArray, "n"], scale: Any = 1.0) -> Float[AnyArray, ""]:
        """Chi-square, or the deviance that stands for it: 0 for a perfect prediction. scale : of the model error."""

    @abstractmethod
    def log_density(self, predicted: Float[AnyArray, "n"], scale: Any = 1.0) -> Float[Array, ""]:
        """Logarithm of the probability (density) of the values."""


class NormalScatter(Scatter):
    """Independent or correlated normal errors, and an error of the model beside them.

    covariance : of the noise (n, n) where it is correlated. error : stated error of the model as a covariance (n, n). whitening : inverse of the
    lower Cholesky factor of both together; all three None where the values are independent.
    """

    square: ClassVar[bool] = True
    covariance: Float[AnyArray, "n n"] | None
    error: Float[AnyArray, "n n"] | None
    whitening: Float[AnyArray, "n n"] | None

    def __init__(self, values: np.ndarray, sd: np.ndarray, covariance: np.ndarray | None = None, error: np.ndarray | None = None):
        self.values, self.sd, self.covariance, self.error = values, sd, covariance, error
        self.whitening = None
        if covariance is not None or error is not None:
            factor = np.linalg.cholesky(self.total(1.0))
            self.whitening = np.linalg.solve(factor, np.eye(len(values)))

    @property
    def independent(self) -> bool:
        return self.whitening is None

    def noise(self) -> Float[AnyArray, "n n"]:
        """Covariance of the noise alone."""
        return np.diag(np.asarray(self.sd) ** 2) if self.covariance is None else self.covariance

    def total(self, scale: Any) -> Any:
        """Covariance at a scale of the model error."""
        return self.noise() if self.error is None else self.noise() + scale**2 * self.error

    def weighted(self, difference: Float[AnyArray, "n"]) -> Float[AnyArray, "n"]:
        return difference / self.sd if self.whitening is None else self.whitening @ difference

    def unweighted(self, residual: Float[AnyArray, "n *p"]) -> Float[AnyArray, "n *p"]:
        if self.whitening is None:
            return super().unweighted(residual)
        return np.linalg.solve(np.asarray(self.whitening), np.asarray(residual))

    @property
    def spread(self) -> Float[AnyArray, "n"]:
        return np.sqrt(np.diag(self.total(1.0)))

    def misfit(self, predicted: Float[AnyArray, "n"], scale: Any = 1.0) -> Float[AnyArray, ""]:
        return self._parts(predicted - self.values, scale)[0]

    def log_density(self, predicted: Float[AnyArray, "n"], scale: Any = 1.0) -> Float[Array, ""]:
        square, log_volume = self._parts(predicted - self.values, scale)
        return -0.5 * square - log_volume - 0.5 * predicted.size * _LOG_2PI

    def _parts(self, difference: Float[AnyArray, "n"], scale: Any) -> tuple[Any, Any]:
        """Chi-square and half the logarithm of the covariance's determinant."""
        if self.error is None or (isinstance(scale, float) and scale == 1.0):
            volume = jnp.sum(jnp.log(self.sd)) if self.whitening is None else -jnp.sum(jnp.log(jnp.diag(self.whitening)))
            return jnp.sum(self.weighted(difference) ** 2), volume
        noise = jnp.diag(self.sd**2) if self.covariance is None else self.covariance
        factor = jnp.linalg.cholesky(noise + scale**2 * self.error)
        return jnp.sum(solve_triangular(factor, difference, lower=True) ** 2), jnp.sum(jnp.log(jnp.diag(factor)))


class StudentScatter(Scatter):
    """Student's t with nu degrees of freedom and scale sd: few values may be far off."""

    nu: Float[AnyArray, ""]

    def informative(self, slopes: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "n p"]:
        """K. L. Lange, R. J. A. Little, J. M. G. Taylor, J. Am. Stat. Assoc. 84, 881 (1989), appendix B: (nu + 1)/(nu + 3) of the normal one."""
        return math.sqrt(float(self.nu + 1.0) / float(self.nu + 3.0)) * super().informative(slopes)

    def misfit(self, predicted: Float[AnyArray, "n"], scale: Any = 1.0) -> Float[AnyArray, ""]:
        return jnp.sum((self.nu + 1.0) * jnp.log1p(self.weighted(predicted - self.values) ** 2 / self.nu))

    def log_density(self, predicted: Float[AnyArray, "n"], scale: Any = 1.0) -> Float[Array, ""]:
        one = gammaln(0.5 * (self.nu + 1.0)) - gammaln(0.5 * self.nu) - 0.5 * jnp.log(self.nu * math.pi)
        return predicted.size * one - jnp.sum(jnp.log(self.sd)) - 0.5 * self.misfit(predicted)


class PoissonScatter(Scatter):
    """Counts; exposure : counts expected for a value of 1. A prediction at or below 0 counts as the smallest number there is."""

    exposure: Float[AnyArray, "n"]

    def _counts(self, predicted: Float[AnyArray, "n"]) -> tuple[Any, Any]:
        counts = jnp.round(self.values * self.exposure)
        least = 1e-12 * jnp.max(counts)
        return counts, jnp.maximum(predicted * self.exposure, least + 1e-300)

    def misfit(self, predicted: Float[AnyArray, "n"], scale: Any = 1.0) -> Float[AnyArray, ""]:
        counts, expected = self._counts(predicted)
        seen = jnp.where(counts > 0, counts, 1.0)
        return 2.0 * jnp.sum(expected - counts + jnp.where(counts > 0, counts * jnp.log(seen / expected), 0.0))

    def log_density(self, predicted: Float[AnyArray, "n"], scale: Any = 1.0) -> Float[Array, ""]:
        counts, expected = self._counts(predicted)
        return jnp.sum(counts * jnp.log(expected) - expected - gammaln(counts + 1.0))
