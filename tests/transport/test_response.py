"""What must hold for every solver: associativity, identity, nothing in zero thickness, reversal, and the sum rules of splitting."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import layerfit as lf
from layerfit.scene.columns import to_columns
from layerfit.transport.beam import point_sources
from layerfit.transport.diffusion_layer import exponential_source_layer
from layerfit.transport.response import Beamed, Response, Scalar, compose, compose_all, excess_reflection, reflection

K = jnp.concatenate([jnp.zeros(1), jnp.geomspace(1e-2, 30, 12)])

SOLVERS = [
    lf.LayeredDiffusion(),
    lf.LayeredDiffusion(source="point", boundary="extrapolated", diffusion="transport"),
    lf.LayeredDiffusion(source="exponential", boundary="partial_current", diffusion="grosjean"),
    lf.LayeredDiffusion(source="mixed", boundary="extrapolated", diffusion="scattering"),
    lf.Multipole(),
    lf.Multipole(source="exponential"),
    lf.Multipole(reflection="egan-hilgeman"),
]


def ids(solver):
    return repr(solver)


def differ(one, other):
    """Largest absolute difference between two responses."""
    return max(float(jnp.max(jnp.abs(a - b))) for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True))


def three_layers(n=(1.4, 1.4, 1.4), n_above=1.0, n_below=1.0):
    return lf.Stack(
        [
            lf.Layer("a", sigma_a=0.02, sigma_s_prime=1.5, g=0.7, n=n[0], thickness=1.0),
            lf.Layer("b", sigma_a=0.3, sigma_s_prime=1.0, g=0.9, n=n[1], thickness=2.0),
            lf.Layer("c", sigma_a=0.001, sigma_s_prime=4.0, g=0.0, n=n[2], thickness=0.5),
        ],
        n_above=n_above,
        n_below=n_below,
    )


def pieces_of(solver, stack):
    """The pieces a solver composes."""
    columns = to_columns(stack)
    if isinstance(solver, lf.LayeredDiffusion):
        return solver.pieces(solver.numbers(columns), K)
    from layerfit.transport.multipole import slabs

    return [solver._layer(slab, K) for slab in slabs(columns, solver.reflection)]


@pytest.mark.parametrize("solver", SOLVERS, ids=ids)
def test_associative_with_identity(solver):
    a, b, c = (pieces_of(solver, three_layers((1.4, 1.33, 1.5))) * 2)[1:4]
    assert differ(compose(compose(a, b), c), compose(a, compose(b, c))) <= 1e-12
    assert differ(compose(a, a.identity()), a) <= 1e-15
    assert differ(compose(a.identity(), a), a) <= 1e-15
    assert differ(compose(a, b).reversed(), compose(b.reversed(), a.reversed())) <= 1e-15
    pieces = [a, b, c]
    assert (
        max(
            float(jnp.max(jnp.abs(x - y)))
            for x, y in zip(jax.tree.leaves(reflection(pieces)), jax.tree.leaves(compose_all(pieces).R_above), strict=True)
        )
        <= 1e-14
    )


@pytest.mark.parametrize("kind", [Scalar, Beamed])
def test_compose_is_the_geometric_series(kind):
    """Against light that is followed bounce by bounce."""
    rng = np.random.default_rng(1)
    size = len(jax.tree.leaves(kind(*[jnp.zeros(3)] * (1 if kind is Scalar else 3))))
    draw = lambda: kind(*[jnp.asarray(0.4 * rng.random(3)) for _ in range(size)])  # noqa: E731
    upper, lower = Response(draw(), draw(), draw(), draw()), Response(draw(), draw(), draw(), draw())
    light, T, R = upper.T_down, None, upper.R_above
    for _ in range(80):
        T = lower.T_down @ light if T is None else T + lower.T_down @ light
        back = lower.R_above @ light
        R = R + upper.T_up @ back
        light = upper.R_below @ back
    whole = compose(upper, lower)
    for found, expected in ((whole.R_above, R), (whole.T_down, T)):
        assert max(float(jnp.max(jnp.abs(a - b))) for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True)) <= 1e-14


def test_excess_reflection_is_the_difference():
    rng = np.random.default_rng(2)
    draw = lambda: Beamed(*[jnp.asarray(0.4 * rng.random(4)) for _ in range(3)])  # noqa: E731
    upper, lower, reference = Response(draw(), draw(), draw(), draw()), draw(), draw()
    nothing = Response(lower, lower.zero(), lower.zero(), lower.zero()), Response(reference, lower.zero(), lower.zero(), lower.zero())
    expected = compose(upper, nothing[0]).R_above - compose(upper, nothing[1]).R_above
    found = excess_reflection(upper, lower, reference)
    assert max(float(jnp.max(jnp.abs(a - b))) for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True)) <= 1e-15


@pytest.mark.parametrize("solver", SOLVERS, ids=ids)
def test_reversal_swaps_the_operators(solver):
    stack = three_layers((1.4, 1.33, 1.5), n_above=1.0, n_below=1.2)
    upside_down = lf.Stack(list(reversed(stack.layers)), n_above=1.2, n_below=1.0)
    one, other = solver.response(to_columns(stack), K), solver.response(to_columns(upside_down), K)
    assert differ(one.reversed(), other) <= 1e-12


@pytest.mark.parametrize("solver", [s for s in SOLVERS if isinstance(s, lf.LayeredDiffusion) or s.source == "exponential"], ids=ids)
def test_zero_thickness_is_nothing(solver):
    stack = three_layers()
    nothing = lf.Layer("nothing", sigma_a=0.5, sigma_s_prime=7.0, g=0.8, n=1.4, thickness=0.0)
    a, b, c = stack.layers
    expected = solver.response(to_columns(stack), K)
    for layers in ([nothing, a, b, c], [a, nothing, b, c], [a, b, c, nothing]):
        found = solver.response(to_columns(lf.Stack(layers)), K)
        if isinstance(solver, lf.Multipole):  # a slab between its own extrapolated boundaries: nothing only in the limit of its operators
            found = solver._layer(_slab_of(solver, nothing), K)
            assert differ(found, found.identity()) <= 1e-12
        else:
            assert differ(found, expected) <= 1e-12
    thin = [lf.Layer("thin", sigma_a=0.5, sigma_s_prime=7.0, g=0.8, n=1.4, thickness=1e-9), a, b, c]
    if isinstance(solver, lf.LayeredDiffusion):
        assert differ(solver.response(to_columns(lf.Stack(thin)), K), expected) <= 1e-6


def _slab_of(solver, layer):
    from layerfit.transport.multipole import slabs

    other = lf.Layer("other", sigma_a=0.1, sigma_s_prime=1.0, n=1.4, thickness=1.0)
    return slabs(to_columns(lf.Stack([layer, other])), solver.reflection)[0]


@pytest.mark.parametrize("parts", [2, 5, 50])
@pytest.mark.parametrize("solver", [s for s in SOLVERS if isinstance(s, lf.LayeredDiffusion)], ids=ids)
def test_splitting_layered_diffusion_changes_nothing(solver, parts):
    slab = lf.Layer("slab", sigma_a=0.02, sigma_s_prime=1.2, g=0.8, n=1.4, thickness=8.0)
    pieces = [slab.replace(thickness=8.0 / parts) for _ in range(parts)]
    split = lf.Stack([lf.Layer(f"slab{i}", **p._keywords()) for i, p in enumerate(pieces)])
    assert differ(solver.response(to_columns(lf.Stack([slab])), K), solver.response(to_columns(split), K)) <= 1e-12
    half = lf.HalfSpace("deep", sigma_a=0.02, sigma_s_prime=1.2, g=0.8, n=1.4)
    deep = lf.Stack([*split.layers, half])
    found, expected = (solver.response(to_columns(s), K).R_above for s in (deep, lf.Stack([half])))
    assert max(float(jnp.max(jnp.abs(a - b))) for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True)) <= 1e-12


def test_splitting_the_multipole_is_its_error():
    """Kubelka-Munk takes what leaves a layer for a fresh beam: a matched slab of 10 mfp' as 5 + 5 loses 0.0022 of R (design: .7350 -> .7328)."""
    whole = lf.Stack([lf.Layer("slab", sigma_a=0.01, sigma_s_prime=0.99, n=1.0, thickness=10.0)])
    halves = lf.Stack([lf.Layer(name, sigma_a=0.01, sigma_s_prime=0.99, n=1.0, thickness=5.0) for name in ("upper", "lower")])
    R = [float(lf.predict(s, lf.TotalReflectance(), solver=lf.Multipole())[0].values[0]) for s in (whole, halves)]
    assert abs(R[0] - 0.7350) <= 0.5e-4
    assert abs(R[1] - 0.7328) <= 0.5e-4


@pytest.mark.parametrize("depth", [0.0, 1e-9, 1e-3, 0.7, 5.0, 80.0, 1e4])
def test_one_layer_with_a_beam(depth):
    """Two halves make a whole, and at q = 0 all that the beam loses to scattering comes out, at thicknesses from 0 to 1e4 mfp'."""
    q, one = jnp.array([0.0, 1e-12, 1e-3, 0.5, 4.0, 1e4]), jnp.ones(6)
    layer = lambda d: exponential_source_layer(0.3 * one, q, d * one, 1.1 * one, 1.0 * one)  # noqa: E731
    whole = layer(depth)
    assert differ(whole, compose(layer(depth / 2), layer(depth / 2))) <= 1e-15
    out = float(whole.R_above.source[0] + whole.T_down.source[0])
    assert abs(out - (1 - np.exp(-1.1 * depth)) / 1.1) <= 1e-15
    assert abs(float(whole.R_above.diffuse[0] + whole.T_down.diffuse[0]) - 1) <= 1e-15


def test_point_source_conserves_what_is_scattered():
    columns = to_columns(three_layers())
    (strength, depth), _ = point_sources(columns, jnp.ones(3), None)
    tau = np.concatenate([[0], np.cumsum(np.asarray(columns.sigma_t_prime * columns.thickness))])
    scattered = sum(np.exp(-tau[i]) * -np.expm1(tau[i] - tau[i + 1]) * float(columns.sigma_s_prime[i] / columns.sigma_t_prime[i]) for i in range(3))
    inside = int(np.argmax(np.asarray(strength)))
    assert abs(float(strength[inside]) * np.exp(-tau[inside]) - scattered) <= 1e-15
    assert np.count_nonzero(np.asarray(strength)) == 1
    assert 0 <= float(depth[inside]) <= float(columns.thickness[inside])
