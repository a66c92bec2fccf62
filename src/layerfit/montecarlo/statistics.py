"""Estimates with honest errors, and the test of whether two sets of numbers agree.

The standard error of a mean of B independent batches is itself uncertain; the standardised difference therefore follows Student's
t with B - 1 degrees of freedom (Welch's approximation where both sides have errors), not the normal law.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .checks import wrong

_EXACT = 1e-9  # relative; numbers without any error on either side must agree to this
_LEAST_SPREAD = 0.1


@dataclass(frozen=True, eq=False)
class Estimate:
    """Numbers with standard errors.

    Parameters
    ----------
    value : array, any shape
    standard_error : array, the same shape
        0 where the number is exact.
    dof : float or array
        Degrees of freedom of the standard errors [1]: batches - 1; ``math.inf`` where they are known exactly.
    samples : array, shape (batches, *value.shape), optional
        The batches, from which correlation between the entries is known.
    quantum : array, the same shape as the value, optional
        For sums over events of one sign: what one photon of full weight adds. With it a comparison knows that the error of such a
        number grows with the square root of its true value, and that no event at all does not mean no error.
    """

    value: NDArray[np.float64]
    standard_error: NDArray[np.float64]
    dof: float = math.inf
    samples: NDArray[np.float64] | None = None
    quantum: NDArray[np.float64] | None = None

    def __init__(
        self,
        value: ArrayLike,
        standard_error: ArrayLike = 0.0,
        dof: float = math.inf,
        samples: NDArray[np.float64] | None = None,
        quantum: ArrayLike | None = None,
    ):
        centre = np.array(value, dtype=np.float64)
        error = np.array(np.broadcast_to(np.asarray(standard_error, dtype=np.float64), centre.shape))
        if not np.all(error >= 0.0):
            raise wrong("standard_error", "negative values or nan", "numbers not below 0")
        if not dof > 0.0:
            raise wrong("dof", dof, "above 0")
        if samples is not None and samples.shape[1:] != centre.shape:
            raise wrong("samples", f"shape {samples.shape}", f"(batches, *{centre.shape})")
        unit = None if quantum is None else np.array(np.broadcast_to(np.asarray(quantum, dtype=np.float64), centre.shape))
        fields = {"value": centre, "standard_error": error, "dof": float(dof), "samples": samples, "quantum": unit}
        for name, item in fields.items():
            object.__setattr__(self, name, item)
        centre.setflags(write=False)
        error.setflags(write=False)

    @staticmethod
    def from_samples(samples: NDArray[np.float64], quantum: ArrayLike | None = None) -> Estimate:
        """Mean of independent batches, shape (batches, ...), with its standard error."""
        count = samples.shape[0]
        if count < 2:
            raise wrong("samples", f"{count} batches", "2 or more")
        return Estimate(samples.mean(axis=0), samples.std(axis=0, ddof=1) / math.sqrt(count), count - 1, samples, quantum)

    @staticmethod
    def join(estimates: Sequence[Estimate]) -> Estimate:
        """One flat family from several; they must have the same number of batches (or none)."""
        samples = [e.samples for e in estimates]
        known = [s.reshape(s.shape[0], -1) for s in samples if s is not None]
        together = len(known) == len(estimates) and len({s.shape[0] for s in known}) == 1
        quanta = [e.quantum.ravel() for e in estimates if e.quantum is not None]
        dofs = {e.dof for e in estimates}
        if len(dofs) != 1:
            raise wrong("estimates", f"degrees of freedom {sorted(dofs)}", "one value for all")
        return Estimate(
            np.concatenate([e.value.ravel() for e in estimates]),
            np.concatenate([e.standard_error.ravel() for e in estimates]),
            dofs.pop(),
            np.concatenate(known, axis=1) if together else None,
            np.concatenate(quanta) if len(quanta) == len(estimates) else None,
        )

    @property
    def relative_error(self) -> NDArray[np.float64]:
        """Standard error over the absolute value; inf where the value is 0 and the error is not, 0 where both are."""
        size = np.abs(self.value)
        safe = np.where(size > 0.0, size, 1.0)
        return np.where(size > 0.0, self.standard_error / safe, np.where(self.standard_error > 0.0, math.inf, 0.0))


@dataclass(frozen=True, eq=False)
class Comparison:
    """Outcome of `compare`. Arrays are flat, one entry a bin.

    Attributes
    ----------
    verdict : str
        "disagree"; "agree"; or "undecided" where nothing was rejected but a deviation as large as the limit asked for would not have
        been noticed.
    score : array
        Standardised differences, mapped from Student's t to the normal law of the same probability; nan where not judged.
    p : array
        Two-sided probability of each; nan where not judged.
    judged : array of bool
        Bins that took part: the others have no error on either side, or one too large to be known.
    level, bin_level : float
        Probability of "disagree" if all is well, for the family and for one bin (Sidak).
    p_family : float
        Probability of a most extreme bin like this one, by Sidak: 1 - (1 - p_min)^m.
    mean_score, p_centred : float
        Mean of the scores, and the two-sided probability of such a mean.
    noticeable : array
        Relative deviation of this bin alone that would have been noticed with probability `power`.
    noticeable_common : float
        Relative deviation common to all bins that would have been noticed with probability `power`.
    power, limit : float
        As asked for.
    mismatched : array of int
        Bins without errors on either side that differ: these alone make "disagree".
    """

    verdict: str
    score: NDArray[np.float64]
    p: NDArray[np.float64]
    judged: NDArray[np.bool_]
    level: float
    bin_level: float
    p_family: float
    mean_score: float
    p_centred: float
    noticeable: NDArray[np.float64]
    noticeable_common: float
    power: float
    limit: float
    mismatched: NDArray[np.int64]

    @property
    def agree(self) -> bool:
        """True if nothing was rejected and a deviation as large as the limit would have been noticed."""
        return self.verdict == "agree"

    def __str__(self) -> str:
        count = int(self.judged.sum())
        text = f"{self.verdict}: {count} of {self.judged.size} bins judged"
        if count:
            worst = int(np.nanargmax(np.abs(self.score)))
            text += (
                f"; largest score {self.score[worst]:+.2f} in bin {worst}, family p {self.p_family:.3g}; mean score"
                f" {self.mean_score:+.3f}, p {self.p_centred:.3g}; level {self.level:g}. A common deviation of"
                f" {100 * self.noticeable_common:.2g} % would have been noticed with {100 * self.power:.0f} % probability, in a"
                f" single bin {100 * float(np.nanmedian(self.noticeable)):.2g} % (median)"
            )
        if self.mismatched.size:
            text += f"; bins without errors differ: {self.mismatched.tolist()}"
        return text


def compare(
    measured: Estimate,
    reference: Estimate | ArrayLike,
    *,
    level: float = 0.01,
    limit: float = 0.05,
    power: float = 0.95,
    reliable: float = 0.2,
) -> Comparison:
    """Do two sets of numbers agree within their errors, and would a deviation have been noticed?

    Half of `level` goes to the largest single difference (Sidak: each of m bins is tested at 1 - (1 - level/2)^(1/m)), half to the
    mean of the scores, which finds a common bias too small for any single bin. Correlation between bins is taken into account in the
    mean where the batches of `measured` are known; otherwise independence is assumed. With one bin, that bin has the whole level.

    Parameters
    ----------
    measured : Estimate
        Usually of a simulation.
    reference : Estimate or array
        The same shape; plain numbers are exact.
    level : float
        Family-wise probability [1] of a false "disagree".
    limit : float
        Relative deviation [1] common to all bins that must be noticeable, or the verdict is "undecided" instead of "agree".
    power : float
        Probability [1] with which it must be noticed.
    reliable : float
        Bins whose standard error exceeds this fraction of the larger value are not judged: errors from so few events are not to be
        trusted. Use ``math.inf`` for numbers that change sign.

    Returns
    -------
    Comparison

    Raises
    ------
    ValueError
        If shapes differ, or a setting is out of range.

    References
    ----------
    Sidak, J. Am. Stat. Assoc. 62, 626 (1967). Welch, Biometrika 34, 28 (1947); degrees of freedom by Satterthwaite, Biometrics Bull.
    2, 110 (1946).
    """
    from scipy import special

    other = reference if isinstance(reference, Estimate) else Estimate(reference)
    if measured.value.shape != other.value.shape:
        raise wrong("reference", f"shape {other.value.shape}", f"{measured.value.shape} as measured")
    for name, number in (("level", level), ("power", power)):
        if not 0.0 < number < 1.0:
            raise wrong(name, number, f"0 < {name} < 1")
    a, b = measured.value.ravel(), other.value.ravel()
    if not (np.all(np.isfinite(a)) and np.all(np.isfinite(b))):
        raise wrong("measured, reference", "values that are not finite", "finite numbers")
    variance_a, variance_b = _variance(measured, b), _variance(other, a)
    variance = variance_a + variance_b
    error = np.sqrt(variance)
    size = np.maximum(np.abs(a), np.abs(b))
    exact = error == 0.0
    mismatched = np.flatnonzero(exact & ~(np.abs(a - b) <= _EXACT * size))
    judged = ~exact & ((error <= min(reliable, 1e300) * size) | math.isinf(reliable))
    count = int(judged.sum())

    score, p, noticeable = (np.full(a.size, math.nan) for _ in range(3))
    bin_level = 0.5 * level if count > 1 else level
    bin_level = -math.expm1(math.log1p(-bin_level) / max(count, 1))
    if count == 0:
        verdict = "disagree" if mismatched.size else "undecided"
        return Comparison(verdict, score, p, judged, level, bin_level, 1.0, 0.0, 1.0, noticeable, math.inf, power, limit, mismatched)

    va, vb = variance_a[judged], variance_b[judged]
    dof = (va + vb) ** 2 / np.maximum(va**2 / measured.dof + vb**2 / other.dof, 1e-300)
    student = (a - b)[judged] / error[judged]
    tail = special.stdtr(dof, -np.abs(student))
    p[judged] = 2.0 * tail
    score[judged] = -np.sign(student) * special.ndtri(np.maximum(tail, 1e-300))
    p_family = float(-np.expm1(count * np.log1p(-min(float(np.nanmin(p)), 1.0 - 1e-16))))

    spread, spread_dof = _spread(measured, vb, judged, error)
    mean_score = float(np.nanmean(score))
    p_centred = 2.0 * float(special.stdtr(spread_dof, -abs(mean_score) * math.sqrt(count / spread)))
    rejected = bool(np.nanmin(p) < bin_level) or (count > 1 and p_centred < 0.5 * level)

    critical = -special.stdtrit(dof, 0.5 * bin_level)
    scale = np.where(b[judged] != 0.0, np.abs(b[judged]), math.nan)
    noticeable[judged] = (critical - special.stdtrit(dof, 1.0 - power)) * error[judged] / scale
    # with its sign: a common factor moves positive and negative numbers apart, and the mean of the scores does not see that
    shift = b[judged] / error[judged]
    centred = abs(float(shift.sum())) / math.sqrt(count * spread) if count > 1 else 0.0
    centred_critical = -float(special.stdtrit(spread_dof, 0.25 * level))
    common = _smallest_noticed(np.abs(shift), critical, centred, centred_critical, power)
    verdict = "disagree" if rejected or mismatched.size else "agree" if common <= limit else "undecided"
    return Comparison(
        verdict,
        score,
        p,
        judged,
        level,
        bin_level,
        p_family,
        mean_score,
        p_centred,
        noticeable,
        common,
        power,
        limit,
        mismatched,
    )


def _variance(estimate: Estimate, value: NDArray[np.float64]) -> NDArray[np.float64]:
    """Variance of an estimate if the other side's `value` were the true one, where that is larger.

    A count below its mean comes with an error that is too small, a count of none with no error at all: judged by its own error it
    would look far off too often.
    """
    own, variance = np.abs(estimate.value.ravel()), estimate.standard_error.ravel() ** 2
    if estimate.quantum is None:
        return variance
    other = np.abs(value)
    safe = np.where(own > 0.0, own, 1.0)
    return np.where(own > 0.0, variance * np.maximum(1.0, other / safe), estimate.quantum.ravel() * other)


def _spread(measured: Estimate, other: NDArray[np.float64], judged: NDArray[np.bool_], error: NDArray[np.float64]) -> tuple[float, float]:
    """Variance of the sum of the scores over their number, and its degrees of freedom.

    1 for independent bins, up to their number for one common error; estimated from the batches, so that the mean score over its own
    error is Student's t again.
    """
    if measured.samples is None:
        return 1.0, math.inf
    batches = measured.samples.shape[0]
    weight = 1.0 / error[judged]
    sums = measured.samples.reshape(batches, -1)[:, judged] @ weight
    ours, theirs = float(sums.var(ddof=1)) / batches, float(np.sum(other * weight**2))
    total = ours + theirs
    return max(total / weight.size, _LEAST_SPREAD), (batches - 1) * (total / max(ours, 1e-300 + 1e-9 * total)) ** 2


def _smallest_noticed(shift: NDArray[np.float64], critical: NDArray[np.float64], centred: float, centred_critical: float, power: float) -> float:
    """Smallest common relative deviation noticed with probability `power`, by the bins or by their mean, whichever is better."""
    from scipy import optimize, special

    def missing(logarithm: float) -> float:
        deviation = math.exp(logarithm)
        quiet = special.ndtr(critical - deviation * shift) - special.ndtr(-critical - deviation * shift)
        bins = -math.expm1(float(np.sum(np.log(np.maximum(quiet, 1e-300)))))
        return max(bins, float(special.ndtr(deviation * centred - centred_critical))) - power

    low, high = math.log(1e-12), math.log(1e6)
    if missing(high) < 0.0:
        return math.inf
    if missing(low) > 0.0:
        return math.exp(low)
    return math.exp(float(optimize.brentq(missing, low, high)))  # pyright: ignore[reportArgumentType]
