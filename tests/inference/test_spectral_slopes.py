"""Derivatives of spectra to many amounts, taken through the few columns of each wavelength, are those taken straight."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import layerfit as lf
from layerfit.inference.model import Scene
from layerfit.solver import Domain
from layerfit.wavelengths import columns_at, over_wavelengths

WAVELENGTH = np.array([480.0, 520.0, 560.0, 600.0, 640.0])
SKIN = lf.TissueLayer("epidermis", melanin=0.02, a=4.6, b=1.4, g=0.8, n=1.4, thickness=0.1) | lf.TissueHalfSpace(
    "dermis", blood=0.01, saturation=0.6, water=0.65, baseline=0.5, a=5.0, b=1.2, g=0.8, n=1.4
)
FREE = {
    "epidermis.melanin": (1e-3, 0.6),
    "epidermis.thickness": (0.05, 0.2),
    "dermis.blood": (5e-4, 0.2),
    "dermis.saturation": (0.0, 1.0),
    "dermis.water": (0.0, 1.0),
    "dermis.baseline": (0.0, 5.0),
    "dermis.a": (1.0, 20.0),
    "dermis.b": (0.0, 4.0),
}
GEOMETRIES = [lf.TotalReflectance(), lf.TotalReflectance(incidence=40.0, specular="included")]
STRAIGHT = 0  # with so few numbers columns never pay


@pytest.fixture(scope="module")
def values():
    """Values as a function of the free numbers, by how many they are said to be; and the numbers."""
    data = [lf.Dataset(lf.Spectrum(WAVELENGTH, g), np.full(5, 0.3), np.full(5, 0.01), name=str(i)) for i, g in enumerate(GEOMETRIES)]
    problem = lf.Problem(SKIN, data, free=FREE, solver=lf.DiscreteOrdinates(streams=8))
    scene: Scene = problem.model.samples[0].scene
    columns = jax.tree.map(lambda c: c[0], columns_at(SKIN, WAVELENGTH))
    forward = lf.DiscreteOrdinates(streams=8).forward(Domain(SKIN.at(500.0), columns, columns), GEOMETRIES, [(0.0, 0.0)] * 2)

    def by(numbers):
        return lambda x: jnp.concatenate(over_wavelengths(forward, scene.columns_at(x, WAVELENGTH), numbers))

    return by, jnp.array([p.init for p in problem.parameters])


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_slopes(values, mode):
    by, x = values
    straight = jax.jit(mode(by(STRAIGHT)))(x)
    found = jax.jit(mode(by(x.size)))(x)
    assert found.shape == (10, len(FREE))
    assert np.all(np.max(np.abs(straight), axis=1) > 0.0)
    assert np.max(np.abs(found - straight)) <= 1e-11 * np.max(np.abs(straight))


def test_in_a_batch(values):
    """Of several stacks at once, as many fits take them."""
    by, x = values
    rows = jnp.stack([x, 1.1 * x])
    found = jax.jit(jax.vmap(jax.jacfwd(by(x.size))))(rows)
    straight = jnp.stack([jax.jit(jax.jacfwd(by(STRAIGHT)))(row) for row in rows])
    assert np.max(np.abs(found - straight)) <= 1e-11 * np.max(np.abs(straight))


def test_values(values):
    """As they come with the slopes."""
    by, x = values
    along = jnp.ones_like(x)
    found, _ = jax.jit(lambda x: jax.jvp(by(x.size), (x,), (along,)))(x)
    assert np.max(np.abs(found - jax.jit(by(STRAIGHT))(x))) <= 1e-14
