"""Light that crosses a layer unscattered, on all directions between a few ordinates."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.special import expn, k1

import layerfit as lf
from layerfit.optics.quadrature import ordinates
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain
from layerfit.transport.crossing import Crossing, fine_directions, rays, rays_between
from layerfit.transport.frequency_layer import closing, coupling
from layerfit.transport.once_scattered import Lit, profile
from layerfit.transport.ordinate_stack import medium

ORDERS, DEPTH = 4, 2.0


def crossing(k, rate=0.0, n=(1.0, 1.0), counts=(6,)):
    """Of a layer of the last index, with the square roots of the ordinates' weights."""
    groups = tuple(sorted(set(n)).index(each) for each in n)
    rule = ordinates(jnp.array(n), groups, counts)
    real, mu = rule.real[1], rule.mu[1]
    root = jnp.sqrt(jnp.where(real, rule.W, 0.0))
    tangent = jnp.where(real, jnp.sqrt(1.0 - jnp.minimum(mu**2, 1.0)) / mu, 0.0)
    fine = fine_directions(rule, counts, 1)
    chain = closing(ORDERS, np.full(sum(counts), 0.7))
    depth = jnp.asarray(DEPTH)
    found = Crossing(rays(jnp.asarray(k), rate / mu, tangent, depth, chain), rays_between(fine, 0, jnp.asarray(k), jnp.asarray(rate), depth, ORDERS))
    return found, np.asarray(root)


@pytest.mark.parametrize(("n", "counts"), [((1.0, 1.0), (6,)), ((1.0, 1.4), (5, 4)), ((1.4, 1.0), (5, 4))])
def test_a_clear_layer_in_even_light_is_the_identity(n, counts):
    """Directions that the layer does not have do not cross."""
    found, root = crossing(0.0, n=n, counts=counts)
    whole = np.asarray(found.whole).reshape(ORDERS * root.size, -1)
    assert np.max(np.abs(whole - np.kron(np.eye(ORDERS), np.diag(root > 0.0)))) <= 1e-12
    if n[1] >= n[0]:
        assert np.max(np.abs(found.lacking())) <= 1e-12


@pytest.mark.parametrize("k", [0.05, 0.5, 1.0, 2.0, 4.0])
def test_spot_of_an_evenly_bright_point(k):
    """It has the spectrum k d K_1(k d); the ordinates alone have rings, J_0 of a few tangents."""
    found, root = crossing(k)
    exact = k * DEPTH * k1(k * DEPTH)
    light = np.zeros((ORDERS, root.size))
    light[0] = root
    assert abs(2.0 * float(root @ found(light)[0]) - exact) <= 4e-3
    if k >= 2.0:
        assert abs(2.0 * float(root @ found._replace(whole=None)(light)[0]) - exact) >= 4e-2


def test_even_light_through_an_absorbing_layer():
    """2 E_3 of its optical thickness."""
    found, root = crossing(0.0, rate=0.4)
    light = np.zeros((ORDERS, root.size))
    light[0] = root
    assert abs(2.0 * float(root @ found(light)[0]) - 2.0 * expn(3, 0.4 * DEPTH)) <= 1e-8


def test_nothing_is_left_of_waves_too_short_to_tell():
    """Where directions next to each other differ by whole periods."""
    found, root = crossing(100.0)
    light = np.zeros((ORDERS, root.size))
    light[0] = root
    assert np.max(np.abs(found(light))) <= 1e-3


@pytest.mark.parametrize(("to", "from_"), [(0, 0), (1, 0), (0, 1), (2, 0), (1, 3), (2, 3)])
def test_orders_turn_into_each_other_as_on_a_long_chain(to, from_):
    """Radiance that is the same in all directions but for cos(m phi), in an absorbing layer, against the exponential of 120 orders."""
    k, rate = 0.3, 0.4
    found, root = crossing(k, rate)
    light = np.zeros((ORDERS, root.size))
    light[from_] = root

    def crossed(mu):
        x = k * DEPTH * np.sqrt(1.0 - mu**2) / mu
        return mu * np.exp(-rate * DEPTH / mu) * expm(-min(x, 60.0) * coupling(120))[to, from_]

    exact = quad(crossed, 1e-3, 1.0, epsabs=1e-6)[0]
    assert abs(float(root @ found(light)[to]) - exact) <= 2e-4


def test_what_the_rays_lack_completes_them():
    found, root = crossing(1.0, rate=0.2)
    light = np.arange(1.0, 1.0 + ORDERS * root.size).reshape(ORDERS, -1)
    both = np.asarray(found.lacking()) @ light.ravel() + np.asarray(found._replace(whole=None)(light)).ravel()
    assert np.max(np.abs(both - np.asarray(found(light)).ravel())) <= 1e-12 * np.max(np.abs(both))
    assert found._replace(whole=None).lacking() == 0.0


def test_no_rings_behind_a_layer_that_hardly_scatters():
    """Dense under clear: with the rays alone 24 and 32 streams differ by up to 6 % where their rings lie."""
    stack = lf.Stack(
        [
            lf.Layer("clear", sigma_a=0.01, sigma_s=0.5, g=0.2, n=1.4, thickness=2.0),
            lf.Layer("dense", sigma_a=0.05, sigma_s=10.0, g=0.2, n=1.4, thickness=1.0),
        ]
    )
    geometry = lf.RadialReflectance(r=np.geomspace(1.0, 8.0, 24))
    few, more = (lf.predict(stack, geometry, solver=lf.DiscreteOrdinates(streams=s, orders=4, frequencies=32))[0].values for s in (24, 32))
    jax.clear_caches()
    assert np.max(np.abs(few / more - 1.0)) <= 5e-3


@pytest.mark.parametrize("side", ["R", "T"])
def test_light_scattered_once_is_taken_out_as_it_went_in(side):
    """Where nothing is scattered twice, R(r) and T(r) are the exact profile of light scattered once, whatever the ordinates make of it."""
    layers = [
        lf.Layer("a", sigma_a=0.3, sigma_s=1e-5, g=0.4, n=1.4, thickness=0.8),
        lf.Layer("b", sigma_a=0.5, sigma_s=2e-5, g=0.4, n=1.4, thickness=2.5),
        lf.Layer("c", sigma_a=0.4, sigma_s=1e-5, g=0.4, n=1.4, thickness=1.0),
    ]
    stack = lf.Stack(layers, n_above=1.0 if side == "R" else 1.4, n_below=1.4)  # no face sends light back to where it is looked for
    low, high = np.array([0.5, 1.0, 2.0]), np.array([0.6, 1.2, 2.5])
    geometry = (lf.RadialReflectance if side == "R" else lf.RadialTransmittance)(r_min=low, r_max=high)
    columns = to_columns(stack)
    forward = lf.DiscreteOrdinates(streams=8, orders=3, frequencies=16).forward(Domain(stack, columns, columns), [geometry], [(0.0, 0.0)])
    assert any(forward.plans[0].open)
    layout = forward.plans[0].layout
    exact = profile(Lit(columns, medium(layout, columns), layout, None, side == "R"), low, high)
    assert np.max(np.abs(np.asarray(forward(columns)[0]) / np.asarray(exact) - 1.0)) <= 3e-3
