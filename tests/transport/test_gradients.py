"""Derivatives: both modes agree, differences approach them as h^2, and they are right at the ends of every range."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import layerfit as lf
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain

R = lf.RadialReflectance(r=[0.3, 1.0, 3.0, 10.0])
T = lf.RadialTransmittance(r=[0.3, 1.0, 3.0, 10.0])
K = lf.SpatialFrequency(k=[0.0, 0.1, 1.0])

OVER_HALF = lf.Layer("top", sigma_a=0.02, sigma_s_prime=1.5, g=0.8, n=1.4, thickness=1.2) | lf.HalfSpace(
    "deep", sigma_a=0.005, sigma_s_prime=1.0, g=0.6, n=1.37
)
SLABS = lf.Stack(
    [
        lf.Layer("top", sigma_a=0.02, sigma_s_prime=1.5, g=0.8, n=1.4, thickness=1.2),
        lf.Layer("deep", sigma_a=0.005, sigma_s_prime=1.0, g=0.6, n=1.37, thickness=3.0),
    ],
    n_below=1.5,
)
FREE = ("sigma_a", "sigma_s_prime", "g", "n", "thickness")
TEXTBOOK = lf.LayeredDiffusion(source="point", boundary="extrapolated", diffusion="transport")


def model(stack, solver, geometries, rough=False):
    """A function from a flat vector of all free columns to all values, and that vector."""
    columns = to_columns(stack, rough_faces=(True,) * (len(stack.layers) + (not stack.half_space)) if rough else None)
    names = (*FREE, "roughness") if rough else FREE
    sizes = [getattr(columns, name).shape[0] for name in names]
    widened = [dataclasses.replace(columns, sigma_a=columns.sigma_a * f, sigma_s_prime=columns.sigma_s_prime * f) for f in (0.5, 2.0)]
    forward = solver.forward(Domain(stack, *widened), geometries, [(0.0, 0.0)] * len(geometries))

    def values(x):
        parts = jnp.split(x, np.cumsum(sizes)[:-1])
        return jnp.concatenate(forward(dataclasses.replace(columns, **dict(zip(names, parts, strict=True)))))

    return values, jnp.concatenate([getattr(columns, name) for name in names])


def compiled(function, x):
    """The function, compiled for arguments like x with the options that compile long chains of small operations fastest."""
    done = jax.jit(function).lower(x).compile(compiler_options={"xla_cpu_use_fusion_emitters": False})
    return lambda x: np.asarray(done(x))


def from_the_right(values, x, i, h):
    """Slope in number i at the lower end of its range, to second order."""
    return (-3 * values(x) + 4 * values(x.at[i].add(h)) - values(x.at[i].add(2 * h))) / (2 * h)


@pytest.mark.parametrize(
    ("stack", "solver", "geometry"),
    [
        (OVER_HALF, lf.LayeredDiffusion(), R),
        pytest.param(SLABS, lf.LayeredDiffusion(), T, marks=pytest.mark.long),
        (SLABS, TEXTBOOK, R),
        (SLABS, lf.Multipole(), R),
    ],
    ids=["half", "slabs", "textbook", "multipole"],
)
def test_forward_reverse_and_differences(stack, solver, geometry):
    """jvp = vjp to 1e-10; central differences approach them as h^2."""
    function, x = model(stack, solver, [geometry])
    values, forward, reverse = compiled(function, x), compiled(jax.jacfwd(function), x)(x), compiled(jax.jacrev(function), x)(x)
    scale = np.abs(forward).max(axis=1, keepdims=True)
    assert np.all(scale > 0)
    assert np.max(np.abs(forward - reverse) / scale) <= 1e-10

    def error(share):
        columns = [(values(x.at[i].multiply(1 + share)) - values(x.at[i].multiply(1 - share))) / (2 * share * x[i]) for i in range(x.size)]
        return np.abs(np.stack(columns, axis=1) - forward) / scale

    coarse, fine = error(1e-2), error(5e-3)
    assert np.max(fine) <= 2e-3
    large = coarse > 1e-7  # above rounding
    assert np.sum(large) >= 10
    assert abs(np.median(coarse[large] / fine[large]) - 4.0) <= 0.01
    assert np.max(fine[large] / coarse[large]) <= 0.5


def test_roughness():
    stack = SLABS.set({"top.roughness": 0.2, "deep.roughness": 0.0, "scene.roughness_below": 0.3, "scene.n_below": 1.0})
    function, x = model(stack, lf.LayeredDiffusion(), [lf.TotalReflectance(), lf.TotalTransmittance()], rough=True)
    values, slope = compiled(function, x), compiled(jax.jacfwd(function), x)(x)
    h = 1e-3
    for i in (x.shape[0] - 3, x.shape[0] - 1):
        central = (values(x.at[i].add(h)) - values(x.at[i].add(-h))) / (2 * h)
        assert np.max(np.abs(slope[:, i] - central)) <= 1e-5
        assert np.max(np.abs(slope[:, i])) > 0.01


@pytest.mark.parametrize("solver", [lf.LayeredDiffusion(), lf.Multipole(source="exponential")], ids=str)
def test_thickness_from_nothing_to_everything(solver):
    """Slope in the first layer's thickness at 0, in thin and in very thick layers: finite, right, and the same in both modes."""
    function, x = model(OVER_HALF, solver, [K])
    values, forward, reverse = compiled(function, x), compiled(jax.jacfwd(function), x), compiled(jax.jacrev(function), x)
    scale = np.abs(forward(x)[:, -1]).max()
    for d in (0.0, 1e-9, 0.1, 1e4):
        at = x.at[-1].set(d)
        found = forward(at)
        assert np.all(np.isfinite(found))
        assert np.max(np.abs(found - reverse(at))) <= 1e-10 * np.abs(found).max()
        h = 1e-3 * max(d, 0.01)
        central = d >= h
        expected = (values(at.at[-1].add(h)) - values(at.at[-1].add(-h))) / (2 * h) if central else from_the_right(values, at, -1, h)
        assert np.max(np.abs(found[:, -1] - expected)) <= 1e-4 * max(np.abs(found[:, -1]).max(), scale)
    assert np.max(np.abs(forward(x.at[-1].set(1e4))[:, -1])) <= 1e-12 * scale


@pytest.mark.parametrize("solver", [lf.LayeredDiffusion(), lf.Multipole()], ids=str)
def test_index_one_and_no_absorption(solver):
    """A(n) has a kink at n = 1, where the derivative is the one towards larger n; at sigma_a = 0 a slab's slope is finite and right."""
    matched = SLABS.set({"top.n": 1.0, "deep.n": 1.0, "scene.n_below": 1.0, "top.sigma_a": 0.0, "deep.sigma_a": 0.0})
    function, x = model(matched, solver, [lf.SpatialFrequency(k=[0.0, 0.3]), lf.TotalTransmittance()])
    values, slope = compiled(function, x), compiled(jax.jacfwd(function), x)(x)
    assert np.all(np.isfinite(slope))
    # between two layers of one index the multipole has a kink to both sides, where no one derivative exists
    for i, h in ((0, 1e-6), (1, 1e-6), *(((6, 1e-8), (7, 1e-8)) if solver.name == "layered-diffusion" else ())):
        assert np.max(np.abs(slope[:, i])) > 0.01
        assert np.max(np.abs(slope[:, i] - from_the_right(values, x, i, h))) <= 1e-3 * np.abs(slope[:, i]).max()


def test_half_space_without_absorption():
    """The slope of total R in sigma_a is minus infinity there, and comes out as a number beyond any use; the value is exact."""
    half = lf.Stack([lf.HalfSpace("white", sigma_a=0.0, sigma_s_prime=1.0, g=0.5, n=1.4)])
    function, x = model(half, lf.LayeredDiffusion(), [lf.TotalReflectance()])
    assert compiled(jax.jacfwd(function), x)(x)[0, 0] <= -1e100
    assert abs(compiled(function, x)(x)[0] - (1 - (0.4 / 2.4) ** 2)) <= 1e-12
