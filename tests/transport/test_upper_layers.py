"""Layers that nobody can see are left out, in all stacks that a model must serve, and that is said."""

import numpy as np
import pytest

import layerfit as lf
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain
from layerfit.transport.upper_layers import visible_layers

NEAR = lf.RadialReflectance(r=[0.6, 1.0, 2.0, 3.0])


def stack(thickness=8.0, sigma_a=0.3):
    """A thick absorbing layer over two others."""
    return lf.Stack(
        [
            lf.Layer("top", sigma_a=sigma_a, sigma_s_prime=1.5, g=0.8, n=1.4, thickness=thickness),
            lf.Layer("middle", sigma_a=0.01, sigma_s_prime=0.8, g=0.8, n=1.36, thickness=3.0),
            lf.HalfSpace("deep", sigma_a=0.1, sigma_s_prime=2.0, g=0.8, n=1.4),
        ]
    )


def domain(low, high=None):
    return Domain(low, to_columns(low), to_columns(high or low))


def count(low, high=None, geometries=(NEAR,), share=1e-3):
    return visible_layers(domain(low, high), list(geometries), share)


def test_only_what_is_seen():
    """By thickness, by distance, by what is asked for."""
    assert count(stack()) == 1 and count(stack(thickness=0.5)) == 3
    assert count(stack(), geometries=[lf.RadialReflectance(r=[30.0])]) == 3  # light goes round the absorbing layer
    assert count(stack(), geometries=[NEAR, lf.SpatialFrequency(k=[0.0])]) == 1
    clear_above = lf.Layer("film", sigma_a=0.05, sigma_s_prime=1.0, g=0.8, n=1.4, thickness=0.2)
    assert count(lf.Stack([clear_above, *stack().layers])) == 2
    slab = lf.Stack([stack().layers[0], lf.Layer("plate", sigma_a=0.1, sigma_s_prime=2.0, g=0.8, n=1.4, thickness=1.0)])
    assert count(slab, geometries=[lf.TotalReflectance()]) == 1 and count(slab, geometries=[lf.TotalTransmittance()]) == 2


def test_all_stacks_of_a_fit_count():
    """A layer that some stack within the bounds shows is kept."""
    assert count(stack(thickness=1.0), stack()) == 3 and count(stack(sigma_a=0.001), stack()) == 3
    assert count(stack(thickness=7.0), stack(thickness=9.0)) == 1


def test_transport_agrees_without_them():
    """The values are those of the whole stack; Auto says what it left out."""
    whole, upper = (lf.predict(stack(), NEAR, solver=lf.DiscreteOrdinates(layers=layers))[0] for layers in (None, 1))
    assert np.all(np.abs(upper.values - whole.values) <= whole.estimated_error + upper.estimated_error)
    alone = lf.Stack([lf.HalfSpace("top", sigma_a=0.3, sigma_s_prime=1.5, g=0.8, n=1.4)])
    assert np.max(np.abs(upper.values / lf.predict(alone, NEAR, solver=lf.DiscreteOrdinates())[0].values - 1)) <= 1e-12
    found = lf.predict(stack(), lf.RadialReflectance(r=[0.3, 1.0]), solver=lf.Auto(tolerance=0.01))[0]
    assert found.solver.layers == 1 and any("'middle', 'deep' are not seen" in note for note in found.notes)


@pytest.mark.long
def test_a_fit_keeps_what_its_bounds_show():
    r = lf.RadialReflectance(r=np.geomspace(0.3, 4.0, 8))
    data = lf.Dataset(r, lf.predict(stack(), r, solver=lf.DiscreteOrdinates())[0].values, noise=lf.Noise(relative=0.01))
    tight = lf.Problem(stack(), data, free={"top.sigma_a": (0.2, 0.5)})
    wide = lf.Problem(stack(), data, free={"top.sigma_a": (0.2, 0.5), "top.thickness": (0.1, 10.0)})
    assert tight.chosen.layers == 1 and wide.chosen.layers is None


@pytest.mark.long
def test_a_fit_says_what_it_left_out():
    r = lf.RadialReflectance(r=np.geomspace(0.3, 4.0, 8))
    data = lf.Dataset(r, lf.predict(stack(), r)[0].values, noise=lf.Noise(relative=0.01))
    fit = lf.fit(lf.Problem(stack(), data, free={"top.sigma_a": (0.2, 0.5)}), starts=1)
    assert abs(fit.parameters["top.sigma_a"].value / 0.3 - 1) <= 0.01
    assert any("not seen" in note for note in fit.warnings) or "not seen" in fit.summary()


def test_wrong_input():
    with pytest.raises(lf.InputError, match="layers = 0; allowed is a whole number, 1 or more"):
        lf.DiscreteOrdinates(layers=0)
    slab = lf.Stack([lf.Layer("slab", sigma_a=0.1, sigma_s_prime=2.0, g=0.8, n=1.4, thickness=1.0)])
    with pytest.raises(lf.InputError, match="leaves nothing to come out below"):
        lf.predict(slab, lf.TotalTransmittance(), solver=lf.DiscreteOrdinates(layers=1))
