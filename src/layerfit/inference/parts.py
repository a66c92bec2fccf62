"""Where the uncertainty of a fitted number comes from: noise, model error, priors."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .scatter import NormalScatter, Scatter


class Parts(NamedTuple):
    """Standard deviations of one number due to noise, model error and priors; their squares add up to that of its standard error."""

    noise: float
    model: float
    prior: float


def parts(
    scatter: Sequence[Scatter], weighted: np.ndarray, information: np.ndarray, free: np.ndarray, stderr: Sequence[float | None], scale: float
) -> list[Parts | None]:
    """Parts of each number's standard error, None where it has none.

    scatter : all normal. weighted : Jacobian of the weighted residuals of the data (n, p), physical units. information : inverse covariance of the
    linearised posterior (p, p). free : numbers not at a bound. scale : of the model error.

    With C = N + E the covariance of the data (noise and model), an error d of them moves the numbers by H^-1 J^T C^-1 d, H the information; so the
    noise contributes H^-1 J^T C^-1 N C^-1 J H^-1, the model's error the same with E, and priors what is left of H^-1.
    """
    count = len(stderr)
    noise, model = np.zeros((free.size, free.size)), np.zeros((free.size, free.size))
    size = 1.0 / np.sqrt(np.maximum(np.diag(information)[free], 1e-300))  # in which the information has ones on its diagonal
    position = 0
    for one in scatter:
        rows = weighted[position : position + one.values.size]
        position += one.values.size
        assert isinstance(one, NormalScatter)
        gain = np.linalg.solve(one.total(scale), np.asarray(one.unweighted(rows))[:, free] * size)
        noise += gain.T @ one.noise() @ gain
        if one.error is not None:
            model += scale**2 * gain.T @ one.error @ gain
    inverse = np.linalg.pinv(information[np.ix_(free, free)] * np.outer(size, size), rcond=1e-13, hermitian=True)
    found: list[Parts | None] = [None] * count
    variances = [np.maximum(np.diag(inverse @ part @ inverse), 0.0) for part in (noise, model)]
    for i, (index, whole) in enumerate(zip(free.tolist(), np.diag(inverse), strict=True)):
        sd = stderr[index]
        if sd is None or not whole > 0:
            continue
        shares = [float(v[i] / whole) for v in variances]
        shares.append(max(1.0 - sum(shares), 0.0))
        total = sum(shares)
        found[index] = Parts(*(float(sd * np.sqrt(share / total)) for share in shares))
    return found
