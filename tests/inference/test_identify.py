"""What data could tell, against closed forms, fits, and brute force."""

import itertools
import json

import numpy as np
import pytest
from click.testing import CliRunner

import layerfit as lf
from layerfit.cli import main
from layerfit.inference.design import greedy
from layerfit.inference.parameters import FreeParameter
from layerfit.inference.uncertainty import open_directions

SOLVER = lf.LayeredDiffusion()
R = np.geomspace(1.0, 15.0, 12)
SKIN = lf.Stack([lf.HalfSpace("skin", sigma_a=0.02, sigma_s_prime=1.2, n=1.4)])
FREE = {"skin.sigma_a": (1e-3, 1.0), "skin.sigma_s_prime": (0.1, 10.0)}
PLAN = lf.Planned(lf.RadialReflectance(r=R), lf.Noise(relative=0.02), name="probe")
TWO = lf.Layer("top", sigma_a=0.01, sigma_s_prime=1.0, n=1.4, thickness=1.3) | lf.HalfSpace("deep", sigma_a=0.02, sigma_s_prime=1.5, n=1.4)
FIVE = {name: {"sigma_a": (1e-4, 1.0), "thickness": (0.1, 10.0)}.get(name.split(".")[1], (0.1, 20.0)) for name in (
    "top.sigma_a", "top.sigma_s_prime", "top.thickness", "deep.sigma_a", "deep.sigma_s_prime")}  # fmt: skip


@pytest.fixture(scope="module")
def found():
    return lf.identify(SKIN, PLAN, free=FREE, solver=SOLVER)


def slopes(stack, geometry, names):
    """Logarithmic slopes by central differences: (values, numbers)."""
    columns = []
    for name in names:
        x, h = stack.get(name), 1e-4
        up, down = (lf.predict(stack.set({name: x * (1 + s)}), geometry, solver=SOLVER)[0].values for s in (h, -h))
        columns.append((np.log(up) - np.log(down)) / (2 * h))
    return np.array(columns).T


def test_bound_is_the_inverse_information(found):
    """Against differences: absolute data, and relative data, where a free amplitude adds a column of ones."""
    jacobian = slopes(SKIN, PLAN.geometry, FREE) / 0.02
    expected = np.linalg.inv(jacobian.T @ jacobian)
    assert np.max(np.abs(found.absolute.relative / np.sqrt(np.diag(expected)) - 1)) <= 1e-4
    assert np.max(np.abs(found.absolute.sd / (found.absolute.relative * found.absolute.x) - 1)) <= 1e-12
    assert abs(found.absolute.correlation[0, 1] - expected[0, 1] / np.sqrt(expected[0, 0] * expected[1, 1])) <= 1e-4
    wider = np.column_stack([jacobian, np.full(R.size, 1 / 0.02)])
    expected = np.linalg.inv(wider.T @ wider)
    assert found.relative.names == (*FREE, "probe.amplitude")
    assert np.max(np.abs(found.relative.relative / np.sqrt(np.diag(expected)) - 1)) <= 1e-4
    assert found.stated == "absolute"
    assert np.all(found.absolute.determined)


def test_information_by_likelihood(found):
    """Student's t tells (nu + 1)/(nu + 3) of what normal noise does; noise that is alike everywhere adds to the absolute bound as a factor would."""
    student = lf.identify(SKIN, PLAN, free=FREE, solver=SOLVER, likelihood=lf.StudentT(4.0))
    assert np.max(np.abs(student.absolute.relative / (found.absolute.relative * np.sqrt(7 / 5)) - 1)) <= 1e-6
    alike = lf.identify(SKIN, PLAN, free=FREE, solver=SOLVER, likelihood=lf.CorrelatedNoise(relative=0.05, length=1e6))
    wider = np.column_stack([slopes(SKIN, PLAN.geometry, FREE) / 0.02, np.full(R.size, 1 / 0.02)])
    information = wider.T @ wider + np.diag([0, 0, 1 / 0.05**2])
    assert np.max(np.abs(alike.absolute.relative / np.sqrt(np.diag(np.linalg.inv(information)))[:2] - 1)) <= 1e-3


def test_a_prior_counts_as_known_before(found):
    """With 1 % of absorption known, its sd left by one value is below that."""
    known = {**FREE, "skin.sigma_a": {"min": 1e-3, "max": 1.0, "init": 0.02, "prior": lf.LogNormal(0.02, 1.01)}}
    prior = lf.identify(SKIN, PLAN, free=known, solver=SOLVER)
    assert prior.places[0].relative[0] <= 0.01
    assert prior.given[0] <= found.given[0]
    assert abs(1 / prior.given[0] ** 2 - 1 / np.log(1.01) ** 2 - 1 / found.given[0] ** 2) <= 0.1 / found.given[0] ** 2


def test_bound_is_the_standard_error_of_a_fit(found):
    clean = lf.predict(SKIN, PLAN.geometry, solver=SOLVER)[0].values
    fit = lf.fit(lf.Problem(SKIN, lf.Dataset(PLAN.geometry, clean, noise=PLAN.noise), free=FREE, solver=SOLVER), starts=1)
    assert np.max(np.abs(np.sqrt(np.diag(fit.covariance)) / found.absolute.sd - 1)) <= 0.02


def test_greedy_choice_against_all_pairs():
    """The first value has the largest gain; the second the largest with it; sd and bits are those of the whole information."""
    rng = np.random.default_rng(7)
    rows = rng.standard_normal((9, 3))
    parameters = [FreeParameter(f"skin.{name}", 0.1, 10.0, 1.0, "log", "1") for name in ("sigma_a", "sigma_s_prime", "thickness")]
    prior = np.diag([0.3, 0.5, 0.8])
    steps = greedy(prior, rows, [("probe", i) for i in range(9)], {"probe": lf.RadialReflectance(r=np.arange(1, 10))}, parameters, np.full(3, 2.0), 3)

    def det(chosen):
        return np.linalg.det(prior + rows[chosen].T @ rows[chosen])

    taken = []
    for step in steps:
        best = max((i for i in range(9) if i not in taken), key=lambda i: det([*taken, i]))
        assert step.index == best
        assert step.place == f"r {best + 1}"
        assert abs(step.bits - 0.5 * np.log2(det([*taken, best]) / det(taken))) <= 1e-9
        taken.append(best)
        expected = np.sqrt(np.diag(np.linalg.inv(prior + rows[taken].T @ rows[taken])))
        assert np.max(np.abs(step.relative / expected - 1)) <= 1e-9
        assert np.max(np.abs(step.sd / (2.0 * expected) - 1)) <= 1e-9
    pairs = max(itertools.combinations(range(9), 2), key=lambda pair: det(list(pair)))
    assert det(taken[:2]) >= 0.63 * det(list(pairs))  # what greedy choice guarantees, nearly


def test_chosen_places_beat_even_ones(found):
    """Three chosen distances tell more than three evenly spread ones."""
    names = list(FREE)
    prior = np.diag(12 / np.log([1000.0, 100.0]) ** 2)
    jacobian = slopes(SKIN, PLAN.geometry, names) / 0.02

    def volume(index):
        return np.linalg.det(prior + jacobian[index].T @ jacobian[index])

    chosen = [step.index for step in found.places[:3]]
    assert all(step.measurement == "probe" for step in found.places)
    assert volume(chosen) >= volume([0, 5, 11])
    assert len(found.places) == 6
    assert np.all(np.diff([step.relative for step in found.places], axis=0) <= 1e-12)
    assert np.all(found.extra[-1].relative <= found.given)


def test_names_what_two_layers_leave_open():
    """Five numbers from a profile with 1 %: open, more so without the amplitude; the sentences name numbers and directions."""
    plan = lf.Planned(lf.RadialReflectance(r=np.linspace(0.5, 15, 20)), lf.Noise(relative=0.01), name="probe")
    found = lf.identify(TWO, plan, free=FIVE, solver=SOLVER, candidates=[lf.Planned(lf.TotalReflectance(), lf.Noise(relative=0.01), name="sphere")])
    assert not found.absolute.determined[0]
    assert np.all(found.relative.relative[:5] >= found.absolute.relative - 1e-12)
    text = found.summary()
    assert "top.sigma_a is not determined by the data" in found.absolute.sentences
    assert any("trade off: the data leave top.sigma_a open" in sentence for sentence in found.absolute.sentences)
    assert "sphere" in text
    assert {step.measurement for step in found.extra} == {"sphere"}


def test_sentence_about_a_direction():
    """The factor is that of the number which moves most: a direction (1, -0.5) with sd 0.8 along it moves the first by exp(0.8 * 2/sqrt 5)."""
    parameters = [FreeParameter(f"skin.{name}", 0.1, 10.0, 1.0, "log", "1") for name in ("sigma_a", "sigma_s_prime")]
    axis = np.array([1.0, -0.5]) / np.sqrt(1.25)
    across = np.array([0.5, 1.0]) / np.sqrt(1.25)
    (sentence,) = open_directions(parameters, 0.64 * np.outer(axis, axis) + 1e-4 * np.outer(across, across))
    assert sentence == (
        "skin.sigma_a and skin.sigma_s_prime trade off: the data leave skin.sigma_a open by a factor 2 (1 sd) "
        "along relative changes of skin.sigma_a (+1.00), skin.sigma_s_prime (-0.50)"
    )


def test_data_with_sd_and_a_free_amplitude():
    """Measured values do not matter, their sd does; an amplitude that is free makes the data relative, as asked."""
    clean = lf.predict(SKIN, PLAN.geometry, solver=SOLVER)[0].values
    free = {**FREE, "probe.amplitude": (0.5, 2.0)}
    found = lf.identify(SKIN, lf.Dataset(PLAN.geometry, 3 * clean, 0.02 * clean, name="probe"), free=free, solver=SOLVER, candidates=[])
    assert found.stated == "relative"
    jacobian = np.column_stack([slopes(SKIN, PLAN.geometry, FREE), np.ones(R.size)]) / 0.02
    assert np.max(np.abs(found.knowledge.relative / np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian))) - 1)) <= 1e-4
    assert found.extra == ()


WRONG = {
    "nothing free": ({"free": {}}, PLAN, "no free parameter was given"),
    "no noise": ({}, lf.Dataset(PLAN.geometry, np.ones(R.size)), "neither sd nor noise"),
    "nothing measured": ({}, [], "no measurement was given"),
    "nothing to choose": ({"choose": 0}, PLAN, "choose = 0"),
    "more numbers than values": ({}, lf.Planned(lf.TotalReflectance(), lf.Noise(relative=0.1)), "2 free parameters and 1 measured value"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_input(case):
    options, data, said = WRONG[case]
    with pytest.raises(lf.InputError) as raised:
        lf.identify(SKIN, data, **{"free": FREE, "solver": SOLVER, "candidates": [], **options})
    assert said in str(raised.value)


def test_noise_of_a_plan():
    with pytest.raises(lf.InputError, match="allowed is Noise"):
        lf.Planned(PLAN.geometry, 0.02)


SCENE = """
[[layer]]
name = "skin"
sigma_a = 0.02
sigma_s_prime = 1.2
n = 1.4

[[measurement]]
name = "probe"
kind = "radial_reflectance"
x = [1, 2, 4, 8]
noise = {relative = 0.02}

[fit]
solver = "layered-diffusion"

[fit.free]
"skin.sigma_a" = [0.001, 1]
"skin.sigma_s_prime" = [0.1, 10]
"""


def test_command(tmp_path):
    """Table and files, without any data."""
    (tmp_path / "scene.toml").write_text(SCENE)
    result = CliRunner().invoke(main, ["identify", str(tmp_path / "scene.toml"), "--choose", "2", "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    content = json.loads((tmp_path / "out" / "identify.json").read_text())
    assert content["absolute"]["parameters"]["skin.sigma_a"]["determined"]
    assert content["relative"]["parameters"]["probe.amplitude"]["unit"] == "1"
    assert 0 < content["absolute"]["parameters"]["skin.sigma_a"]["sd"] < content["relative"]["parameters"]["skin.sigma_a"]["sd"]
    assert len(content["places"]) == len(content["extra"]) == 2
    assert (tmp_path / "out" / "identify.txt").read_text().strip() in result.output
    assert (tmp_path / "out" / "identify.svg").read_text().startswith("<svg")


COMMANDS = {
    "no noise": ("noise = {relative = 0.02}\n", "", "measurement 'probe' has no noise"),
    "nothing free": ('"skin.sigma_a" = [0.001, 1]\n"skin.sigma_s_prime" = [0.1, 10]\n', "", "no free parameter was given"),
    "a free number that does not exist": ('"skin.sigma_a"', '"skin.mu_a"', "'skin.mu_a' does not exist"),
    "a solver that does not exist": ("layered-diffusion", "diffusion", "solver 'diffusion' does not exist"),
}


@pytest.mark.parametrize("case", COMMANDS)
def test_command_refuses(case, tmp_path):
    old, new, said = COMMANDS[case]
    (tmp_path / "scene.toml").write_text(SCENE.replace(old, new))
    result = CliRunner().invoke(main, ["identify", str(tmp_path / "scene.toml")])
    assert result.exit_code == 2
    assert said in result.output
    assert len(result.output.strip().splitlines()) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["scene.toml"]
