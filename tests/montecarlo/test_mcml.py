"""Against MCML, ring by ring, and the wrong scenes that must be rejected."""

import dataclasses
import math

import pytest
from montecarlo_cases import MCML, families, judge, mcml, mcml_names
from montecarlo_mcml import level

import layerfit.montecarlo as mc

NAMES = mcml_names() or ("none",)
needed = pytest.mark.skipif(not mcml_names(), reason=f"the MCML cases are not there ({MCML.parent.parent.name}/reference/cases)")


@needed
def test_all_cases_are_found():
    assert len(NAMES) == 22


@needed
@pytest.mark.parametrize("name", NAMES)
def test_profiles(name: str):
    """The run of benchmarks/montecarlo_mcml.py with fewer photons: same families, same level."""
    profile = mcml(name)
    result = mc.simulate(profile.medium, None, profile.tallies, photons=100_000, seed=500 + NAMES.index(name), threads=1)
    for family, comparison in judge(result, profile, level(3 * len(NAMES))).items():
        assert comparison.agree, f"{family}: {comparison}"
        assert comparison.noticeable_common <= 0.05
    assert abs(result.balance).max() <= 1e-12


def changed(medium: mc.Medium, **fields) -> mc.Medium:
    """The same medium with some fields replaced."""
    kept = {field.name: getattr(medium, field.name) for field in dataclasses.fields(medium)}
    return mc.Medium(**(kept | fields))


def g_of(medium: mc.Medium, factor: float) -> list[float]:
    return [factor * phase.mean_cosine for phase in medium.phase]


PHOTONS = {"slab_dj_2mfp": 2e6}  # two mean free paths: short walks, and R and T that depend on sigma_s most
CONTROLS = {
    "g 2 % high": ("slab_n14_g08_5mfp", lambda m: changed(m, phase=g_of(m, 1.02))),
    "g 2 % low": ("slab_n14_g08_5mfp", lambda m: changed(m, phase=g_of(m, 0.98))),
    "sigma_s 1 % high": ("slab_dj_2mfp", lambda m: changed(m, sigma_s=[1.01 * s for s in m.sigma_s])),
    "sigma_s 1 % low": ("slab_dj_2mfp", lambda m: changed(m, sigma_s=[0.99 * s for s in m.sigma_s])),
    "n 1 % high": ("slab_n14_g08_5mfp", lambda m: changed(m, n=[1.01 * n for n in m.n])),
    "n 1 % low": ("slab_n14_g08_5mfp", lambda m: changed(m, n=[0.99 * n for n in m.n])),
    "missing interface": ("skin3_dj_R", lambda m: changed(m, n=[m.n[0], m.n[0], m.n[2]])),
    "missing surface": ("slab_n14_g08_5mfp", lambda m: changed(m, n_below=m.n[0])),
    "swapped layers": (
        "two_thick_low_over_thin_high",
        lambda m: changed(m, sigma_a=m.sigma_a[::-1], sigma_s=m.sigma_s[::-1], thickness=m.thickness[::-1]),
    ),
    "swapped coefficients": ("skin3_dj_R", lambda m: changed(m, sigma_s=[m.sigma_s[1], m.sigma_s[0], m.sigma_s[2]])),
}


@needed
@pytest.mark.parametrize("name", CONTROLS)
def test_wrong_scenes_are_rejected(name: str):
    """Each wrong scene is refused by its profile at the level at which the right scene is accepted, with the same photons."""
    case, change = CONTROLS[name]
    profile = mcml(case)
    each = level(3)
    wrong = mc.simulate(change(profile.medium), None, profile.tallies, photons=PHOTONS.get(case, 3e5), seed=900, threads=1)
    verdicts = {family: comparison.verdict for family, comparison in judge(wrong, profile, each).items()}
    assert "disagree" in verdicts.values(), verdicts


@needed
@pytest.mark.parametrize("case", sorted({case for case, _ in CONTROLS.values()}))
def test_the_right_scenes_are_accepted(case: str):
    profile = mcml(case)
    right = mc.simulate(profile.medium, None, profile.tallies, photons=PHOTONS.get(case, 3e5), seed=901, threads=1)
    for family, comparison in judge(right, profile, level(3)).items():
        assert comparison.agree, f"{family}: {comparison}"
    assert families(right)["rings"].value.size == profile.rings.value.size
    assert math.isclose(float(right.value("R_specular")), 0.0277777777778 * (profile.medium.n[0] != 1.0), rel_tol=1e-9)
