"""Gauss's rule on (0, 1), and Legendre polynomials."""

from functools import cache

import numpy as np

from ..arrays import AnyArray


@cache
def unit_gauss(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights on (0, 1).

    >>> unit_gauss(1)
    (array([0.5]), array([1.]))
    """
    x, w = np.polynomial.legendre.leggauss(n)
    x, w = 0.5 * (x + 1.0), 0.5 * w
    x.flags.writeable = w.flags.writeable = False
    return x, w


def legendre(x: AnyArray, count: int) -> list[AnyArray]:
    """The first Legendre polynomials at x, real or complex, by their recurrence.

    >>> legendre(np.array([0.5]), 3)[2]
    array([-0.125])
    """
    values = [0.0 * x + 1.0, x]
    for l in range(1, count - 1):
        values.append(((2 * l + 1) * x * values[l] - l * values[l - 1]) / (l + 1))
    return values[:count]
