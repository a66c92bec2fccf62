"""Derivatives of R(r) by discrete ordinates against those that a Monte Carlo takes from its paths."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import layerfit as lf
import layerfit.montecarlo as mc

RINGS = np.array([0.2, 0.5, 1.0, 1.5, 2.0, 3.0])
NUMBERS = {"sigma_a": (0.1, 0.05), "sigma_s": (10.0, 5.0)}
G, N, THICKNESS = (0.8, 0.5), (1.4, 1.33), (0.5, 4.0)


@pytest.mark.parametrize("photons", [400_000, pytest.param(8_000_000, marks=pytest.mark.long)])
def test_derivatives_of_rings(photons):
    """sigma_a and sigma_s of both layers with an index step between them: every ring within 3.5 standard errors, nine in ten within 2."""
    run = mc.simulate(
        mc.Medium(N, *NUMBERS.values(), G, THICKNESS, n_below=1.33),
        mc.Pencil(),
        mc.Tallies(rings=RINGS, derivatives=True),
        photons=photons,
        seed=4,
        threads=1,
    )
    layers = [lf.Layer(f"l{i}", sigma_a=NUMBERS["sigma_a"][i], sigma_s=NUMBERS["sigma_s"][i], g=G[i], n=N[i], thickness=THICKNESS[i]) for i in (0, 1)]
    geometry = lf.RadialReflectance(r_min=RINGS[:-1], r_max=RINGS[1:])
    free = {f"l{i}.{name}": (0.5 * value, 2.0 * value) for name, pair in NUMBERS.items() for i, value in enumerate(pair)}
    data = lf.Dataset(geometry, np.ones(geometry.size), np.ones(geometry.size))
    problem = lf.Problem(lf.Stack(layers, n_below=1.33), data, free=free, solver=lf.DiscreteOrdinates())
    x = jnp.array([p.init for p in problem.parameters])
    slopes = np.asarray(jax.jit(jax.jacfwd(lambda x: problem.model.predict(x)[0]))(x))
    deviations = []
    for j, name in enumerate(free):
        found = run.derivative("R_rings", name.rsplit(".")[1], int(name[1]))
        deviations.append((slopes[:, j] - found.value) / found.standard_error)
        if name.endswith("sigma_a"):
            assert np.all(found.standard_error <= 0.05 * np.abs(found.value))  # sharp enough to tell
    deviations = np.abs(np.array(deviations))
    assert np.max(deviations) <= 3.5
    assert np.mean(deviations <= 2.0) >= 0.9
