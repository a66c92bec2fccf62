"""The posterior density of a problem's free numbers: what samplers draw from."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from .model import Model
from .problem import Problem


class Density(eqx.Module):
    """Logarithm of prior times likelihood, up to a constant.

    Called with numbers in physical units (p,); minus infinity outside the bounds.
    """

    model: Model
    estimates_noise: bool = eqx.field(static=True)

    def __init__(self, problem: Problem):
        self.model, self.estimates_noise = problem.model, problem.estimates_noise

    def log_prior(self, x: Float[Array, "p"]) -> Float[Array, ""]:
        """Uniform between the bounds."""
        low, high = self._ends()
        return jnp.where(jnp.all((x >= low) & (x <= high)), 0.0, -jnp.inf)

    def log_likelihood(self, x: Float[Array, "p"]) -> Float[Array, ""]:
        """Gaussian; where the data have no sd, integrated over one relative noise whose logarithm is uniform."""
        pairs = zip(self.model.predict(x), self.model.values, self.model.sd, strict=True)
        residuals = jnp.concatenate([(predicted - values) / sd for predicted, values, sd in pairs])
        square = jnp.sum(residuals**2)
        return -0.5 * residuals.size * jnp.log(square) if self.estimates_noise else -0.5 * square

    def __call__(self, x: Float[Array, "p"]) -> Float[Array, ""]:
        prior = self.log_prior(x)
        inside = jnp.isfinite(prior)
        low, high = self._ends()
        found = self.log_likelihood(jnp.clip(x, low, high))
        return jnp.where(inside & jnp.isfinite(found), prior + found, -jnp.inf)

    def unbounded(self, u: Float[Array, "p"]) -> Float[Array, ""]:
        """The density of the unbounded coordinates u of `Coordinates`: the same times dx/du."""
        x, slope = jax.jvp(self.model.coordinates.physical, (u,), (jnp.ones_like(u),))  # each x depends on its own u alone
        return self(x) + jnp.sum(jnp.log(slope))

    def _ends(self) -> tuple[Float[Array, "p"], Float[Array, "p"]]:
        low, high, log = self.model.coordinates.low, self.model.coordinates.high, self.model.coordinates.log
        return jnp.where(log, jnp.exp(jnp.where(log, low, 0.0)), low), jnp.where(log, jnp.exp(jnp.where(log, high, 0.0)), high)
