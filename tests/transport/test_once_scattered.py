"""Light scattered once: its total in closed form, its profile against its spectrum."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import j0

import layerfit as lf
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain
from layerfit.transport.once_scattered import even_azimuths, exact_path, profile, spectrum
from layerfit.transport.ordinate_stack import lay_out, medium

AZIMUTHS = even_azimuths(64)


def path_of(stack, above=True):
    """The exact part without delta-M: as many moments as isotropic scattering needs."""
    columns = to_columns(stack)
    layout = lay_out(Domain(stack, columns, columns), 16, 1, (None,) * columns.count)
    return exact_path(columns, medium(layout, columns), layout, None, above, 192)


def test_total_of_a_half_space():
    """omega/2 (1 - ln 2), by integration: isotropic scattering, a face that mirrors nothing."""
    path = path_of(lf.Stack([lf.HalfSpace("deep", sigma_a=0.2, sigma_s=0.8, g=0.0, n=1.0)]))
    exact = 0.5 * 0.8 * (1.0 - np.log(2.0))
    assert abs(float(spectrum(path, jnp.asarray(1e-9), *AZIMUTHS)) / exact - 1.0) <= 1e-4
    low, high = np.array([0.0, 1.0]), np.array([1.0, 1e4])
    power = np.asarray(profile(path, low, high)) * np.pi * (high**2 - low**2)
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
    path = path_of(stack, above)
    edges = np.concatenate([[0.0], np.geomspace(1e-3, 300.0, 4000)])
    low, high = edges[:-1], edges[1:]
    power = np.asarray(profile(path, low, high)) * np.pi * (high**2 - low**2)
    whole, bent = (float(spectrum(path, jnp.asarray(k), *AZIMUTHS)) for k in (1e-9, 0.02))
    assert abs(power.sum() / whole - 1.0) <= 1e-6
    middle = np.sqrt(0.5 * (low**2 + high**2))
    assert abs((power @ j0(0.02 * middle)) / bent - 1.0) <= 1e-5
