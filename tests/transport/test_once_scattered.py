"""Light scattered once: its total in closed form, its profile against its spectrum."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import j0

import layerfit as lf
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain
from layerfit.transport.once_scattered import Lit, even_azimuths, even_directions, exact_path, profile, spectrum
from layerfit.transport.ordinate_stack import lay_out, medium

AZIMUTHS = even_azimuths(64)


def lit_of(stack, above=True):
    """The exact part without delta-M: as many moments as isotropic scattering needs."""
    columns = to_columns(stack)
    layout = lay_out(Domain(stack, columns, columns), 16, 1, (None,) * columns.count)
    return Lit(columns, medium(layout, columns), layout, None, above)


def test_total_of_a_half_space():
    """omega/2 (1 - ln 2), by integration: isotropic scattering, a face that mirrors nothing."""
    lit = lit_of(lf.Stack([lf.HalfSpace("deep", sigma_a=0.2, sigma_s=0.8, g=0.0, n=1.0)]))
    path = exact_path(lit, *even_directions(192))
    exact = 0.5 * 0.8 * (1.0 - np.log(2.0))
    assert abs(float(spectrum(path, jnp.asarray(1e-9), *AZIMUTHS)) / exact - 1.0) <= 1e-4
    low, high = np.array([0.0, 1.0]), np.array([1.0, 1e4])
    power = np.asarray(profile(lit, low, high)) * np.pi * (high**2 - low**2)
    assert abs(power.sum() / exact - 1.0) <= 1e-4


@pytest.mark.parametrize("above", [True, False])
def test_profile_and_spectrum_of_layers_have_the_same_total_and_spread(above):
    """Through two layers of different index, up and down: power, and mean square distance from the bend of the spectrum at k = 0."""
    stack = lf.Stack(
        [
            lf.Layer("a", sigma_a=0.3, sigma_s=1.0, g=0.0, n=1.3, thickness=0.8),
            lf.Layer("b", sigma_a=0.1, sigma_s=2.0, g=0.0, n=1.5, thickness=0.5),
        ]
    )
    lit = lit_of(stack, above)
    path = exact_path(lit, *even_directions(192))
    edges = np.concatenate([[0.0], np.geomspace(1e-3, 300.0, 4000)])
    low, high = edges[:-1], edges[1:]
    power = np.asarray(profile(lit, low, high)) * np.pi * (high**2 - low**2)
    whole, bent = (float(spectrum(path, jnp.asarray(k), *AZIMUTHS)) for k in (1e-9, 0.02))
    assert abs(power.sum() / whole - 1.0) <= 1e-6
    middle = np.sqrt(0.5 * (low**2 + high**2))
    assert abs((power @ j0(0.02 * middle)) / bent - 1.0) <= 1e-5


LAYERS = (
    lf.Layer("a", sigma_a=0.1, sigma_s=20.0, g=0.9, n=1.4, thickness=0.2),
    lf.Layer("b", sigma_a=0.1, sigma_s=5.0, g=0.9, n=1.33, thickness=0.4),
)


@pytest.mark.parametrize("above", [True, False])
def test_narrow_rings_have_slopes(above):
    """At one distance, which few directions lead to: by thickness, index and scattering, compiled forward derivatives are those of differences.

    Directions common to all rings leave slopes by thickness ten times too large, of either sign.
    """
    deep = [lf.HalfSpace("deep", sigma_a=0.01, sigma_s=10.0, g=0.8, n=1.5)] if above else []
    lit = lit_of(lf.Stack([*LAYERS, *deep]), above)
    r = np.array([0.1, 0.3])

    def where(columns):
        return columns.thickness, columns.n, columns.sigma_s_prime

    sizes = [x.size for x in where(lit.columns)]

    def values(x):
        columns = eqx.tree_at(where, lit.columns, tuple(jnp.split(x, np.cumsum(sizes)[:-1])))
        return profile(Lit(columns, medium(lit.layout, columns), lit.layout, None, above), r * (1 - 5e-4), r * (1 + 5e-4))

    x = jnp.concatenate(where(lit.columns))
    slopes, f = np.asarray(jax.jit(jax.jacfwd(values))(x)), jax.jit(values)
    assert np.all(np.isfinite(slopes))
    for i in range(x.size):
        step = jnp.zeros_like(x).at[i].set(1e-6)
        difference = np.asarray(f(x + step) - f(x - step)) / 2e-6
        assert np.all(np.abs(difference - slopes[:, i]) <= 1e-4 * np.max(np.abs(slopes), axis=1)), i


def test_narrow_rings_are_their_wide_ones():
    """The mean over a wide ring is that over the rings it is made of, at a bend of the profile too (0.2 mm, where the first layer ends)."""
    lit = lit_of(lf.Stack(list(LAYERS)), False)
    edges = np.linspace(0.1, 0.3, 65)
    area = edges[1:] ** 2 - edges[:-1] ** 2
    parts = np.asarray(profile(lit, edges[:-1], edges[1:]))
    whole = float(profile(lit, edges[:1], edges[-1:])[0])
    assert abs(parts @ area / area.sum() / whole - 1.0) <= 1e-5
