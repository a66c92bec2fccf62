"""Does the comparison find what is there, and leave alone what is not? On made-up data whose truth is known."""

import math

import numpy as np
import pytest

import layerfit.montecarlo as mc

TRUE = np.geomspace(1.0, 1e-3, 30)


def batches(rng: np.random.Generator, count: int, mean: np.ndarray, relative: float = 0.1, common: float = 0.0) -> mc.Estimate:
    """Normal batches about a mean, with independent and with common scatter relative to the truth."""
    scatter = relative * rng.standard_normal((count, mean.size)) + common * rng.standard_normal((count, 1))
    return mc.Estimate.from_samples(mean + TRUE * scatter)


def rate(make, runs: int = 1000, **settings) -> dict[str, float]:
    """How often each verdict is given."""
    rng = np.random.default_rng(17)
    verdicts = [mc.compare(*make(rng), **settings).verdict for _ in range(runs)]
    return {verdict: verdicts.count(verdict) / runs for verdict in ("agree", "disagree", "undecided")}


def test_level_is_kept_with_few_batches_on_both_sides():
    found = rate(lambda rng: (batches(rng, 100, TRUE), batches(rng, 20, TRUE)), level=0.05)
    assert abs(found["disagree"] - 0.05) <= 3.5 * math.sqrt(0.05 * 0.95 / 1000)


def test_level_is_kept_against_exact_numbers():
    found = rate(lambda rng: (batches(rng, 10, TRUE), TRUE), level=0.05)
    assert abs(found["disagree"] - 0.05) <= 3.5 * math.sqrt(0.05 * 0.95 / 1000)


def test_normal_scores_in_the_place_of_student_would_fail():
    # what the degrees of freedom are for: five batches taken for exact errors reject far too often
    def blunt(rng: np.random.Generator) -> tuple[mc.Estimate, np.ndarray]:
        few = batches(rng, 5, TRUE)
        return mc.Estimate(few.value, few.standard_error), TRUE

    assert rate(blunt, 300)["disagree"] >= 0.3


def test_level_is_kept_with_common_errors():
    # all bins move together, as R(k) at neighbouring k: with the batches known, the mean score does not take it for a bias
    found = rate(lambda rng: (batches(rng, 100, TRUE, 0.02, 0.2), TRUE), level=0.05, limit=0.5)
    assert found["disagree"] <= 0.05 + 3.5 * math.sqrt(0.05 * 0.95 / 1000)
    blind = rate(lambda rng: (mc.Estimate((e := batches(rng, 100, TRUE, 0.02, 0.2)).value, e.standard_error, 99), TRUE), 300)
    assert blind["disagree"] >= 0.3


def test_level_is_kept_with_few_counts():
    # photons that each add the same to a bin, from thousands down to none, against a reference with its own counts
    def counts(rng: np.random.Generator) -> tuple[mc.Estimate, mc.Estimate]:
        mean = np.geomspace(3000.0, 0.3, 30)
        ours = mc.Estimate.from_samples(rng.poisson(mean / 100, (100, 30)) / 1.0, 1.0 / 100)
        theirs = mc.Estimate.from_samples(rng.poisson(mean / 4, (20, 30)) / 25.0, 1.0 / 500)
        return ours, theirs

    found = rate(counts, level=0.05, limit=0.5)
    assert found["disagree"] <= 0.05 + 3.5 * math.sqrt(0.05 * 0.95 / 1000)
    # but light where there must be none, or none where there must be, is seen
    rng = np.random.default_rng(3)
    ours, theirs = counts(rng)
    dark = mc.Estimate(np.r_[0.0, ours.value[1:]], np.r_[0.0, ours.standard_error[1:]], 99, quantum=0.01)
    assert mc.compare(dark, theirs).verdict == "disagree"
    assert mc.compare(theirs, dark).verdict == "disagree"


@pytest.mark.parametrize("common", [True, False])
def test_stated_power_is_true(common: bool):
    rng = np.random.default_rng(5)
    first = mc.compare(batches(rng, 100, TRUE), TRUE)
    size = first.noticeable_common if common else float(first.noticeable.mean())
    factor = np.full(30, 1.0 + size) if common else np.where(np.arange(30) == 7, 1.0 + size, 1.0)
    found = rate(lambda rng: (batches(rng, 100, TRUE * factor), TRUE), 400)
    assert found["disagree"] >= 0.95 - 3.5 * math.sqrt(0.95 * 0.05 / 400)
    assert found["disagree"] <= 0.999  # not overcautious either


def test_a_bias_too_small_for_any_bin_is_seen():
    found = [mc.compare(batches(np.random.default_rng(s), 100, TRUE * 1.008), TRUE) for s in range(20)]
    assert sum(c.verdict == "disagree" and c.p_centred < 0.005 for c in found) >= 15
    assert sum(float(np.nanmin(c.p)) < c.bin_level for c in found) <= 10


def test_no_power_is_no_agreement():
    found = mc.compare(batches(np.random.default_rng(1), 20, TRUE, 3.0), TRUE, reliable=math.inf)
    assert found.verdict == "undecided"
    assert not found.agree
    assert found.noticeable_common > found.limit
    assert "undecided" in str(found)
    empty = mc.compare(mc.Estimate(np.zeros(3)), np.zeros(3))
    assert empty.verdict == "undecided"


def test_single_number_and_exact_numbers():
    assert mc.compare(mc.Estimate(1.0, 0.001, 99), 1.001).agree
    assert mc.compare(mc.Estimate(1.0, 0.001, 99), 1.01).verdict == "disagree"
    assert mc.compare(mc.Estimate([1.0, 2.0], [0.001, 0.0], 99), [1.001, 2.0]).agree
    found = mc.compare(mc.Estimate([1.0, 2.0], [0.001, 0.0], 99), [1.001, 2.001])
    assert found.verdict == "disagree"
    assert found.mismatched.tolist() == [1]


def test_scores_are_standard_normal():
    rng = np.random.default_rng(2)
    scores = np.concatenate([mc.compare(batches(rng, 10, TRUE), batches(rng, 10, TRUE)).score for _ in range(200)])
    assert abs(scores.mean()) <= 3.5 / math.sqrt(scores.size)
    assert abs(scores.std() - 1.0) <= 3.5 / math.sqrt(2.0 * scores.size)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: mc.compare(mc.Estimate([1.0]), [1.0, 2.0]), "reference"),
        (lambda: mc.compare(mc.Estimate([math.nan]), [1.0]), "measured"),
        (lambda: mc.compare(mc.Estimate([1.0]), [1.0], level=0.0), "level"),
        (lambda: mc.Estimate([1.0], [-1.0]), "standard_error"),
        (lambda: mc.Estimate([1.0], [math.nan]), "standard_error"),
        (lambda: mc.Estimate.from_samples(np.ones((1, 3))), "samples"),
    ],
)
def test_wrong_input_is_named(call, name: str):
    with pytest.raises(ValueError, match=rf"^{name}.*given.*allowed"):
        call()
