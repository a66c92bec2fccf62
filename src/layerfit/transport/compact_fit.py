"""Making a compact form: matrices over a grid of free numbers, fitted, and what the fit is worth."""

import itertools
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..measurement.geometry import TotalReflectance
from ..optics.splines import basis
from ..scene.columns import Columns, to_columns
from ..scene.stack import Stack
from ..solver import Domain
from .compact import ARRAYS, Angles, CompactForm, Errors
from .compact_axis import Axis, axes
from .discrete_ordinates import DiscreteOrdinates
from .ordinate_stack import media
from .reciprocal_matrices import ReciprocalMatrices, Shape, assemble, optics, plan

_SAFETY = 2.0  # stated error over the largest found
_TESTS = 24  # sets of free numbers tried, at most
_FLOOR = 0.01  # share of the largest value below which relative errors are not counted


def compact_form(
    stack: Stack,
    free: Mapping[str, Any],
    *,
    orders: int = 8,
    angles: int = 12,
    points: int | Mapping[str, int] = 5,
    solver: DiscreteOrdinates | None = None,
) -> CompactForm:
    """A compact form of a stack for ranges of some of its numbers.

    Behind rough faces it is poor near grazing, where the matrices it is fitted to scatter; its stated errors say so.

    Arguments
    ---------
    stack : numbers that are not free keep its values.
    free : ``{"layer.number": (min, max)}``, or with a table ``{"min":, "max":, "scale": "log" | "linear"}``, names as in `Problem`.
    orders : cosine orders kept.
    angles : coefficients of the splines for each cosine, at least 4; two more for each critical angle seen from outside. Not more than ordinates
        there.
    points : of the grid for each free number, or by name: cubic splines between 4 or more, linear between 2.
    solver : sets streams (64 left out) and tabulated phase functions of the matrices that are fitted.

    Raises InputError for names, ranges and counts that cannot be, for refractive indices whose ranges cross, and for what the solver cannot do.

    >>> import layerfit as lf
    >>> slab = lf.Stack([lf.Layer("slab", sigma_a=0.1, sigma_s=2, g=0.3, n=1.4, thickness=1)])
    >>> fast = lf.DiscreteOrdinates(streams=16)
    >>> form = lf.compact_form(slab, {"slab.sigma_a": (0.05, 0.2)}, orders=3, angles=4, points=2, solver=fast)
    >>> form.names, form.R_above.shape, form.brdf(0.8, 0.5, 0.0, {"slab.sigma_a": 0.1}).shape
    (('slab.sigma_a',), (3, 4, 4, 2), ())

    References
    ----------
    J. Stam, Proc. Eurographics Workshop on Rendering, 39 (2001), section 5.
    """
    solver = DiscreteOrdinates(streams=64) if solver is None else solver
    solver.check(stack, TotalReflectance())
    grid = axes(stack, free, points)
    corners = [_stack(stack, grid, shares) for shares in itertools.product((0.0, 1.0), repeat=len(grid))]
    rough = tuple(np.any([[not s for s in to_columns(corner).smooth] for corner in corners], axis=0).tolist())
    domain = _domain(stack, corners, rough)
    shape = plan(domain, solver, orders)
    if isinstance(angles, bool) or not isinstance(angles, int) or angles < 4:
        raise InputError(f"angles = {angles!r}; allowed is a whole number, 4 or more")
    splines = (_angles(domain, shape, 0, angles), _angles(domain, shape, 0 if domain.low.half_space else -1, angles))
    form = _fit(stack, grid, domain, shape, rough, splines)
    streams = 2 * sum(shape.layout.counts)
    other = DiscreteOrdinates(streams=streams + 2 * max(2, streams // 16), phase=dict(solver.phase))
    return replace(form, errors=_errors(form, domain, other))


def _angles(domain: Domain, shape: Shape, outside: int, count: int) -> Angles:
    """Splines over the cosine in the medium above (0) or below (-1): broken where known indices make light reflect totally within the stack."""
    n_low, n_high, layout = np.asarray(media(domain.low)), np.asarray(media(domain.high)), shape.layout
    edges = [(n_low[layout.groups.index(i)], n_high[layout.groups.index(i)]) for i in range(len(layout.counts))]
    ends, ordinates = [0.0, 1.0], [0]
    for (low, high), number in zip(sorted(edges), layout.counts, strict=True):
        if low > n_low[outside]:
            break
        ordinates[0] += number  # from mu 1 downwards: the inner panels come last
        if low == high < n_low[outside] == n_high[outside]:
            ends.insert(1, float(np.sqrt(1.0 - (low / n_low[outside]) ** 2)))
            ordinates.insert(0, 0)
    intervals = np.maximum(1, np.round((count - 3) * np.array(ordinates) / sum(ordinates)).astype(int))
    needed = intervals.sum() + 3 + 2 * (len(intervals) - 1)
    if needed > sum(ordinates):
        raise InputError(f"angles = {count}: {needed} coefficients for {sum(ordinates)} ordinates outside; allowed are fewer angles, or more streams")
    return Angles.over(np.array(ends), intervals)


def _stack(stack: Stack, grid: tuple[Axis, ...], shares: tuple[float, ...]) -> Stack:
    return stack.set({axis.name: axis.at(share) for axis, share in zip(grid, shares, strict=True)})


def _domain(stack: Stack, corners: list[Stack], rough: tuple[bool, ...]) -> Domain:
    columns = [to_columns(corner, rough_faces=rough) for corner in corners]
    low = jax.tree.map(lambda *c: jnp.asarray(np.min(c, axis=0)), *columns)
    high = jax.tree.map(lambda *c: jnp.asarray(np.max(c, axis=0)), *columns)
    n_low, n_high = np.asarray(media(low)), np.asarray(media(high))
    for i, j in itertools.combinations(range(len(n_low)), 2):
        apart = n_high[i] <= n_low[j] or n_high[j] <= n_low[i]
        if not apart:
            raise InputError(
                f"free: refractive indices {n_low[i]:g} to {n_high[i]:g} and {n_low[j]:g} to {n_high[j]:g} overlap; allowed are ranges apart"
            )
    return Domain(stack, low, high)


class _Matrices:
    """Matrices at any free numbers; interfaces are kept where no free number changes them."""

    def __init__(self, domain: Domain, shape: Shape, rough: tuple[bool, ...]):
        self.shape, self.rough = shape, rough
        self.optics = optics(shape, domain.low) if domain.fixed_optics else None

    def __call__(self, stack: Stack) -> ReciprocalMatrices:
        columns = to_columns(stack, rough_faces=self.rough)
        return assemble(self.shape, columns, *(self.optics or optics(self.shape, columns)), peaks=False)


def _fit(stack: Stack, grid: tuple[Axis, ...], domain: Domain, shape: Shape, rough: tuple[bool, ...], angles: tuple[Angles, Angles]) -> CompactForm:
    """Least squares in both cosines at each point of the grid, then interpolation along its axes."""
    grazing = _grazing(domain.low, domain.high)
    matrices = _Matrices(domain, shape, rough)
    rows = [_coefficients(matrices(_stack(stack, grid, shares)), angles, grazing) for shares in itertools.product(*(axis.grid for axis in grid))]
    fitted = []
    for values in zip(*rows, strict=True):
        C = np.moveaxis(np.stack(values).reshape(*(axis.points for axis in grid), *values[0].shape), range(len(grid)), range(-len(grid), 0))
        for i, axis in enumerate(grid):
            solve = np.linalg.inv(np.asarray(basis(axis.grid, axis.knots, axis.degree)))
            C = np.moveaxis(np.tensordot(solve, C, (1, C.ndim - len(grid) + i)), 0, C.ndim - len(grid) + i)
        fitted.append(C)
    nothing = Errors((), (), (), 0)
    return CompactForm(stack, grid, shape.layout, rough, grazing, angles, **dict(zip(ARRAYS, fitted, strict=True)), errors=nothing)


def _grazing(low: Columns, high: Columns) -> tuple[bool, bool, bool]:
    """Whether light grazes the first layer from above, the last from below, both: where a face does not refract."""
    n_low, n_high = np.asarray(media(low)), np.asarray(media(high))
    above = n_low[0] == n_high[0] == n_low[1] == n_high[1]
    below = not low.half_space and n_low[-1] == n_high[-1] == n_low[-2] == n_high[-2]
    return bool(above), bool(below), bool(above and below)


def _coefficients(m: ReciprocalMatrices, angles: tuple[Angles, Angles], grazing: tuple[bool, bool, bool]) -> tuple[np.ndarray, ...]:
    """Of R_above, R_below, T_down/n_below^2, and of the hemispherical totals of rough first faces."""
    mu, weight = (np.asarray(m.mu_above), np.asarray(m.mu_below)), (np.asarray(m.weight_above), np.asarray(m.weight_below))
    inverse = [np.stack([np.linalg.pinv(b) for b in np.asarray(a.rows(jnp.asarray(c), m.orders))]) for a, c in zip(angles, mu, strict=True)]
    kernels = []
    for kernel, out, into, flat in (
        (m.R_above, 0, 0, grazing[0]),
        (m.R_below, 1, 1, grazing[1]),
        (m.T_down / m.n_below**2, 1, 0, grazing[2]),
    ):
        value = np.asarray(kernel) * ((mu[out][:, None] + mu[into]) if flat else 1.0)
        C = inverse[out] @ value @ np.swapaxes(inverse[into], 1, 2)
        kernels.append(0.5 * (C + np.swapaxes(C, 1, 2)) if out == into else C)
    surfaces = [
        np.linalg.pinv(np.asarray(basis(c, a.knots, 3))) @ (2.0 * np.pi * (w * c) @ np.asarray(first)[0])
        for a, c, w, first in zip(angles, mu, weight, (m.surface_above, m.surface_below), strict=True)
    ]
    return (*kernels, *surfaces)


def _errors(form: CompactForm, domain: Domain, solver: DiscreteOrdinates) -> Errors:
    """Differences to matrices of more orders at other ordinates, at free numbers amid the grid's cells."""
    shape = plan(domain, solver, None)
    if shape.layout.orders < form.orders:
        shape = plan(domain, solver, form.orders)
    matrices = _Matrices(domain, shape, form.rough)
    phi = np.linspace(0.0, np.pi, 9)
    ours = eqx.filter_jit(_predicted)
    found = []
    middles = _middles(form.axes)
    for shares in middles:
        m = matrices(_stack(form.stack, form.axes, shares))
        free = {axis.name: axis.at(share) for axis, share in zip(form.axes, shares, strict=True)}
        exact = _exact(m, phi)
        approximate = ours(form, m.mu_above, m.mu_below, phi, {name: jnp.asarray(value) for name, value in free.items()})
        row = []
        for i, (a, b) in enumerate(zip(exact, approximate, strict=True)):
            a, b = np.asarray(a), np.asarray(b)
            if a.size == 0:
                row.append((0.0, 0.0))
                continue
            error, size = np.abs(a - b), np.abs(a)
            counted = size >= _FLOOR * size.max()
            row.append((error.max(), np.max(error[counted] / np.maximum(size[counted], 1e-300)) if i < 3 else 0.0))
        found.append(row)
    largest = _SAFETY * np.max(np.array(found), axis=0)
    absolute, total, relative = (tuple(part.tolist()) for part in (largest[:3, 0], largest[3:, 0], largest[:3, 1]))
    return Errors(absolute, relative, total, len(middles))


def _middles(grid: tuple[Axis, ...]) -> list[tuple[float, ...]]:
    """Middles of the grid's cells: all, or those in its corners, where splines are worst, and some others."""
    half = [0.5 / (axis.points - 1) for axis in grid]
    middles = list(itertools.product(*(axis.grid[:-1] + h for axis, h in zip(grid, half, strict=True))))
    if len(middles) <= _TESTS:
        return middles
    ends = list(itertools.product(*((h, 1.0 - h) for h in half)))[: _TESTS // 2]
    picked = np.random.default_rng(1).choice(len(middles), _TESTS - len(ends), replace=False)
    return ends + [middles[i] for i in picked]


def _exact(m: ReciprocalMatrices, phi: np.ndarray) -> tuple:
    functions = m.brdf(phi), m.brdf(phi, side="below"), m.btdf(phi)
    return (*functions, m.reflectance(), m.reflectance(side="below"), m.transmittance()[: m.mu_above.size if m.mu_below.size else 0])


def _predicted(form: CompactForm, above: Any, below: Any, phi: Any, free: Mapping[str, Any]) -> tuple:
    phi = phi[:, None, None]
    return (
        form.brdf(above, above[:, None], phi, free),
        form.brdf(below, below[:, None], phi, free, side="below"),
        form.btdf(above, below[:, None], phi, free),
        form.reflectance(above, free),
        form.reflectance(below, free, side="below"),
        form.transmittance(above, free)[: above.size if below.size else 0],
    )
