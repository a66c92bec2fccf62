"""A homogeneous layer in discrete ordinates: published values, energy at albedo 1, directions of zero weight, derivatives."""

import csv
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ordinates_layer import deep, response, totals

REFERENCE = Path(__file__).parent.parent / "reference"


def rows(name: str) -> list[dict[str, float]]:
    lines = [line for line in (REFERENCE / name).read_text().splitlines() if not line.startswith("#")]
    return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(lines)]


def numbers(g=0.0, albedo=0.9, tau=1.0, n=1.0, mu=1.0):
    return jnp.array([g, albedo, tau, n, mu])


def test_slabs():
    """34 slabs, Henyey-Greenstein, normal incidence (PythonicDISORT with 128 streams): 32 streams up to g 0.75, else 64."""
    for row in rows("slabs.csv"):
        count = 16 if row["g"] <= 0.75 else 32
        (R, T), root = response(numbers(row["g"], row["albedo"], row["tau"]), 0, count, 1, 2 * count)
        error = max(abs(totals(R, root)[0] - row["R"]), abs(totals(T, root)[0] - row["T"]))
        assert error <= (1e-5 if row["g"] > 0.9 else 1e-6), row


def test_half_space_matches_the_H_functions():
    """Plane albedo, spherical albedo, and the BRDF albedo/(4 pi) H(mu) H(mu0)/(mu + mu0) at the angles tabulated. Six printed decimals."""
    cosines = (0.1, 0.2, 0.5, 0.8, 1.0)
    for row in rows("half_space_H.csv"):
        R, root = deep(numbers(0.0, row["a"]))
        beam, diffuse = totals(R, root)
        assert abs(beam - row["UR1"]) <= 1e-6
        assert abs(diffuse - row["URU"]) <= 1e-6
        for mu in cosines:
            R, root = deep(numbers(0.0, row["a"], mu=mu))
            # from the beam into ordinates: R/(2 pi sqrt W) is the BRDF times mu0/mu0; compare at the beam's own direction (line of sight 1)
            exact = row["a"] / 4.0 * row[f"H({mu:g})"] ** 2 / (2.0 * mu) / np.pi
            assert abs(float(R[1, -1]) / (2.0 * np.pi) - exact) <= 1e-5
            if mu == 0.5:
                assert abs(totals(R, root)[0] - row["R(mu0=0.5)"]) <= 1e-6


@pytest.mark.parametrize("g", [0.0, 0.5, 0.9, 0.99])
def test_albedo_one_loses_nothing(g):
    for tau in (1e-9, 1e-4, 1.0, 1e2, 1e4, 1e5, 1e6):
        (R, T), root = response(numbers(g, 1.0, tau))
        for a, b in zip(totals(R, root), totals(T, root), strict=True):
            assert abs(a + b - 1.0) <= 1e-9 * max(1.0, tau / 1e4)
    R, root = deep(numbers(g, 1.0))
    for total in totals(R, root):
        assert abs(total - 1.0) <= 1e-9


@pytest.mark.parametrize("tau", [1e-3, 1.0, 30.0])
@pytest.mark.parametrize("order", [0, 2])
def test_a_line_of_sight_sees_what_an_ordinate_carries(order, tau):
    """Line of sight 0 lies on ordinate 2: from the beam (corner), and from the ordinates (row)."""
    (R, T), root = response(numbers(0.7, 0.9, tau, 1.4, 0.6), order, 6, 2, 12)
    infinite, _ = deep(numbers(0.7, 0.9, tau, 1.4, 0.6), order, 6, 2, 12)
    for operator in (R, T, infinite):
        scale = np.abs(np.asarray(operator)[3:15, -1]).max()
        assert abs(operator[0, -1] * root[2] - operator[5, -1]) <= 1e-11 * scale + 1e-15
    off = np.arange(12) != 2
    for operator in (R, infinite):
        assert np.abs(np.asarray(operator[0, 3:15] * root[2] - operator[5, 3:15])).max() <= 1e-12
    assert np.abs(np.asarray(T[0, 3:15] * root[2] - T[5, 3:15]))[off].max() <= 1e-12


def _gradients(kind, order):
    weights = jax.random.normal(jax.random.PRNGKey(0), (16, 16))

    def value(x):
        operators = response(x, order, 6, 2, 12)[0] if kind == "layer" else deep(x, order, 6, 2, 12)[0]
        return jnp.sum(weights * operators)

    return jax.jit(value), jax.jit(jax.jacfwd(value)), jax.jit(jax.grad(value))


AWKWARD = {
    "plain": (0.7, 0.9, 1.0, 1.4, 0.6),
    "albedo 1": (0.7, 1.0, 1.0, 1.4, 0.6),
    "albedo 1, thick": (0.7, 1.0, 300.0, 1.4, 0.6),
    "isotropic, albedo 1": (0.0, 1.0, 3.0, 1.4, 0.6),
    "no scattering (coinciding eigenvalues)": (0.7, 0.0, 3.0, 1.4, 0.6),
    "no thickness": (0.7, 0.9, 0.0, 1.4, 0.6),
    "thick": (0.7, 0.9, 40.0, 1.4, 0.6),
}
SCALE = (1.0, 1.0, 1.0, 1.0, 1.0)


@pytest.mark.parametrize("kind", ["layer", "half space"])
def test_derivatives(kind):
    """Forward and reverse agree to rounding; differences fall as h^2 until rounding, one-sided at the ends of a range."""
    value, forward, reverse = _gradients(kind, 0)
    for name, numbers in AWKWARD.items():
        if kind == "half space" and "albedo 1" in name:
            continue  # a true kink: infinite slope in the albedo
        x = jnp.array(numbers)
        a, b = np.asarray(forward(x)), np.asarray(reverse(x))
        assert np.all(np.isfinite(a)), name
        assert np.abs(a - b).max() <= 1e-9 * np.abs(a).max(), name
        for i in range(5):
            errors = []
            for h in (1e-3, 5e-4):
                step = h * max(float(x[2]), 1.0) if i == 2 else h / max(float(x[2]), 1.0)
                move = jnp.zeros(5).at[i].set(step)
                if i == 1 and numbers[1] == 1.0:
                    move = -move
                if i in (0, 1, 2) and numbers[i] in (0.0, 1.0) and not (i == 2 and numbers[2] == 1.0):
                    difference = (-3.0 * value(x) + 4.0 * value(x + move) - value(x + 2.0 * move)) / (2.0 * move[i])
                else:
                    difference = (value(x + move) - value(x - move)) / (2.0 * move[i])
                errors.append(abs(float(difference) - a[i]))
            floor = 1e-7 * np.abs(a).max()
            assert errors[1] <= 0.4 * errors[0] + floor, (name, i, errors)


@pytest.mark.parametrize("tau", [1e-12, 1e-10])
def test_a_layer_of_next_to_nothing_that_does_not_scatter_joins_no_directions(tau):
    """Not even by rounding: what is trapped between two faces multiplies that by 1/tau^2."""
    (R, T), _ = response(numbers(0.5, 0.0, tau))
    for found in (R, T - jnp.diag(jnp.diagonal(T))):
        assert np.all(np.asarray(found) == 0.0)


def test_a_thin_layer_is_continuous_where_its_modes_are_left_out():
    """To second order: R and 1 - T in proportion to tau on both sides."""
    below, above = (response(numbers(0.5, 0.9, 2e-10 * f))[0] for f in (1.0 - 1e-9, 1.0 + 1e-9))
    for one, other in zip(below, above, strict=True):
        assert np.max(np.abs(np.asarray(one - other))) <= 1e-14
