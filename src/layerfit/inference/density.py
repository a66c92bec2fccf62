"""The posterior density of a problem's free numbers: what samplers draw from."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from .model import Model
from .problem import Problem


class Density(eqx.Module):
    """Logarithm of prior times likelihood.

    Called with numbers in physical units (p,); minus infinity outside the bounds. Both are normalised, except where the noise is estimated.
    """

    model: Model
    estimates_noise: bool = eqx.field(static=True)

    def __init__(self, problem: Problem):
        self.model, self.estimates_noise = problem.model, problem.estimates_noise

    def log_prior(self, x: Float[Array, "p"]) -> Float[Array, ""]:
        """Per unit of each number; minus infinity outside the bounds."""
        low, high = self.model.priors.low, self.model.priors.high
        inside = jnp.all((x >= low) & (x <= high))
        found = jnp.sum(self.model.priors.log_densities(jnp.clip(x, low, high)))
        return jnp.where(inside, found, -jnp.inf)

    def log_likelihood(self, x: Float[Array, "p"]) -> Float[Array, ""]:
        """Of the data, as the problem's likelihood and model error say."""
        return self.model.log_likelihood(x, estimates_noise=self.estimates_noise)

    def __call__(self, x: Float[Array, "p"]) -> Float[Array, ""]:
        prior = self.log_prior(x)
        inside = jnp.isfinite(prior)
        found = self.log_likelihood(jnp.clip(x, self.model.priors.low, self.model.priors.high))
        return jnp.where(inside & jnp.isfinite(found), prior + found, -jnp.inf)

    def unbounded(self, u: Float[Array, "p"]) -> Float[Array, ""]:
        """The density of the unbounded coordinates u of `Coordinates`: the same times dx/du."""
        x, slope = jax.jvp(self.model.coordinates.physical, (u,), (jnp.ones_like(u),))  # each x depends on its own u alone
        return self(x) + jnp.sum(jnp.log(slope))
