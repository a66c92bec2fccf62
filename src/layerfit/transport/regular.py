"""Light that crosses a stack as a beam: never scattered, and only through smooth faces."""

from typing import Literal, NamedTuple

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from ..scene.columns import Columns
from .discrete_ordinates_interface import fresnel_shares
from .response import Response, Scalar, compose_all, reflection

Face = Literal["above", "below"]
SIDES = ("above", "below")


class Regular(NamedTuple):
    """Shares of a beam, by direction. surface_above, surface_below : what the first face mirrors. above, below : what deeper faces return; down, up :
    what passes. (Regular reflection and transmission are the CIE's names for what stays a beam.)"""

    surface_above: Float[Array, "d"]
    surface_below: Float[Array, "d"]
    above: Float[Array, "d"]
    below: Float[Array, "d"]
    down: Float[Array, "d"]
    up: Float[Array, "d"]


def regular(
    columns: Columns, tau: Float[Array, "finite"], n: Float[Array, "media"], mu: Float[Array, "media d"], real: Bool[Array, "media d"]
) -> Regular:
    """Shares of beams whose directions are given by their cosines in all media.

    tau : optical thickness of the finite layers. real : whether a medium has the direction. Rough faces let no beam through and mirror none.
    """
    nothing = Scalar(jnp.zeros(mu.shape[1]))
    pieces = []
    for i in range(n.shape[0] - 1):
        if columns.smooth[i]:
            back, under, through = (Scalar(x) for x in fresnel_shares(n[i], n[i + 1], mu[i], mu[i + 1], real[i], real[i + 1]))
            pieces.append(Response(back, under, through, through))
        else:
            pieces.append(Response(nothing, nothing, nothing, nothing))
        if i < tau.shape[0]:
            passing = Scalar(jnp.exp(-tau[i] / mu[i + 1]))
            pieces.append(Response(nothing, nothing, passing, passing))
    first, last = pieces[0].R_above.value, pieces[-1].R_below.value
    if columns.half_space:
        zero = nothing.value
        return Regular(first, zero, reflection(pieces).value - first, zero, zero, zero)
    whole = compose_all(pieces)
    return Regular(first, last, whole.R_above.value - first, whole.R_below.value - last, whole.T_down.value, whole.T_up.value)
