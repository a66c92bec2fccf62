"""Functions that stay accurate and differentiable where the textbook form is 0/0 or overflows.

All of them take ``x = (gamma h)^2`` rather than ``gamma h``: layer formulas are even in ``gamma h``, hence analytic in ``x`` at 0, where
``gamma`` itself (a square root) has no derivative.
"""

import math

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

# Below _SMALL the convergent of Lambert's continued fraction tanh(sqrt x)/sqrt x = 1/(1 + x/(3 + x/(5 + ...))) that ends with 13, good to 1e-17.
_SMALL = 0.1
_ABOVE, _BELOW = (135135.0, 17325.0, 378.0, 1.0), (135135.0, 62370.0, 3150.0, 28.0)


def _cubic(c: tuple[float, ...], x: Float[Array, "*s"]) -> Float[Array, "*s"]:
    return c[0] + x * (c[1] + x * (c[2] + x * c[3]))


def _slope_of_cubic(c: tuple[float, ...], u: Float[Array, "*s"], v: Float[Array, "*s"]) -> Float[Array, "*s"]:
    """Its divided difference between u and v."""
    return c[1] + c[2] * (u + v) + c[3] * (u * u + v * (u + v))


@jax.jit
def tanhc(x: Float[Array, "*s"]) -> Float[Array, "*s"]:
    """tanh(sqrt x)/sqrt x for x >= 0, analytic at 0 [dimensionless]."""
    small = x < _SMALL
    root = jnp.sqrt(jnp.where(small, 1.0, x))
    x = jnp.where(small, x, 0.0)
    return jnp.where(small, _cubic(_ABOVE, x) / _cubic(_BELOW, x), jnp.tanh(root) / root)


@jax.jit
def log_cosh(x: Float[Array, "*s"]) -> Float[Array, "*s"]:
    """log cosh(sqrt x) for x >= 0. Ratios of hyperbolic functions are exponentials of its differences: nothing overflows."""
    return _log_cosh(x)


@jax.custom_jvp
def _log_cosh(x: Float[Array, "*s"]) -> Float[Array, "*s"]:
    root = jnp.sqrt(x)
    return root + jnp.log1p(jnp.exp(-2.0 * root)) - math.log(2.0)


@_log_cosh.defjvp
def _log_cosh_jvp(primals, tangents):
    (x,), (dx,) = primals, tangents
    return _log_cosh(x), 0.5 * tanhc(x) * dx


@jax.jit
def expc(y: Float[Array, "*s"]) -> Float[Array, "*s"]:
    """(1 - exp(-y))/y for y >= 0, equal to 1 at y = 0."""
    half = tanhc(0.25 * y * y)
    return half / (1.0 + 0.5 * y * half)


@jax.jit
def divided_differences(x1: Float[Array, "*s"], x2: Float[Array, "*s"]) -> tuple[Float[Array, "*s"], Float[Array, "*s"]]:
    """Divided differences of `tanhc` and of sech^2(sqrt x) between x1 and x2, finite and accurate when they coincide.

    Returns ``(f(x1) - f(x2))/(x1 - x2)`` for both functions. They are what a triangular 2 x 2 matrix argument needs: the off-diagonal
    element of f([[x1, c], [0, x2]]) is c times this. With a = sqrt(min), b = sqrt(max),

        tanhc:  (sinhc(b - a) sech a sech b - tanhc(a^2)) / (b (a + b))
        sech^2: -sinhc(b - a) sech a sech b (tanh a + tanh b) / (a + b)

    for small x the differences of the fraction's two polynomials are, which have no cancellation.
    """
    low, high = jnp.minimum(x1, x2), jnp.maximum(x1, x2)
    small = high < _SMALL
    u, v = jnp.where(small, low, 0.0), jnp.where(small, high, 0.0)
    fu, fv = (_cubic(_ABOVE, x) / _cubic(_BELOW, x) for x in (u, v))
    dd_tanhc_small = (_slope_of_cubic(_ABOVE, u, v) - fv * _slope_of_cubic(_BELOW, u, v)) / _cubic(_BELOW, u)
    dd_sech2_small = -(fu**2 + v * (fu + fv) * dd_tanhc_small)

    # low may be 0 here while high is not. The formulas are even in its root a, but the slope of the root is infinite at 0: a shift that is
    # invisible in the value keeps their slope, which a lower limit would make 0
    a = jnp.sqrt(jnp.where(small, 1.0, low + jnp.where(low < 1e-6, 3e-15, 0.0)))
    b = jnp.sqrt(jnp.where(small, 1.0, high))
    ea, eb = jnp.exp(-2.0 * a), jnp.exp(-2.0 * b)
    bridge = 4.0 * ea * expc(2.0 * (b - a)) / ((1.0 + ea) * (1.0 + eb))  # sinhc(b - a) sech a sech b
    ta, tb = tanhc(jnp.where(small, 1.0, low)), jnp.tanh(b)
    dd_tanhc = (bridge - ta) / (b * (a + b))
    dd_sech2 = -bridge * (a * ta + tb) / (a + b)
    return jnp.where(small, dd_tanhc_small, dd_tanhc), jnp.where(small, dd_sech2_small, dd_sech2)
