"""Comparing models: against closed forms, refits with values left out, and how often the truth wins."""

import numpy as np
import pytest

import layerfit as lf

SOLVER = lf.LayeredDiffusion()
R = np.geomspace(1.0, 12.0, 12)
GEOMETRY = lf.RadialReflectance(r=R)
SKIN = lf.Stack([lf.HalfSpace("skin", sigma_a=0.02, sigma_s_prime=1.2, n=1.4)])
BOTH = {"skin.sigma_a": (1e-3, 1.0), "skin.sigma_s_prime": (0.1, 10.0)}
CLEAN = lf.predict(SKIN, GEOMETRY, solver=SOLVER)[0].values
SD = 0.02 * CLEAN


def fitted(values, names=tuple(BOTH), sd=SD, r=R, stack=SKIN):
    data = lf.Dataset(lf.RadialReflectance(r=r), values, sd)
    return lf.fit(lf.Problem(stack, data, free={name: BOTH[name] for name in names}, solver=SOLVER), starts=1)


@pytest.fixture(scope="module")
def values():
    return CLEAN * (1 + 0.02 * np.random.default_rng(6).standard_normal(R.size))


@pytest.fixture(scope="module")
def compared(values):
    wrong = SKIN.set({"skin.sigma_a": 0.03})
    fits = {"absorption held": fitted(values, ("skin.sigma_s_prime",), stack=wrong), "both free": fitted(values)}
    return lf.compare_models(fits)


def test_criteria(compared, values):
    """AIC, AICc, BIC and weights from the density of the data written out."""
    scores = {}
    for c in compared.candidates:
        predicted = c.fit.predictions[0]
        likelihood = np.sum(-0.5 * ((values - predicted) / SD) ** 2 - np.log(SD * np.sqrt(2 * np.pi)))
        k, n = c.fit.x.size, R.size
        scores[c.name] = -2 * likelihood + 2 * k + 2 * k * (k + 1) / (n - k - 1)
        assert abs(c.log_likelihood - likelihood) <= 1e-8 * abs(likelihood)
        assert abs(c.aic - (-2 * likelihood + 2 * k)) <= 1e-6
        assert abs(c.aicc - scores[c.name]) <= 1e-6
        assert abs(c.bic - (-2 * likelihood + k * np.log(n))) <= 1e-6
    ratio = np.exp(-0.5 * (scores["absorption held"] - scores["both free"]))
    assert abs(compared.candidates[1].weight - ratio / (1 + ratio)) <= 1e-9
    assert compared.best.name == "both free"


def test_score_is_that_of_fits_with_a_value_left_out(compared, values):
    """Linearised leave-one-out against 12 fits of 11 values: residual of the value left out, its variance that of noise and fit."""
    rows = []
    for i in range(R.size):
        keep = np.arange(R.size) != i
        fit = fitted(values[keep], sd=SD[keep], r=R[keep])
        predicted = lf.predict(fit.stack, GEOMETRY, solver=SOLVER)[0].values[i]
        h = 1e-4
        slope = [
            (lf.predict(fit.stack.set({n: x * (1 + h)}), GEOMETRY, solver=SOLVER)[0].values[i] - predicted) / (x * h)
            for n, x in zip(BOTH, fit.x, strict=True)
        ]
        variance = SD[i] ** 2 + slope @ fit.covariance @ slope
        rows.append(-0.5 * np.log(2 * np.pi * variance) - 0.5 * (values[i] - predicted) ** 2 / variance)
    best = compared.best
    assert np.max(np.abs(best.pointwise - rows)) <= 0.1
    assert abs(best.elpd - np.sum(rows)) <= 0.2
    assert abs(best.elpd_se - np.sqrt(R.size * np.var(rows))) <= 0.1


def test_sentence(compared):
    assert compared.sentence.startswith("'both free' describes the data better than 'absorption held': AICc lower by")
    assert "evidence is decisive" in compared.sentence
    assert "BIC agrees" in compared.sentence
    assert "both free" in compared.summary()
    assert [row["name"] for row in compared.table()] == ["both free", "absorption held"]
    assert abs(sum(row["weight"] for row in compared.table()) - 1) <= 1e-12


def test_weak_evidence_is_said(values):
    """A number held at its true value: nothing is gained by setting it free."""
    result = lf.compare_models({"held": fitted(values, ("skin.sigma_s_prime",)), "free": fitted(values)})
    assert "hardly tell" in result.sentence or result.best.name == "held"


def test_estimated_noise_counts_as_a_number(values):
    fits = {name: fitted(values, names, sd=None) for name, names in {"one": ("skin.sigma_s_prime",), "two": tuple(BOTH)}.items()}
    result = lf.compare_models(fits)
    assert {c.name: c.numbers for c in result.candidates} == {"one": 2, "two": 3}
    c = result.candidates[0]
    ratio = (values - c.fit.predictions[0]) / values
    variance = np.mean(ratio**2)
    assert abs(c.log_likelihood - np.sum(-0.5 * ratio**2 / variance - 0.5 * np.log(2 * np.pi * variance) - np.log(values))) <= 1e-6


def test_scores_from_posteriors_take_their_place(compared, values):
    fits = {c.name: c.fit for c in compared.candidates}
    given = {"both free": np.full(R.size, 1.0), "absorption held": np.full(R.size, 0.5)}
    result = lf.compare_models(fits, pointwise=given)
    assert {c.name: c.elpd for c in result.candidates} == {"both free": 12.0, "absorption held": 6.0}
    with pytest.raises(lf.InputError, match="for some fits only"):
        lf.compare_models(fits, pointwise={"both free": np.ones(R.size)})
    with pytest.raises(lf.InputError, match="with 3 numbers"):
        lf.compare_models(fits, pointwise={"both free": np.ones(3), "absorption held": np.ones(R.size)})


def test_refuses_what_cannot_be_compared(compared, values):
    fit = compared.best.fit
    with pytest.raises(lf.InputError, match="1 fit was given"):
        lf.compare_models({"one": fit})
    with pytest.raises(lf.InputError, match="a float; allowed are results"):
        lf.compare_models({"one": fit, "two": 3.0})
    for other, said in (
        (fitted(1.001 * values), "values of"),
        (fitted(values, sd=2 * SD), "sd of"),
        (fitted(values, r=1.1 * R), "measured differently"),
    ):
        with pytest.raises(lf.InputError, match=said):
            lf.compare_models({"one": fit, "two": other})


def test_outliers_need_scores_from_posteriors(values):
    data = lf.Dataset(lf.RadialReflectance(r=R), values, SD)
    fits = {
        name: lf.fit(lf.Problem(SKIN, data, free={k: BOTH[k] for k in free}, likelihood=lf.StudentT(), solver=lf.LayeredDiffusion()), starts=1)
        for name, free in (("one", list(BOTH)[:1]), ("both", list(BOTH)))
    }
    with pytest.raises(lf.InputError, match=r"'one': values left out one by one .* give pointwise"):
        lf.compare_models(fits)
    found = lf.compare_models(fits, pointwise=dict.fromkeys(fits, np.zeros(R.size)))
    expected = fits["both"].problem.model.scatter[0].log_density(fits["both"].predictions[0])
    assert abs(next(c for c in found.candidates if c.name == "both").log_likelihood - float(expected)) <= 1e-9
