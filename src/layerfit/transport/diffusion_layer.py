"""Exact diffusion in one homogeneous layer, at one spatial frequency: its response and the light a beam feeds into it.

Across a face phi/n^2 and the flux J are continuous (phi: fluence of diffuse light). The channels are J+- = phi/(4 n^2) +- J/2, the partial
currents an index-1 gap at that place would carry: continuous as well, so that layers compose without further conditions. With
N = n^2 D and q = k^2 + sigma_a/D (the square of gamma), everything is a function of q that is analytic at 0; growing exponentials never
appear.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ..optics.special import divided_differences, log_cosh, tanhc
from .response import Beamed, Response

# sqrt(q) has an infinite slope at q = 0 (a conservative half space at k = 0, a true kink). This keeps that derivative a number - 1e150,
# infinite for every purpose - so that it cannot turn the derivatives in other directions into 0 * inf = NaN.
_TINY = 1e-300


def decay_rate(q: Float[Array, "*s"]) -> Float[Array, "*s"]:
    """gamma = sqrt q [1/mm]."""
    return jnp.sqrt(q + _TINY)


class _Slab:
    """Hyperbolic functions of one layer: t = sinh/(gamma cosh), and cosh relative to cosh over the whole thickness."""

    def __init__(self, N: Float[Array, "*s"], q: Float[Array, "*s"], d: Float[Array, "*s"]):
        self.N, self.q, self.d = N, q, d
        self.log_cosh_d = log_cosh(q * d**2)
        self.t_d = d * tanhc(q * d**2)
        self.denominator = self.t_d * (1.0 + 4.0 * N**2 * q) + 4.0 * N

    def emission(self, z: Float[Array, "*s"]) -> Float[Array, "*s"]:
        """J- leaving a face, with nothing coming back, from a plane source of strength 1 at distance z below it."""
        rest = self.d - z
        x = self.q * rest**2
        return jnp.exp(log_cosh(x) - self.log_cosh_d) * (rest * tanhc(x) + 2.0 * self.N) / self.denominator

    def reflection(self) -> Float[Array, "*s"]:
        return self.t_d * (1.0 - 4.0 * self.N**2 * self.q) / self.denominator

    def transmission(self) -> Float[Array, "*s"]:
        return 4.0 * self.N * jnp.exp(-self.log_cosh_d) / self.denominator


def point_source_layer(
    N: Float[Array, "*s"],
    q: Float[Array, "*s"],
    d: Float[Array, "*s"],
    beam: Float[Array, "*s"],
    from_above: tuple[Float[Array, "*s"], Float[Array, "*s"]],
    from_below: tuple[Float[Array, "*s"], Float[Array, "*s"]],
) -> Response[Beamed]:
    """A layer of thickness d in which a beam may feed one plane source (a point, in r).

    beam : what the layer lets through of the beam. from_above : (strength per unit of beam at the upper face, depth below it [mm]), strength
    0 where the source lies elsewhere; from_below : the same for a beam from below, distance from the lower face.
    """
    slab = _Slab(N, q, d)
    R, T = slab.reflection(), slab.transmission()
    s_down, z_down = from_above
    s_up, z_up = from_below
    zero = jnp.zeros_like(beam)
    return Response(
        R_above=Beamed(R, s_down * slab.emission(z_down), zero),
        R_below=Beamed(R, s_up * slab.emission(z_up), zero),
        T_down=Beamed(T, s_down * slab.emission(d - z_down), beam),
        T_up=Beamed(T, s_up * slab.emission(d - z_up), beam),
    )


def exponential_source_layer(
    N: Float[Array, "*s"],
    q: Float[Array, "*s"],
    d: Float[Array, "*s"],
    extinction: Float[Array, "*s"],
    scattering: Float[Array, "*s"],
) -> Response[Beamed]:
    """A layer in which the beam, losing ``extinction`` per depth [1/mm], feeds ``scattering`` [1/mm] of itself into diffuse light.

    The beam is one more channel, so the layer is the even and odd parts of a 2 x 2 triangular problem (design 3.3 with alpha + beta = 1/(2 N),
    alpha - beta = 2 N q for the diffuse channel). Divided differences keep it finite where gamma equals the extinction.
    """
    h = 0.5 * d
    x, chi = q * h**2, (extinction * h) ** 2
    phi, phi_beam = tanhc(x), tanhc(chi)
    dd_phi, dd_sech2 = divided_differences(x, chi)
    corner = -(h**2) * scattering / (2.0 * N)  # the off-diagonal element of X
    phi_source = corner * dd_phi
    zero = jnp.zeros_like(x)
    Z = Beamed(2.0 * N * q * h * phi, h * (2.0 * N * q * phi_source - scattering * phi_beam), extinction * h * phi_beam)
    Y = Beamed(h * phi / (2.0 * N), h * extinction * phi_source, extinction * h * phi_beam)
    left, right = (Y.one() + Y).inverse(), (Z.one() + Z).inverse()
    difference = Beamed(Y.diffuse - Z.diffuse, Y.source - Z.source, zero)
    R = left @ difference @ right
    sech2 = Beamed(jnp.exp(-2.0 * log_cosh(x)), corner * dd_sech2, jnp.exp(-2.0 * log_cosh(chi)))
    T = left @ sech2 @ right
    return Response(R, R, T, T)


def half_space_reflection(N: Float[Array, "*#s"], q: Float[Array, "*#s"]) -> Float[Array, "*s"]:
    """Diffuse reflection of a half space."""
    y = 2.0 * N * decay_rate(q)
    return (1.0 - y) / (1.0 + y)


def half_space_emission(N: Float[Array, "*#s"], q: Float[Array, "*#s"], z: Float[Array, "*#s"]) -> Float[Array, "*s"]:
    """J- at the face of a half space from a plane source of strength 1 at depth z."""
    gamma = decay_rate(q)
    return jnp.exp(-gamma * z) / (1.0 + 2.0 * N * gamma)


def half_space_exponential(
    N: Float[Array, "*#s"], q: Float[Array, "*#s"], extinction: Float[Array, "*#s"], scattering: Float[Array, "*#s"]
) -> Float[Array, "*s"]:
    """J- at the face of a half space fed by a beam that enters it with power 1."""
    gamma = decay_rate(q)
    return scattering / ((gamma + extinction) * (1.0 + 2.0 * N * gamma))
