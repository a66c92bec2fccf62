"""Numbers as texts."""

import jax
import numpy as np
import pytest

import layerfit as lf
from layerfit.report.tables import chi_square_text, derived_rows, fit_text, parameter_rows, solver_text, unit_text, versions, with_uncertainty


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        (0.020312, 0.00118, "0.0203 ± 0.0012"),
        (1.5, None, "1.5"),
        (1.5, 0.0, "1.5"),
        (1.5, float("nan"), "1.5"),
        (1.5, float("inf"), "1.5"),
        (12.3456, 0.5, "12.35 ± 0.50"),
        (123.4, 56.0, "123 ± 56"),
        (12345.0, 678.0, "12340 ± 680"),
        (-0.5, 0.25, "-0.50 ± 0.25"),
        (0.0, 0.011, "0.000 ± 0.011"),
        (0.808, 110.0, "0.808 ± 110"),
        (0.0395, 4.9, "0.0395 ± 4.9"),
        (-0.00273, 0.038, "-0.00273 ± 0.038"),
        (1e-9, 1e-15, "1e-09 ± 1e-15"),
        (2e8, 3e6, "2e+08 ± 3e+06"),
    ],
)
def test_with_uncertainty(value, sd, text):
    assert with_uncertainty(value, sd) == text


def test_small_texts():
    assert unit_text("1/mm^2") == "1/mm²" and unit_text("mm") == "mm"
    assert [chi_square_text(v) for v in (1e-25, 0.5, 12.914, 1e6, float("nan"))] == ["0", "0.5", "12.91", "1e+06", "nan"]
    assert solver_text(lf.LayeredDiffusion(source="point")).startswith("layered-diffusion (source point, boundary averaged, ")
    assert solver_text(lf.Auto()) == "auto"


def test_repr_of_a_solver_holds_all_settings():
    assert repr(lf.Multipole(source="point")) == "Multipole(source='point', reflection='exact', subtract=True)"
    for solver in (lf.LayeredDiffusion(boundary="partial_current"), lf.Dipole(), lf.Auto()):
        assert eval(repr(solver), {type(solver).__name__: type(solver)}) == solver


def test_versions():
    found = versions()
    assert found["jax"] == jax.__version__ and found["numpy"] == np.__version__ and "python" in found and "layerfit" in found


def test_rows(small_fit):
    a, s, background = parameter_rows(small_fit)
    assert (a["name"], a["unit"], a["bounds"]) == ("skin.sigma_a", "1/mm", "0.001 to 1")
    assert s["note"] == "at its bound" and "±" not in s["value"]
    assert background["unit"] == "1/mm²"
    estimate = small_fit.parameters["skin.sigma_a"]
    assert a["value"] == with_uncertainty(estimate.value, estimate.stderr) and "±" in a["value"]


def test_text(small_fit):
    text = fit_text(small_fit)
    assert repr(small_fit) == text == small_fit.summary()
    for part in ("converged: chi-square", "degrees of freedom", "solver layered-diffusion (source mixed", "skin.sigma_a", "at its bound", "1/mm²"):
        assert part in text
    assert all(f"  ! {warning}" in text for warning in small_fit.warnings) and small_fit.warnings


def test_derived_quantities(small_fit):
    """mu_eff, penetration depth, transport mean free path and albedo by their definitions; sd by differences in the free numbers."""
    row = derived_rows(small_fit)[0]
    layer = small_fit.stack.layers[0]
    a, s = layer.sigma_a, layer.sigma_s_prime

    def quantities(a):
        mu_eff = np.sqrt(3 * a * (a + s))
        return np.array([mu_eff, 1 / mu_eff, 1 / (a + s), s / (a + s)])

    sd_a = small_fit.parameters["skin.sigma_a"].stderr  # sigma_s_prime is at its bound
    sd = np.abs(quantities(a + 1e-6 * a) - quantities(a - 1e-6 * a)) / (2e-6 * a) * sd_a
    assert row["layer"] == "skin"
    for key, value, error in zip(("mu_eff", "penetration", "mfp", "albedo"), quantities(a), sd, strict=True):
        assert row[key] == with_uncertainty(value, error), key


def test_a_fit_as_tables(small_fit):
    table = small_fit.to_pandas()
    assert list(table.index) == list(small_fit.parameters) and table["unit"]["skin.sigma_a"] == "1/mm"
    assert bool(table["at_bound"]["skin.sigma_s_prime"]) and np.isnan(table["stderr"]["skin.sigma_s_prime"])
    held = small_fit.to_xarray()
    assert float(held["skin.sigma_a"]) == small_fit.parameters["skin.sigma_a"].value
    assert np.array_equal(held["probe.fitted"], small_fit.predictions[0]) and np.array_equal(held["probe.r"], small_fit.problem.data[0].geometry.r)
    assert held.covariance.shape == (3, 3) and held.attrs["outcome"] == "converged"
