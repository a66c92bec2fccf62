"""The beam on its way: its direction, what a face sees of each layer, and the points where its light turns diffuse."""

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ..optics.diffusion import mean_optical_depth
from ..optics.special import expc
from ..scene.columns import Columns

Plane = tuple[Float[Array, "layers"], Float[Array, "layers"]]


def refracted(columns: Columns, mu: Float[Array, ""] | float) -> Float[Array, "layers"]:
    """Cosine of the beam in each layer."""
    if isinstance(mu, float) and mu == 1.0:
        return jnp.ones_like(columns.n)
    sine = jnp.sqrt(jnp.maximum(1.0 - jnp.asarray(mu) ** 2, 0.0)) * columns.n_above / columns.n
    return jnp.sqrt(jnp.maximum(1.0 - sine**2, 1e-12))


def seen_from_above(columns: Columns) -> Float[Array, "layers"]:
    """Weight exp(-transport optical depth) of each layer, sum 1: how much of it a face sees.

    Textbooks continue the first layer beyond the face. A first layer much thinner than a mean free path then rules the boundary alone, and at
    thickness 0 the result jumps. Weighted so, thick first layers change nothing, a layer of no thickness is nothing, and splitting one is harmless.
    """
    tau = columns.sigma_t_prime[: columns.thickness.shape[0]] * columns.thickness
    above = jnp.exp(-jnp.concatenate([jnp.zeros(1), jnp.cumsum(tau)]))
    if columns.half_space:
        return jnp.concatenate([-jnp.diff(above), above[-1:]])
    # all layers equally in the limit of a thin sample: (1 - exp(-tau))/(1 - exp(-sum)) without 0/0
    share = above[:-1] * tau * expc(tau)
    return share / jnp.sum(share)


def seen_from_below(columns: Columns) -> Float[Array, "layers"]:
    upside_down = eqx.tree_at(
        lambda c: (c.sigma_a, c.sigma_s_prime, c.thickness), columns, (columns.sigma_a[::-1], columns.sigma_s_prime[::-1], columns.thickness[::-1])
    )
    return seen_from_above(upside_down)[::-1]


def point_sources(columns: Columns, cosines: Float[Array, "layers"], share: Float[Array, "layers"] | None) -> tuple[Plane, Plane]:
    """Point sources of a beam from above and from below, see `Numbers`."""
    extinction = columns.sigma_t_prime / cosines
    fed = columns.sigma_s_prime / columns.sigma_t_prime
    if share is not None:
        fed = fed * (1.0 - share)
    down = _point_source(extinction, fed, columns.thickness, columns.half_space)
    if columns.half_space:
        return down, (jnp.zeros_like(fed), jnp.zeros_like(fed))
    strength, depth = _point_source(extinction[::-1], fed[::-1], columns.thickness[::-1], False)
    return down, (strength[::-1], depth[::-1])


def _point_source(extinction: Float[Array, "layers"], fed: Float[Array, "layers"], thickness: Float[Array, "finite"], half_space: bool) -> Plane:
    tau = extinction[: thickness.shape[0]] * thickness
    above = jnp.concatenate([jnp.zeros(1), jnp.cumsum(tau)])  # optical depth of each upper face
    if half_space:
        target = jnp.ones(())
        lost = jnp.concatenate([-jnp.expm1(-tau), jnp.ones(1)])
        inside = (above <= target) & (jnp.concatenate([above[1:], jnp.full(1, jnp.inf)]) > target)
    else:
        target = mean_optical_depth(above[-1])
        lost = -jnp.expm1(-tau)
        above = above[:-1]
        inside = (above <= target) & (above + tau > target)
        inside = inside.at[-1].set(inside[-1] | ~jnp.any(inside))
    power = jnp.sum(jnp.exp(-above) * lost * fed)
    depth = (target - above) / extinction
    return jnp.where(inside, power * jnp.exp(jnp.where(inside, above, 0.0)), 0.0), jnp.where(inside, depth, 0.0)
