"""What a face between the sample and its surroundings does to diffuse light and to a beam."""

from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..optics.fresnel import diffuse_moments, egan_hilgeman, mismatch, reflectance
from ..optics.microfacet import rough_moments, rough_reflectance

Reflection = Literal["exact", "egan-hilgeman"]

_X, _W = np.polynomial.legendre.leggauss(24)
_X, _W = 0.5 * (_X + 1.0), 0.5 * _W


class Face(eqx.Module):
    """One face, seen from inside the sample.

    R1, R2 : reflected parts of diffuse fluence and flux. A : (1 + R2)/(1 - R1).
    exit_fluence, exit_flux : what leaves is exit_fluence phi + exit_flux J, J the outward flux.
    """

    R1: Float[Array, ""]
    R2: Float[Array, ""]
    A: Float[Array, ""]
    exit_fluence: Float[Array, ""]
    exit_flux: Float[Array, ""]


def face(
    n_inside: Float[Array, ""],
    n_outside: Float[Array, ""],
    roughness: Float[Array, ""],
    *,
    smooth: bool,
    reflection: Reflection = "exact",
    na: float | None = None,
) -> Face:
    """Moments of the reflectance of a face.

    smooth : the roughness is known to be 0 and the exact moments are used. reflection : "egan-hilgeman" takes the polynomial of DJ05 with
    A = (1 + R1)/(1 - R1). na : numerical aperture, in the outer medium, within which light is collected (None: all of it); the face is
    taken as smooth for that restriction.
    """
    n = n_inside / n_outside
    if reflection == "egan-hilgeman":
        R1 = R2 = egan_hilgeman(n)
    elif smooth:
        R1, R2 = diffuse_moments(n)
    else:
        R1, R2 = rough_moments(n, roughness)
    if na is None:
        exit_fluence, exit_flux = 0.25 * (1.0 - R1), 0.5 * (1.0 - R2)
    else:
        exit_fluence, exit_flux = _cone(n, na / n_outside)
    return Face(R1, R2, mismatch(R1, R2), exit_fluence, exit_flux)


def _cone(n: Float[Array, ""], sine: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """exit_fluence and exit_flux for directions outside with a sine below the given one (at most 1)."""
    low = jnp.sqrt(jnp.maximum(1.0 - jnp.minimum(sine, 1.0) ** 2, 0.0))
    mu_out = low + (1.0 - low) * _X
    weight = (1.0 - low) * _W * (1.0 - reflectance(mu_out, 1.0 / n)) * mu_out / n**2
    mu_in = jnp.sqrt(jnp.maximum(1.0 - (1.0 - mu_out**2) / n**2, 0.0))
    return 0.5 * jnp.sum(weight), 1.5 * jnp.sum(weight * mu_in)


def beam_reflectance(mu: Float[Array, ""], n: Float[Array, ""], roughness: Float[Array, ""], *, smooth: bool) -> Float[Array, ""]:
    """Share of a beam at cosine mu that a face sends back; n: index on the beam's side over that beyond."""
    return reflectance(mu, n) if smooth else rough_reflectance(mu, n, roughness)
