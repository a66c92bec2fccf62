"""The one table that solvers read: a stack as columns over its layers."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..errors import InputError
from .layer import Layer
from .stack import Stack


class Columns(eqx.Module):
    """A stack as arrays, one row a layer (or a face), top first.

    Axis names used in shapes everywhere: layers (N), finite (N, or N - 1 above a half space), faces (finite + 1).
    """

    sigma_a: Float[Array, "layers"]  # [1/mm]
    sigma_s_prime: Float[Array, "layers"]  # [1/mm]
    g: Float[Array, "layers"]  # 0 where unknown, see g_unknown
    n: Float[Array, "layers"]
    thickness: Float[Array, "finite"]  # [mm]
    roughness: Float[Array, "faces"]  # RMS slope, upper faces and then the lowest
    n_above: Float[Array, ""]
    n_below: Float[Array, ""]
    half_space: bool = eqx.field(static=True)
    g_unknown: tuple[bool, ...] = eqx.field(static=True)  # layers written without g
    smooth: tuple[bool, ...] = eqx.field(static=True)  # faces that are known to be smooth: their cheaper formulas are used

    @property
    def count(self) -> int:
        return self.sigma_a.shape[0]

    @property
    def sigma_t_prime(self) -> Float[Array, "layers"]:
        """Reduced extinction coefficient [1/mm]."""
        return self.sigma_a + self.sigma_s_prime

    @property
    def sigma_tr(self) -> Float[Array, "layers"]:
        """Effective attenuation coefficient sqrt(3 sigma_a sigma_t') [1/mm]; its slope at sigma_a = 0 is infinite."""
        return jnp.sqrt(3.0 * self.sigma_a * self.sigma_t_prime)


def to_columns(stack: Stack, *, rough_faces: tuple[bool, ...] | None = None) -> Columns:
    """The columns of a stack.

    rough_faces : for traced roughness, which faces may be rough (default: those whose roughness is not 0).
    """
    if stack.spectral:
        raise InputError("the stack has layers of tissue, whose optics depend on the wavelength; allowed here is stack.at(wavelength)")
    faces = [layer.roughness for layer in stack.layers] + ([] if stack.half_space else [stack.roughness_below])
    smooth = tuple(not r for r in rough_faces) if rough_faces is not None else tuple(_is_zero(r) for r in faces)

    def column(values: list) -> Float[Array, "rows"]:
        if all(isinstance(v, float) for v in values):
            return jnp.asarray(np.array(values, dtype=float))  # nothing to compile
        return jnp.stack([jnp.asarray(v, dtype=float) for v in values])

    layers = stack.layers
    finite = [layer.thickness for layer in layers if isinstance(layer, Layer)]
    if all(isinstance(t, float) and t == 0.0 for t in finite) and not stack.half_space:
        raise InputError("every layer of the stack has thickness 0: there is no sample; allowed is one layer above 0")
    return Columns(
        sigma_a=column([layer.sigma_a for layer in layers]),
        sigma_s_prime=column([layer.sigma_s_prime for layer in layers]),
        g=column([0.0 if layer.g is None else layer.g for layer in layers]),
        n=column([layer.n for layer in layers]),
        thickness=column(finite),
        roughness=column(faces),
        n_above=jnp.asarray(stack.n_above, dtype=float),
        n_below=jnp.asarray(stack.n_below, dtype=float),
        half_space=stack.half_space,
        g_unknown=tuple(layer.g is None for layer in layers),
        smooth=smooth,
    )


def _is_zero(value: object) -> bool:
    return isinstance(value, float) and value == 0.0
