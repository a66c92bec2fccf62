"""The Monte Carlo behind the interface of the solvers: what it is asked to count, and what is read off."""

import ast
import dataclasses
from pathlib import Path

import numpy as np
import pytest

import layerfit as lf
import layerfit.montecarlo as mc
from layerfit import montecarlo_solver
from layerfit.montecarlo_reading import reading, runs
from layerfit.montecarlo_solver import medium, with_run_settings
from layerfit.scene.columns import to_columns

SLAB = lf.Stack([lf.Layer("slab", sigma_a=0.1, sigma_s=0.9, g=0.75, n=1.0, thickness=2)])
LAYERS = lf.Stack(
    [
        lf.Layer("top", sigma_a=0.1, sigma_s_prime=1.5, g=0.7, n=1.4, thickness=0.5, roughness=0.2),
        lf.Layer("deep", sigma_a=0.02, sigma_s=8, g=0.9, n=1.5, thickness=3, roughness=0.1),
    ],
    n_above=1.1,
    n_below=1.2,
    roughness_below=0.3,
)
SAME = mc.Medium(
    [1.4, 1.5], [0.1, 0.02], [1.5 / 0.3, 8.0], [0.7, 0.9], [0.5, 3.0], n_above=1.1, n_below=1.2, roughness=[0.2, 0.1, 0.3]
)  # fmt: skip


def solver(photons: int = 20_000, seed: int = 3) -> lf.MonteCarlo:
    return lf.MonteCarlo(photons=photons, seed=seed, threads=1)


def simulate(source, **tallies) -> mc.Result:
    return mc.simulate(medium(to_columns(LAYERS)), source, mc.Tallies(**tallies), photons=20_000, seed=3, threads=1)


def test_a_stack_in_its_terms():
    made = medium(to_columns(LAYERS))
    for name in ("n", "sigma_a", "sigma_s", "thickness", "n_above", "n_below", "roughness"):
        assert getattr(made, name) == pytest.approx(getattr(SAME, name), rel=1e-12)
    assert [phase.mean_cosine for phase in made.phase] == [0.7, 0.9]
    half = lf.Stack([lf.HalfSpace("deep", sigma_a=0.1, sigma_s_prime=1, g=0.0, n=1.4)])
    assert medium(to_columns(half)).half_space


@pytest.mark.parametrize(
    ("geometry", "exact"),
    [
        (lf.TotalReflectance(), 0.09739464),
        (lf.TotalTransmittance(), 0.660957700),
        (lf.SpatialFrequency(k=[0.0]), 0.09739464),
        (lf.RadialReflectance(r_min=[0.0], r_max=[1e4]), 0.09739464 / (np.pi * 1e8)),
    ],
)
def test_exact_totals(geometry, exact: float):
    """A slab of albedo 0.9, g 0.75, optical thickness 2: van de Hulst, Multiple Light Scattering (1980), by 128 streams."""
    found = lf.predict(SLAB, geometry, solver=solver(200_000))[0]
    assert found.estimated_error is not None
    assert abs(found.values[0] - exact) <= 4.0 * found.estimated_error[0]
    assert found.estimated_error[0] <= 0.01 * exact


def test_one_standard_error_is_what_runs_scatter_by():
    runs_made = [lf.predict(SLAB, lf.TotalTransmittance(), solver=solver(2000, seed))[0] for seed in range(60)]
    scatter = np.std([p.values[0] for p in runs_made], ddof=1)
    stated = np.sqrt(np.mean([p.estimated_error[0] ** 2 for p in runs_made if p.estimated_error is not None]))
    assert 0.7 <= stated / scatter <= 1.4  # 60 runs know their scatter to 9 %


@pytest.mark.parametrize(
    ("geometry", "source", "tallies", "name"),
    [
        (lf.RadialReflectance(r_min=[0, 0.5], r_max=[0.4, 1]), mc.Pencil(), {"rings": [(0, 0.4), (0.5, 1)]}, "R_rings"),
        (lf.RadialTransmittance(r_min=[0], r_max=[0.4], source=lf.Disk(0.3)), mc.Disk(0.3), {"rings": [(0, 0.4)]}, "T_rings"),
        (
            lf.RadialReflectance(r_min=[0.5], r_max=[1], detector=lf.Detector(0, 0.4), source=lf.Gaussian(0.2)),
            mc.Gaussian(0.2),
            {"rings": [(0.5, 1)], "na": 0.4},
            "R_rings",
        ),
        (
            lf.RadialTransmittance([0.5, 1], detector=lf.Detector(0.2, 0.5)),
            mc.Pencil(),
            {"fibres": [mc.CollectingFibre(0.5, 0.2, 0.5), mc.CollectingFibre(1, 0.2, 0.5)]},
            "T_fibres",
        ),
        (lf.SpatialFrequency(k=[0, 0.5, 2]), mc.Pencil(), {"k": [0, 0.5, 2]}, "R_k"),
        (lf.TotalReflectance(incidence=60), mc.Pencil(0.5), {}, "R"),
        (lf.TotalTransmittance(incidence="diffuse"), mc.Lambertian(), {}, "T"),
    ],
)
def test_what_is_counted(geometry, source, tallies: dict, name: str):
    """The same photons as in a run written out by hand; fibres that collect all directions are an aperture of the whole hemisphere."""
    found = lf.predict(LAYERS, geometry, solver=solver())[0]
    expected = simulate(source, **tallies)
    np.testing.assert_allclose(found.values, np.atleast_1d(expected.value(name)), rtol=1e-12)
    np.testing.assert_allclose(found.estimated_error, np.atleast_1d(expected.standard_error(name)), rtol=1e-9)  # pyright: ignore[reportArgumentType, reportCallIssue]


def test_detector_of_radius_collects_all_directions():
    found = lf.predict(LAYERS, lf.RadialReflectance([0.5], detector=lf.Detector(0.2)), solver=solver())[0]
    expected = simulate(mc.Pencil(), fibres=[mc.CollectingFibre(0.5, 0.2, 2.0)])
    np.testing.assert_allclose(found.values, expected.value("R_fibres"), rtol=1e-12)


def test_first_surface_reflection_is_added_where_it_is_asked_for():
    stack = lf.Stack([lf.HalfSpace("deep", sigma_a=0.1, sigma_s_prime=1, g=0.5, n=1.4)])
    without, with_it = lf.predict(stack, [lf.TotalReflectance(), lf.TotalReflectance(specular="included")], solver=solver(5000))
    assert with_it.values[0] - without.values[0] == pytest.approx((0.4 / 2.4) ** 2, rel=1e-9)
    assert with_it.estimated_error == pytest.approx(without.estimated_error, rel=1e-6)


@pytest.mark.parametrize(
    ("profile", "r", "width", "bound"),
    [
        (lambda r: np.exp(-5.0 * r), 1.0, 0.0, 2e-4),
        (lambda r: np.exp(-2.0 * r) / r**2, 1.0, 0.0, 2e-4),
        (lambda r: r**-3.0, 2.0, 0.0, 1e-4),
        (lambda r: np.exp(-2.0 * r**2), 0.0, 1.0, 1e-3),
    ],
)
def test_two_fibres_stand_for_a_point(profile, r: float, width: float, bound: float):
    """The weighted means over both disks are the value at the point, to the bound that the docstring states."""
    source = lf.Gaussian(width) if width else None
    one = reading(lf.RadialReflectance([r], source=source))

    def mean(fibre: mc.CollectingFibre) -> float:
        x, w = np.polynomial.legendre.leggauss(40)
        rho = 0.5 * fibre.radius * (x + 1.0)
        angle = np.pi * (np.arange(64) + 0.5) / 64
        away = np.sqrt(fibre.distance**2 + rho[:, None] ** 2 + 2.0 * fibre.distance * rho[:, None] * np.cos(angle))
        return float(np.sum(w * rho * profile(away).mean(axis=1)) / np.sum(w * rho))

    assert one.weights is not None
    value = float((one.weights @ [mean(fibre) for fibre in one.fibres])[0])
    exact = float(profile(np.float64(r)))
    assert abs(value / exact - 1.0) <= bound
    assert abs(mean(one.fibres[0]) / exact - 1.0) >= 5.0 * bound  # one fibre alone would be off: the second one is needed


def test_points_lie_on_the_profile_of_rings():
    points, rings = lf.predict(
        LAYERS, [lf.RadialReflectance([1.0]), lf.RadialReflectance(r_min=[0.97], r_max=[1.03])], solver=solver(200_000)
    )  # fmt: skip
    assert points.estimated_error is not None
    assert rings.estimated_error is not None
    assert abs(points.values[0] - rings.values[0]) <= 4.0 * np.hypot(points.estimated_error[0], rings.estimated_error[0])
    assert points.estimated_error[0] <= 0.05 * points.values[0]


def test_as_few_runs_as_the_light_and_the_apertures_allow():
    geometries = [
        lf.TotalReflectance(),
        lf.RadialReflectance(r_min=[0], r_max=[1], detector=lf.Detector(na=0.5)),
        lf.RadialReflectance([1.0], detector=lf.Detector(0.1, 0.3)),
        lf.SpatialFrequency(k=[1.0]),
        lf.TotalReflectance(incidence=30),
        lf.RadialReflectance(r_min=[0, 1], r_max=[1, 2], source=lf.Disk(1)),
        lf.RadialTransmittance(r_min=[0, 1], r_max=[1, 3], source=lf.Disk(1)),
    ]
    planned = runs([reading(g) for g in geometries])
    assert sorted(i for run in planned for i in run.members) == list(range(7))
    assert sorted(run.members for run in planned) == [(0, 1, 2), (3,), (4,), (5, 6)]
    assert next(run for run in planned if 5 in run.members).tallies.rings == ((0.0, 1.0), (1.0, 2.0), (1.0, 3.0))
    alone = [lf.predict(LAYERS, g, solver=solver(2000))[0] for g in geometries]
    together = lf.predict(LAYERS, geometries, solver=solver(2000))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_allclose(one.values, other.values, rtol=1e-12)


def test_nothing_counted_is_not_no_error():
    found = lf.predict(SLAB, lf.RadialReflectance(r_min=[0, 500], r_max=[1, 501]), solver=solver(1000))[0]
    assert found.values[1] == 0.0
    assert found.estimated_error is not None
    assert found.estimated_error[1] == pytest.approx(1.0 / (1000 * np.pi * (501**2 - 500**2)))
    deep = lf.Stack([lf.HalfSpace("deep", sigma_a=0.1, sigma_s_prime=1, g=0.5, n=1.4)])
    nothing = lf.predict(deep, lf.TotalTransmittance(), solver=solver(1000))[0]
    assert nothing.values[0] == 0.0
    assert nothing.estimated_error is not None
    assert nothing.estimated_error[0] == 0.0


def test_the_seed_decides_and_the_threads_do_not():
    geometry = lf.RadialReflectance([0.5, 1.0])
    one = lf.predict(LAYERS, geometry, solver=lf.MonteCarlo(2000, seed=1, threads=1))[0]
    two = lf.predict(LAYERS, geometry, solver=lf.MonteCarlo(2000, seed=1, threads=2))[0]
    other = lf.predict(LAYERS, geometry, solver=lf.MonteCarlo(2000, seed=2, threads=1))[0]
    assert np.array_equal(one.values, two.values)
    assert np.array_equal(one.estimated_error, two.estimated_error)  # pyright: ignore[reportArgumentType]
    assert not np.array_equal(one.values, other.values)
    assert one.solver == lf.MonteCarlo(2000, seed=1, threads=1)
    assert "2,000 photons, seed 1" in one.notes[-1]


def test_an_interrupted_run_keeps_what_is_done(monkeypatch: pytest.MonkeyPatch):
    """The first illumination is interrupted; the second one gets a short run, so that every value is there."""
    limits = []

    def interrupted(*arguments, **settings):
        limits.append(settings["max_seconds"])
        result = simulate_whole(*arguments, **settings | {"photons": 1000})
        return dataclasses.replace(result, outcome="interrupted") if len(limits) == 1 else result

    simulate_whole = montecarlo_solver.mc.simulate
    monkeypatch.setattr(montecarlo_solver.mc, "simulate", interrupted)
    found = lf.predict(SLAB, [lf.TotalReflectance(), lf.TotalReflectance(incidence="diffuse")], solver=solver(10**9))
    assert limits == [None, 2.0]
    assert all(np.all(p.values > 0.0) and p.estimated_error is not None for p in found)
    assert "interrupted: 1,000 of 1,000,000,000 photons for each of 2 simulations" in found[0].notes[-1]


@pytest.mark.parametrize(
    ("stack", "geometry", "said"),
    [
        (
            lf.Stack([lf.HalfSpace("deep", sigma_a=0.1, sigma_s_prime=1, n=1.4)]),
            lf.TotalReflectance(),
            "'deep' has no g, which solver monte-carlo",
        ),
        (lf.Stack([lf.HalfSpace("deep", sigma_a=0.0, sigma_s_prime=0, n=1.4)]), lf.TotalReflectance(), "neither absorbs nor scatters"),
        (SLAB, lf.RadialReflectance([1], source=lf.Line()), "source kind 'line'; allowed: pencil, disk, gaussian"),
        (SLAB, lf.RadialReflectance([1], source=lf.Edge()), "source kind 'edge'"),
    ],
)
def test_what_it_cannot_do_is_said_before_it_runs(stack, geometry, said: str):
    with pytest.raises(lf.InputError, match=said):
        lf.predict(stack, geometry, solver=solver())


def test_a_clear_layer_needs_no_g():
    stack = lf.Stack([lf.Layer("glass", sigma_a=0.1, sigma_s_prime=0, n=1.0, thickness=2)])
    assert lf.predict(stack, lf.TotalTransmittance(), solver=solver(1000))[0].values[0] == pytest.approx(np.exp(-0.2), rel=1e-9)


def test_a_fit_with_it_is_refused():
    data = lf.Dataset(lf.TotalReflectance(), [0.1], [0.01])
    with pytest.raises(lf.InputError, match="solver monte-carlo has no derivatives"):
        lf.Problem(SLAB, data, free={"slab.sigma_a": (0.01, 1)}, solver=solver(10**12))  # refused before a photon is followed


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"photons": 99}, "photons = 99; allowed is a whole number, at least 100"),
        ({"photons": 1000.5}, "photons = 1000.5"),
        ({"photons": float("nan")}, "photons = nan"),
        ({"seed": -1}, "seed = -1"),
        ({"seed": 2**64}, "seed = .*below 2\\^64"),
        ({"threads": 0}, "threads = 0"),
    ],
)
def test_wrong_settings_are_named(settings: dict, said: str):
    with pytest.raises(lf.InputError, match=said):
        lf.MonteCarlo(**settings)


def test_settings_of_a_command_line():
    assert with_run_settings(lf.MonteCarlo(), photons=500, seed=4) == lf.MonteCarlo(500, seed=4)
    assert with_run_settings(lf.LayeredDiffusion(), photons=None, seed=4) == lf.LayeredDiffusion()
    with pytest.raises(lf.InputError, match="--photons has no meaning for solver layered-diffusion"):
        with_run_settings(lf.LayeredDiffusion(), photons=500, seed=4)


def test_the_accused_do_not_lean_on_the_judge():
    package = Path(lf.__file__).parent
    for path in [*package.glob("optics/*.py"), *package.glob("transport/*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = [getattr(node, "module", None) or "", *(alias.name for alias in node.names)]
                assert not any("montecarlo" in name for name in names), path
