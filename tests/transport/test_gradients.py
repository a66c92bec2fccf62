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
EXPONENTIAL = lf.LayeredDiffusion(source="exponential", boundary="partial_current", diffusion="grosjean")


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

    return jax.jit(values), jnp.concatenate([getattr(columns, name) for name in names])


def evaluate(function, x):
    """The function's value at x, compiled with the options that compile these long chains of small operations fastest."""
    return np.asarray(jax.jit(function).lower(x).compile(compiler_options={"xla_cpu_use_fusion_emitters": False})(x))


def differences(values, x, steps):
    """Central differences in every number, (values, numbers)."""
    return np.stack([(values(x.at[i].add(h)) - values(x.at[i].add(-h))) / (2 * h) for i, h in enumerate(steps)], axis=1)


@pytest.mark.parametrize(
    ("stack", "solver", "geometries"),
    [
        (OVER_HALF, lf.LayeredDiffusion(), [R]),
        (SLABS, lf.LayeredDiffusion(), [T, lf.TotalReflectance(incidence=60.0, specular="included")]),
        (SLABS, TEXTBOOK, [R]),
        (OVER_HALF, EXPONENTIAL, [K]),
        (SLABS, lf.Multipole(), [R, lf.TotalTransmittance()]),
    ],
    ids=["half", "slabs", "textbook", "exponential", "multipole"],
)
def test_forward_reverse_and_differences(stack, solver, geometries):
    values, x = model(stack, solver, geometries)
    forward, reverse = evaluate(jax.jacfwd(values), x), evaluate(jax.jacrev(values), x)
    scale = np.abs(forward).max(axis=1, keepdims=True)
    assert np.all(scale > 0)
    assert np.max(np.abs(forward - reverse) / scale) <= 1e-10
    steps = 1e-2 * np.asarray(x)
    coarse, fine = (np.abs(differences(values, x, h) - forward) / scale for h in (steps, 0.5 * steps))
    assert np.max(fine) <= 2e-3
    large = coarse > 1e-7  # above rounding
    assert np.sum(large) >= 10
    ratio = coarse[large] / fine[large]
    assert np.median(np.abs(ratio - 4.0)) <= 0.01
    assert np.max(fine[large] / coarse[large]) <= 0.5


def test_roughness():
    values, x = model(
        SLABS.set({"top.roughness": 0.2, "deep.roughness": 0.0, "scene.roughness_below": 0.3}),
        lf.LayeredDiffusion(),
        [K, lf.TotalTransmittance()],
        rough=True,
    )
    chosen = [x.shape[0] - 3, x.shape[0] - 1]
    slope = evaluate(jax.jacfwd(values), x)[:, chosen]
    h = 1e-3
    central = np.stack([(values(x.at[i].add(h)) - values(x.at[i].add(-h))) / (2 * h) for i in chosen], axis=1)
    assert np.max(np.abs(slope - central)) <= 1e-5
    assert np.max(np.abs(slope)) > 0.01


@pytest.mark.parametrize("solver", [lf.LayeredDiffusion(), TEXTBOOK, EXPONENTIAL, lf.Multipole(source="exponential")], ids=str)
def test_thickness_from_nothing_to_everything(solver):
    """Slope in the first layer's thickness at 0, in thin and in very thick layers: finite, right, and the same in both modes."""
    values, x = model(OVER_HALF, solver, [K])
    at = lambda d: values(x.at[-1].set(d))  # noqa: E731
    slope = jax.jacfwd(at)
    scale = np.abs(np.asarray(slope(1.2))).max()
    for d in (0.0, 1e-9, 0.1, 1e4):
        found, reverse = np.asarray(slope(d)), np.asarray(jax.jacrev(at)(d))
        assert np.all(np.isfinite(found))
        assert np.max(np.abs(found - reverse)) <= 1e-10 * max(scale, np.abs(found).max())
        h = 1e-3 * max(d, 0.01)
        if d < h:  # from the right alone
            expected = (-3 * at(d) + 4 * at(d + h) - at(d + 2 * h)) / (2 * h)
        else:
            expected = (at(d + h) - at(d - h)) / (2 * h)
        assert np.max(np.abs(found - np.asarray(expected))) <= 1e-4 * max(np.abs(found).max(), scale)
    assert np.max(np.abs(np.asarray(slope(1e4)))) <= 1e-12 * scale


def test_index_one_from_the_right():
    """A(n) has a kink at n = 1; the derivative is the one towards larger n."""
    matched = SLABS.set({"top.n": 1.0, "deep.n": 1.0, "scene.n_below": 1.0})
    values, x = model(matched, lf.LayeredDiffusion(), [lf.TotalReflectance(), lf.TotalTransmittance()])
    for i in (6, 7):  # n of the layers
        slope = np.asarray(jax.jacfwd(values)(x))[:, i]
        h = 1e-5
        right = np.asarray((-3 * values(x) + 4 * values(x.at[i].add(h)) - values(x.at[i].add(2 * h))) / (2 * h))
        assert np.all(np.isfinite(slope))
        assert np.max(np.abs(slope)) > 0.1
        assert np.max(np.abs(slope - right)) <= 1e-3


def test_no_absorption():
    """At sigma_a = 0 a slab's slope is finite and right; that of a half space's total R is infinite, and comes out infinite."""
    white = SLABS.set({"top.sigma_a": 0.0, "deep.sigma_a": 0.0})
    for solver in (lf.LayeredDiffusion(), TEXTBOOK, lf.Multipole()):
        values, x = model(white, solver, [lf.SpatialFrequency(k=[0.0, 0.3]), lf.TotalReflectance(), lf.TotalTransmittance()])
        for i in (0, 1):
            found, reverse = np.asarray(jax.jacfwd(values)(x))[:, i], np.asarray(jax.jacrev(values)(x))[:, i]
            h = 1e-6
            right = np.asarray((-3 * values(x) + 4 * values(x.at[i].add(h)) - values(x.at[i].add(2 * h))) / (2 * h))
            assert np.max(np.abs(found - reverse)) <= 1e-10 * np.abs(found).max()
            assert np.max(np.abs(found - right)) <= 1e-4 * np.abs(found).max()
            assert np.min(np.abs(found)) > 0.01
    half = lf.Stack([lf.HalfSpace("white", sigma_a=0.0, sigma_s_prime=1.0, g=0.5, n=1.4)])
    values, x = model(half, lf.LayeredDiffusion(), [lf.TotalReflectance()])
    assert np.isneginf(np.asarray(jax.jacfwd(values)(x))[0, 0])
    assert abs(float(values(x)[0]) - (1 - (0.4 / 2.4) ** 2)) <= 1e-12
