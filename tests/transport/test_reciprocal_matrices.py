"""Reciprocal matrices: symmetry, energy, and what `predict` says of the same stacks by its own way (lines of sight and beams of no weight)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import layerfit as lf
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain

SOLVER = lf.DiscreteOrdinates(streams=16)
ORDERS = 12  # all that 16 streams in two panels can tell apart


def predicted(stack: lf.Stack, geometries) -> list[np.ndarray]:
    """Values alone: no second rule for the error."""
    columns = to_columns(stack)
    return [np.asarray(v) for v in SOLVER.forward(Domain(stack, columns, columns), geometries, [(0.0, 0.0)] * len(geometries))(columns)]


def single(albedo: float = 0.9, roughness: float = 0.0, **around) -> lf.Stack:
    layer = lf.Layer("slab", sigma_a=2.0 * (1.0 - albedo), sigma_s=2.0 * albedo, g=0.5, n=1.4, thickness=1.0, roughness=roughness)
    return lf.Stack([layer], roughness_below=roughness, **around)


def double(albedo: float = 0.9, roughness: float = 0.0) -> lf.Stack:
    """Two layers of unlike index on glass."""
    upper = lf.Layer("upper", sigma_a=1.0 - albedo, sigma_s=albedo, g=0.6, n=1.3, thickness=0.7)
    lower = lf.Layer("lower", sigma_a=1.0 - albedo, sigma_s=2.0 * albedo, g=0.0, n=1.45, thickness=0.5, roughness=roughness)
    return lf.Stack([upper, lower], n_below=1.5)


DEEP = lf.Stack([lf.HalfSpace("deep", sigma_a=0.1, sigma_s=1.0, g=0.5, n=1.4)])
STACKS = {"one layer": single(), "two layers": double(), "half space": DEEP, "rough": single(roughness=0.3)}


@pytest.fixture(scope="module")
def matrices() -> dict[str, lf.ReciprocalMatrices]:
    return {name: lf.reciprocal_matrices(stack, solver=SOLVER, orders=ORDERS) for name, stack in STACKS.items()}


def angles(mu) -> np.ndarray:
    return np.degrees(np.arccos(np.asarray(mu)))


@pytest.mark.parametrize("name", STACKS)
def test_reciprocity(matrices, name):
    m = matrices[name]
    for kernel in (m.R_above, m.R_below, m.surface_above, m.surface_below):
        assert np.all(np.abs(kernel - jnp.swapaxes(kernel, 1, 2)) <= 1e-13)
    difference = m.T_down / m.n_below**2 - jnp.swapaxes(m.T_up, 1, 2) / m.n_above**2
    assert np.all(np.abs(difference) <= 1e-13)
    assert abs(float(m.weight_above @ m.mu_above) - 0.5) <= 1e-14
    if name == "half space":
        assert m.R_below.shape == (ORDERS, 0, 0) and m.T_down.shape[1] == 0
    else:
        assert abs(float(m.weight_below @ m.mu_below) - 0.5) <= 1e-14
        assert float(jnp.abs(m.T_down[1]).max()) >= 1e-3


def test_radiances_of_one_layer():
    """The cosine series at ordinates against lines of sight and a beam in their place, both ways through."""
    m = lf.reciprocal_matrices(STACKS["one layer"], solver=SOLVER, orders=ORDERS)
    angle = np.sort(angles(m.mu_above))  # the ordinates come in falling cosines or rising ones, which is read here
    order = np.argsort(angles(m.mu_above))
    where = {"incidence": float(angle[1]), "azimuth": 40.0}
    R, T = predicted(STACKS["one layer"], [lf.AngularReflectance(angle, **where), lf.AngularTransmittance(angle, **where)])
    assert np.max(np.abs(m.brdf(np.radians(40.0))[order, order[1]] - R)) <= 2e-3 * np.max(R)
    assert np.max(np.abs(m.btdf(np.radians(40.0))[order, order[1]] - T)) <= 2e-3 * np.max(T)


def forward(n: float) -> lf.Stack:
    """Two strongly forward scattering layers."""
    upper = lf.Layer("upper", sigma_a=0.1, sigma_s=2.0, g=0.9, n=n, thickness=0.5)
    return lf.Stack([upper, lf.Layer("lower", sigma_a=0.0, sigma_s=1.0, g=0.8, n=1.2, thickness=1.0)], n_below=1.1)


@pytest.mark.parametrize("stack", [forward(1.2), forward(1.4), lf.Stack([lf.HalfSpace("deep", sigma_a=1.0, sigma_s=2.0, g=0.95, n=1.4)])])
def test_light_scattered_once_is_exact(stack):
    """Averages over azimuth at ordinates, between smooth faces, g to 0.95: what predict says of a beam and lines of sight there, which corrects
    light scattered once beam by beam. Without it the matrices are off by a tenth and more."""
    m = lf.reciprocal_matrices(stack, solver=SOLVER, orders=1)
    i = len(m.mu_above) // 2
    angle, order = float(angles(m.mu_above)[i]), np.argsort(angles(m.mu_above))
    asked = [(lf.AngularReflectance(angles(m.mu_above)[order], incidence=angle), m.R_above[0][order, i])]
    if not stack.half_space:
        order = np.argsort(angles(m.mu_below))
        asked.append((lf.AngularTransmittance(angles(m.mu_below)[order], incidence=angle), m.T_down[0][order, i]))
    for (_, ours), theirs in zip(asked, predicted(stack, [g for g, _ in asked]), strict=True):
        assert np.max(np.abs(ours / theirs - 1.0)) <= 1e-6
    assert np.all(np.abs(m.R_above - jnp.swapaxes(m.R_above, 1, 2)) <= 1e-13)


@pytest.mark.long
@pytest.mark.parametrize("name", STACKS)
def test_what_predict_says(matrices, name):
    """Totals of diffuse light and of a beam at an ordinate; radiances from the cosine series at ordinates. What is left of these is the series' end.

    Behind a rough face predict carries a beam by its own paths, not by the symmetric part of the ordinates'.
    """
    m, stack = matrices[name], STACKS[name]
    i = len(m.mu_above) // 2
    angle, order = float(angles(m.mu_above)[i]), np.argsort(angles(m.mu_above))
    where = {"incidence": angle, "azimuth": 40.0}
    beam = 1e-12 if name != "rough" else 5e-3
    asked = [
        (lf.TotalReflectance(incidence="diffuse", specular="included"), m.diffuse(m.reflectance())[None], 1e-12),
        (lf.TotalReflectance(incidence="diffuse"), m.diffuse(m.reflectance(surface=False))[None], 1e-12),
        (lf.TotalReflectance(incidence=angle, specular="included"), m.reflectance()[i : i + 1], beam),
        (lf.TotalReflectance(incidence=angle), m.reflectance(surface=False)[i : i + 1], beam),
        (lf.AngularReflectance(angles(m.mu_above)[order], **where), m.brdf(np.radians(40.0))[order, i], 2e-3 if name != "rough" else 5e-2),
    ]
    if not stack.half_space:
        order = np.argsort(angles(m.mu_below))
        asked += [
            (lf.TotalTransmittance(incidence="diffuse"), m.diffuse(m.transmittance())[None], 1e-12),
            (lf.TotalTransmittance(incidence=angle), m.transmittance()[i : i + 1], beam),
            (lf.AngularTransmittance(angles(m.mu_below)[order], **where), m.btdf(np.radians(40.0))[order, i], 2e-3 if name != "rough" else 5e-2),
        ]
    for (geometry, ours, allowed), theirs in zip(asked, predicted(stack, [g for g, _, _ in asked]), strict=True):
        error = np.max(np.abs(ours - theirs)) / np.max(theirs)
        assert error <= allowed, (geometry, error)


@pytest.mark.parametrize("roughness", [0.0, pytest.param(0.3, marks=pytest.mark.long)])
def test_energy_at_albedo_1(roughness):
    m = lf.reciprocal_matrices(double(1.0, roughness), solver=SOLVER, orders=ORDERS)
    for side in ("above", "below"):
        assert np.all(np.abs(m.reflectance(side=side) + m.transmittance(side=side) - 1.0) <= 1e-12)


def test_surface_is_apart(matrices):
    """Smooth: a mirror of Fresnel's reflectance. Rough: no beam, and r_tot is the sum."""
    from layerfit.optics.fresnel import reflectance

    m = matrices["one layer"]
    assert np.max(np.abs(m.surface_above)) <= 1e-13
    assert np.all(np.abs(m.regular_surface_above - reflectance(m.mu_above, 1.0 / 1.4)) <= 1e-14)
    tau = 2.0 * (1.0 - 0.9 * 0.5**ORDERS)  # delta-M's share is the first moment beyond what the rule can tell apart
    inside = jnp.sqrt(1.0 - (1.0 - m.mu_above**2) / 1.4**2)
    once, passing = reflectance(m.mu_above, 1.0 / 1.4), jnp.exp(-tau / inside)
    assert np.all(np.abs(m.regular_down - (1.0 - once) ** 2 * passing / (1.0 - (once * passing) ** 2)) <= 1e-13)
    m = matrices["rough"]
    assert np.all(m.regular_surface_above == 0.0) and np.all(m.regular_down == 0.0)
    assert np.all(m.r_tot == m.surface_above + m.R_above)
    assert float(m.diffuse(m.reflectance() - m.reflectance(surface=False))) >= 0.04


def test_a_rough_surface_is_smooth_in_direction(matrices):
    """The lobe of the face alone is that of its facets at each pair of ordinates, without ripples in azimuth; its share stays."""
    from layerfit.optics.microfacet_paths import brdf

    m = lf.reciprocal_matrices(single(roughness=0.6), solver=SOLVER, orders=ORDERS)
    mu, phi = np.asarray(m.mu_above), np.linspace(0.0, np.pi, 9)
    once = np.asarray(brdf(*map(jnp.asarray, (mu[None, None, :], mu[None, :, None], phi[:, None, None], 1.0 / 1.4, 0.6))))
    ours = np.asarray(m.brdf(phi, surface=True) - m.brdf(phi))
    steep = mu >= 0.15
    difference = (ours - once)[:, steep][:, :, steep]
    assert np.max(np.abs(difference)) <= 0.02  # what meets a second facet is spread evenly
    assert np.max(np.ptp(difference, axis=0)) <= 2e-3  # and alike in all azimuths: 12 orders are nearly enough
    shares = 2.0 * np.pi * (np.asarray(m.weight_above) * mu) @ np.asarray(m.surface_above[0])
    assert np.all((shares >= 0.0) & (shares <= 1.0))


def test_derivatives():
    """Compiled, with traced numbers; forward against reverse and differences, in a refractive index too."""
    stack = double()

    def some(x):
        moved = stack.set({"upper.sigma_a": x[0], "lower.n": x[1], "upper.thickness": x[2]})
        m = lf.reciprocal_matrices(moved, solver=lf.DiscreteOrdinates(streams=8), orders=2, like=stack)
        return jnp.stack([m.brdf(0.3)[1, 2], m.btdf(0.3)[2, 1], m.diffuse(m.reflectance())])

    x = jnp.array([0.1, 1.45, 0.7])
    some = jax.jit(some)
    forward, reverse = jax.jit(jax.jacfwd(some))(x), jax.jit(jax.jacrev(some))(x)
    assert np.all(np.abs(forward - reverse) <= 1e-11)
    h = 1e-4
    difference = jnp.stack([(some(x.at[i].add(h)) - some(x.at[i].add(-h))) / (2.0 * h) for i in range(3)], axis=1)
    assert np.all(np.abs(forward - difference) <= 1e-6)


def test_what_it_refuses():
    with pytest.raises(ValueError, match="orders"):
        lf.reciprocal_matrices(single(), solver=SOLVER, orders=13)
    with pytest.raises(ValueError, match="needs g"):
        lf.reciprocal_matrices(lf.Stack([lf.HalfSpace("deep", sigma_a=0.1, sigma_s_prime=1.0, n=1.4)]))
    with pytest.raises(ValueError, match="give like"):
        jax.jit(lambda x: lf.reciprocal_matrices(single().set({"slab.sigma_a": x}), solver=SOLVER).R_above)(0.1)
    with pytest.raises(ValueError, match="other layers"):
        lf.reciprocal_matrices(single(), like=double())
