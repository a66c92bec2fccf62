"""Validation against the Monte Carlo: solvers with known errors must be told apart, at the level that is stated."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

import layerfit as lf
from layerfit.solver import Forward, Solver
from layerfit.validation import Verdict, _with_neighbours

SLAB = lf.Stack([lf.Layer("slab", sigma_a=0.1, sigma_s=0.9, g=0.75, n=1.0, thickness=2)])
TOTALS = (lf.TotalReflectance(), lf.TotalTransmittance())
EXACT = (0.09739464, 0.660957700)  # albedo 0.9, g 0.75, optical thickness 2: van de Hulst (1980), by 128 streams


class Known(Solver):
    """A solver whose values are the exact ones times a factor, and which states a relative error."""

    name: ClassVar[str] = "known"
    factor: float = 1.0
    stated: float | None = None

    def check(self, stack, geometry) -> None:
        pass

    def forward(self, domain, geometries: Sequence, shifts) -> Forward:
        return _Known(self.factor, self.stated, tuple(EXACT[0] if g.side == "above" else EXACT[1] for g in geometries))


class _Known(Forward):
    factor: float
    stated: float | None
    exact: tuple[float, ...]

    def __call__(self, columns, shifts=None):
        return tuple(jnp.array([self.factor * value]) for value in self.exact)

    def error(self, columns):
        if self.stated is None:
            return None
        return tuple(np.array([self.stated * self.factor * value]) for value in self.exact)


def judge(solver: Solver, photons: int = 100_000, seed: int = 1, **settings) -> lf.Validation:
    return lf.validate(SLAB, TOTALS, solver=solver, photons=photons, seed=seed, threads=1, **settings)


@pytest.mark.parametrize(
    ("factor", "stated", "verdict"),
    [
        (1.0, None, Verdict.AGREE),
        (1.0, 1e-6, Verdict.AGREE),
        (1.05, None, Verdict.DISAGREE),  # no error stated: any difference counts
        (0.95, 1e-6, Verdict.DISAGREE),
        (1.05, 0.06, Verdict.AGREE),  # within what it states
        (1.10, 0.04, Verdict.DISAGREE),  # beyond it
        (1.0, 0.6, Verdict.OVERSTATED),
        (1.0, 0.04, Verdict.AGREE),  # ten times the true error, but not above 5 %
        (1.2, 0.6, Verdict.AGREE),  # above 5 %, but not ten times the true error
    ],
)
def test_verdicts(factor: float, stated: float | None, verdict: Verdict):
    found = judge(Known(factor, stated), photons=400_000)
    assert found.verdict is verdict, found.summary()


def test_an_error_is_not_called_overstated_on_the_strength_of_noise():
    # 100 photons know T to 5 %, so that its true error may be 2 %; by chance they often come closer
    assert not any(judge(Known(1.0, 0.2), photons=100, seed=seed).verdict is Verdict.OVERSTATED for seed in range(20))


def test_a_deviation_that_changes_sign_is_small_by_chance():
    assert _with_neighbours(np.array([3.0, 1.0, 0.0, 2.0, 0.0])).tolist() == [3.0, 3.0, 2.0, 2.0, 2.0]


def test_few_photons_decide_nothing():
    found = judge(Known(1.02), photons=200)
    assert found.verdict is Verdict.UNDECIDED
    assert found.noticeable > 0.05
    assert judge(Known(1.0), photons=400_000).noticeable <= 0.05


def test_the_level_is_kept():
    """An exact solver is called wrong in 5 % of the runs at most: of 200, no more than 22 (probability 3e-4), and some, or the test is blunt."""
    wrong = sum(judge(Known(), photons=1000, seed=seed, level=0.05).verdict is Verdict.DISAGREE for seed in range(200))
    assert 1 <= wrong <= 22


def test_the_stated_power_is_true():
    """What is said to be noticeable with 95 % probability is noticed that often."""

    def total(factor: float, seed: int) -> lf.Validation:
        return lf.validate(SLAB, TOTALS[1], solver=Known(factor), photons=20_000, seed=seed, threads=1)

    # an error from 100 batches is known to 7 %: what one run calls noticeable varies as much
    smallest = float(np.mean([total(1.0, seed).noticeable for seed in range(40)]))
    noticed = sum(total(1.0 + smallest, seed).verdict is Verdict.DISAGREE for seed in range(100, 200))
    assert noticed >= 87  # of 95 expected; fewer with probability 1e-3


def test_layered_diffusion_is_found_out_close_to_the_source():
    """Within a mean free path of a pencil beam diffusion is wrong by more than 5 %, and far from it right within 5 %."""
    stack = lf.Stack([lf.HalfSpace("deep", sigma_a=0.01, sigma_s_prime=1, g=0.5, n=1.4)])
    geometry = lf.RadialReflectance(r_min=[0.05, 3.0], r_max=[0.15, 5.0])
    check = lf.validate(stack, geometry, solver=lf.LayeredDiffusion(), photons=100_000, threads=1).checks[0]
    assert check.judged.all()
    assert abs(check.ratio[0] - 1.0) >= 0.05
    assert abs(check.ratio[1] - 1.0) <= 0.05


def test_bins_without_photons_are_not_judged():
    found = lf.validate(
        lf.Stack([lf.HalfSpace("deep", sigma_a=1, sigma_s_prime=1, g=0.5, n=1.4)]),
        lf.RadialReflectance(r_min=[0.1, 50], r_max=[1, 51]),
        solver=lf.LayeredDiffusion(),
        photons=1000,
        threads=1,
    )
    assert found.checks[0].judged.tolist() == [True, False]
    assert [row["finding"] for row in found.table()][1] == "too few photons"
    assert np.isnan(found.checks[0].ratio[1])
    assert "1 of 2 values judged" in found.summary()
    assert found.plot().axes


def test_a_value_where_nothing_is_counted_and_much_is_claimed_differs():
    """No photon of 100,000 comes out below, where the solver claims 66 %."""
    black = lf.Stack([lf.Layer("black", sigma_a=50, sigma_s_prime=1, g=0.5, n=1.0, thickness=2)])
    found = lf.validate(black, lf.TotalTransmittance(), solver=Known(), photons=100_000, threads=1)
    assert found.verdict is Verdict.DISAGREE


def test_both_exactly_nothing():
    deep = lf.Stack([lf.HalfSpace("deep", sigma_a=0.1, sigma_s_prime=1, g=0.5, n=1.4)])
    found = lf.validate(deep, [lf.TotalTransmittance(), *TOTALS[:1]], solver=Known(0.0), photons=1000, threads=1)
    assert found.checks[0].beyond.tolist() == [False]
    assert found.table()[0]["finding"] == ""


def test_table_text_files_and_figure(tmp_path: Path):
    found = judge(Known(1.05, 0.01), names=["R", "T"])
    rows = found.table()
    assert [row["measurement"] for row in rows] == ["R", "T"]
    for row, exact in zip(rows, EXACT, strict=True):
        assert row["value"] == pytest.approx(1.05 * exact)
        assert row["stated_error"] == pytest.approx(0.0105 * exact)
        assert row["z"] == pytest.approx((row["value"] - row["monte_carlo"]) / row["standard_error"])
        assert row["deviation"] == pytest.approx(row["value"] / row["monte_carlo"] - 1.0)
    assert found.summary().startswith("disagree: solver known against monte-carlo, 2 of 2 values judged, differs: ")
    paths = found.save(tmp_path / "out")
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["validation.json", "validation.svg", "validation.txt"]
    content = json.loads(paths["validation.json"].read_text())
    assert content["rows"] == rows
    assert (content["verdict"], content["solver"], content["photons"], content["seed"]) == ("disagree", "known", 100_000, 1)
    assert paths["validation.svg"].read_text().startswith("<svg")
    assert paths["validation.txt"].read_text().strip() == found.summary() == repr(found)
    axes = found.plot().axes
    assert [axis.get_title() for axis in axes] == ["R", "T"]
    low, high = axes[0].get_ylim()
    assert low < 1.0 < rows[0]["value"] / rows[0]["monte_carlo"] < high


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"solver": lf.MonteCarlo()}, "monte-carlo is the judge and cannot judge itself"),
        ({"solver": Known(), "names": ["one"]}, "1 names for 2 geometries"),
        ({"solver": Known(), "level": 1.0}, "level = 1.0; allowed is a number between 0 and 1"),
        ({"solver": Known(), "photons": 10}, "photons = 10; allowed is a whole number, at least 100"),
    ],
)
def test_wrong_input_is_named(settings: dict, said: str):
    with pytest.raises(lf.InputError, match=said):
        lf.validate(SLAB, TOTALS, **settings)


def test_a_layer_without_g_is_refused_before_anything_runs():
    stack = lf.Stack([lf.HalfSpace("deep", sigma_a=0.1, sigma_s_prime=1, n=1.4)])
    with pytest.raises(lf.InputError, match="layer 'deep' has no g"):
        lf.validate(stack, TOTALS, photons=10**12)
