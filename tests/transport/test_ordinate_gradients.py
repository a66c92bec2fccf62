"""Derivatives of discrete ordinates: both modes agree, differences approach them as h^2, also where a formula could be 0/0 or has a kink."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ordinates_scenes import R_ALL, T_DIFFUSE

import layerfit as lf
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain

NAMES = ("sigma_a", "sigma_s_prime", "g", "n", "thickness")
OBLIQUE = lf.TotalReflectance(incidence=50.0)
OPTIONS = {"xla_cpu_use_fusion_emitters": False}  # compiles in less time


class Model:
    """Values, forward and reverse derivatives of a stack as functions of its free numbers (x); index and roughness may move too."""

    def __init__(self, stack: lf.Stack, geometries, names=NAMES, streams: int = 8):
        rough = (True,) * (len(stack.layers) + (not stack.half_space)) if "roughness" in names else None
        columns = to_columns(stack, rough_faces=rough)
        sizes = [getattr(columns, name).shape[0] for name in names]
        wide = [dataclasses.replace(columns, n=columns.n * f, roughness=columns.roughness * f) for f in (0.99, 1.01)]
        forward = lf.DiscreteOrdinates(streams=streams).forward(Domain(stack, *wide), geometries, [(0.0, 0.0)] * len(geometries))

        def values(x):
            parts = jnp.split(x, np.cumsum(sizes)[:-1])
            return jnp.concatenate(forward(dataclasses.replace(columns, **dict(zip(names, parts, strict=True)))))

        self.x = jnp.concatenate([getattr(columns, name) for name in names])
        self.values, self.forward, self.reverse = (self._compiled(f) for f in (values, jax.jacfwd(values), jax.jacrev(values)))

    def _compiled(self, function):
        done = jax.jit(function).lower(self.x).compile(compiler_options=OPTIONS)
        return lambda x: np.asarray(done(jnp.asarray(x)))

    def both(self, x) -> np.ndarray:
        """The derivative, forward and reverse found equal to 1e-9 and finite."""
        a, b = self.forward(x), self.reverse(x)
        assert np.all(np.isfinite(a)) and np.all(np.isfinite(b))
        assert np.max(np.abs(a - b) / np.abs(a).max(axis=1, keepdims=True)) <= 1e-9
        return a

    def difference(self, x, i: int, h: float, one_sided: bool) -> np.ndarray:
        def at(k):
            return self.values(np.asarray(x) + k * h * (np.arange(len(x)) == i))

        return (-3.0 * at(0) + 4.0 * at(1) - at(2)) / (2.0 * h) if one_sided else (at(1) - at(-1)) / (2.0 * h)

    def check(self, x, at_end=(), skip=(), h: float = 4e-3) -> None:
        """Both modes; then differences at h and h/2 for each number, to one side for those at the end of their range."""
        slope = self.both(x)
        for i in range(len(x)):
            if i in skip:
                continue
            exact, size = slope[:, i], np.abs(slope).max(axis=1)
            coarse, fine = (self.difference(x, i, step, i in at_end) for step in (h, h / 2))
            first, second = np.abs(coarse - exact), np.abs(fine - exact)
            floor = 1e-8 * size
            assert np.all(second <= 0.3 * first + floor), (i, first, second, exact)
            assert np.all(np.abs((4.0 * fine - coarse) / 3.0 - exact) <= 1e-5 * size), (i, fine, exact)


SLAB = lf.Stack([lf.Layer("slab", sigma_a=0.1, sigma_s_prime=1.0, g=0.5, n=1.4, thickness=1.0)])
A, S, G, N, D = range(5)


@pytest.fixture(scope="module")
def one_slab() -> Model:
    return Model(SLAB, [OBLIQUE, T_DIFFUSE])


@pytest.mark.parametrize(
    ("x", "at_end"),
    [
        ((0.1, 1.0, 0.5, 1.4, 1.0), ()),
        ((0.0, 1.0, 0.5, 1.4, 1.0), (A,)),
        ((0.0, 1.0, 0.5, 1.4, 20.0), (A,)),
        ((0.1, 1.0, 0.0, 1.4, 1.0), ()),
        ((0.0, 1.0, 0.0, 1.4, 1.0), (A,)),
        ((0.1, 1.0, -0.4, 1.4, 1.0), ()),
        ((0.3, 0.0, 0.5, 1.4, 1.0), (S,)),
        ((0.1, 1.0, 0.5, 1.4, 0.0), (D,)),
        ((0.0, 1.0, 0.5, 1.4, 0.0), (A, D)),
        ((0.1, 1.0, 0.9, 1.4, 1.0), ()),
    ],
    ids=[
        "ordinary",
        "albedo 1",
        "albedo 1, thick",
        "isotropic",
        "isotropic, albedo 1",
        "backward",
        "clear: all eigenvalues coincide in pairs with the directions",
        "tau 0",
        "tau 0, albedo 1",
        "forward",
    ],
)
def test_one_slab(one_slab, x, at_end):
    one_slab.check(x, at_end, h=1e-5 if x[D] > 10.0 else 4e-3)


def test_a_clear_slab(one_slab):
    """Where there is neither absorption nor scattering the slope in sigma_s depends on the way there: light trapped by the faces is lost or not."""
    one_slab.check((0.0, 0.0, 0.5, 1.4, 1.0), at_end=(A,), skip=(S,))


def test_index_of_the_surroundings(one_slab):
    """n = 1: a kink, where the slope is the one towards larger n, taken 1e-6 above, where two indices that may differ are kept apart.

    It is the slope of the rule, which is steep there: ordinates cannot see a critical angle closer to grazing than their last one.
    """
    x = np.array([0.1, 1.0, 0.5, 1.0, 1.0])
    one_slab.check(x, skip=(N,))
    slope = one_slab.both(x)[:, N]
    start = x + 1e-6 * (np.arange(5) == N)
    assert np.abs(one_slab.both(start)[:, N] - slope).max() <= 1e-6 * np.abs(slope).max()
    coarse, fine = (np.abs(one_slab.difference(start, N, h, True) - slope) for h in (1e-7, 5e-8))
    assert np.all(fine <= 0.3 * coarse + 1e-6 * np.abs(slope))


@pytest.fixture(scope="module")
def half_space() -> Model:
    return Model(lf.Stack([lf.HalfSpace("deep", sigma_a=0.1, sigma_s_prime=1.0, g=0.5, n=1.4)]), [R_ALL], names=NAMES[:4])


@pytest.mark.parametrize("x", [(0.1, 1.0, 0.5, 1.4), (0.1, 1.0, 0.0, 1.4), (1e-4, 1.0, 0.5, 1.4)], ids=["ordinary", "isotropic", "white"])
def test_half_space(half_space, x):
    half_space.check(x, h=1e-6 if x[A] < 0.01 else 4e-3)


def test_half_space_without_absorption(half_space):
    """R = 1 - c sqrt(sigma_a): the slope in sigma_a is minus infinity and comes out as a number beyond any use; the others are 0."""
    x = np.array([0.0, 1.0, 0.5, 1.4])
    for slope in (half_space.forward(x), half_space.reverse(x)):
        assert np.all(np.isfinite(slope))
        assert slope[0, A] <= -1e100
        assert np.abs(slope[0, [G, N]]).max() <= 1e-9
    assert abs(half_space.values(x)[0] - 1.0) <= 1e-13


@pytest.mark.long
def test_rough_faces():
    """Steps are small: where a facet of the rule's integration comes to its critical angle its values step by 1e-6, and differences see that."""
    stack = SLAB.set({"slab.roughness": 0.2, "scene.roughness_below": 0.3})
    model = Model(stack, [OBLIQUE, T_DIFFUSE], names=(*NAMES, "roughness"))
    model.check(model.x, h=1e-5)


@pytest.mark.long
@pytest.mark.parametrize("x", [(0.1, 1.0, 0.5, 1.4, 1.0), (0.0, 1.0, 0.0, 1.4, 1.0)], ids=["ordinary", "isotropic, albedo 1"])
def test_radiances(x):
    """With single scattering corrected, out of the plane of incidence."""
    directions = {"incidence": 40.0, "azimuth": 60.0}
    model = Model(SLAB, [lf.AngularReflectance([20.0, 50.0], **directions), lf.AngularTransmittance([20.0, 50.0], **directions)])
    model.check(x, at_end=(A,) if x[A] == 0.0 else ())
