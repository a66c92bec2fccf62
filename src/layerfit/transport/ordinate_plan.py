"""How distances and spatial frequencies are to be computed with discrete ordinates: all that does not depend on the free numbers of the stack."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..arrays import AnyArray
from ..compilation import compiled
from ..measurement.geometry import Geometry, Radial
from ..measurement.rings import rings
from ..optics.frequencies import chebyshev_frequencies, interpolation
from ..optics.hankel import Span
from ..scene.columns import Columns
from ..solver import Domain
from .fineness import Events, Fineness, nearest, scales
from .frequency_layer import Closing, closing, deep_steps, times
from .frequency_response import Steps
from .layered_diffusion import LayeredDiffusion
from .matrix import Matrix
from .ordinate_stack import Grid, Layout, make_faces, make_grid, medium, middle
from .response import Response
from .spectral import Functional, aperture, functional
from .successive import endless_chain

_BASELINE = LayeredDiffusion(source="exponential", boundary="partial_current")


class _Rings(eqx.Module):
    """values = weights @ (means over rings)."""

    low: np.ndarray
    high: np.ndarray
    weights: Float[AnyArray, "..."]


Optics = tuple[Grid, tuple[Response[Matrix], ...]]


class FewEvents(eqx.Module):
    """Light after a few events, see `successive`. number : of events. The others as in `ProfilePlan`."""

    number: int = eqx.field(static=True)
    clear: tuple[bool, ...] = eqx.field(static=True)
    layout: Layout
    points: Float[AnyArray, "points"]
    chain: Closing
    from_points: Float[AnyArray, "..."]
    from_half: Float[AnyArray, "..."]
    optics: Optics | None


class ProfilePlan(eqx.Module):
    """One geometry with all that does not depend on the free numbers of the stack.

    open : layers that light crosses unscattered, see `crossing`. points : frequencies [rad/mm] of the transport part; from_points, from_half : values
    from the spectrum there, and from every other one of them.
    rings : of the part scattered once; none in spatial frequency. optics : directions and faces, where they are the same for all stacks.
    few : light after a few events, where it is computed apart.
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
    optics: Optics | None
    few: FewEvents | None

    @property
    def above(self) -> bool:
        return self.geometry.side == "above"


def plan_profile(domain: Domain, geometry: Geometry, shift: tuple[float, float], fineness: Fineness) -> ProfilePlan:
    """shift : range of the offset of the distances [mm]."""
    layout, count = fineness.layout, fineness.count
    mean = middle(domain)
    optics = optics_of(layout, mean)
    scale = _scale(mean)
    baseline = _BASELINE if diffusion_helps(domain, geometry) else None
    few = None
    if isinstance(geometry, Radial):
        deep = baseline is not None and mean.half_space and not fineness.along
        spread = _deep_spread(domain) if deep else (scale, 0.0)
        rule = functional(geometry, shift, _span(domain, baseline, scale))
        seen = nearest(geometry, shift) if fineness.along else None
        points, from_points, from_half = _interpolated(rule, count, spread, mean, seen)
        rings = _rings(rule)
        if fineness.events is not None:
            few = _few_events(domain, fineness.events, _interpolated(rule, fineness.events.count, spread, mean, seen))
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
        few,
    )


def _interpolated(
    rule: Functional, count: int, spread: tuple[float, float], columns: Columns, distances: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies, and the values from the spectrum at all and at half of them. distances : where the spectrum is to be smoothed; None where not."""
    points = chebyshev_frequencies(count, *spread)
    kept = np.ones((rule.weights.shape[-2], count)) if distances is None else _smoothing(distances, columns, points)
    from_points, from_half = (rule.weights @ interpolation(count // step, rule.k, *spread) * kept[:, ::step] for step in (1, 2))
    unseen = points[np.max(kept, axis=0) < _NOTHING]
    return np.minimum(points, np.min(unseen, initial=np.inf)), from_points, from_half


_AZIMUTHS = 48  # of half a circle


def _few_events(domain: Domain, events: Events, interpolated: tuple[np.ndarray, np.ndarray, np.ndarray]) -> FewEvents:
    points, from_points, from_half = interpolated
    chain = Closing(*(np.broadcast_to(x, (points.size, *x.shape)) for x in endless_chain(events.layout.orders, _AZIMUTHS)))
    optics = optics_of(events.layout, middle(domain)) if domain.fixed_optics else None
    clear = tuple(map(bool, np.asarray(domain.high.sigma_s_prime) == 0.0))
    return FewEvents(events.number, clear, events.layout, points, chain, from_points, from_half, optics)


_NOTHING = 1e-12  # share of a frequency in all values below which its value does not matter: one that is cheaper does as well
_SMOOTHED, _LARGEST = 1.0 / 12.0, 0.2  # width of the smoothing: share of the distance, at most so many transport mean free paths


def _smoothing(distances: np.ndarray, columns: Columns, points: np.ndarray) -> np.ndarray:
    """Share of each frequency in each value, seen no nearer than these distances [mm]: (values, points).

    A few directions in a slab are a few cones of light, rings at its faces that are not there in truth; they ripple at frequencies that light
    scattered more than once hardly has. The window is flat up to its sixth power: what is smooth over the width stays.
    """
    width = np.minimum(_SMOOTHED * distances, _LARGEST / float(np.max(np.asarray(columns.sigma_t_prime))))
    x = (width[:, None] * points) ** 2
    return np.exp(-x) * (1.0 + x + 0.5 * x**2)


_OPEN, _DULL, _DULL_BOTH = 4.0, 1.0, 0.3


def _open(domain: Domain, layout: Layout) -> tuple[bool, ...]:
    """Layers that light crosses unscattered in a share that matters, from or to others that scatter it.

    Light trapped between two faces crosses so often that its directions, projected each time, are lost: there ordinates alone do better. It is not
    trapped between layers that scatter on both sides.
    """
    low = domain.low
    finite = low.thickness.shape[0]
    depth = np.asarray(medium(layout, low).extinction[:finite] * low.thickness)
    dull = np.append(np.asarray(low.thickness * low.sigma_t_prime[:finite]), [np.inf] if low.half_space else [])
    sides = [(np.sum(dull[:i]), np.sum(dull[i + 1 :])) for i in range(finite)]
    crossed = [depth[i] < _OPEN and (max(sides[i]) > _DULL or min(sides[i]) > _DULL_BOTH) for i in range(finite)]
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
def optics_of(layout: Layout, columns: Columns) -> Optics:
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


_THIN = 0.5  # optical thickness from which a layer is made as a scattering one
_START, _SATURATED, _LEAST = 2.0, 64.0, 4  # of the fastest mode: decay times half thickness; and steps by which that is reached from any start


def _steps(domain: Domain, grid: Grid, k: float) -> Steps:
    """How often layers are doubled or tripled, for frequencies up to k."""
    n = grid.root.shape[1]
    low, high = domain.low, domain.high
    sigma_low, sigma_high = (np.asarray(c.sigma_a + c.sigma_s_prime / (1.0 - c.g)) for c in (low, high))
    thin, of_thin, of_thick = [], 0, deep_steps(k / float(low.sigma_t_prime[-1])) if low.half_space else 0
    for i, (least, most) in enumerate(zip(np.asarray(low.thickness), np.asarray(high.thickness), strict=True)):
        mu = np.where(np.asarray(grid.real[i + 1]), np.asarray(grid.mu[i + 1]), 1.0)[:n]
        fastest = 0.5 * most * np.max((sigma_high[i] + k * np.sqrt(1.0 - mu**2)) / mu)
        thin.append(bool(sigma_low[i] * (1.0 - np.asarray(low.g)[i]) * least < _THIN))
        if thin[-1]:
            of_thin = max(of_thin, times(fastest / _START, 2.0))
        else:
            of_thick = max(of_thick, min(times(fastest / _START, 3.0), max(_LEAST, times(fastest / _SATURATED, 3.0))))
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
