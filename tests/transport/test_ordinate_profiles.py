"""R(r), T(r) and R(k) by discrete ordinates: Monte Carlo profiles, limits, sources, derivatives, and the error that is stated."""

import cases
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import layerfit as lf
from layerfit.optics.frequencies import chebyshev_frequencies, interpolation
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain
from layerfit.transport.ordinate_profiles import _at_least_as_around, _block

TOP = {"sigma_a": 0.02, "sigma_s_prime": 1.0, "g": 0.8, "n": 1.4}
HALF = lf.Stack([lf.HalfSpace("deep", **TOP)])
BANDS = ((0.1, 0.5, 0.02), (0.5, np.inf, 0.005))
QUICK = {"skin_over_fat R", "thin_slab_01mfp T", "slab_dj_2mfp T"}
PROFILES = [f"{name} {side}" for name in cases.NAMES for side in ("R", "T") if side == "R" or not cases.load(name).stack.half_space]

BY_CHANCE = 2  # in 36 rings or so; 20 batches make 3 standard errors rather 2.6


def profile(case, side):
    """Places, reference with its error where that is below 10 %, prediction."""
    low, high = case.rings
    geometry = (lf.RadialReflectance if side == "R" else lf.RadialTransmittance)(r_min=low, r_max=high)
    reference, se = (case.R, case.R_se) if side == "R" else (case.T, case.T_se)
    r = np.sqrt(0.5 * (low**2 + high**2)) / case.mfp
    found = lf.predict(case.stack, geometry, solver=lf.DiscreteOrdinates())[0]
    use = (r >= 0.1) & (reference > 0.0) & (se < 0.1 * reference)
    return r[use], reference[use], se[use], found.values[use], found.estimated_error[use]


@pytest.mark.parametrize("name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.long) for name in PROFILES])
def test_against_monte_carlo(name):
    """0.5 % or 3 standard errors beyond half a transport mean free path, 2 % from a tenth on; and the stated error is honest."""
    case, side = name.split()
    r, reference, se, value, stated = profile(cases.load(case), side)
    jax.clear_caches()
    deviation = np.abs(value - reference)
    out = 0
    for start, end, share in BANDS:
        m = (r >= start) & (r < end)
        out += int(np.sum(~(deviation[m] <= np.maximum(share * reference[m], 3.0 * se[m]))))
    assert np.mean(deviation <= stated + 2.0 * se) >= 0.9
    assert np.median(stated / reference) <= 10.0 * np.median(np.hypot(deviation, se) / reference)
    assert out <= BY_CHANCE


def test_points_interpolate_what_falls_off():
    """Rational functions of k of few poles; every other point is a point of half the number."""
    k = np.geomspace(1e-3, 1e3, 50)

    def function(k):
        return 1.0 / ((1.0 + k) * (2.0 + k))

    found = interpolation(24, k, 1.3) @ function(chebyshev_frequencies(24, 1.3))
    assert np.max(np.abs(found - function(k))) <= 1e-6  # the first point is not quite at 0
    assert np.max(np.abs(chebyshev_frequencies(24, 1.3)[::2][1:] / chebyshev_frequencies(12, 1.3)[1:] - 1.0)) <= 1e-12
    points = chebyshev_frequencies(24, 1.3)
    assert np.max(np.abs(interpolation(24, points, 1.3) - np.eye(24))) <= 1e-10
    assert np.max(np.abs(interpolation(24, np.zeros(1), 1.3) @ function(points) - function(0.0))) <= 1e-5


def test_points_of_a_half_space_know_its_decay():
    """A function of sqrt(k^2 + nu^2): the same points without the decay are worse by orders of magnitude, with too little of it no worse."""
    k, nu = np.geomspace(1e-3, 1e3, 50), 0.05

    def function(k):
        return 1.0 / ((1.0 + np.sqrt(k**2 + nu**2)) * (2.0 + np.sqrt(k**2 + nu**2)))

    worst = {}
    for decay in (0.0, 0.5 * nu, nu):
        points = chebyshev_frequencies(24, 1.3, decay)
        worst[decay] = np.max(np.abs(interpolation(24, k, 1.3, decay) @ function(points) - function(k)))
        assert np.max(np.abs(interpolation(24, points, 1.3, decay) - np.eye(24))) <= 1e-10
        assert np.max(np.abs(points[::2][1:] / chebyshev_frequencies(12, 1.3, decay)[1:] - 1.0)) <= 1e-12
    assert worst[nu] <= 1e-9
    assert worst[0.5 * nu] <= worst[0.0]
    assert worst[nu] <= 1e-3 * worst[0.0]


def test_few_frequencies_reach_far_in_a_half_space():
    """R at 20 transport mean free paths, a millionth of that near the source, from 24 frequencies; and of a range of stacks."""
    stack = lf.Stack([lf.HalfSpace("deep", **(TOP | {"sigma_a": 0.1}))])
    geometry, columns = lf.RadialReflectance(r=np.geomspace(0.5, 18.0, 12)), to_columns(stack)
    exact, few = (lf.predict(stack, geometry, solver=lf.DiscreteOrdinates(streams=8, orders=3, frequencies=n))[0].values for n in (96, 24))
    assert np.max(np.abs(few / exact - 1.0)) <= 5e-3
    low, high = (eqx.tree_at(lambda c: (c.sigma_a, c.sigma_s_prime), columns, (f * columns.sigma_a, f * columns.sigma_s_prime)) for f in (0.2, 5.0))
    forward = lf.DiscreteOrdinates(streams=8, orders=3, frequencies=32).forward(Domain(stack, low, high), [geometry], [(0.0, 0.0)])
    assert np.max(np.abs(forward(columns)[0] / exact - 1.0)) <= 2e-2


def test_blocks_of_one_size():
    """A smaller last block would be compiled anew."""
    assert [_block(count) for count in (8, 16, 24, 32, 40, 48, 64)] == [8, 16, 12, 16, 10, 16, 16]
    assert [_block(count) for count in (22, 34, 46)] == [11, 16, 16]  # of no good divisor


def test_errors_are_those_of_the_surroundings_where_a_difference_changes_sign():
    """In relation to the values, and only from places near by."""
    geometry, value = lf.RadialReflectance(r=[1.0, 1.1, 1.2, 5.0]), np.array([4.0, 2.0, 1.0, 0.1])
    found = _at_least_as_around(geometry, np.array([0.03, 0.0, 0.03, 0.5]) * value, value)
    assert np.max(np.abs(found / value - [0.03, 0.02, 0.03, 0.5])) <= 1e-12
    broken = _at_least_as_around(geometry, np.array([0.12, 0.0, 0.03, np.nan]), np.array([4.0, 2.0, 1.0, np.nan]))
    assert np.all(np.isfinite(broken[:3])) and not np.isfinite(broken[3])  # a value that is no number is no matter of those far from it
    alone = lf.RadialReflectance(r=[2.0])
    assert _at_least_as_around(alone, np.array([0.1]), np.array([-2.0]))[0] == 0.1


SLAB = lf.Stack([lf.Layer("a", sigma_a=0.0, sigma_s_prime=1.0, g=0.5, n=1.4, thickness=1.0), lf.Layer("b", **TOP, thickness=1.5)], n_below=1.3)


def test_even_light_is_the_limit_of_no_frequency():
    """R(k = 0) is the total of the solver for even light, which shares no formula with it beyond the layer's matrices."""
    there = lf.predict(SLAB, lf.SpatialFrequency([0.0, 0.5]), solver=lf.DiscreteOrdinates())[0]
    total = lf.predict(SLAB, lf.TotalReflectance(), solver=lf.DiscreteOrdinates())[0].values[0]
    assert abs(there.values[0] / total - 1.0) <= 2e-3
    assert there.values[1] < there.values[0]


def test_sources_and_detectors_against_sums_over_the_pencil():
    """A fibre, a disk and a Gaussian are averages of R(r): done here by brute force over its profile."""
    r = np.geomspace(0.02, 12.0, 300)
    solver = lf.DiscreteOrdinates(streams=12, orders=4, frequencies=16)
    pencil = lf.predict(HALF, lf.RadialReflectance(r=r), solver=solver)[0].values
    random = np.random.default_rng(1)
    angle, share = 2 * np.pi * random.random(400_000), random.random(400_000)
    pairs = [
        (lf.RadialReflectance(r=[1.0], detector=lf.Detector(radius=0.3)), 0.3 * np.sqrt(share)),
        (lf.RadialReflectance(r=[1.0], source=lf.Disk(0.4)), 0.4 * np.sqrt(share)),
        (lf.RadialReflectance(r=[1.0], source=lf.Gaussian(0.5)), 0.5 * np.sqrt(-0.5 * np.log1p(-share))),
    ]
    for geometry, offset in pairs:
        distance = np.hypot(1.0 + offset * np.cos(angle), offset * np.sin(angle))
        mean = np.mean(np.exp(np.interp(np.log(distance), np.log(r), np.log(pencil))))
        assert abs(lf.predict(HALF, geometry, solver=solver)[0].values[0] / mean - 1.0) <= 5e-3


def test_derivatives_are_finite_and_those_of_the_values():
    """By absorption, scattering, g and thickness, at albedo 1 of the first layer too: forward and reverse agree, and so do differences."""
    geometry = lf.RadialReflectance(r=[0.3, 1.0, 4.0])
    columns = to_columns(SLAB)
    forward = lf.DiscreteOrdinates(streams=12, orders=3, frequencies=16).forward(Domain(SLAB, columns, columns), [geometry], [(0.0, 0.0)])

    def values(x):
        return forward(eqx.tree_at(lambda c: (c.sigma_a, c.sigma_s_prime, c.g, c.thickness), columns, tuple(x.reshape(4, 2))))[0]

    x = jnp.concatenate([columns.sigma_a, columns.sigma_s_prime, columns.g, columns.thickness])
    slopes = np.asarray(jax.jit(jax.jacfwd(values))(x))
    back = np.asarray(jax.jit(jax.jacrev(values))(x))
    assert np.all(np.isfinite(slopes))
    assert np.max(np.abs(slopes - back)) <= 1e-9 * np.max(np.abs(slopes))
    values = jax.jit(values)
    for i in range(x.size):
        step = jnp.zeros_like(x).at[i].set(1e-5)
        difference = (values(x + step) - values(x - step)) / 2e-5 if i else (4.0 * values(x + step) - values(x + 2 * step) - 3.0 * values(x)) / 2e-5
        assert np.max(np.abs(np.asarray(difference) - slopes[:, i])) <= 1e-6 * np.max(np.abs(slopes[:, i])) + 1e-9, i


def test_layers_that_are_nothing_change_nothing():
    """A clear layer, one of no thickness, and a slide of another index all have finite answers; nothing of no thickness is nothing."""
    solver = lf.DiscreteOrdinates(streams=12, orders=3, frequencies=16)
    geometry = lf.RadialReflectance(r=[0.5, 2.0])
    bare = lf.predict(HALF, geometry, solver=solver)[0].values
    film = lf.Layer("film", sigma_a=0.0, sigma_s_prime=0.0, g=0.0, n=1.4, thickness=0.0) | HALF.layers[0]
    assert np.max(np.abs(lf.predict(film, geometry, solver=solver)[0].values / bare - 1.0)) <= 2e-2  # without diffusion as baseline
    slide = lf.Layer("slide", sigma_a=0.0, sigma_s_prime=0.0, g=0.0, n=1.5, thickness=1.0) | HALF.layers[0]
    assert np.all(np.isfinite(lf.predict(slide, geometry, solver=solver)[0].values))


def test_a_layer_by_tripling_by_doubling_and_as_a_half_space():
    """Tripling Y and Z, doubling R and T, and a very thick layer against a half space."""
    from layerfit.transport.frequency_layer import Sheet, thick_layer, thin_layer

    columns = to_columns(SLAB)
    plan = (
        lf.DiscreteOrdinates(streams=12, orders=3, frequencies=16)
        .forward(Domain(SLAB, columns, columns), [lf.SpatialFrequency([0.7])], [(0.0, 0.0)])
        .plans[0]
    )
    from layerfit.transport.frequency_response import make_sheets
    from layerfit.transport.ordinate_stack import medium

    sheet: Sheet = make_sheets(columns, plan.optics[0], medium(plan.layout, columns), plan.layout)[1]
    k = jnp.asarray(0.7)
    closing = jnp.asarray(plan.closing.share[0])
    R, T = thick_layer(sheet, k, closing, 8, jnp.zeros(()))
    R2, T2 = thin_layer(sheet, k, closing, 12)
    assert np.max(np.abs(np.asarray(R - R2))) <= 1e-9
    assert np.max(np.abs(np.asarray(T - T2))) <= 1e-9
    deep = thick_layer(sheet, k, closing, 7, jnp.ones(()))[0]
    far = thick_layer(sheet._replace(depth=jnp.asarray(60.0)), k, closing, 12, jnp.zeros(()))[0]
    assert np.max(np.abs(np.asarray(deep - far))) <= 1e-9


def test_fine_stripes_on_a_half_space_see_no_depth():
    """k of 1600 sigma_t': a half space and a slab of 20 transport mean free paths, whose doublings are not the same, give one R(k)."""
    k = np.array([300.0, 2500.0])
    deep = lf.Stack([lf.HalfSpace("deep", sigma_a=0.5, sigma_s_prime=1.0, g=0.8, n=1.4)])
    slab = lf.Stack([lf.Layer("slab", sigma_a=0.5, sigma_s_prime=1.0, g=0.8, n=1.4, thickness=13.0)], n_below=1.4)
    a, b = (lf.predict(stack, lf.SpatialFrequency(k=k), solver=lf.DiscreteOrdinates(streams=12, orders=4))[0].values for stack in (deep, slab))
    assert np.all(np.abs(a - b) <= 1e-8)


def test_few_azimuthal_orders_do_in_a_thin_slab():
    """Light that runs along a slab a tenth of a mean free path thin: R(r) of 4 orders is that of 12, of which all but the end of the chain differ.

    The same share for all directions at that end leaves 1.9 %.
    """
    slab = lf.Stack([lf.Layer("slab", sigma_a=0.01, sigma_s=1.0, g=0.0, n=1.4, thickness=0.1)])
    geometry = lf.RadialReflectance(r=[0.5, 1.0, 2.0])
    few, many = (lf.predict(slab, geometry, solver=lf.DiscreteOrdinates(streams=16, orders=orders, frequencies=64))[0].values for orders in (4, 12))
    assert np.all(np.abs(few / many - 1.0) <= 1.5e-3)


def test_smoothing_keeps_what_is_smooth_and_takes_ripples():
    """Its share of a frequency, against series: 1 - (k w)^6/6 at small k; ripples three times finer than the width are gone; none at r = 0."""
    from layerfit.transport.fineness import nearest
    from layerfit.transport.ordinate_plan import _smoothing

    columns = to_columns(lf.Stack([lf.Layer("slab", sigma_a=0.0, sigma_s=1.0, g=0.0, n=1.4, thickness=1.0)]))
    geometry = lf.RadialReflectance(r_min=[0.0, 1.2, 120.0], r_max=[0.1, 1.4, 121.0])
    k = np.array([0.0, 3.0, 30.0])
    kept = _smoothing(nearest(geometry, (0.0, 0.0)), columns, k)
    assert np.all(kept[0] == 1.0)
    assert np.all(kept[:, 0] == 1.0)
    assert abs(kept[1, 1] - (1.0 - 0.3**6 / 6.0)) <= 1e-4
    assert kept[1, 2] <= 0.01
    assert np.all(
        np.abs(kept[2] - _smoothing(nearest(lf.RadialReflectance(r=[2.4]), (0.0, 0.0)), columns, k)[0]) <= 1e-15
    )  # at most 0.2 mean free paths
    assert np.all(np.abs(_smoothing(nearest(lf.RadialReflectance(r=[1.5]), (-0.3, 0.3)), columns, k)[0] - kept[1]) <= 1e-15)


def test_far_tail_over_an_absorber():
    """Light runs in the layer above, which lets it further than the absorber: from 4 to 11 mm, against twice the frequencies."""
    stack = lf.Layer("top", sigma_a=0.02, sigma_s=10.0, g=0.9, n=1.4, thickness=1.0) | lf.HalfSpace("below", sigma_a=3.0, sigma_s=10.0, g=0.9, n=1.4)
    geometry = lf.RadialReflectance(r=[4.0, 6.0, 8.0, 11.0])
    found = lf.predict(stack, geometry, solver=lf.DiscreteOrdinates())[0]
    more = lf.predict(stack, geometry, solver=lf.DiscreteOrdinates(frequencies=96))[0].values
    error = np.abs(found.values / more - 1.0)
    assert np.max(error) <= 0.02
    assert np.all(np.abs(found.values - more) <= found.estimated_error)
