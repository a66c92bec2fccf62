"""The multipole as Donner & Jensen 2005 (DJ05) publish it: a sum over images in real space.

It tests the closed form of `multipole`, and for a single slab it is the better formula at distances where R is below 1e-12 of its peak.
"""

from typing import Any

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ..errors import InputError
from ..scene.columns import to_columns
from ..scene.layer import Layer
from ..scene.stack import Stack
from .diffusion_layer import decay_rate
from .faces import Reflection
from .images import Images
from .multipole import slabs


def image_positions(
    d: Float[Array, ""], l: Float[Array, ""], zb0: Float[Array, ""], zb1: Float[Array, ""], pairs: int
) -> tuple[Float[Array, "images"], Float[Array, "images"]]:
    """Depths of the real (+) and mirrored (-) sources below the lit face [mm], i = -pairs..pairs (DJ05 eqs 11, 15, 16)."""
    shift = 2.0 * jnp.arange(-pairs, pairs + 1) * (d + zb0 + zb1)
    return shift + l, shift - l - 2.0 * zb0


def slab_images(stack: Stack, *, pairs: int = 1000, from_below: bool = False, reflection: Reflection = "exact") -> tuple[Images, Images]:
    """The images of a slab as seen from the lit face (R) and from the other (T), for light that has entered it.

    Raises InputError for anything but one layer of finite thickness.
    """
    if len(stack.layers) != 1 or not isinstance(stack.layers[0], Layer):
        raise InputError(f"slab_images: {len(stack.layers)} layers or a half space were given; allowed is one layer of finite thickness")
    (slab,) = slabs(to_columns(stack), reflection)
    assert slab.d is not None
    zb0, zb1 = (slab.zb1, slab.zb0) if from_below else (slab.zb0, slab.zb1)
    real, virtual = image_positions(slab.d, slab.l, zb0, zb1, pairs)
    z = jnp.concatenate([real, virtual])
    sign = jnp.concatenate([jnp.ones_like(real), -jnp.ones_like(virtual)])
    sigma = decay_rate(slab.sigma_a / slab.D)

    def seen(height: Float[Array, "images"]) -> Images:
        side = jnp.where(height >= 0.0, 1.0, -1.0)  # a source in the face itself counts as below it
        return Images(jnp.abs(height), 0.5 * slab.alpha * sign * side, jnp.zeros_like(height), sigma)

    return seen(z), seen(slab.d - z)


def image_sum(
    stack: Stack, r: Any, *, pairs: int = 1000, from_below: bool = False, reflection: Reflection = "exact"
) -> tuple[Float[Array, "r"], Float[Array, "r"]]:
    """R(r) and T(r) of a slab [1/mm^2] per unit power that has entered it, by DJ05 eqs 11 to 16.

    r : distances [mm]. pairs : dipoles on each side of the first. from_below : lit from below; R is then what leaves through the bottom.

    >>> import layerfit as lf
    >>> slab = lf.Stack([lf.Layer("slab", sigma_a=0.01, sigma_s_prime=1, n=1.4, thickness=5)])
    >>> R, T = lf.image_sum(slab, [1.0, 5.0])
    >>> R.round(6), T.round(6)
    (Array([0.029545, 0.001073], dtype=float64), Array([0.003991, 0.000901], dtype=float64))
    """
    reflected, transmitted = slab_images(stack, pairs=pairs, from_below=from_below, reflection=reflection)
    r = jnp.atleast_1d(jnp.asarray(r, dtype=float))
    return reflected.at(r), transmitted.at(r)
