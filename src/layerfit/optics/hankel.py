"""From spatial frequency to distance: quadrature whose nodes do not depend on the distances.

A measurement at distance r is a linear functional of F(k), the response in spatial frequency,

    value = int_0^inf F(k) kernel(k) dk,        kernel(k) = k J0(k r)/(2 pi) for a point at r,

with other kernels for rings, spots and fibres. F is smooth on panels that double in width (its singularities lie on the imaginary k axis),
so it is interpolated there by polynomials on Gauss nodes, and the kernel, which oscillates, is integrated against those polynomials
exactly: value = weights @ F(nodes). The weights are computed once, in NumPy, before anything is traced; after that a prediction is one
matrix product, which jit, vmap, jvp and vjp all pass through. The number of nodes grows with the logarithm of the range of k only.

Where kernel oscillates many times within a panel the integral is turned into the upper half plane, where it decays (J0 -> Re H0): no
cost grows with k r either. A last panel [k_max, inf) in 1/k carries the algebraic tail that distributed sources leave.
"""

from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy import special

from .gauss import legendre

Wave = Literal["J0", "J1", "cos", "sin"]
_BENT = 400.0  # phase over a panel above which the path is turned into the complex plane
_DEEP = 42.0  # e^-42: where a decaying path ends


@dataclass(frozen=True)
class Term:
    """coefficient k^power wave(k radius), one value an element of the measurement."""

    coefficient: np.ndarray  # (elements,)
    radius: np.ndarray  # (elements,) [mm]
    wave: Wave
    power: int


@dataclass(frozen=True)
class Kernel:
    """Sum of terms, times 2 J1(k a)/(k a) for each disk radius a and exp(-k^2 w^2/8) for a Gaussian of 1/e^2 radius w.

    at_zero : multiple of F(0) to add (an edge sees half the plane evenly lit).
    """

    terms: tuple[Term, ...]
    disks: tuple[float, ...] = ()
    gaussian: float = 0.0
    at_zero: float = 0.0

    @property
    def elements(self) -> int:
        return len(self.terms[0].radius)

    @property
    def key(self) -> tuple:
        """Equal for kernels with equal numbers."""
        return (tuple((t.coefficient.tobytes(), t.radius.tobytes(), t.wave, t.power) for t in self.terms), self.disks, self.gaussian, self.at_zero)


@dataclass(frozen=True)
class Quadrature:
    """values = weights @ F(k)."""

    k: np.ndarray  # (nodes,) [rad/mm]
    weights: np.ndarray  # (elements, nodes)


@dataclass(frozen=True)
class Span:
    """The range of spatial frequencies that a family of functions F needs.

    k_low : scale below which F is flat [rad/mm] (the smallest effective attenuation coefficient; 0 if none is absorbing).
    k_high : where F has died out, or has become a smooth function of 1/k (with tail).
    tail : whether F decays only algebraically beyond k_high.
    """

    k_low: float
    k_high: float
    tail: bool


def quadrature(kernel: Kernel, span: Span, *, order: int = 20, r_max: float | None = None) -> Quadrature:
    """Nodes and weights for all functions within a span.

    order : Gauss nodes a panel; 20 reaches 1e-15 of the largest value, 12 about 1e-9.
    r_max : largest distance the panels are laid out for [mm] (default: that of the kernel). Kernels with one r_max share their nodes.

    The last 32 results are kept: fits of many data of one geometry ask for the same one again and again.
    """
    key = (kernel.key, span, order, r_max)
    if key not in _KEPT:
        while len(_KEPT) >= 32:
            _KEPT.pop(next(iter(_KEPT)), None)
        _KEPT[key] = _quadrature(kernel, span, order, r_max)
    return _KEPT[key]


_KEPT: dict[tuple, Quadrature] = {}


def _quadrature(kernel: Kernel, span: Span, order: int, r_max: float | None) -> Quadrature:
    if r_max is None:
        r_max = max(float(np.max(np.abs(t.radius))) for t in kernel.terms)
    r_max += sum(kernel.disks) + kernel.gaussian
    k_high, tail = span.k_high, span.tail
    if kernel.gaussian > 0 and k_high * kernel.gaussian > 17.0:  # exp(-17^2/8) = 2e-16
        k_high, tail = 17.0 / kernel.gaussian, False
    first = max(0.5 * span.k_low, 1e-4 / r_max if r_max > 0 else 0.0)
    if first == 0.0:
        first = 1e-4 * k_high
    first = min(first, k_high)
    panels = max(0, int(np.ceil(np.log2(k_high / first))))
    edges = np.concatenate([[0.0], first * (k_high / first) ** (np.arange(panels + 1) / max(panels, 1))])
    x, _ = _gauss(order)
    nodes, weights = [], []
    for a, b in pairwise(edges):
        nodes.append(0.5 * (a + b) + 0.5 * (b - a) * x)
        weights.append(_panel(kernel, a, b, order))
    if kernel.at_zero:
        weights[0] = weights[0] + kernel.at_zero * _lagrange(np.array([-1.0]), order)[:, 0]
    if tail:
        u, _ = _gauss(12)
        nodes.append(2.0 * k_high / (1.0 + u))
        weights.append(_tail(kernel, k_high, 12))
    rule = Quadrature(np.concatenate(nodes), np.concatenate(weights, axis=1))
    rule.k.flags.writeable = rule.weights.flags.writeable = False
    return rule


@cache
def _gauss(n: int) -> tuple[np.ndarray, np.ndarray]:
    return np.polynomial.legendre.leggauss(n)


def _lagrange(x: np.ndarray, order: int) -> np.ndarray:
    """Lagrange polynomials on the Gauss nodes, at real or complex x: (order, points).

    Written as a sum over Legendre polynomials, which stays accurate off the interval.
    """
    nodes, weights = _gauss(order)
    legendre_at_nodes = np.polynomial.legendre.legvander(nodes, order - 1)  # (nodes, degree)
    coefficients = weights[:, None] * legendre_at_nodes * (np.arange(order) + 0.5)
    return coefficients @ np.stack(legendre(x, order))


def _panel(kernel: Kernel, a: float, b: float, order: int) -> np.ndarray:
    """int_a^b (Lagrange polynomials) kernel dk: (elements, order)."""
    total = np.zeros((kernel.elements, order))
    for term in kernel.terms:
        phase = (b - a) * (np.abs(term.radius) + sum(kernel.disks))
        bent = (phase > _BENT) & ((b - a) * _decay(kernel, term) > _BENT) & (a > 0.0)
        if np.any(~bent):
            total[~bent] += _straight(kernel, term, ~bent, a, b, order)
        if np.any(bent):
            total[bent] += _ends(kernel, term, bent, a, b, order)
    return total


def _straight(kernel: Kernel, term: Term, chosen: np.ndarray, a: float, b: float, order: int) -> np.ndarray:
    phase = (b - a) * (float(np.max(np.abs(term.radius[chosen]))) + sum(kernel.disks))
    pieces = int(np.ceil(phase / 800.0)) or 1
    count = 16 * int(np.ceil((0.3 * phase / pieces + 0.5 * order + 24) / 16))
    x, w = _gauss(count)
    result = np.zeros((int(np.sum(chosen)), order))
    for piece in range(pieces):
        left, right = -1.0 + 2.0 * piece / pieces, -1.0 + 2.0 * (piece + 1) / pieces
        t = 0.5 * (left + right) + 0.5 * (right - left) * x
        k = 0.5 * (a + b) + 0.5 * (b - a) * t
        value = _wave(term.wave, np.outer(term.radius[chosen], k)) * term.coefficient[chosen, None]
        envelope = k**term.power * _windows(kernel, k) * w * 0.25 * (b - a) * (right - left)
        result += (value * envelope) @ _lagrange(t, order).T
    return result


def _ends(kernel: Kernel, term: Term, chosen: np.ndarray, a: float, b: float, order: int) -> np.ndarray:
    """The same from the two ends of the panel, up into the complex plane."""
    tau, w = np.polynomial.laguerre.laggauss(40)
    keep = tau < _DEEP
    tau, w = tau[keep], (w * np.exp(tau))[keep]
    result = np.zeros((int(np.sum(chosen)), order))
    decay = _decay(kernel, term)[chosen]
    for row, element in enumerate(np.flatnonzero(chosen).tolist()):
        for end, sign in ((a, 1.0), (b, -1.0)):
            t = tau / decay[row]
            k = end + 1j * t
            f = _rising(kernel, term, element, k) * (1j * w / decay[row])
            result[row] += sign * np.real(_lagrange((2.0 * k - a - b) / (b - a), order) @ f)
    return result


def _tail(kernel: Kernel, k_high: float, order: int) -> np.ndarray:
    """int_k_high^inf F kernel dk for F = u (polynomial in u), u = k_high/k, given at the Gauss nodes of u."""
    u_nodes = 0.5 * (1.0 + _gauss(order)[0])
    x, w = _gauss(24)
    total = np.zeros((kernel.elements, order))
    for term in kernel.terms:
        decay = _decay(kernel, term)
        for element in np.flatnonzero(term.coefficient).tolist():  # the inner edge of a ring from 0 on has none
            reach = _DEEP / max(decay[element], 1e-12 * k_high)
            edges = [0.0, min(0.5 * k_high, 0.25 * reach)]
            while edges[-1] < reach:
                edges.append(2.0 * edges[-1])
            e = np.array(edges)
            half = 0.5 * np.diff(e)[:, None]
            t = (0.5 * (e[1:] + e[:-1])[:, None] + half * x).ravel()
            k = k_high + 1j * t
            u = k_high / k
            f = _rising(kernel, term, element, k) * 1j * (half * w).ravel()
            total[element] += np.real((_lagrange(2.0 * u - 1.0, order) * u) @ f) / u_nodes
    return total


def _windows(kernel: Kernel, k: np.ndarray) -> np.ndarray:
    value = np.exp(-((k * kernel.gaussian) ** 2) / 8.0)
    for a in kernel.disks:
        value = value * _disk(k * a)
    return value


def _disk(x: np.ndarray) -> np.ndarray:
    safe = np.where(np.abs(x) < 1e-8, 1.0, x)
    return np.where(np.abs(x) < 1e-8, 1.0, 2.0 * special.jv(1, safe) / safe)


def _wave(wave: Wave, x: np.ndarray) -> np.ndarray:
    return {"J0": special.j0, "J1": special.j1, "cos": np.cos, "sin": np.sin}[wave](x)


def _radii(kernel: Kernel, term: Term) -> np.ndarray:
    """Radii of all oscillating factors, the term's own first: (elements, factors)."""
    own = np.abs(term.radius)[:, None]
    return np.concatenate([own, np.broadcast_to(np.array(kernel.disks), (len(own), len(kernel.disks)))], axis=1)


def _decay(kernel: Kernel, term: Term) -> np.ndarray:
    """Rate [mm] at which a term dies out upwards: the largest radius goes down, all others go up."""
    radii = _radii(kernel, term)
    return 2.0 * radii.max(axis=1) - radii.sum(axis=1)


def _rising(kernel: Kernel, term: Term, element: int, k: np.ndarray) -> np.ndarray:
    """A function whose real part on the real axis is the term, and which decays above it.

    The oscillating factor of the largest radius becomes its Hankel function; exponentials are taken out of all factors and joined.
    """
    radii = _radii(kernel, term)[element]
    leader = int(np.argmax(radii))
    sign = np.sign(term.radius[element]) if term.wave == "sin" else 1.0
    value = sign * term.coefficient[element] * k**term.power * np.exp(-((k * kernel.gaussian) ** 2) / 8.0)
    growth = np.zeros_like(k)
    for j, radius in enumerate(radii):
        z = k * radius
        wave = term.wave if j == 0 else "J1"
        if j == leader:
            factor = {"J0": lambda z: special.hankel1e(0, z), "J1": lambda z: special.hankel1e(1, z)}.get(
                wave, np.ones_like if wave == "cos" else (lambda z: -1j * np.ones_like(z))
            )(z)
            growth = growth + 1j * z
        elif wave in ("J0", "J1"):
            factor = special.jve(int(wave[1]), z)
            growth = growth + np.abs(z.imag)
        else:  # e^(iz) or e^(-iz) part below a larger disk: both at most e^|Im z|
            factor = (np.cos(z) if wave == "cos" else np.sin(z)) * np.exp(-np.abs(z.imag))
            growth = growth + np.abs(z.imag)
        value = value * factor * (2.0 / z if j > 0 else 1.0)
    return value * np.exp(growth)
