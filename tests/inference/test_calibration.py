"""A phantom measured together with the sample."""

import numpy as np
import pytest

import layerfit as lf

SOLVER = lf.LayeredDiffusion()
GEOMETRY = lf.RadialReflectance(r=np.geomspace(1.0, 10.0, 15))
SKIN = lf.Stack([lf.HalfSpace("skin", sigma_a=0.02, sigma_s_prime=1.5, n=1.4)])
PHANTOM = lf.Stack([lf.Layer("phantom", sigma_a=0.005, sigma_s_prime=1.0, n=1.5, thickness=30.0)])
TRUE = 1.23
FREE = {"skin.sigma_a": (1e-3, 1.0), "skin.sigma_s_prime": (0.1, 10.0), "probe.amplitude": (0.2, 5.0)}


def measured(stack, name, relative=0.01):
    values = TRUE * lf.predict(stack, GEOMETRY, solver=SOLVER)[0].values
    return lf.Dataset(GEOMETRY, values, noise=lf.Noise(relative=relative), name=name)


def problem(*, phantom=PHANTOM, check=None, free=FREE, ties=None, **more):
    reference = lf.Reference(phantom, measured(PHANTOM, "check") if check is None else check)
    ties = {"check.amplitude": "probe.amplitude"} if ties is None else ties
    return lf.Problem(SKIN, measured(SKIN, "probe"), reference=reference, free=free, ties=ties, solver=SOLVER, **more)


def test_amplitude_from_a_phantom():
    """The truth comes back from another start; the amplitude is as certain as the phantom's values and numbers are."""
    away = {**FREE, "skin.sigma_a": {"min": 1e-3, "max": 1.0, "init": 0.05}}
    result = lf.fit(problem(free=away), starts=1)
    truth = {"skin.sigma_a": 0.02, "skin.sigma_s_prime": 1.5, "probe.amplitude": TRUE}
    assert max(abs(result.parameters[name].value / value - 1.0) for name, value in truth.items()) <= 1e-5
    assert [p.size for p in result.predictions] == [15, 15] and result.dof == 27
    sharp = result.parameters["probe.amplitude"].stderr / TRUE
    assert sharp <= 0.01 / np.sqrt(15)  # all 15 values of the phantom and what the sample adds
    prior = {"min": 0.7, "max": 1.3, "init": 1.1, "prior": lf.Normal(1.0, 0.05)}
    absorption = {"min": 1e-3, "max": 2e-2, "prior": lf.LogNormal(0.005, 1.2)}
    unsure = lf.fit(problem(free={**FREE, "phantom.sigma_s_prime": prior, "phantom.sigma_a": absorption}), starts=1)
    assert unsure.parameters["probe.amplitude"].stderr / TRUE > 1.2 * sharp
    assert abs(unsure.references[0].get("phantom.sigma_s_prime") - 1.0) <= 0.01
    alone = lf.fit(lf.Problem(SKIN, measured(SKIN, "probe"), free=FREE, solver=SOLVER), starts=1)
    assert alone.parameters["probe.amplitude"].stderr / TRUE > 2.0 * sharp


def test_surroundings_are_the_samples_own():
    """scene.n_above of the sample is not that of the phantom."""
    free = {"skin.sigma_a": (1e-3, 1.0), "scene.n_above": {"min": 1.0, "max": 1.4, "init": 1.2}, "probe.amplitude": (0.2, 5.0)}
    result = lf.fit(problem(free=free), starts=1)
    assert abs(result.parameters["probe.amplitude"].value / TRUE - 1.0) <= 1e-3
    assert result.references[0].get("scene.n_above") == 1.0


def test_model_error_of_both_samples():
    stated = problem(model_error="on")
    errors = [np.sqrt(np.diag(one.error)) / one.values for one in stated.model.scatter]
    predicted = [lf.predict(stack, GEOMETRY, solver=SOLVER)[0] for stack in (stated.stack, PHANTOM)]
    shares = [p.estimated_error / p.values for p in predicted]
    ratio = [e / s for e, s in zip(errors, shares, strict=True)]
    assert np.max(np.abs(np.array(ratio) / ratio[0][0] - 1.0)) <= 1e-9
    assert np.max(np.abs(shares[0] / shares[1] - 1.0)) >= 0.05


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"phantom": lf.Stack([lf.HalfSpace("skin", sigma_a=0.1, sigma_s_prime=1, n=1.4)])}, "'skin' is in the sample and in a reference"),
        ({"check": measured(PHANTOM, "probe")}, "measurement name 'probe' is also the name of another"),
        ({"ties": {"check.amplitude": ("probe.amplitude", 2.0)}}, "can only be the same as another's"),
        ({"ties": {"check.offset": "probe.amplitude"}}, "another kind of number"),
        ({"ties": {"phantom.sigma_a": "skin.sigma_a"}}, "belongs to another sample"),
        ({"ties": {"check.amplitude": "probe.background"}}, "can only be the same as another's"),
    ],
)
def test_what_does_not_go_together(more, said):
    with pytest.raises(lf.InputError) as error:
        problem(**more)
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("source", "detector", "name", "truth", "bounds"),
    [
        (lf.Disk(0.6), lf.Detector(), "source_radius", 0.6, (0.2, 1.0)),
        (lf.Gaussian(0.5), lf.Detector(), "source_radius", 0.5, (0.2, 1.0)),
        (lf.Pencil(), lf.Detector(radius=0.4), "detector_radius", 0.4, (0.1, 0.8)),
    ],
    ids=["disk", "gaussian", "fibre"],
)
def test_size_of_spot_and_fibre(source, detector, name, truth, bounds):
    """A radius comes back with the absorption, from predictions of the geometry itself."""
    r = np.array([1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 8.0])
    geometry = lf.RadialReflectance(r=r, source=source, detector=detector)
    data = lf.Dataset(geometry, lf.predict(SKIN, geometry, solver=SOLVER)[0].values, noise=lf.Noise(relative=0.01), name="probe")
    free = {"skin.sigma_a": (1e-3, 1.0), f"probe.{name}": {"min": bounds[0], "max": bounds[1], "init": 0.3}}
    result = lf.fit(lf.Problem(SKIN.set({"skin.sigma_a": 0.03}), data, free=free, solver=SOLVER), starts=1)
    assert abs(result.x[1] / truth - 1.0) <= 1e-3
    assert abs(result.x[0] / 0.02 - 1.0) <= 1e-4
    assert result.parameters[f"probe.{name}"].unit == "mm"


def test_radii_that_cannot_be_free():
    point = measured(SKIN, "probe")
    with pytest.raises(lf.InputError, match=r"'probe.source_radius' does not exist"):
        lf.Problem(SKIN, point, free={"probe.source_radius": (0.1, 1.0)}, solver=SOLVER)
    geometry = lf.RadialReflectance(r=[1.0, 2.0, 3.0], source=lf.Disk(0.2), detector=lf.Detector(radius=0.2))
    both = lf.Dataset(geometry, [0.1, 0.05, 0.02], noise=lf.Noise(relative=0.01), name="probe")
    with pytest.raises(lf.InputError, match="are both free"):
        lf.Problem(SKIN, both, free={"probe.source_radius": (0.1, 1.0), "probe.detector_radius": (0.1, 1.0)}, solver=SOLVER)
