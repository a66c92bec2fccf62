"""One scattering event: the cosine of the angle, the azimuth, and the new direction."""

from __future__ import annotations

import math

import numpy as np

from .streams import compiled


@compiled
def henyey_greenstein(g, number):
    """Cosine of the scattering angle for a uniform `number` in (0, 1).

    Witt, Astrophys. J. Suppl. 35, 1 (1977), eq. 19, with the fraction cleared: nothing is divided by g, so that g = 0 and
    tiny g keep all digits.
    """
    s = 2.0 * number - 1.0
    inverse = 1.0 / (1.0 + g * s)
    return (s + g * (0.5 * (s * s + 3.0) + g * (s + 0.5 * g * (s * s - 1.0)))) * inverse * inverse


@compiled
def tabulated(node, density, cumulative, first, last, number):
    """Cosine of the scattering angle from nodes `first` to `last`, the density linear between them."""
    low, high = first, last
    while high - low > 1:
        middle = (low + high) // 2
        if cumulative[middle] <= number:
            low = middle
        else:
            high = middle
    # solve u t + (v - u) t^2 / (2 w) = rest for t; this form of the root has no cancellation and allows u = v and u = 0
    rest = number - cumulative[low]
    width = node[high] - node[low]
    u, v = density[low], density[high]
    root = math.sqrt(max(0.0, u * u + 2.0 * rest * (v - u) / width))
    if u + root == 0.0:
        return node[low]
    return min(node[high], node[low] + 2.0 * rest / (u + root))


def _quarter_angle() -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Polynomials in y = 2 x^2 - 1 for sin(pi x / 4) / x and cos(pi x / 4), |x| <= 1, by interpolation at Chebyshev nodes."""
    y = np.cos(np.pi * (np.arange(32) + 0.5) / 32)
    x = np.sqrt(0.5 * (y + 1.0))
    sine = np.polynomial.chebyshev.chebfit(y, np.sin(0.25 * np.pi * x) / x, 6)
    cosine = np.polynomial.chebyshev.chebfit(y, np.cos(0.25 * np.pi * x), 7)
    powers = np.polynomial.chebyshev.cheb2poly
    return tuple(powers(sine).tolist()), tuple(powers(cosine).tolist())


(_S0, _S1, _S2, _S3, _S4, _S5, _S6), (_C0, _C1, _C2, _C3, _C4, _C5, _C6, _C7) = _quarter_angle()


@compiled
def azimuth(number):
    """Cosine and sine of pi (2 `number` - 1), to 1e-14: polynomials for a quarter of the angle, doubled twice; no branch, no call."""
    x = 2.0 * number - 1.0
    y = 2.0 * x * x - 1.0
    s = x * (_S0 + y * (_S1 + y * (_S2 + y * (_S3 + y * (_S4 + y * (_S5 + y * _S6))))))
    c = _C0 + y * (_C1 + y * (_C2 + y * (_C3 + y * (_C4 + y * (_C5 + y * (_C6 + y * _C7))))))
    sine, cosine = 2.0 * s * c, c * c - s * s
    return cosine * cosine - sine * sine, 2.0 * sine * cosine


@compiled
def turn(ux, uy, uz, cosine, c, s):
    """Unit vector at the angle acos(`cosine`) from (ux, uy, uz); `c`, `s` are the cosine and sine of the azimuth.

    The basis is that of Duff et al., JCGT 6, 1 (2017), which has no pole. Rounding does not build up in the length: the
    error of one turn is not carried into the next (tested over a million turns).
    """
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    p, q = sine * c, sine * s
    sign = math.copysign(1.0, uz)
    a = -1.0 / (sign + uz)
    b = ux * uy * a
    return (
        p * (1.0 + sign * ux * ux * a) + q * b + cosine * ux,
        p * sign * b + q * (sign + uy * uy * a) + cosine * uy,
        cosine * uz - p * sign * ux - q * uy,
    )
