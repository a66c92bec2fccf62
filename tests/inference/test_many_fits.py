"""Fits by the hundred against fits alone, and their scatter against what theory allows."""

import numpy as np
import pytest

import layerfit as lf
from layerfit.inference.many import _most_alike, _stand_out

R = np.linspace(0.5, 15.0, 24)
GEOMETRY = lf.RadialReflectance(r=R)
SOLVER = lf.LayeredDiffusion()
STACK = lf.Layer("top", sigma_a=0.01, sigma_s_prime=1.0, n=1.4, thickness=2.0) | lf.HalfSpace("deep", sigma_a=0.03, sigma_s_prime=1.5, n=1.4)
FREE = {"top.sigma_s_prime": (0.1, 20.0), "deep.sigma_a": (1e-3, 1.0), "deep.sigma_s_prime": (0.1, 20.0)}
TRUTH = np.array([1.0, 0.03, 1.5])


def values_of(x):
    stack = STACK.set(dict(zip(FREE, x, strict=True)))
    return lf.predict(stack, GEOMETRY, solver=SOLVER)[0].values


def problem(values, sd):
    return lf.Problem(STACK, lf.Dataset(GEOMETRY, values, sd, name="probe"), free=FREE, solver=SOLVER)


@pytest.fixture(scope="module")
def sets():
    """Values of 12 samples with 1 % noise and their sd, and the fits of all, batched."""
    rng = np.random.default_rng(2)
    clean = np.array([values_of(TRUTH * np.exp(rng.uniform(-0.4, 0.4, 3))) for _ in range(12)])
    values = clean * (1.0 + 0.01 * rng.standard_normal(clean.shape))
    return values, 0.01 * clean, lf.fit_many(problem(values[0], 0.01 * clean[0]), values, 0.01 * clean)


def test_same_as_alone(sets):
    """Numbers, chi-square, predictions, standard errors and covariances of a fit alone; no set is worse."""
    values, sd, many = sets
    for row in (0, 5, 11):
        alone = lf.fit(problem(values[row], sd[row]), starts=3)
        assert many.chi2[row] - alone.chi2 <= 1e-5
        assert np.max(np.abs(many.x[row] - alone.x) / np.sqrt(np.diag(alone.covariance))) <= 0.01
        assert np.max(np.abs(many.predictions[row] / np.concatenate(alone.predictions) - 1)) <= 1e-4
        assert np.max(np.abs(many.covariance[row] - alone.covariance) / np.sqrt(np.outer(*[np.diag(alone.covariance)] * 2))) <= 0.01
        assert many.outcome[row] is lf.Outcome.CONVERGED
    assert np.all(many.determined)
    assert np.all(many.met == 4)
    assert np.all(many.runs == 4)
    assert many.dof == 21


def test_neighbours_are_the_nearest_in_relative_terms():
    values = np.array([[1.0, 2.0], [1.3, 2.6], [1.1, 2.2], [9.0, 1.0], [1.0, 2.01]])
    found = _most_alike(values, 0.01 * values, [0, 2])
    assert found[:, 0].tolist() == [4, 2, 4, 1, 0]
    assert found[0, 1] == 1


def test_what_stands_out_is_tried_again(sets):
    """A set whose first run ends in a poor minimum is seen among the others, and gets more runs."""
    chi2 = np.array([20.0, 21, 22, 19, 18, 23, 25, 20, 60])
    assert _stand_out(chi2).tolist() == [False] * 8 + [True]
    assert not np.any(_stand_out(chi2[-3:]))
    values, sd, _ = sets
    odd = np.concatenate([values, values[:1] * (1.0 + 0.2 * (-1.0) ** np.arange(values.shape[1]))])
    many = lf.fit_many(problem(values[0], sd[0]), odd, np.concatenate([sd, sd[:1]]), starts=2)
    assert many.runs.tolist() == [2] * 12 + [10]


def test_tables(sets):
    many = sets[2]
    table = many.to_pandas()
    assert len(table) == 12
    assert np.array_equal(table["deep.sigma_a"].to_numpy(), many.x[:, 1])
    assert np.array_equal(table["deep.sigma_a.stderr"].to_numpy(), many.stderr[:, 1])
    found = many.to_xarray()
    assert found["deep.sigma_a"].attrs["units"] == "1/mm"
    assert np.array_equal(found["covariance"].sel(number="deep.sigma_a", other="deep.sigma_s_prime"), many.covariance[:, 1, 2])
    assert "12 sets fitted" in many.summary()
    assert "deep.sigma_s_prime" in many.summary()


def test_scatter_of_500_fits_is_the_cramer_rao_bound():
    """Low noise, 0.1 %: the sd of 500 fits is the bound that was stated before any data, within 10 %; so is the standard error of each."""
    clean = values_of(TRUTH)
    rng = np.random.default_rng(4)
    values = clean * (1.0 + 0.001 * rng.standard_normal((500, clean.size)))
    many = lf.fit_many(problem(clean, 0.001 * clean), values, 0.001 * clean, starts=1)
    planned = lf.Planned(GEOMETRY, lf.Noise(relative=0.001), name="probe")
    bound = lf.identify(STACK.set(dict(zip(FREE, TRUTH, strict=True))), planned, free=FREE, solver=SOLVER, candidates=[]).absolute
    assert bound.names == tuple(FREE)
    spread = np.std(many.x, axis=0, ddof=1) / bound.sd
    print("sd of 500 fits over the bound:", spread.round(3))
    assert np.max(np.abs(spread - 1)) <= 0.1
    assert np.max(np.abs(np.median(many.stderr, axis=0) / bound.sd - 1)) <= 0.02
    assert np.max(np.abs(np.corrcoef(many.x.T) - bound.correlation)) <= 0.1
    assert abs(np.mean(many.chi2) - many.dof) <= 3 * np.sqrt(2 * many.dof / 500)


def test_estimates_the_noise_of_each_set():
    clean = values_of(TRUTH)
    rng = np.random.default_rng(5)
    size = np.array([0.01, 0.04])
    values = clean * (1.0 + size[:, None] * rng.standard_normal((2, clean.size)))
    many = lf.fit_many(lf.Problem(STACK, lf.Dataset(GEOMETRY, clean), free=FREE, solver=SOLVER), values)
    assert many.noise is not None
    assert np.max(np.abs(many.noise / size - 1)) <= 0.4
    assert np.max(np.abs(many.chi2 / many.dof - 1)) <= 1e-6


WRONG = {
    "one value too few": (np.ones((3, 23)), None, "shape (3, 23); allowed is (sets, 24)"),
    "NaN": (np.where(np.arange(48).reshape(2, 24) == 30, np.nan, 1.0), None, "value 7 of set 2 is nan"),
    "sd of 0": (np.ones((2, 24)), np.zeros(24), "not a finite number above 0"),
    "sd of another shape": (np.ones((2, 24)), np.ones((3, 24)), "sd of shape (3, 24)"),
    "texts": ([["a"] * 24], None, "not a number"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_input(case):
    values, sd, said = WRONG[case]
    clean = values_of(TRUTH)
    with pytest.raises(lf.InputError) as raised:
        lf.fit_many(problem(clean, 0.01 * clean), values, sd)
    assert said in str(raised.value)


def test_errors_that_are_not_independent_and_normal():
    data = lf.Dataset(GEOMETRY, values_of(TRUTH), noise=lf.Noise(relative=0.01), name="probe")
    for likelihood, said in ((lf.StudentT(), "takes least squares alone"), (lf.CorrelatedNoise(0.01, 2.0), "of measurement 'probe' are correlated")):
        with pytest.raises(lf.InputError, match=said):
            lf.fit_many(lf.Problem(STACK, data, free=FREE, likelihood=likelihood, solver=SOLVER), data.values[None])


def test_a_prior_pulls_as_in_a_fit_alone(sets):
    """A tight prior on one number, among the residuals of every set; chi-square is that of the data."""
    values, sd, _ = sets
    free = {**FREE, "deep.sigma_s_prime": {"min": 0.1, "max": 20.0, "init": 1.5, "prior": lf.Normal(1.7, 0.05)}}
    stated = [lf.Problem(STACK, lf.Dataset(GEOMETRY, values[row], sd[row], name="probe"), free=free, solver=SOLVER) for row in (0, 5)]
    many = lf.fit_many(stated[0], values[[0, 5]], sd[[0, 5]])
    for row, one in enumerate(stated):
        alone = lf.fit(one, starts=1)
        assert np.max(np.abs(many.x[row] - alone.x) / np.sqrt(np.diag(alone.covariance))) <= 0.01
        assert abs(many.chi2[row] - alone.chi2) <= 1e-3
        assert many.chi2[row] >= sets[2].chi2[[0, 5]][row] + 0.01
        assert np.max(np.abs(many.predictions[row] / np.concatenate(alone.predictions) - 1)) <= 1e-4
