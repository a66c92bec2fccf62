"""The same forward model from fewer spatial frequencies, for a known range of stacks and values.

A quadrature that serves any spectrum needs hundreds of frequencies. The spectra of one family of stacks are far fewer-dimensional: some of its
nodes, chosen by a pivoted QR of sample spectra, carry all the others, and new weights follow by linear least squares from the same samples
(empirical quadrature: Antil et al., J. Sci. Comput. 57, 604 (2013)).
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jax import Array
from jaxtyping import Float

from ..compilation import compiled
from ..measurement.geometry import Radial
from ..scene.columns import Columns
from .spectral import Functional, SpectralForward, images_of

_RANK = 1e-10  # share of the largest pivot below which a node adds nothing
_ROUNDING = 1e-13


def fewer_frequencies(forward: SpectralForward, columns: Columns, floors: Sequence[Float[np.ndarray, "n"]]) -> SpectralForward:
    """A forward model that agrees with another one on all stacks like the samples.

    columns : samples, one a row of each leaf. floors : for each geometry the size of its values below which errors no longer matter.
    """
    plans = []
    for geometry, plan, floor in zip(forward.geometries, forward.plans, floors, strict=True):
        if isinstance(geometry, Radial):
            spectra, values = (np.asarray(part) for part in _samples(forward, plan, columns, forward.geometries.index(geometry)))
            usable = np.all(np.isfinite(spectra), axis=1) & np.all(np.isfinite(values), axis=(1, 2))
            plan = _fewer(plan, spectra[usable], values[usable], floor)
        plans.append(plan)
    return eqx.tree_at(lambda f: f.plans, forward, tuple(plans))


@compiled
def _samples(
    forward: SpectralForward, plan: Functional, columns: Columns, index: int
) -> tuple[Float[Array, "samples k"], Float[Array, "samples c n"]]:
    """Spectra, and what the plan makes of them at each of its offsets."""
    geometry = forward.geometries[index]

    def one(columns: Columns) -> tuple[Float[Array, "k"], Float[Array, "c n"]]:
        left_out = images_of(forward.solver, columns, geometry, plan) is not None
        spectrum = forward.solver.spectrum(columns, jnp.asarray(plan.k), geometry, without_images=left_out)
        weights = jnp.atleast_3d(plan.weights) if plan.nodes is not None else jnp.asarray(plan.weights)[None]
        return spectrum.diffuse, weights @ spectrum.diffuse

    return jax.lax.map(one, columns)


def _fewer(plan: Functional, spectra: Float[np.ndarray, "s k"], values: Float[np.ndarray, "s c n"], floor: Float[np.ndarray, "n"]) -> Functional:
    """A plan with fewer nodes."""
    full = plan.weights if plan.nodes is not None else plan.weights[None]
    size = np.maximum(np.abs(values), floor)
    importance = np.max(np.abs(full) / np.median(size, axis=0)[..., None], axis=(0, 1))
    scaled = spectra * importance
    scaled = scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
    triangle, order = scipy.linalg.qr(scaled, mode="r", pivoting=True)  # pyright: ignore[reportAssignmentType]
    pivots = np.abs(np.diag(triangle))
    nodes = np.sort(order[: int(np.sum(pivots > _RANK * pivots[0]))])
    if 2 * nodes.size > spectra.shape[0] or 2 * nodes.size > spectra.shape[1]:
        return plan  # not worth it, or too few samples to tell
    weights = np.empty((*values.shape[1:], nodes.size))
    for at in np.ndindex(*values.shape[1:]):
        scale = 1.0 / size[:, *at]
        system = spectra[:, nodes] * scale[:, None]
        norm = np.linalg.norm(system, axis=0)
        weights[at] = np.linalg.lstsq(system / norm, values[:, *at] * scale, rcond=_ROUNDING)[0] / norm
    weights = weights if plan.nodes is not None else weights[0]
    return eqx.tree_at(lambda p: (p.k, p.weights), plan, (np.asarray(plan.k)[nodes], weights))
