"""Light after a few events: against light of any number of them, and near the axis behind thin samples, against Monte Carlo."""

import sys
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import layerfit as lf
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain
from layerfit.transport.frequency_layer import coupling
from layerfit.transport.frequency_response import Sample, scattered_often
from layerfit.transport.ordinate_profiles import sample_of
from layerfit.transport.successive import _stages, endless_chain, successive

sys.path.insert(0, str(Path(__file__).parents[1] / "reference"))

import make_near_axis

TWO = (
    lf.Layer("a", sigma_a=0.1, sigma_s=3.0, g=0.7, n=1.0, thickness=0.2),
    lf.Layer("b", sigma_a=0.3, sigma_s=2.0, g=0.2, n=1.0, thickness=0.3),
)
STEPPED = (TWO[0], lf.Layer("b", sigma_a=0.3, sigma_s=2.0, g=0.2, n=1.4, thickness=0.3))


def all_and_few(layers, side, k, events, **media):
    """Light scattered more than once: all of it, and that of 2 to so many events."""
    stack = lf.Stack(list(layers), **media)
    columns = to_columns(stack)
    geometry = (lf.RadialReflectance if side == "R" else lf.RadialTransmittance)(r=[2.0])
    solver = lf.DiscreteOrdinates(streams=8, orders=4, frequencies=8)
    plan = solver.forward(Domain(stack, columns, columns), [geometry], [(0.0, 0.0)]).plans[0]
    sample: Sample = sample_of(plan, plan.layout, plan.optics, columns)
    chain = jax.tree.map(lambda x: jnp.asarray(x[-4]), plan.closing)
    clear = tuple(layer.sigma_s_prime == 0.0 for layer in layers)
    steps = plan.steps._replace(of_thin=12)
    pair = jax.jit(lambda k: (scattered_often(sample, k, chain, steps), successive(sample, k, chain, events, clear)))
    return [float(x) for x in pair(jnp.asarray(k))]


@pytest.mark.parametrize("side", ["R", "T"])
@pytest.mark.parametrize("k", [0.0, 3.0])
def test_many_events_are_all_light(side, k):
    """Two scattering layers without a face that reflects the beam: 40 events leave out nothing that eight stages tell."""
    every, found = all_and_few(TWO, side, k, 40)
    assert abs(found - every) <= 1e-5 * abs(every)


@pytest.mark.parametrize("side", ["R", "T"])
def test_clear_layers_are_crossed_exactly(side):
    """A clear layer between the two, too thick for the stages: waves along flat directions turn many times in it."""
    gap = lf.Layer("gap", sigma_a=0.01, sigma_s=0.0, g=0.0, n=1.0, thickness=3.0)
    every, found = all_and_few((TWO[0], gap, TWO[1]), side, 2.0, 40)
    assert abs(found - every) <= 1e-5 * abs(every)


@pytest.mark.parametrize("side", ["R", "T"])
def test_reflections_at_faces_are_events(side):
    """A step of index between two layers and to what is below. The beam is reflected once at most.

    Without reflections of other light 20 % of R and a tenth of T are missing.
    """
    every, found = all_and_few(STEPPED, side, 1.0, 40)
    assert abs(found - every) <= 5e-4 * abs(every)


def test_the_endless_chain_has_no_end():
    """All its elements but the last diagonal one are those of streaming between neighbouring orders."""
    chain = endless_chain(5, 12)
    matrix = ((chain.vectors[0] * chain.modes[0]) @ chain.inverse[0]).real
    assert np.max(np.abs(matrix - coupling(5))) <= 1e-12
    assert np.max(np.abs((chain.vectors[0] @ chain.inverse[0]).real - np.eye(5))) <= 1e-12


def test_stages_integrate_polynomials_and_damp():
    """Places and matrix of the method: exact to its stage order, and nothing is left of light that a layer takes away at once."""
    rule = _stages(8)
    assert rule.place[0] == 0.0 and abs(rule.place[-1] - 1.0) <= 1e-15
    for power in range(7):
        assert np.max(np.abs(rule.matrix @ rule.place**power - rule.place ** (power + 1) / (power + 1))) <= 1e-12
    assert np.max(np.abs((rule.vectors * rule.eigenvalues) @ rule.inverse - rule.matrix)) <= 1e-12
    for loss, bound in ((2.0, 1e-10), (1e6, 1e-5)):
        left = np.linalg.solve(np.eye(8) + loss * rule.matrix, np.ones(8))
        assert abs(left[-1] - np.exp(-loss)) <= bound


QUICK = {"glass_3"}
NEAR_AXIS = np.loadtxt(Path(make_near_axis.__file__).with_name("near_axis.csv"), delimiter=",", skiprows=2, dtype=str)


@pytest.mark.parametrize("name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.long) for name in make_near_axis.SLABS])
def test_near_the_axis_behind_a_slab(name):
    """T within half a transport mean free path of the axis, within 2 % or 3 standard errors. Up to 24 % off with all light alike."""
    rows = NEAR_AXIS[NEAR_AXIS[:, 0] == name][:, 1:].astype(float)
    low, high, reference, se = rows.T
    found = lf.predict(make_near_axis.SLABS[name], lf.RadialTransmittance(r_min=low, r_max=high), solver=lf.DiscreteOrdinates())[0]
    jax.clear_caches()
    assert np.all(np.abs(found.values - reference) <= np.maximum(0.02 * reference, 3.0 * se))
    assert np.mean(np.abs(found.values - reference) <= found.estimated_error + 2.0 * se) >= 0.9


@pytest.mark.long
def test_derivatives_near_the_axis():
    """By absorption, scattering, g, index and thickness of a thin slab: forward, reverse and differences agree."""
    stack = lf.Stack([lf.Layer("a", sigma_a=0.1, sigma_s=2.0, g=0.6, n=1.4, thickness=0.2)])
    columns = to_columns(stack)
    geometry = lf.RadialTransmittance(r=[0.1, 0.3])

    def where(c):
        return c.sigma_a, c.sigma_s_prime, c.g, c.n, c.thickness

    far = eqx.tree_at(lambda c: c.n, columns, 1.01 * columns.n)
    forward = lf.DiscreteOrdinates(streams=8, orders=3, frequencies=16).forward(Domain(stack, columns, far), [geometry], [(0.0, 0.0)])
    assert forward.plans[0].few is not None

    def values(x):
        return forward(eqx.tree_at(where, columns, tuple(x[:, None])))[0]

    x = jnp.concatenate(where(columns))
    slopes, back = (np.asarray(jax.jit(mode(values))(x)) for mode in (jax.jacfwd, jax.jacrev))
    assert np.all(np.isfinite(slopes))
    assert np.max(np.abs(slopes - back)) <= 1e-9 * np.max(np.abs(slopes))
    values = jax.jit(values)
    for i, h in enumerate(1e-4 * np.maximum(np.abs(np.asarray(x)), 0.1)):
        step = jnp.zeros_like(x).at[i].set(h)
        difference = (values(x + step) - values(x - step)) / (2.0 * h)
        assert np.max(np.abs(np.asarray(difference) - slopes[:, i])) <= 1e-5 * np.max(np.abs(slopes[:, i])), i
