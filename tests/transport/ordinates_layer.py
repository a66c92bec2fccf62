"""One layer of a medium between others, straight from the formulas: no solver, no interface."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from layerfit.optics.phase import delta_m, henyey_greenstein_moments, legendre_functions
from layerfit.optics.quadrature import ordinates
from layerfit.transport.discrete_ordinates_layer import Directions, deep_layer, layer, problem, scattering

ORDERS = 4


def posed(x, order, count, panels, terms):
    """x: g, albedo, tau, n, cosine of the beam. Lines of sight: an ordinate, the beam's own direction, one beside it."""
    g, albedo, n, mu_beam = x[0], x[1], x[3], x[4]
    indices = jnp.stack([jnp.asarray(1.0), n])[2 - panels :]
    rule = ordinates(indices, tuple(range(panels)), (count,) * panels)
    root, own = jnp.sqrt(rule.W), rule.mu[-1]
    mu = jnp.concatenate([own, jnp.stack([own[2], mu_beam, mu_beam * 1.001, mu_beam])])
    directions = Directions(mu, jnp.concatenate([root, jnp.ones(4)]) / mu / n, root)
    chi = henyey_greenstein_moments(g, terms + 1)
    left, scaled, moments = delta_m(albedo, chi[:terms], chi[terms])
    m = jnp.asarray(float(order))
    kernel = scattering(moments, legendre_functions(mu, terms, ORDERS)[order], directions, m, 1)
    return problem(kernel, directions, scaled, (1.0 - albedo) / left, m), x[2] * left, root


@partial(jax.jit, static_argnums=(1, 2, 3, 4))
def response(x, order=0, count=16, panels=1, terms=32):
    """R and T over all channels, and the root of the weights."""
    problem, tau, root = posed(x, order, count, panels, terms)
    parts = layer(problem, tau)
    return jnp.stack([parts.R_above.value, parts.T_down.value]), root


@partial(jax.jit, static_argnums=(1, 2, 3, 4))
def deep(x, order=0, count=16, panels=1, terms=32):
    problem, _, root = posed(x, order, count, panels, terms)
    return deep_layer(problem).value, root


def totals(operator, root):
    """Share of the beam, and of diffuse light, that an operator passes on."""
    n = root.shape[0]
    operator, root = np.asarray(operator)[3:, 3:], np.asarray(root)
    return root @ operator[:n, n] + operator[n, n], root @ operator[:n, :n] @ root / np.sum(root**2)
