"""Measured data and Monte Carlo profiles as a user would fit them."""

import csv
import gzip

import numpy as np
import pytest
from cases import load

import layerfit as lf


@pytest.fixture(scope="module")
def skin(shared):
    """Reflectance factor of 100 people, three repeats each, by wavelength [nm] (NIST, doi 10.18434/M38597)."""
    with gzip.open(shared / "data" / "nist-skin" / "M38597.csv.gz", "rt", encoding="latin-1") as file:
        rows = [row for row in csv.reader(file) if row and row[0].isdigit()]
    return {int(row[0]): np.array([float(v) for v in row[1:401]]).reshape(100, 4)[:, :3] for row in rows}


def two_layer_skin(wavelength, melanin):
    """Epidermis over dermis: sigma_s' and melanin by Jacques, Phys. Med. Biol. 58, R37 (2013), eq 1 (skin) and section 4.5."""
    scattering = 4.6 * (wavelength / 500) ** -1.421
    return lf.Layer("epidermis", sigma_a=melanin * 6.6e10 * wavelength**-3.33, sigma_s_prime=scattering, g=0.8, n=1.4, thickness=0.06) | lf.HalfSpace(
        "dermis", sigma_a=0.05, sigma_s_prime=scattering, g=0.8, n=1.4
    )


@pytest.mark.parametrize(("wavelength", "low", "high"), [(550, 0.05, 1.5), (661, 0.005, 0.4), (850, 0.005, 0.2)])
def test_reflectance_of_measured_skin(skin, wavelength, low, high):
    """sigma_a of the dermis from total R of ten people: a good fit, and a value that blood and water can give."""
    geometry = lf.TotalReflectance(incidence=8.0, specular="included")
    stack = two_layer_skin(wavelength, melanin=0.02)
    found = []
    for person in skin[wavelength][::10]:
        data = lf.Dataset(geometry, [person.mean()], sd=[0.002 + person.std(ddof=1) / np.sqrt(3)])
        result = lf.fit(
            lf.Problem(stack, data, free={"dermis.sigma_a": {"min": 1e-3, "max": 5.0, "init": 0.05}}, solver=lf.LayeredDiffusion()), starts=1
        )
        assert result.outcome is lf.Outcome.CONVERGED
        assert result.predictions[0][0] == pytest.approx(person.mean(), abs=1e-6)
        found.append(result.x[0])
    assert low <= np.median(found) <= high
    assert np.std(np.log(found)) > 0.05  # people differ


@pytest.mark.parametrize(("name", "bound"), [("si_n14_g08_a0980", 0.15), ("skin_over_fat", 0.35)])
def test_fit_of_monte_carlo_profiles(name, bound):
    """Fits of MCML rings beyond 1 mfp' with 2 % error come back as near the truth as diffusion allows (docs/fits-of-monte-carlo.md)."""
    case = load(name)
    low, high = case.rings
    chosen = np.flatnonzero((0.5 * (low + high) >= case.mfp) & (case.R_se < 0.05 * case.R))
    chosen = chosen[np.unique(np.round(np.geomspace(1, len(chosen), 25)).astype(int) - 1)]
    sd = np.hypot(case.R_se, 0.02 * case.R)[chosen]
    data = lf.Dataset(lf.RadialReflectance(r_min=low[chosen], r_max=high[chosen]), case.R[chosen], sd)
    truth = {name: float(case.stack.get(name)) for name in case.stack.names if name.rsplit(".", 1)[1] in ("sigma_a", "sigma_s", "thickness")}
    free = {key: {"min": value / 5, "max": value * 5, "init": value * 1.5} for key, value in truth.items()}
    result = lf.fit(lf.Problem(case.stack, data, free=free, solver=lf.LayeredDiffusion()))
    assert result.outcome is lf.Outcome.CONVERGED
    for key, estimate in result.parameters.items():
        determined = f"{key} is not determined by the data" not in result.warnings
        assert not determined or abs(np.log(estimate.value / truth[key])) <= max(bound, 3 * estimate.stderr / estimate.value)
