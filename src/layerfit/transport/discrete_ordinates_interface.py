"""Interfaces between two media in discrete ordinates: the same channels on both sides (see `discrete_ordinates_layer`)."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from ..optics.fresnel import matched_reflectance
from .matrix import Matrix
from .response import Response


def fresnel_shares(
    n_above: Float[Array, ""],
    n_below: Float[Array, ""],
    mu_above: Float[Array, "c"],
    mu_below: Float[Array, "c"],
    real_above: Bool[Array, "c"],
    real_below: Bool[Array, "c"],
) -> tuple[Float[Array, "c"], Float[Array, "c"], Float[Array, "c"]]:
    """Reflected from above, from below, and transmitted share of each channel [1].

    Directions on both sides are matched by Snell's law. mu : cosines on the two sides. real : whether a side has the direction; where only one has
    it, reflection is total.
    """
    both = real_above & real_below
    one = jnp.ones_like(mu_above)
    back = matched_reflectance(jnp.where(both, mu_above, one), jnp.where(both, mu_below, one), n_above / n_below)
    return (
        jnp.where(both, back, jnp.where(real_above, 1.0, 0.0)),
        jnp.where(both, back, jnp.where(real_below, 1.0, 0.0)),
        jnp.where(both, 1.0 - back, 0.0),
    )


def smooth_interface(above: Float[Array, "c"], below: Float[Array, "c"], through: Float[Array, "c"]) -> Response[Matrix]:
    """Fresnel reflection and refraction from the shares of `fresnel_shares`: each channel for itself."""
    crossing = Matrix(jnp.diag(through))
    return Response(Matrix(jnp.diag(above)), Matrix(jnp.diag(below)), crossing, crossing)
