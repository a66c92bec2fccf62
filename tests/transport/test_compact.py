"""Compact forms: reciprocity, their stated error at random places, files, derivatives, refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import layerfit as lf
from layerfit.optics.splines import basis, clamped_knots, interpolating_knots

SOLVER = lf.DiscreteOrdinates(streams=24)
FREE = {"slab.sigma_a": (0.05, 0.5), "slab.thickness": (0.5, 1.0)}
STACK = lf.Stack([lf.Layer("slab", sigma_a=0.1, sigma_s=2.0, g=0.4, n=1.4, thickness=1.0)], n_below=1.3)
AT = {"slab.sigma_a": 0.2, "slab.thickness": 0.8}
POINTS = {"slab.sigma_a": 4, "slab.thickness": 3}


@pytest.fixture(scope="module")
def form() -> lf.CompactForm:
    return lf.compact_form(STACK, FREE, orders=5, angles=6, points=POINTS, solver=SOLVER)


def test_splines():
    """They sum to 1, are continuous, reproduce cubics, and go through their points."""
    knots = clamped_knots(np.array([0.0, 0.1, 0.4, 1.0]))
    x = np.linspace(0.0, 1.0, 41)
    rows = np.asarray(basis(x, knots, 3))
    assert rows.shape == (41, 6) and np.all(np.abs(rows.sum(axis=1) - 1.0) <= 1e-14)
    for power in range(4):
        C, *_ = np.linalg.lstsq(rows, x**power, rcond=None)
        assert np.all(np.abs(rows @ C - x**power) <= 1e-13)
        slope = np.asarray(jax.vmap(jax.grad(lambda t, C=C: basis(t, knots, 3) @ C))(jnp.asarray(x)))
        assert np.all(np.abs(slope - power * x ** max(power - 1, 0)) <= 1e-12)
    for count in (2, 3, 4, 7):
        points = np.linspace(0.0, 1.0, count)
        degree = min(3, count - 1)
        C = np.linalg.solve(np.asarray(basis(points, interpolating_knots(points), degree)), points**degree)
        assert np.all(np.abs(np.asarray(basis(x, interpolating_knots(points), degree)) @ C - x**degree) <= 1e-13)


def test_reciprocity_is_exact(form):
    mu, other, phi = np.random.default_rng(0).uniform(0.01, 1.0, (3, 40))
    for side in ("above", "below"):
        f, g = (form.brdf(*pair, phi, AT, side=side) for pair in ((mu, other), (other, mu)))
        assert np.all(np.abs(f - g) <= 1e-15)
    down, up = form.btdf(mu, other, phi, AT), form.btdf(other, mu, phi, AT, side="below")
    assert np.all(np.abs(down / 1.3**2 - up) <= 1e-15)
    assert float(jnp.min(down)) >= 1e-3


def test_error_is_not_understated(form):
    """At random free numbers, against matrices of more streams and orders; and the form is of use."""
    random = np.random.default_rng(3)
    phi = np.linspace(0.0, np.pi, 7)
    solver = lf.DiscreteOrdinates(streams=28)
    for shares in random.uniform(0.0, 1.0, (6, 2)):
        free = {"slab.sigma_a": 0.05 * 10.0 ** shares[0], "slab.thickness": 0.5 + 0.5 * shares[1]}
        m = lf.reciprocal_matrices(STACK.set(free), solver=solver, orders=12)
        a, b = m.mu_above, m.mu_below
        around = phi[:, None, None]
        both = (
            (m.brdf(phi), form.brdf(a, a[:, None], around, free)),
            (m.brdf(phi, side="below"), form.brdf(b, b[:, None], around, free, side="below")),
            (m.btdf(phi), form.btdf(a, b[:, None], around, free)),
        )
        # seen from below the critical angle of the upper face is harder than these few coefficients can do
        for (exact, ours), absolute, relative, use in zip(both, form.errors.absolute, form.errors.relative, (0.04, 0.2, 0.1), strict=True):
            error, size = np.abs(exact - ours), np.asarray(exact)
            assert np.max(error) <= absolute <= use * np.max(size)
            assert np.max((error / size)[size >= 0.01 * size.max()]) <= relative
        totals = (
            (m.reflectance(), form.reflectance(a, free)),
            (m.reflectance(side="below"), form.reflectance(b, free, side="below")),
            (m.transmittance(), form.transmittance(a, free)),
        )
        for (exact, ours), allowed in zip(totals, form.errors.total, strict=True):
            assert np.max(np.abs(exact - ours)) <= allowed <= 0.05
        up = np.abs(m.transmittance(side="below") - form.transmittance(b, free, side="below"))
        assert np.max(up) <= 0.02


@pytest.mark.long
def test_against_predict(form):
    """Normal incidence, by lines of sight and a beam."""
    from layerfit.scene.columns import to_columns
    from layerfit.solver import Domain

    stack = STACK.set(AT)
    columns = to_columns(stack)
    geometries = [lf.AngularReflectance([20.0, 50.0]), lf.AngularTransmittance([20.0, 50.0]), lf.TotalReflectance(specular="included")]
    R, T, total = SOLVER.forward(Domain(stack, columns, columns), geometries, [(0.0, 0.0)] * 3)(columns)
    mu = np.cos(np.radians([20.0, 50.0]))
    assert np.max(np.abs(form.brdf(1.0, mu, 0.0, AT) - R)) <= form.errors.absolute[0]
    assert np.max(np.abs(form.btdf(1.0, mu, 0.0, AT) - T)) <= form.errors.absolute[2]
    assert abs(form.reflectance(1.0, AT) - total[0]) <= form.errors.total[0]
    beams = form.regular(1.0, AT)
    assert abs(float(beams.surface_above) - (0.4 / 2.4) ** 2) <= 1e-12


def test_files(form, tmp_path):
    path = tmp_path / "slab.npz"
    form.save(path)
    again = lf.CompactForm.load(path)
    for one, other in zip(jax.tree.leaves(form), jax.tree.leaves(again), strict=True):
        assert np.array_equal(np.asarray(one), np.asarray(other))
    assert (again.names, again.errors, again.layout) == (form.names, form.errors, form.layout)
    assert form.brdf(0.7, 0.3, 1.0, AT) == again.brdf(0.7, 0.3, 1.0, AT)
    assert form.transmittance(0.7, AT) == again.transmittance(0.7, AT)
    for name, write in (
        ("text.npz", lambda p: p.write_text("nothing of the kind")),
        ("other.npz", lambda p: np.savez(p, a=np.ones(3))),
        ("empty.npz", lambda p: p.write_bytes(b"")),
        ("array.npy", lambda p: np.save(p, np.ones(3))),
    ):
        write(tmp_path / name)
        with pytest.raises(lf.InputError, match=r"CompactForm\.save"):
            lf.CompactForm.load(tmp_path / name)
    with np.load(path) as content:
        np.savez(tmp_path / "later.npz", **{**content, "version": np.array(2)})
        np.savez(tmp_path / "torn.npz", **{**content, "text": np.array("{}")})
        np.savez(tmp_path / "short.npz", **{key: content[key] for key in content if key != "R_above"})
    with pytest.raises(lf.InputError, match="version 2"):
        lf.CompactForm.load(tmp_path / "later.npz")
    for name in ("torn.npz", "short.npz", "missing.npz"):
        with pytest.raises(lf.InputError, match=name):
            lf.CompactForm.load(tmp_path / name)


def test_compiled_and_differentiated(form):
    """The form is an argument of what is compiled; derivatives in free numbers and cosines against differences, at normal incidence too."""

    def some(form, x):
        free = {"slab.sigma_a": x[0], "slab.thickness": x[1]}
        return jnp.stack([form.brdf(x[2], 0.5, 0.7, free), form.btdf(x[2], 1.0, 0.7, free), form.reflectance(x[2], free)])

    compiled = jax.jit(some)
    x = jnp.array([0.2, 0.8, 0.6])
    assert np.all(np.abs(compiled(form, x) - some(form, x)) <= 1e-14)
    forward, reverse = (jax.jit(derivative(some, argnums=1))(form, x) for derivative in (jax.jacfwd, jax.jacrev))
    assert np.all(np.abs(forward - reverse) <= 1e-12)
    h = 1e-5
    difference = jnp.stack([(compiled(form, x.at[i].add(h)) - compiled(form, x.at[i].add(-h))) / (2.0 * h) for i in range(3)], axis=1)
    assert np.all(np.abs(forward - difference) <= 1e-7)
    assert np.all(np.isnan(compiled(form, x.at[0].set(0.6)))) and np.all(np.isnan(compiled(form, x.at[2].set(1.1))[:2]))


def test_what_it_refuses(form):
    with pytest.raises(lf.InputError, match="holds from"):
        form.brdf(0.5, 0.5, 0.0, {**AT, "slab.sigma_a": 0.6})
    with pytest.raises(lf.InputError, match="for each of"):
        form.brdf(0.5, 0.5, 0.0, {"slab.sigma_a": 0.2})
    with pytest.raises(lf.InputError, match="0 to 1"):
        form.btdf(1.5, 0.5, 0.0, AT)
    for free, settings, message in (
        ({}, {}, "nothing was given"),
        ({"slab.colour": (0, 1)}, {}, "no number of this scene"),
        ({"slab.sigma_a": 3}, {}, "min, max"),
        ({"slab.sigma_a": (0.2, 0.1)}, {}, "below the second"),
        ({"slab.sigma_a": {"min": 0, "max": 1, "scale": "log"}}, {}, "above 0"),
        ({"slab.roughness": (0.0, 0.3)}, {}, "above 0"),
        ({"slab.n": (1.2, 1.5)}, {}, "overlap"),
        ({"slab.sigma_a": (0.1, 0.2)}, {"angles": 40}, "angles"),
        ({"slab.sigma_a": (0.1, 0.2)}, {"points": 1}, "points"),
        ({"slab.sigma_a": (0.1, 0.2)}, {"orders": 0}, "orders"),
    ):
        with pytest.raises(lf.InputError, match=message):
            lf.compact_form(STACK, free, solver=SOLVER, **settings)


@pytest.mark.long
@pytest.mark.parametrize(
    "stack",
    [
        lf.Stack([lf.Layer("slab", sigma_a=0.1, sigma_s=2.0, g=0.4, n=1.0, thickness=1.0)]),
        lf.Stack([lf.Layer("slab", sigma_a=0.1, sigma_s=2.0, g=0.4, n=1.4, thickness=1.0, roughness=0.3)], roughness_below=0.3),
        lf.Layer("slab", sigma_a=0.1, sigma_s=2.0, g=0.4, n=1.4, thickness=1.0) | lf.HalfSpace("deep", sigma_a=0.05, sigma_s=1.0, g=0.4, n=1.4),
    ],
    ids=["matched", "rough", "half space"],
)
def test_other_stacks(stack):
    """Grazing light without an index step, rough faces, nothing below: stated errors hold, and are small but for grazing light on rough faces."""
    rough = any(layer.roughness > 0 for layer in stack.layers)
    free = {"slab.sigma_a": (0.05, 0.5)}
    form = lf.compact_form(stack, free, orders=6, angles=8, solver=lf.DiscreteOrdinates(streams=48))
    for x in (0.06, 0.13, 0.31):
        m = lf.reciprocal_matrices(stack.set({"slab.sigma_a": x}), solver=lf.DiscreteOrdinates(streams=56), orders=18)
        error = np.abs(form.brdf(m.mu_above, m.mu_above[:, None], 0.5, {"slab.sigma_a": x}) - m.brdf(0.5))
        total = np.abs(form.reflectance(m.mu_above, {"slab.sigma_a": x}) - m.reflectance())
        assert np.max(error) <= form.errors.absolute[0]
        assert np.max(total) <= form.errors.total[0]
        steep = np.asarray(m.mu_above) >= (0.3 if rough else 0.0)
        assert np.max(error[np.ix_(steep, steep)]) <= (0.05 if rough else 0.1) * np.max(m.brdf(0.5))
        assert np.max(total[steep]) <= 0.01
