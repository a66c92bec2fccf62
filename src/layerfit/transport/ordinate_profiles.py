"""Forward models of discrete ordinates in space and spatial frequency: R(r), T(r) and R(k).

Three parts are added. Light scattered once, exactly (`once_scattered`). Diffusion, where it describes the sample at all, at all frequencies that a
transform needs. And what both lack, at few frequencies, interpolated (`optics.frequencies`).
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..arrays import AnyArray
from ..compilation import compiled
from ..measurement.geometry import Geometry, Radial
from ..measurement.rings import rings
from ..optics.frequencies import chebyshev_frequencies, interpolation
from ..optics.hankel import Span
from ..optics.quadrature import collected_share
from ..scene.columns import Columns
from ..solver import Domain, Evaluation, Forward, relative_errors
from .crossing import fine_directions
from .fineness import Fineness, scales
from .frequency_layer import Closing, closing, deep_steps
from .frequency_response import Sample, Steps, make_sheets, unscattered, values
from .layered_diffusion import LayeredDiffusion
from .matrix import Matrix
from .once_scattered import even_azimuths, exact_path, ordinate_path, profile, spectrum
from .ordinate_stack import Grid, Layout, make_faces, make_grid, medium, middle
from .response import Response
from .spectral import Functional, aperture, functional

_BLOCK = 16  # frequencies worked on at a time, at most
_BASELINE = LayeredDiffusion(source="exponential", boundary="partial_current")
_DIRECTIONS = 192  # of exit, in the exact part
_AZIMUTHS = 64


class _Rings(eqx.Module):
    """values = weights @ (means over rings)."""

    low: np.ndarray
    high: np.ndarray
    weights: Float[AnyArray, "..."]


class ProfilePlan(eqx.Module):
    """One geometry with all that does not depend on the free numbers of the stack.

    open : layers that light crosses unscattered, see `crossing`. points : frequencies [rad/mm] of the transport part; from_points, from_half : values
    from the spectrum there, and from every other one of them.
    rings : of the part scattered once; none in spatial frequency. optics : directions and faces, where they are the same for all stacks.
    """

    geometry: Geometry
    layout: Layout
    steps: Steps = eqx.field(static=True)
    open: tuple[bool, ...] = eqx.field(static=True)
    points: Float[AnyArray, "points"]
    closing: Closing
    from_points: Float[AnyArray, "..."]
    from_half: Float[AnyArray, "..."]
    functional: Functional
    baseline: LayeredDiffusion | None
    rings: _Rings | None
    optics: tuple[Grid, tuple[Response[Matrix], ...]] | None

    @property
    def above(self) -> bool:
        return self.geometry.side == "above"


def plan_profile(domain: Domain, geometry: Geometry, shift: tuple[float, float], fineness: Fineness) -> ProfilePlan:
    """shift : range of the offset of the distances [mm]."""
    layout, count = fineness.layout, fineness.count
    optics = optics_of(layout, middle(domain))
    mean = middle(domain)
    scale = _scale(mean)
    baseline = _BASELINE if diffusion_helps(domain, geometry) else None
    if isinstance(geometry, Radial):
        deep = baseline is not None and mean.half_space and not fineness.along
        spread = _deep_spread(domain) if deep else (scale, 0.0)
        points = chebyshev_frequencies(count, *spread)
        rule = functional(geometry, shift, _span(domain, baseline, scale))
        kept = _smoothing(geometry, shift, mean, points) if fineness.along else np.ones((geometry.size, count))
        from_points, from_half = (rule.weights @ interpolation(count // step, rule.k, *spread) * kept[:, ::step] for step in (1, 2))
        rings = _rings(rule)
    else:
        rule = functional(geometry, shift, None)
        points, baseline, rings = np.maximum(rule.k, 1e-6 * scale), None, None
        from_points = from_half = rule.weights
    steps = _steps(domain, optics[0], float(points[-1]))
    ends = _closing(layout, optics[0], mean, points, fineness.along)
    return ProfilePlan(
        geometry,
        layout,
        steps,
        _open(domain, layout),
        points,
        ends,
        from_points,
        from_half,
        rule,
        baseline,
        rings,
        optics if domain.fixed_optics else None,
    )


_SMOOTHED, _LARGEST = 1.0 / 12.0, 0.2  # width of the smoothing: share of the distance, at most so many transport mean free paths


def _smoothing(geometry: Radial, shift: tuple[float, float], columns: Columns, points: np.ndarray) -> np.ndarray:
    """Share of each frequency in each value: (values, points).

    A few directions in a slab are a few cones of light, rings at its faces that are not there in truth; they ripple at frequencies that light
    scattered more than once hardly has. The window is flat up to its sixth power: what is smooth over the width stays.
    """
    extent = geometry.detector.radius + 2.0 * float(getattr(geometry.source, "radius", 0.0))
    r = np.abs(next(iter(geometry.places().values()))) + min(shift[0], 0.0) - extent
    width = np.minimum(_SMOOTHED * np.maximum(r, 0.0), _LARGEST / float(np.max(np.asarray(columns.sigma_t_prime))))
    x = (width[:, None] * points) ** 2
    return np.exp(-x) * (1.0 + x + 0.5 * x**2)


_OPEN, _DULL = 4.0, 1.0


def _open(domain: Domain, layout: Layout) -> tuple[bool, ...]:
    """Layers that light crosses unscattered in a share that matters, from or to others that scatter it.

    Light trapped between two faces crosses so often that its directions, projected each time, are lost: there ordinates alone do better.
    """
    low = domain.low
    finite = low.thickness.shape[0]
    depth = np.asarray(medium(layout, low).extinction[:finite] * low.thickness)
    dull = np.append(np.asarray(low.thickness * low.sigma_t_prime[:finite]), [np.inf] if low.half_space else [])
    crossed = [depth[i] < _OPEN and max(np.sum(dull[:i]), np.sum(dull[i + 1 :])) > _DULL for i in range(finite)]
    return (*map(bool, crossed), *[False] * low.half_space)


_ENDLESS = 0.7


def _closing(layout: Layout, grid: Grid, columns: Columns, points: np.ndarray, along: bool) -> Closing:
    """What the last azimuthal order hands on (see `frequency_layer.coupling`), for directions in a sample like this one.

    Light that runs along a slab keeps to rho = sqrt(1 + x^2) - x, x = 1/(k sin(theta)) in mean free paths of isotropic scattering; in a half space
    one share does as well and leaves a smoother spectrum.
    """
    n = grid.root.shape[1]
    share = np.full((points.size, n), _ENDLESS)
    if along:
        row = slice(1, columns.count + 1)
        mu, real = np.asarray(grid.mu)[row, :n], np.asarray(grid.real)[row, :n]
        sine = np.sqrt(1.0 - np.where(real, mu, 0.5) ** 2)
        least = np.min(np.where(real, np.asarray(columns.sigma_t_prime)[:, None] / sine, np.inf), axis=0)
        x = least / points[:, None]
        share = np.sqrt(1.0 + x**2) - x
    return closing(layout.orders, share)


def _scale(columns: Columns) -> float:
    """A frequency in the middle of those that matter [rad/mm].

    Between the densest layer, which is felt near the source, and the clearest, felt far away; at least that of a thin sample's thickness.
    """
    dense, clear = scales(columns)
    thin = 0.0 if columns.half_space else 1.0 / float(np.sum(np.asarray(columns.thickness)))
    return max(float(np.sqrt(dense * max(clear, 0.01 * dense))), thin)


_DEEP = 3.0


def _deep_spread(domain: Domain) -> tuple[float, float]:
    """Scale and decay of the points for what diffusion leaves of a half space.

    Three times the scale is where the fewest points are enough; in a wide domain, of the mean of its two middles. The decay is the smallest of
    diffuse light in any layer, over an absorber that of the layer above: with more than the true one the far tail is lost, with less little is.
    """
    low, high = domain.low, domain.high
    centre = jax.tree.map(lambda a, b: jnp.sqrt(jnp.maximum(a, 1e-4 * b) * b), low, high)
    scale = _DEEP * float(np.sqrt(_scale(middle(domain)) * _scale(centre)))
    return scale, float(np.min(np.asarray(low.sigma_tr)))


@compiled
def optics_of(layout: Layout, columns: Columns) -> tuple[Grid, tuple[Response[Matrix], ...]]:
    """Directions and faces, with the beam as one more channel."""
    grid = make_grid(layout, columns, jnp.zeros(0), jnp.zeros(1))
    return grid, make_faces(columns, grid, layout, 1)


_LEAST_DEPTH = 1.0 / 15.0


def diffusion_helps(domain: Domain, geometry: Geometry) -> bool:
    """Whether diffusion is near enough to take most of the spectrum's shape away: every layer scatters, and none is a gap."""
    for columns in (domain.low, domain.high):
        depth = np.asarray(columns.thickness * columns.sigma_t_prime[: columns.thickness.shape[0]])
        if np.any(np.asarray(columns.sigma_s_prime) <= 0.0) or np.any(depth < _LEAST_DEPTH):
            return False
    return aperture(geometry) is None or all(domain.low.smooth)


def _span(domain: Domain, baseline: LayeredDiffusion | None, scale: float) -> Span:
    if baseline is not None:
        span = baseline.span(domain)
        return Span(span.k_low, max(span.k_high, 20.0 * scale), True)
    low = domain.low
    decay = float(np.min(np.sqrt(np.asarray(low.sigma_a) * np.asarray(low.sigma_t_prime))))
    return Span(decay, 40.0 * scale, True)


_THIN = 0.5  # optical thickness from which a layer is doubled as a scattering one
_START, _SATURATED, _LEAST = 2.0, 64.0, 6  # of the fastest mode: decay times half thickness


def _steps(domain: Domain, grid: Grid, k: float) -> Steps:
    """How often layers are doubled, for frequencies up to k."""
    n = grid.root.shape[1]
    low, high = domain.low, domain.high
    sigma_low, sigma_high = (np.asarray(c.sigma_a + c.sigma_s_prime / (1.0 - c.g)) for c in (low, high))
    thin, of_thin, of_thick = [], 0, deep_steps(k / float(low.sigma_t_prime[-1])) if low.half_space else 0
    for i, (least, most) in enumerate(zip(np.asarray(low.thickness), np.asarray(high.thickness), strict=True)):
        mu = np.where(np.asarray(grid.real[i + 1]), np.asarray(grid.mu[i + 1]), 1.0)[:n]
        fastest = 0.5 * most * np.max((sigma_high[i] + k * np.sqrt(1.0 - mu**2)) / mu)
        count = int(np.ceil(np.log2(max(fastest / _START, 1.0))))
        thin.append(bool(sigma_low[i] * (1.0 - np.asarray(low.g)[i]) * least < _THIN))
        if thin[-1]:
            of_thin = max(of_thin, count)
        else:
            of_thick = max(of_thick, min(count, max(_LEAST, int(np.ceil(np.log2(max(fastest / _SATURATED, 1.0)))))))
    return Steps((*thin, *[False] * low.half_space), of_thin, of_thick)


def _rings(rule: Functional) -> _Rings:
    """Rings about the beam, and how much each counts for each value: under a pencil one a value, else what source and detector see of it."""
    lows, highs, weights = [], [], []
    for geometry in rule.shifted:
        assert isinstance(geometry, Radial)
        low, high, weight = rings(geometry)
        lows.append(low)
        highs.append(high)
        weights.append(weight)
    if rule.nodes is None:
        return _Rings(lows[0], highs[0], weights[0])
    count = sum(low.size for low in lows)
    joined, start = np.zeros((len(lows), weights[0].shape[0], count)), 0
    for i, weight in enumerate(weights):
        joined[i, :, start : start + weight.shape[1]] = weight
        start += weight.shape[1]
    return _Rings(np.concatenate(lows), np.concatenate(highs), joined)


def _values(plan: ProfilePlan, columns: Columns, shift: Float[Array, ""] | None) -> tuple[Float[Array, "values"], Float[Array, "values"]]:
    """The values, and the same from half the frequencies."""
    geometry, layout, na = plan.geometry, plan.layout, aperture(plan.geometry)
    grid, faces = optics_of(layout, columns) if plan.optics is None else plan.optics
    numbers = medium(layout, columns)
    sheets = make_sheets(columns, grid, numbers, layout)
    out = grid.root[0 if plan.above else -1]
    collected = out if na is None else out * collected_share(grid.rule, layout.counts, 0 if plan.above else -1, na)
    path = ordinate_path(columns, grid, numbers, sheets, collected, plan.above)
    fine = fine_directions(grid.rule, layout.counts, columns.count)
    sample = Sample(sheets, faces, collected, path, fine, plan.open, columns.half_space, plan.above)
    points = jnp.asarray(plan.points)
    lacking = values(sample, points, plan.closing, plan.steps, _block(points.size))
    smooth = 0.0
    if plan.baseline is not None:
        k = jnp.concatenate([points, jnp.asarray(plan.functional.k)])
        diffuse = plan.baseline.spectrum(columns, k, geometry).diffuse
        lacking = lacking - diffuse[: points.size]
        smooth = plan.functional.weights @ diffuse[points.size :]
    if plan.rings is not None:
        exact = exact_path(columns, numbers, layout, na, plan.above, _DIRECTIONS)
        once = plan.rings.weights @ profile(exact, plan.rings.low, plan.rings.high)
    else:
        exact = exact_path(columns, numbers, layout, na, plan.above, _AZIMUTHS)
        once = jax.vmap(lambda k: spectrum(exact, k, *even_azimuths(_AZIMUTHS)))(points)
    rest = smooth + once + plan.functional.direct * unscattered(sample)
    half = lacking[..., ::2] if plan.rings is not None else lacking
    return plan.functional.at(shift, plan.from_points @ lacking + rest), plan.functional.at(shift, plan.from_half @ half + rest)


def _block(count: int) -> int:
    """Frequencies worked on at a time: blocks of one size, since a smaller last one would be a program of its own."""
    equal = max(size for size in range(1, _BLOCK + 1) if count % size == 0)
    return equal if 2 * equal >= _BLOCK else min(_BLOCK, count)


_profile = compiled(_values)


def profiles_forward(
    domain: Domain, geometries: Sequence[Geometry], shifts: Sequence[tuple[float, float]], fine: Fineness, coarse: Fineness
) -> "ProfilesForward":
    """coarse : for the error."""
    pairs = list(zip(geometries, shifts, strict=True))
    return ProfilesForward(*(tuple(plan_profile(domain, *pair, chosen) for pair in pairs) for chosen in (fine, coarse)))


class ProfilesForward(Forward):
    """See `Forward`. coarser : the same geometries with fewer directions and orders, for the error."""

    plans: tuple[ProfilePlan, ...]
    coarser: tuple[ProfilePlan, ...]

    def __call__(self, columns: Columns, shifts: Sequence[Float[Array, ""] | None] | None = None) -> tuple[Array, ...]:
        shifts = [None] * len(self.plans) if shifts is None else shifts
        return tuple(_profile(plan, columns, shift)[0] for plan, shift in zip(self.plans, shifts, strict=True))

    def run(self, columns: Columns) -> tuple[Array, ...]:
        return self(columns)

    def error(self, columns: Columns) -> tuple[np.ndarray | None, ...] | None:
        return self.evaluate(columns).errors

    def evaluate(self, columns: Columns) -> Evaluation:
        found, errors = [], []
        for plan, coarse in zip(self.plans, self.coarser, strict=True):
            value, half = (np.asarray(v) for v in _profile(plan, columns, None))
            other = np.asarray(_profile(coarse, columns, None)[0])
            found.append(value)
            errors.append(_at_least_as_around(plan.geometry, np.abs(value - other), value) + np.abs(value - half))
        return Evaluation(tuple(found), tuple(errors))


_AROUND = 0.2  # share of the distance, or of the frequency


def _at_least_as_around(geometry: Geometry, difference: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Differences to a coarser setting, each at least the mean of its surroundings in relation to the values: they change sign from place to place,
    and are 0 where the error is not."""
    place = geometry.centers()
    around = np.abs(place[:, None] - place) <= _AROUND * place[:, None]
    mean = np.sum(np.where(around, relative_errors(difference, value), 0.0), axis=1) / np.sum(around, axis=1)
    return np.maximum(difference, np.abs(value) * mean)
