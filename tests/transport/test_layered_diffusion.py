"""Layered diffusion against values of other programs, and physical sense on random stacks."""

import cases
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import layerfit as lf
from layerfit.optics.hankel import Kernel, Span, Term, quadrature
from layerfit.scene.columns import Columns, to_columns
from layerfit.transport.diffusion_pieces import Numbers
from layerfit.transport.interior import fluence_images, spectral_fluence
from layerfit.transport.layered_diffusion import LayeredDiffusion

HALF = lf.Stack([lf.HalfSpace("tissue", sigma_a=0.01, sigma_s_prime=1.0, g=0.8, n=1.4)])
ENTERING = 1 - (0.4 / 2.4) ** 2


@pytest.mark.parametrize("subtract", [True, False])
@pytest.mark.parametrize(
    ("source", "expected"),
    [("point", [0.0225725, 0.00450628, 0.000171486]), ("exponential", [0.0210195, 0.00408104, 0.000162658])],
)
def test_half_space_of_vts_with_exact_moments(source, expected, subtract):
    """Virtual Tissue Simulator, R(rho) at 1, 3, 10 mm (reference-numbers.md section 7); its point source has strength 1, ours alpha'."""
    solver = lf.LayeredDiffusion(source=source, boundary="extrapolated", diffusion="transport", subtract=subtract)
    found = lf.predict(HALF, lf.RadialReflectance(r=[1, 3, 10]), solver=solver)[0].values / ENTERING
    found = found * 1.01 if source == "point" else found
    assert np.max(np.abs(found / expected - 1)) <= 1e-5


@pytest.mark.parametrize(
    ("source", "expected"),
    [("point", [0.0224959, 0.00448017, 0.000170622]), ("exponential", [0.0209155, 0.00405628, 0.000161842])],
)
def test_half_space_of_vts_with_its_polynomials(source, expected):
    """The same with the cubic fits for A, R1 and R2 that VTS uses."""
    n = 1.4
    A = -0.13755 * n**3 + 4.3390 * n**2 - 4.90466 * n + 1.68960
    R1 = 0.7857 * n**3 - 4.3259 * n**2 + 8.26405 * n - 4.71306
    R2 = -0.02043 * n**3 - 0.38418 * n**2 + 2.01132 * n - 1.62198
    solver = lf.LayeredDiffusion(source=source, boundary="extrapolated", diffusion="transport")
    numbers = solver.numbers(to_columns(HALF))
    numbers = numbers.__class__(
        **{**vars(numbers), "edge_A": (jnp.array(A),), "exit_fluence": (jnp.array(0.25 * (1 - R1)),), "exit_flux": (jnp.array(0.5 * (1 - R2)),)}
    )
    r = np.array([1.0, 3.0, 10.0])
    rule = quadrature(Kernel((Term(np.full(3, 1 / (2 * np.pi)), r, "J0", 1),)), Span(0.17, 40.0, source == "exponential"))
    from layerfit.transport.response import reflection

    found = rule.weights @ np.asarray(reflection(solver.pieces(numbers, jnp.asarray(rule.k))).source) / ENTERING
    found = found * 1.01 if source == "point" else found
    assert np.max(np.abs(found / expected - 1)) <= 1e-5


def light_propagation(mu_a, mu_s_prime, thickness):
    """The numbers of LightPropagation.jl's recipe: D = 1/(3 mu_s'), point of strength 1 at 1/mu_s', n = 1, extrapolated boundaries; cm."""
    mu_a, mu_s_prime = np.array(mu_a), np.array(mu_s_prime)
    D = 1 / (3 * mu_s_prime)
    half_space = len(thickness) < len(mu_a)
    edges = [0] if half_space else [0, -1]
    scalars = lambda values: tuple(jnp.asarray(float(v)) for v in values)  # noqa: E731
    zero = scalars(0 * mu_a)
    first = scalars([1.0, *([0.0] * (len(mu_a) - 1))])
    depth = scalars([1 / mu_s_prime[0], *([0.0] * (len(mu_a) - 1))])
    return Numbers(
        N=scalars(D),
        decay2=scalars(mu_a / D),
        thickness=scalars(thickness),
        extinction=scalars(0 * mu_a + 1e-9),
        fed=zero,
        down=(first, depth),
        up=(zero, zero),
        inner_beam=scalars([0.0] * (len(mu_a) - 1)),
        edge_beam=scalars([0.0 for _ in edges]),
        edge_A=scalars([1.0 for _ in edges]),
        edge_D=scalars([D[i] for i in edges]),
        edge_decay2=scalars([(mu_a / D)[i] for i in edges]),
        edge_n2=scalars([1.0 for _ in edges]),
        exit_fluence=scalars([0.25 for _ in edges]),
        exit_flux=scalars([0.5 for _ in edges]),
        half_space=half_space,
        spread=False,
        pointed=True,
    )


@pytest.mark.parametrize(
    ("mu_a", "mu_s_prime", "thickness", "rho", "expected", "bound"),
    [
        ([0.1], [10], [], 1.0, 0.024035998288332864, 1e-10),
        ([0.1], [10], [1.0], 1.0, 0.021728999570708202, 1e-10),
        ([0.1, 0.2], [10, 12], [1, 5], 1.0, 0.023755152650609134, 1e-8),
        ([0.2, 0.15], [15, 20], [0.4, 0.8], 1.0, 0.007359921451026246, 1e-8),
        ([0.20, 0.10, 0.15, 0.35, 0.25], [20, 15, 10, 25, 12], [0.4, 0.8, 0.3, 0.5, 8], 1.0, 0.004532033682694147, 1e-8),
        ([0.2, 0.1, 0.2], [12, 10, 11], [1, 1.2, 4], 1.0, 0.010592467105996449954, 1e-8),
        ([0.2, 0.1, 0.2], [12, 10, 11], [1, 1.2, 4], 10.0, 5.130032007256222345e-13, 1e-5),
        ([0.01, 0.2, 0.35], [6, 15, 11], [0.5, 1.2, 4], 3.5, 2.378088006083617464807e-5, 1e-8),
    ],
)
def test_fluence_of_light_propagation(mu_a, mu_s_prime, thickness, rho, expected, bound):
    """LightPropagation.jl, fluence at z = 0 (reference-numbers.md section 7), 1 to 5 layers, down to 1e-13 of the peak."""
    solver = LayeredDiffusion(source="point", boundary="extrapolated")
    numbers = light_propagation(mu_a, mu_s_prime, thickness)
    sigma = min(float(d) ** 0.5 for d in numbers.decay2)
    rule = quadrature(Kernel((Term(np.full(1, 1 / (2 * np.pi)), np.array([rho]), "J0", 1),)), Span(sigma, 40.0 * mu_s_prime[0], False))
    k = jnp.asarray(rule.k)
    rest = spectral_fluence(solver, numbers, 0, 0.0, k, without_images=True)
    found = (rule.weights @ np.asarray(rest))[0] + float(fluence_images(numbers, 0.0).at(jnp.array([rho]))[0])
    assert abs(found / expected - 1) <= bound
    if bound < 1e-6:  # without images as well, where no digits cancel
        assert abs((rule.weights @ np.asarray(spectral_fluence(solver, numbers, 0, 0.0, k)))[0] / expected - 1) <= 1e-8


def random_arrays(count, layers, half_space, rng):
    """Stacks as arrays: sigma_a 1e-4..1, sigma_s' 0.1..20 /mm, thickness 0.01..10 mm, all log-uniform, n 1.3..1.5, g 0..0.95, n below 1..1.5."""
    log = lambda low, high, size: np.exp(rng.uniform(np.log(low), np.log(high), (count, size)))  # noqa: E731
    return (
        log(1e-4, 1, layers),
        log(0.1, 20, layers),
        rng.uniform(0, 0.95, (count, layers)),
        rng.uniform(1.3, 1.5, (count, layers)),
        log(0.01, 10, layers - half_space),
        rng.uniform(1.0, 1.5, count),
    )


@pytest.mark.parametrize("layers", [1, 2, 3, 4, 5])
def test_physical_on_random_stacks(layers):
    """R, T >= 0 and R + T <= 1, the first-surface reflection included: 10,000 stacks over all of this test's parameters."""
    rng = np.random.default_rng(layers)
    solver = lf.LayeredDiffusion()
    for half_space in (0, 1):
        finite = layers - half_space

        @jax.jit
        @jax.vmap
        def totals(sigma_a, sigma_s_prime, g, n, thickness, n_below, half_space=bool(half_space), finite=finite):
            columns = Columns(
                sigma_a=sigma_a,
                sigma_s_prime=sigma_s_prime,
                g=g,
                n=n,
                thickness=thickness,
                roughness=jnp.zeros(finite + 1),
                n_above=jnp.ones(()),
                n_below=n_below,
                half_space=half_space,
                g_unknown=(False,) * layers,
                smooth=(True,) * (finite + 1),
            )
            whole = solver.response(columns, jnp.zeros(()))
            return whole.R_above.source + whole.R_above.beam, whole.T_down.source + whole.T_down.beam

        R, T = (np.asarray(x) for x in totals(*random_arrays(1000, layers, half_space, rng)))
        assert R.shape == (1000,)
        assert np.all(R >= 0)
        assert np.all(T >= 0)
        assert np.all(R + T <= 1 + 1e-12)


@pytest.mark.parametrize("solver", [lf.LayeredDiffusion(), lf.LayeredDiffusion(source="point", boundary="partial_current")])
def test_energy_without_absorption(solver):
    """R + T = 1 at sigma_a = 0 with index steps, any incidence, thickness 1e-3 to 1e4 mfp'."""
    for d in (1e-3, 1.0, 1e4):
        stack = lf.Stack(
            [
                lf.Layer("a", sigma_a=0.0, sigma_s_prime=1.0, g=0.6, n=1.4, thickness=d),
                lf.Layer("b", sigma_a=0.0, sigma_s_prime=3.0, g=0.9, n=1.33, thickness=0.3),
            ],
            n_below=1.5,
        )
        for incidence in ("normal", 60.0, "diffuse"):
            geometries = [lf.TotalReflectance(incidence=incidence, specular="included"), lf.TotalTransmittance(incidence=incidence)]
            R, T = (p.values[0] for p in lf.predict(stack, geometries, solver=solver))
            assert abs(R + T - 1) <= 1e-12


def test_conservative_half_space_returns_everything():
    stack = lf.Stack([lf.HalfSpace("white", sigma_a=0.0, sigma_s_prime=1.0, g=0.9, n=1.4)])
    assert abs(lf.predict(stack, lf.TotalReflectance(specular="included"), solver=lf.LayeredDiffusion())[0].values[0] - 1) <= 1e-12


def test_specular_part_and_incidence():
    """Included minus excluded is Fresnel's; oblique light is reflected more, diffuse light lies between."""
    R = {}
    for incidence in ("normal", 45.0, 80.0, "diffuse"):
        included, excluded = (
            float(p.values[0])
            for p in lf.predict(
                HALF, [lf.TotalReflectance(incidence=incidence, specular=s) for s in ("included", "excluded")], solver=lf.LayeredDiffusion()
            )
        )
        R[incidence] = included, included - excluded
    assert abs(R["normal"][1] - (0.4 / 2.4) ** 2) <= 1e-15
    mu, t = np.cos(np.pi / 4), np.sqrt(1 - 0.5 / 1.96)
    fresnel = 0.5 * (((mu - 1.4 * t) / (mu + 1.4 * t)) ** 2 + ((1.4 * mu - t) / (1.4 * mu + t)) ** 2)
    assert abs(R[45.0][1] - fresnel) <= 1e-14
    assert R["normal"][0] < R[45.0][0] < R[80.0][0]
    assert R["normal"][0] < R["diffuse"][0] < R[80.0][0]


def test_clear_layers_are_refused():
    stack = lf.Layer("glass", sigma_a=0.0, sigma_s_prime=0.0, n=1.5, thickness=1.0) | HALF.layers[0]
    with pytest.raises(lf.InputError, match="layer 'glass' is clear"):
        lf.predict(stack, lf.TotalReflectance(), solver=lf.LayeredDiffusion())


def test_aperture_collects_part_of_the_light():
    """na 1 is everything; a small one collects about na^2 of it, more towards the normal than a Lambertian surface would send."""
    whole, half, small = (
        float(lf.predict(HALF, lf.RadialReflectance(r=[3.0], detector=lf.Detector(na=na)), solver=lf.LayeredDiffusion())[0].values[0])
        for na in (1.0, 0.5, 0.05)
    )
    assert 0.25 < half / whole < 0.32
    assert 1.0 < small / whole / 0.05**2 < 1.35
    nearly = float(lf.predict(HALF, lf.RadialReflectance(r=[3.0], detector=lf.Detector(na=0.9999999)), solver=lf.LayeredDiffusion())[0].values[0])
    assert abs(nearly / whole - 1) <= 1e-6


def test_against_monte_carlo_where_diffusion_holds():
    """R(r) of MCML beyond 2 mfp', layers of 2 mfp' and more, sigma_s'/sigma_a from 10, no clear gap: median error within 5 %, 20 % in each case."""
    errors = []
    for case in (case for case in cases.cases() if case.diffusive):
        low, high = case.rings
        far = (0.5 * (low + high) >= 2.0 * case.mfp) & (case.R_se < 0.05 * case.R)
        found = lf.predict(case.stack, lf.RadialReflectance(r_min=low[far], r_max=high[far]), solver=lf.LayeredDiffusion())[0].values
        errors.append(np.abs(found / case.R[far] - 1.0))
        assert np.median(errors[-1]) <= 0.20, case.name
    print(f"median {100 * np.median(np.concatenate(errors)):.2f} % of {len(errors)} cases")  # shown by -rP
    assert len(errors) >= 5
    assert np.median(np.concatenate(errors)) <= 0.05
