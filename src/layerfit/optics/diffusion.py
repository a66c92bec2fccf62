"""Coefficients of diffusion theory from those of transport theory.

sigma_a and sigma_s' [1/mm] in, D [mm] or dimensionless weights out. ``g`` only enters through the second moment of the phase function
(Henyey-Greenstein: g^2); where g is unknown, g = 1 stands for the limit of strongly forward scattering, which tissue is close to.
"""

from typing import Literal

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

DiffusionCoefficient = Literal["asymptotic", "transport", "scattering", "grosjean"]


def diffusion_coefficient(
    kind: DiffusionCoefficient,
    sigma_a: Float[Array, "*s"],
    sigma_s_prime: Float[Array, "*s"],
    g: Float[Array, "*s"],
) -> Float[Array, "*s"]:
    """D [mm] by one of its usual definitions, sigma_t' = sigma_a + sigma_s'.

    transport   1/(3 sigma_t')
    scattering  1/(3 sigma_s'), absorption left out
    grosjean    (2 sigma_a + sigma_s')/(3 sigma_t'^2), d'Eon & Irving 2011
    asymptotic  1/(3 sigma_t' (1 - 0.8 sigma_a/sigma_2)), sigma_2 = sigma_a + sigma_s' (1 + g): gives the decay rate of transport theory
                far from all sources to second order in absorption (Aronson & Corngold 1999)
    """
    sigma_t_prime = sigma_a + sigma_s_prime
    if kind == "transport":
        return 1.0 / (3.0 * sigma_t_prime)
    if kind == "scattering":
        return 1.0 / (3.0 * sigma_s_prime)
    if kind == "grosjean":
        return (2.0 * sigma_a + sigma_s_prime) / (3.0 * sigma_t_prime**2)
    sigma_2 = sigma_a + sigma_s_prime * (1.0 + g)
    return 1.0 / (3.0 * sigma_t_prime * (1.0 - 0.8 * sigma_a / sigma_2))


def exponential_share(g: Float[Array, "*s"]) -> Float[Array, "*s"]:
    """Share w of the source that follows the beam's exponential, the rest being at transport depth 1: w = (1 - g)/(1 + g).

    In transport theory a beam entering an infinite, weakly absorbing medium looks from afar like a monopole, a dipole of length 1/sigma_t'
    and a quadrupole <z^2> - <x^2> = 2/(sigma_t' sigma_2), sigma_2 = sigma_t' (1 + g): the moment equations of the spherical-harmonics
    expansion give all three exactly. A point at depth 1/sigma_t' has the quadrupole 1/sigma_t'^2, an exponential source 2/sigma_t'^2; the
    mixture with share w of the exponential has the right one: 1 + w = 2/(1 + g).
    """
    return (1.0 - g) / (1.0 + g)


@jax.jit
def mean_optical_depth(tau: Float[Array, ""]) -> Float[Array, ""]:
    """Mean transport optical depth at which a beam is scattered in a sample of optical thickness tau: 1 - tau/(exp(tau) - 1).

    1 for a thick sample (the transport optical depth 1 of the half space), tau/2 for a thin one; always inside.
    """
    small = tau < 1e-2
    safe = jnp.where(small, 1.0, jnp.minimum(tau, 700.0))
    series = tau / 2.0 - tau**2 / 12.0 + tau**4 / 720.0
    return jnp.where(small, series, 1.0 - safe / jnp.expm1(safe))
