"""Point images: the part of a layered medium's response that has a closed form both in spatial frequency and in distance.

Left out in k and added in r, the sources nearest to a face carry the slowly decaying part of the spectrum; what remains is smaller and dies
out sooner. Solvers compute that remainder as a product, not as a difference: distant values then keep their digits over any range.
"""

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ..measurement.geometry import Geometry
from ..optics.special import expc


class Images(eqx.Module):
    """sum over images of exp(-gamma |z|) (flux + fluence/gamma), gamma^2 = k^2 + sigma^2.

    z : distance of each image from the face [mm], positive. flux [1] and fluence [1/mm]: strengths with which it is seen. sigma: effective
    attenuation coefficient of the medium [1/mm].
    """

    z: Float[Array, "images"]
    flux: Float[Array, "images"]
    fluence: Float[Array, "images"]
    sigma: Float[Array, ""]

    def profile(self, geometry: Geometry) -> Float[Array, "values"]:
        """The same at points or averaged over rings [1/mm^2]."""
        places = geometry.places()
        if "r" in places:
            return self.at(jnp.asarray(places["r"]))
        low, high = jnp.asarray(places["r_min"]), jnp.asarray(places["r_max"])
        return self._between(low, high) / (jnp.pi * (high**2 - low**2))

    def at(self, r: Float[Array, "r"]) -> Float[Array, "r"]:
        """Inverse Hankel transform: z (1 + sigma rho) exp(-sigma rho)/(2 pi rho^3) and exp(-sigma rho)/(2 pi rho) (DJ05 eqs 12, 13)."""
        rho = jnp.sqrt(r[:, None] ** 2 + self.z**2)
        decay = jnp.exp(-self.sigma * rho) / (2.0 * jnp.pi * rho)
        return jnp.sum(decay * (self.flux * self.z * (1.0 + self.sigma * rho) / rho**2 + self.fluence), axis=-1)

    def _between(self, low: Float[Array, "r"], high: Float[Array, "r"]) -> Float[Array, "r"]:
        """Power between two radii."""
        near, far = jnp.sqrt(low[:, None] ** 2 + self.z**2), jnp.sqrt(high[:, None] ** 2 + self.z**2)
        decay_near, decay_far = jnp.exp(-self.sigma * near), jnp.exp(-self.sigma * far)
        flux = self.z * (decay_near / near - decay_far / far)
        fluence = decay_near * (far - near) * expc(self.sigma * (far - near))
        return jnp.sum(self.flux * flux + self.fluence * fluence, axis=-1)
