"""The whole walk against exact results, conservation, and its own tallies against each other."""

import csv
import math

import numpy as np
import pytest
from montecarlo_cases import EXACT, ROOT
from montecarlo_exact import run, scores, summary
from scipy import integrate, stats

import layerfit.montecarlo as mc
from layerfit.montecarlo import engine
from layerfit.montecarlo.tallies import ROULETTE, Layout, R

TABLES = ROOT.parent / "shared" / "reference" / "plane_parallel"


def short(medium: mc.Medium, source=None, tallies=None, photons: float = 100_000, seed: int = 1, **settings) -> mc.Result:
    return mc.simulate(medium, source, tallies, photons=photons, seed=seed, threads=1, **settings)


def table(name: str) -> list[dict[str, str]]:
    path = TABLES / name
    if not path.exists():
        pytest.skip(f"{name} is not there (shared/reference/plane_parallel beside the repository)")
    with open(path) as file:
        return list(csv.DictReader(file))


def test_exact_values():
    """The run of benchmarks/montecarlo_exact.py with a hundredth of its photons; same bounds on the scores together."""
    results = {case.name: run(case, 1e5, 100 + index, 1) for index, case in enumerate(EXACT)}
    found = summary(results)
    count = scores(results).size
    assert count >= 12
    assert found["largest"] <= stats.norm.isf(0.5 * (1.0 - 0.99 ** (1.0 / count)))
    assert found["p_mean"] >= 0.01
    assert found["p_spread"] >= 0.01
    assert found["balance"] <= 1e-12
    relative = [entry["R"]["standard_error"] / entry["R"]["value"] for entry in results.values()]
    assert np.median(relative) <= 0.005  # a mistake of a few per cent would be seen


@pytest.mark.parametrize("below", [0.0, 1e-4, 0.3, 1.0])
def test_the_weight_threshold_does_not_matter(below: float):
    result = short(mc.Medium([1.0], [0.1], [0.9], [0.75], [2.0]), photons=200_000, analogue_below=below if below else 1e-9)
    for name, exact in (("R", 0.09739464), ("T", 0.660957700), ("A_total", 1.0 - 0.09739464 - 0.660957700)):
        assert abs(float(result.value(name)) - exact) <= 3.5 * float(result.standard_error(name))


NASTY = {
    "absorbing half space": mc.Medium([1.4], [0.1], [10.0], 0.9, [math.inf]),
    "nearly conservative": mc.Medium([1.4], [1e-6], [1.0], 0.0, [50.0]),
    "conservative slab": mc.Medium([1.4], [0.0], [10.0], 0.8, [2.0]),
    "clear, absorbing and scattering": mc.Medium([1.5, 1.3, 1.4], [0.0, 1.0, 0.2], [0.0, 0.0, 5.0], 0.5, [0.3, 0.2, 1.0]),
    "clear film on absorber": mc.Medium([1.5, 1.3], [0.0, 2.0], 0.0, 0.0, [0.3, math.inf]),
    "thin layers": mc.Medium([1.4, 1.6, 1.4], [0.5] * 3, [5.0] * 3, 0.9, [0.0, 1e-9, 1.0]),
    "rough with steps": mc.Medium([1.4, 1.34, 1.5], [0.5, 0.0, 0.1], [20.0, 1.0, 5.0], 0.8, [0.1, 0.2, math.inf], roughness=[0.3, 1.0, 0.05]),
    "very rough slab": mc.Medium([1.5], [0.01], [1.0], 0.0, [1.0], roughness=[3.0, 3.0]),
    "from glass into air": mc.Medium([1.0, 1.4], [0.1, 0.1], [1.0, 3.0], 0.3, [0.5, 0.5], n_above=1.5, n_below=1.33, roughness=0.2),
    "black": mc.Medium([1.4], [1e4], [1.0], 0.0, [math.inf]),
    "contrast": mc.Medium([1.4, 1.4], [0.0, 1e-3], [1e4, 1e-3], [0.99, -0.9], [0.01, math.inf]),
}  # fmt: skip
SOURCES = (mc.Pencil(), mc.Pencil(0.1), mc.Lambertian())


@pytest.mark.parametrize("name", NASTY)
def test_energy_is_kept_to_rounding(name: str):
    for seed, source in enumerate(SOURCES):
        result = short(NASTY[name], source, mc.Tallies(derivatives=True), photons=5000, seed=seed)
        assert np.abs(result.balance).max() <= 1e-12
        assert float(result.value("roulette")) == 0.0  # nothing is lost, nothing added
        parts = [float(result.value(tally)) for tally in ("R_specular", "R", "T", "A_total")]
        assert abs(sum(parts) - 1.0) <= 1e-12
        assert min(parts) >= 0.0
        assert np.all(np.isfinite(result.sums))


def test_endless_walks_are_ended_without_bias_and_booked():
    medium = mc.Medium([1.0], [0.0], [1.0], 0.0, [math.inf])
    layout = Layout(mc.Tallies(), 1, 1.0, 1.0)
    tables = (medium.table(), mc.Pencil().table(1.0), layout.table(True))
    stop = np.zeros(1, np.int64)
    # roulette from the 100th scattering on, so that it matters: in a run it starts at the millionth
    sums = [engine.run_batch(*tables, 1, b, 2000, 0.3, 100, layout.rows, layout.columns, stop) for b in range(50)]
    reflected = mc.Estimate.from_samples(np.array([s[R, 0] for s in sums if s is not None]) / 2000)
    booked = np.array([s[ROULETTE, 0] for s in sums if s is not None]) / 2000
    assert abs(float(reflected.value) - 1.0) <= 3.5 * float(reflected.standard_error)
    assert float(reflected.standard_error) <= 0.05
    assert np.abs(booked).max() > 0.0
    assert np.abs(reflected.samples + booked - 1.0).max() <= 1e-12
    # the real setting: nearly all walks end by themselves
    result = short(medium, photons=1000)
    assert np.abs(result.balance).max() <= 1e-12
    assert abs(float(result.value("R")) - 1.0) <= 0.02


@pytest.mark.parametrize("cosine", [1.0, 0.5])
def test_clear_slab_is_the_closed_form(cosine: float):
    n, sigma_a, thickness = 1.5, 0.7, 1.3
    refracted = math.sqrt(1.0 - (1.0 - cosine**2) / n**2)
    s = (cosine - n * refracted) / (cosine + n * refracted)
    p = (n * cosine - refracted) / (n * cosine + refracted)
    f = 0.5 * (s * s + p * p)
    a = math.exp(-sigma_a * thickness / refracted)
    exact = {
        "T": (1 - f) ** 2 * a / (1 - f**2 * a**2),
        "R": (1 - f) ** 2 * f * a**2 / (1 - f**2 * a**2),
        "R_specular": f,
    }
    medium = mc.Medium([n], [sigma_a], [0.0], None, [thickness])
    result = short(medium, mc.Pencil(cosine), mc.Tallies(derivatives=True), photons=200_000)
    for name, value in exact.items():
        assert abs(float(result.value(name)) - value) <= 3.5 * float(result.standard_error(name)) + 1e-14
    assert np.array_equal(result.value("T"), result.value("T_unscattered"))
    step = 1e-5
    for name in ("T", "R", "A_total"):

        def total(x: float, name: str = name) -> float:
            b = math.exp(-x * thickness / refracted)
            t, r = (1 - f) ** 2 * b / (1 - f**2 * b**2), (1 - f) ** 2 * f * b**2 / (1 - f**2 * b**2)
            return {"T": t, "R": r, "A_total": 1 - f - t - r}[name]

        slope = (total(sigma_a + step) - total(sigma_a - step)) / (2 * step)
        found = result.derivative(name, "sigma_a", 0)
        assert abs(float(found.value) - slope) <= 3.5 * float(found.standard_error)
    with pytest.raises(ValueError, match="clear layer"):
        result.derivative("R", "sigma_s", 0)


def h_function(albedo: float):
    """Chandrasekhar's H by iteration of 1/H(mu) = sqrt(1 - a) + (a/2) integral of x H(x) / (x + mu) dx."""
    node, weight = np.polynomial.legendre.leggauss(200)
    node, weight = 0.5 * (node + 1.0), 0.5 * weight
    h = np.ones(200)

    def at(mu: np.ndarray) -> np.ndarray:
        kernel = (weight * node * h) / (node + mu[:, None])
        return 1.0 / (math.sqrt(1.0 - albedo) + 0.5 * albedo * kernel.sum(axis=1))

    for _ in range(200):
        h = 0.5 * (h + at(node))
    return at


@pytest.mark.parametrize("incidence", [1.0, 0.5])
def test_directions_are_the_exact_brdf(incidence: float):
    # a / (4 pi) H(mu) H(mu0) / (mu + mu0), the same at all azimuths for isotropic scattering
    albedo, h = 0.9, h_function(0.9)
    assert abs(float(h(np.ones(1))[0]) - 1.850099) <= 1e-6
    theta, phi = np.linspace(0.0, 90.0, 16), [0.0, 60.0, 120.0, 180.0]
    result = short(
        mc.Medium([1.0], [1 - albedo], [albedo], 0.0, [math.inf]),
        mc.Pencil(incidence),
        mc.Tallies(theta=theta, phi=phi),
        1e6,
    )
    exact = []
    for low, high in zip(np.cos(np.radians(theta[1:])), np.cos(np.radians(theta[:-1])), strict=True):

        def density(mu: float) -> float:
            values = h(np.array([mu, incidence]))
            return 2.0 * mu * albedo / (4.0 * math.pi) * float(values[0] * values[1]) / (mu + incidence)

        exact.append(integrate.quad(density, low, high)[0] / (high**2 - low**2))
    comparison = mc.compare(result.estimate("R_angle"), np.repeat(np.array(exact)[:, None], 3, axis=1), limit=0.01)
    assert comparison.agree, str(comparison)
    wrong = mc.compare(result.estimate("R_angle"), np.repeat(np.array(exact)[:, None], 3, axis=1) * 1.02)
    assert wrong.verdict == "disagree"


def test_azimuth_convention_against_discrete_ordinates():
    scene = {"g": 0.5, "albedo": 0.99, "tau": 1.0, "mu0": 0.5}
    rows = [r for r in table("angular_radiance.csv") if all(float(r[name]) == value for name, value in scene.items())]
    radiance = {(float(r["mu"]), float(r["phi_deg"])): r for r in rows}
    # narrow bins about mu = 0.7 and 0.4 and about the azimuths 0, 90 and 180 degrees
    theta, phi = np.degrees(np.arccos([0.72, 0.68, 0.42, 0.38])), [0.0, 6.0, 84.0, 96.0, 174.0, 180.0]
    result = short(mc.Medium([1.0], [0.01], [0.99], 0.5, [1.0]), mc.Pencil(0.5), mc.Tallies(theta=theta, phi=phi), 2e6)
    for name, column in (("R_angle", "I_reflected"), ("T_angle", "I_transmitted_diffuse")):
        estimate = result.estimate(name)
        for place, mu in ((0, 0.7), (2, 0.4)):
            for azimuth, side in ((0.0, 0), (90.0, 2), (180.0, 4)):
                exact = float(radiance[mu, azimuth][column])
                # 1 % for the width of the bins, in which the radiance is not linear
                bound = 3.5 * float(estimate.standard_error[place, side]) + 0.01 * exact
                assert abs(float(estimate.value[place, side]) - exact) <= bound
                assert bound <= 0.15 * exact


@pytest.mark.parametrize(("incidence", "source"), [("normal", mc.Pencil()), ("mu0=0.5", mc.Pencil(0.5)), ("diffuse", mc.Lambertian())])
def test_layers_and_directions_against_discrete_ordinates(incidence: str, source):
    (row,) = [
        r for r in table("layered_totals.csv")
        if r["stack"] == "skin_R_matched" and r["incidence"] == incidence and float(r["ground_albedo"]) == 0.0
    ]  # fmt: skip
    layers = [[float(x) for x in part.split("/")] for part in row["layers_tau/albedo/g_top_first"].split(";")]
    tau, albedo, g = (np.array(column) for column in zip(*layers, strict=True))
    result = short(mc.Medium([1.0] * 3, 1.0 - albedo, albedo, g, tau), source, photons=400_000)
    found = mc.Estimate.join([result.estimate(name) for name in ("R", "T", "A_total")])
    comparison = mc.compare(found, [float(row[c]) for c in ("R_total", "flux_down_at_ground", "absorbed_in_layers")], limit=0.01)
    assert comparison.agree, str(comparison)


def test_diffuse_light_on_mismatched_slabs_against_adding_doubling():
    rows = [r for r in table("mismatched_totals.csv") if float(r["tau"]) in (1.0, 10.0) and float(r["albedo"]) in (0.9, 0.99, 1.0)]
    for index, row in enumerate(rows[:8]):
        albedo = float(row["albedo"])
        medium = mc.Medium([float(row["n"])], [1.0 - albedo], [albedo], float(row["g"]), [float(row["tau"])])
        result = short(medium, mc.Lambertian(), photons=50_000, seed=300 + index)
        total = float(result.value("R")) + float(result.value("R_specular"))
        error = math.hypot(float(result.standard_error("R")), float(row["R_diffuse_unc"]))
        assert abs(total - float(row["R_diffuse"])) <= 3.5 * error
        error = math.hypot(float(result.standard_error("T")), float(row["T_diffuse_unc"]))
        assert abs(float(result.value("T")) - float(row["T_diffuse"])) <= 3.5 * error


SKIN = mc.Medium([1.4, 1.34], [0.5, 0.1], [10.0, 5.0], [0.5, 0.8], [0.2, 1.0])


def test_places_agree_with_each_other():
    """Fine rings, integrated in other ways, give the other tallies of place: the light is the same, so the bound is the rings' width."""
    edges, k = np.linspace(0.0, 8.0, 4001), np.array([0.0, 0.1, 1.0, 3.0, 10.0])
    fibres = [mc.CollectingFibre(0.0, 0.3, 1.0), mc.CollectingFibre(0.5, 0.2, 1.0), mc.CollectingFibre(0.1, 0.4, 1.0)]
    result = short(SKIN, mc.Disk(0.2), mc.Tallies(rings=edges, k=k, fibres=fibres), photons=50_000)
    middle, area = 0.5 * (edges[1:] + edges[:-1]), math.pi * np.diff(edges**2)
    power = result.value("R_rings") * area
    assert abs(power.sum() + float(result.value("R_beyond")) - float(result.value("R"))) <= 1e-13
    assert abs(result.value("R_k")[0] - float(result.value("R"))) <= 1e-13
    from scipy.special import j0

    hankel = (power * j0(np.outer(k, middle))).sum(axis=1)
    assert np.abs(hankel - result.value("R_k")).max() <= 10.0 * 0.001 + float(result.value("R_beyond"))
    assert np.abs(hankel - result.value("R_k"))[:4].max() <= 1e-3 + float(result.value("R_beyond"))
    # a fibre as a mean over its face, by quadrature in polar coordinates about its own centre
    for index, fibre in enumerate(fibres):
        rho, angle = np.meshgrid((np.arange(200) + 0.5) / 200, (np.arange(200) + 0.5) * math.pi / 100)
        rho = fibre.radius * np.sqrt(rho)
        place = np.hypot(fibre.distance + rho * np.cos(angle), rho * np.sin(angle))
        mean = result.value("R_rings")[np.minimum((place / 0.002).astype(int), 3999)].mean()
        assert abs(mean - result.value("R_fibres")[index]) <= 0.01 * mean


def test_no_direction_is_lost():
    theta, phi = np.linspace(0.0, 90.0, 7), np.linspace(0.0, 180.0, 5)
    sphere = np.outer(np.diff(np.sin(np.radians(theta)) ** 2), np.diff(np.radians(phi)))
    rough = mc.Medium(SKIN.n, SKIN.sigma_a, SKIN.sigma_s, 0.5, SKIN.thickness, roughness=[0.5, 0.0, 2.0])
    for medium in (SKIN, rough, mc.Medium([], n_below=1.5), mc.Medium([])):
        for source in (mc.Pencil(), mc.Pencil(0.3), mc.Lambertian()):
            result = short(medium, source, mc.Tallies(theta=theta, phi=phi), photons=10_000)
            for name in ("R", "T", "R_specular"):
                assert abs((result.value(f"{name}_angle") * sphere).sum() - float(result.value(name))) <= 1e-12


def test_rings_and_frequencies_select_by_aperture():
    tallies = {"rings": [0.0, 0.5, 1.0], "k": [0.0, 2.0]}
    wide, narrow = (short(SKIN, None, mc.Tallies(**tallies, theta=[0, 30, 90], na=na), photons=20_000) for na in (None, 0.5))
    within = float(narrow.value("R_angle")[0, 0]) * math.pi * 0.25
    assert abs(float(narrow.value("R_k")[0]) - within) <= 1e-12
    area = math.pi * np.diff(np.array([0.0, 0.5, 1.0]) ** 2)
    assert abs((narrow.value("R_rings") * area).sum() + float(narrow.value("R_beyond")) - within) <= 1e-12
    assert float(wide.value("R")) == float(narrow.value("R"))
    assert np.all(narrow.value("R_rings") < 0.5 * wide.value("R_rings"))


def test_fibres_select_by_aperture_and_side():
    # aperture: the fraction of a Lambertian source within sin(theta) < 0.5 is 0.25; a fibre as wide as the scene sees all places
    empty = mc.Medium([], n_above=1.0, n_below=1.0)
    fibre = mc.CollectingFibre(0.0, 1.0, 0.5)
    result = short(empty, mc.Lambertian(radius=0.5), mc.Tallies(fibres=[fibre]), photons=200_000)
    assert abs(float(result.value("T_fibres")[0]) * math.pi - 0.25) <= 3.5 * float(result.standard_error("T_fibres")[0]) * math.pi
    # oblique light: forward (azimuth 0) and backward fibres differ, and symmetric pairs do not
    tilted = mc.Pencil(0.5)
    places = [mc.CollectingFibre(0.4, 0.2, 1.0, azimuth) for azimuth in (0.0, 180.0, 90.0, -90.0)]
    result = short(SKIN, tilted, mc.Tallies(fibres=places, rings=[[0.2, 0.6]]), photons=100_000)
    forward, backward, left, right = result.value("R_fibres")
    assert forward > backward + 5.0 * float(result.standard_error("R_fibres")[0])
    assert left == right
    # at normal incidence the average over the full circle must be the single fibre, within the error
    straight = short(SKIN, mc.Pencil(), mc.Tallies(fibres=places), photons=100_000)
    assert np.ptp(straight.value("R_fibres")) <= 1e-12


@pytest.mark.parametrize(
    ("source", "inside"),
    [
        (mc.Pencil(), lambda r: float(r > 0.0)),
        (mc.Disk(1.0), lambda r: min(1.0, r * r)),
        (mc.Gaussian(1.0), lambda r: 1.0 - math.exp(-2.0 * r * r)),
        (mc.Fibre(1.0, 0.3), lambda r: min(1.0, r * r)),
        (mc.Lambertian(radius=1.0), lambda r: min(1.0, r * r)),
    ],
)
def test_sources_light_the_right_places(source, inside):
    edges = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.5])
    result = short(mc.Medium([]), source, mc.Tallies(rings=edges), photons=200_000)
    exact = np.diff([inside(r) for r in edges]) / (math.pi * np.diff(edges**2))
    assert float(result.value("T")) == 1.0
    error = np.maximum(result.standard_error("T_rings"), 1e-12)
    assert np.abs(result.value("T_rings") - exact).max() <= 1e-12 or (np.abs(result.value("T_rings") - exact) / error).max() <= 3.5


def test_sources_light_the_right_directions():
    theta = np.array([0.0, 10.0, 20.0, 30.0, 60.0, 90.0])
    squares = np.sin(np.radians(theta)) ** 2
    tallies = mc.Tallies(theta=theta, phi=[0.0, 90.0, 180.0])
    cases = {
        mc.Lambertian(): squares,
        mc.Fibre(0.1, math.sin(math.radians(20.0)) * 1.33): np.minimum(squares / squares[2], 1.0),
        mc.Lambertian(theta=(10.0, 30.0)): np.clip((squares - squares[1]) / (squares[3] - squares[1]), 0.0, 1.0),
    }
    for source, below in cases.items():
        result = short(mc.Medium([], n_above=1.33, n_below=1.33), source, tallies, photons=200_000)
        exact = np.repeat((np.diff(below) / np.diff(squares) / math.pi)[:, None], 2, axis=1)
        error = np.maximum(result.standard_error("T_angle"), 1e-12)
        assert (np.abs(result.value("T_angle") - exact) / error).max() <= 4.0
    # an oblique beam travels towards azimuth 0, also after a reflection
    result = short(mc.Medium([], n_below=1.5), mc.Pencil(math.cos(math.radians(25.0))), tallies, photons=1000)
    assert float(result.value("R_specular_angle")[2, 0]) > 0.0
    assert float(np.delete(result.value("R_specular_angle").ravel(), 4).max()) == 0.0
    assert float(result.value("T_angle")[1, 0]) > 0.0


def test_units_scale():
    # lengths twice as long: the same walks, rings of a quarter the brightness
    edges = np.linspace(0.0, 2.0, 11)
    small = short(SKIN, mc.Gaussian(0.1), mc.Tallies(rings=edges), photons=20_000)
    large = mc.Medium([1.4, 1.34], [0.25, 0.05], [5.0, 2.5], [0.5, 0.8], [0.4, 2.0])
    other = short(large, mc.Gaussian(0.2), mc.Tallies(rings=2.0 * edges), photons=20_000)
    assert np.allclose(small.value("R_rings"), 4.0 * other.value("R_rings"), rtol=1e-9, atol=0.0)


def test_tabulated_phase_function_walks_like_henyey_greenstein():
    node = np.concatenate(([-1.0], 1.0 - np.geomspace(2.0, 1e-6, 3000)[1:], [1.0]))
    g = 0.8
    phase = mc.TabulatedPhase(node, (1 - g * g) / (1 + g * g - 2 * g * node) ** 1.5)
    assert abs(phase.mean_cosine - g) <= 1e-4
    layers = {"n": [1.4], "sigma_a": [0.05], "sigma_s": [5.0], "thickness": [2.0]}
    one = short(mc.Medium(**layers, phase=[phase]), photons=200_000, seed=1)
    other = short(mc.Medium(**layers, phase=[g]), photons=200_000, seed=2)
    comparison = mc.compare(*(mc.Estimate.join([r.estimate(n) for n in ("R", "T")]) for r in (one, other)))
    assert comparison.agree, str(comparison)
    backward = short(mc.Medium(**layers, phase=[mc.TabulatedPhase([-1, 1], [1.0, 0.5])]), photons=20_000)
    assert float(backward.value("R")) > float(one.value("R")) + 0.05


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"n": [0.0], "sigma_a": [1], "sigma_s": [1], "thickness": [1]}, r"n\[0\]"),
        ({"n": [1.4], "sigma_a": [-1], "sigma_s": [1], "thickness": [1]}, r"sigma_a\[0\]"),
        ({"n": [1.4], "sigma_a": [1], "sigma_s": [math.nan], "thickness": [1]}, r"sigma_s\[0\]"),
        ({"n": [1.4, 1.4], "sigma_a": [1, 1], "sigma_s": [1, 1], "thickness": [math.inf, 1]}, r"thickness\[0\]"),
        ({"n": [1.4, 1.4], "sigma_a": [1, 1, 1], "sigma_s": [1, 1], "thickness": [1, 1]}, "sigma_a"),
        ({"n": [1.4], "sigma_a": [0], "sigma_s": [0], "thickness": [math.inf]}, "thickness"),
        ({"n": [1.4], "sigma_a": [1], "sigma_s": [1], "thickness": [1], "g": [1.0]}, "g"),
        ({"n": [1.4], "sigma_a": [1], "sigma_s": [1], "thickness": [1], "phase": ["HG"]}, "phase"),
        ({"n": [1.4], "sigma_a": [1], "sigma_s": [1], "thickness": [1], "roughness": [0.1]}, "roughness"),
        ({"n": [1.4], "sigma_a": [1], "sigma_s": [1], "thickness": [1], "n_below": -1.0}, "n_below"),
    ],
)
def test_a_wrong_medium_is_named(arguments: dict, name: str):
    with pytest.raises(ValueError, match=rf"^{name}.*given.*allowed"):
        mc.Medium(**arguments)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: mc.Pencil(0.0), "cosine"),
        (lambda: mc.Disk(-1.0), "radius"),
        (lambda: mc.Gaussian(math.inf), "radius"),
        (lambda: mc.Lambertian(theta=(30.0, 20.0)), "theta"),
        (lambda: short(SKIN, mc.Fibre(0.1, 1.2)), "na"),
        (lambda: short(SKIN, photons=1.5), "photons"),
        (lambda: short(SKIN, seed=-1), "seed"),
        (lambda: short(SKIN, max_seconds=0.0), "max_seconds"),
        (lambda: short(SKIN, store="/no/such/folder/run.npz"), "store"),
        (lambda: mc.Tallies(na=0.0), "na"),
        (lambda: short(SKIN, relative_error={"Q": 0.1}), "name"),
        (lambda: short("skin"), "medium"),
        (lambda: short(SKIN, photons=100).value("R_rings"), "name"),
        (lambda: short(SKIN, photons=100).derivative("R", "sigma_a", 0), "derivatives"),
        (lambda: SKIN.__class__([1.4], [1], [1], 0.0, [math.inf]).flipped(), "flipped"),
    ],
)
def test_wrong_input_is_named(call, name: str):
    with pytest.raises(ValueError, match=rf"^{name}.*given.*allowed"):
        call()
