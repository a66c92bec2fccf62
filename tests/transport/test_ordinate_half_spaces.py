"""Half spaces of isotropic scattering in discrete ordinates against Chandrasekhar's H functions."""

import csv
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ordinates_scenes import predicted

import layerfit as lf
from layerfit.optics.phase import legendre_functions
from layerfit.optics.quadrature import ordinates
from layerfit.transport.discrete_ordinates_layer import Directions, deep_layer, problem, scattering

COSINES = np.array([1.0, 0.8, 0.5, 0.2, 0.1])
ROWS = list(csv.DictReader((Path(__file__).parent.parent / "reference" / "half_space_H.csv").read_text().splitlines()[1:]))


def exact_brdf(row: dict[str, str]) -> np.ndarray:
    """a/(4 pi) H(mu) H(mu0)/(mu + mu0)."""
    H = np.array([float(row[f"H({mu:g})"]) for mu in COSINES])
    return float(row["a"]) / (4.0 * np.pi) * np.outer(H, H) / np.add.outer(COSINES, COSINES)


@partial(jax.jit, static_argnums=1)
def reflection(albedo, count):
    """The operator over five lines of sight, ordinates and five beams in the same directions; roots of the weights."""
    rule = ordinates(jnp.ones(1), (0,), (count,))
    root = jnp.sqrt(rule.W)
    mu = jnp.concatenate([rule.mu[0], COSINES, COSINES])
    directions = Directions(mu, jnp.concatenate([root, jnp.ones(10)]) / mu, root)
    kernel = scattering(jnp.zeros(2 * count).at[0].set(1.0), legendre_functions(mu, 2 * count, 1)[0], directions, jnp.zeros(()), 5)
    return deep_layer(problem(kernel, directions, albedo, 1.0 - albedo, jnp.zeros(()))).value, root


def test_all_pairs_of_angles():
    """BRDF at 25 pairs and 11 albedos; plane and spherical albedo. 32 streams; the table has six decimals of H."""
    for row in ROWS:
        operator, root = (np.asarray(v) for v in reflection(jnp.asarray(float(row["a"])), 16))
        assert np.abs(operator[:5, -5:] / (2.0 * np.pi) - exact_brdf(row)).max() <= 1e-6
        beams = root @ operator[5:-5, -5:]
        assert abs(beams[0] - float(row["UR1"])) <= 1e-6
        assert abs(beams[2] - float(row["R(mu0=0.5)"])) <= 1e-6
        assert abs(root @ operator[5:-5, 5:-5] @ root / np.sum(root**2) - float(row["URU"])) <= 1e-6


@pytest.mark.parametrize("mu0", [0.5, *(pytest.param(mu, marks=pytest.mark.long) for mu in (1.0, 0.8, 0.2, 0.1))])
def test_the_solver_at_all_pairs_of_angles(mu0):
    """The same through the solver: radiance per incident power is the BRDF. Plane and spherical albedo."""
    angle = np.degrees(np.arccos(COSINES))
    incidence = float(np.degrees(np.arccos(mu0)))
    geometries = [lf.AngularReflectance(angle, incidence=incidence), lf.TotalReflectance(incidence=incidence)]
    if mu0 == 1.0:
        geometries.append(lf.TotalReflectance(incidence="diffuse"))
    for row in ROWS:
        a = float(row["a"])
        found = predicted(lf.Stack([lf.HalfSpace("deep", sigma_a=1.0 - a, sigma_s=a, g=0.0, n=1.0)]), geometries, 32)
        assert np.abs(found[0] - exact_brdf(row)[:, list(COSINES).index(mu0)]).max() <= 1e-6
        assert abs(found[1][0] - (1.0 - np.sqrt(1.0 - a) * float(row[f"H({mu0:g})"]))) <= 1e-6
        if mu0 == 1.0:
            assert abs(found[2][0] - float(row["URU"])) <= 1e-6
