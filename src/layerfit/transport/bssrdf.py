"""The BSSRDF that renderers use, assembled from a profile."""

from typing import Any

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ..measurement.geometry import RadialReflectance
from ..predict import predict
from ..scene.columns import to_columns
from ..scene.stack import Stack
from ..solver import Solver
from .faces import beam_reflectance
from .multipole import Multipole, entering_share


def bssrdf(stack: Stack, r: Any, mu_in: Any, mu_out: Any, *, solver: Solver | None = None) -> Float[Array, "..."]:
    """S = Ft(mu_in) R(r) Ft(mu_out)/pi [1/(mm^2 sr)], Donner & Jensen 2005, eq 2; for a rough surface Ft is rho_dt, eq 25.

    r : distances between entry and exit [mm], one dimension. mu_in, mu_out : cosines of incidence and exit outside, of r's shape or scalars.
    solver : gives R(r), the multipole by default. R(r) is per unit power that has entered.

    >>> import layerfit as lf
    >>> skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.01, sigma_s_prime=1, n=1.4)])
    >>> lf.bssrdf(skin, [1.0, 2.0], 0.8, 0.6).round(5)
    Array([0.00871, 0.00253], dtype=float64)
    """
    solver = Multipole() if solver is None else solver
    columns = to_columns(stack)
    profile = predict(stack, RadialReflectance(r), solver=solver)[0].values / entering_share(columns)
    n = columns.n_above / columns.n[0]

    @jnp.vectorize
    def passing(mu: Float[Array, ""]) -> Float[Array, ""]:
        return 1.0 - beam_reflectance(mu, n, columns.roughness[0], smooth=columns.smooth[0])

    return passing(jnp.asarray(mu_in, dtype=float)) * profile * passing(jnp.asarray(mu_out, dtype=float)) / jnp.pi
