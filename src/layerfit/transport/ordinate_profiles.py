"""Forward models of discrete ordinates in space and spatial frequency: R(r), T(r) and R(k).

Three parts are added. Light scattered once, exactly (`once_scattered`). Diffusion, where it describes the sample at all, at all frequencies that a
transform needs; in thin samples light after a few events (`successive`). And what these lack, at few frequencies, interpolated
(`optics.frequencies`).
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..compilation import compiled
from ..measurement.geometry import Geometry
from ..optics.quadrature import collected_share
from ..scene.columns import Columns
from ..solver import Domain, Evaluation, Forward, relative_errors
from .crossing import fine_directions
from .fineness import Fineness
from .frequency_layer import Closing
from .frequency_response import Sample, at_frequencies, make_sheets, scattered_often, unscattered
from .once_scattered import Lit, even_azimuths, even_directions, exact_path, ordinate_path, profile, spectrum
from .ordinate_plan import FewEvents, Optics, ProfilePlan, optics_of, plan_profile
from .ordinate_stack import Layout, medium
from .spectral import aperture
from .successive import successive

_BLOCK = 16  # frequencies worked on at a time, at most
_DIRECTIONS, _AZIMUTHS = 64, 64  # of light scattered once, in spatial frequency


def sample_of(plan: ProfilePlan, layout: Layout, optics: Optics | None, columns: Columns) -> Sample:
    """A stack on the directions of a layout."""
    grid, faces = optics_of(layout, columns) if optics is None else optics
    na = aperture(plan.geometry)
    numbers = medium(layout, columns)
    sheets = make_sheets(columns, grid, numbers, layout)
    out = grid.root[0 if plan.above else -1]
    collected = out if na is None else out * collected_share(grid.rule, layout.counts, 0 if plan.above else -1, na)
    path = ordinate_path(columns, grid, numbers, sheets, collected, plan.above)
    fine = fine_directions(grid.rule, layout.counts, columns.count)
    return Sample(sheets, faces, collected, path, fine, plan.open, columns.half_space, plan.above)


def _after_few(plan: ProfilePlan, few: FewEvents, columns: Columns) -> Float[Array, "points"]:
    """Spectrum of light after a few events, by the fine setting."""
    sample = sample_of(plan, few.layout, few.optics, columns)
    return at_frequencies(
        lambda sample, k, chain: successive(sample, k, chain, few.number, few.clear), sample, few.points, few.chain, _block(few.points.size)
    )


def _values(plan: ProfilePlan, columns: Columns, shift: Float[Array, ""] | None) -> tuple[Float[Array, "values"], Float[Array, "values"]]:
    """The values, and the same from half the frequencies."""
    geometry, layout, na, few = plan.geometry, plan.layout, aperture(plan.geometry), plan.few
    sample = sample_of(plan, layout, plan.optics, columns)
    points = jnp.asarray(plan.points)

    def not_simple(sample: Sample, k: Float[Array, ""], chain: Closing) -> Float[Array, ""]:
        """What neither diffusion nor an exact part describes."""
        often = scattered_often(sample, k, chain, plan.steps)
        return often if few is None else often - successive(sample, k, chain, few.number, few.clear)

    lacking = at_frequencies(not_simple, sample, points, plan.closing, _block(points.size))
    smooth = 0.0
    if plan.baseline is not None:
        k = jnp.concatenate([points, jnp.asarray(plan.functional.k)])
        diffuse = plan.baseline.spectrum(columns, k, geometry).diffuse
        lacking = lacking - diffuse[: points.size]
        smooth = plan.functional.weights @ diffuse[points.size :]
    lit = Lit(columns, medium(layout, columns), layout, na, plan.above)
    if plan.rings is not None:
        once = plan.rings.weights @ profile(lit, plan.rings.low, plan.rings.high)
    else:
        exact = exact_path(lit, *even_directions(_DIRECTIONS))
        once = jax.vmap(lambda k: spectrum(exact, k, *even_azimuths(_AZIMUTHS)))(points)
    rest = smooth + once + plan.functional.direct * unscattered(sample)
    from_all, from_half = plan.from_points @ lacking, plan.from_half @ (lacking[..., ::2] if plan.rings is not None else lacking)
    if few is not None:
        after = _after_few(plan, few, columns)
        from_all, from_half = from_all + few.from_points @ after, from_half + few.from_half @ after[..., ::2]
    return plan.functional.at(shift, from_all + rest), plan.functional.at(shift, from_half + rest)


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
