"""Forward models of solvers that answer in spatial frequency.

A solver gives the spectrum of what leaves one side; every kind of measurement is a linear functional of it: the spectrum itself at given
frequencies, its value at 0 (a total), or its Hankel transform (see `optics.hankel`).
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..arrays import AnyArray
from ..measurement.geometry import Geometry, Radial, SpatialFrequency, Total, TotalReflectance
from ..measurement.source import Pencil
from ..optics.hankel import Span, quadrature
from ..scene.columns import Columns
from ..solver import Domain, Forward, Solver
from .images import Images

_SHIFT_NODES = 14  # Chebyshev nodes over the range of a free offset of r


class Spectrum(eqx.Module):
    """What leaves one side, per unit incident power, at the frequencies asked for.

    diffuse : scattered light. unscattered : light of the beam that was never scattered, the same at all frequencies (the first-surface
    reflection not in it). specular : the first-surface reflection.
    """

    diffuse: Float[Array, "k"]
    unscattered: Float[Array, ""]
    specular: Float[Array, ""]


class SpectralSolver(Solver):
    """A solver that gives spectra."""

    @abstractmethod
    def spectrum(self, columns: Columns, k: Float[Array, "k"], geometry: Geometry, *, without_images: bool = False) -> Spectrum:
        """What a geometry's side sends out, for a pencil beam (or at k = 0 its incidence), collected as the geometry's detector does.

        without_images : the diffuse part is to lack that of `images`.
        """

    @abstractmethod
    def span(self, domain: Domain) -> Span:
        """The spatial frequencies that all stacks of the domain need."""

    def relative_error(self, columns: Columns, geometry: Geometry) -> np.ndarray | None:
        """Relative error that the method is known to make in each value; None where nothing is known."""
        return None

    def images(self, columns: Columns, geometry: Geometry) -> Images | None:
        """The part of the spectrum that falls off most slowly, where it has a closed form in r (None: none is taken out)."""
        return None

    def forward(self, domain: Domain, geometries: Sequence[Geometry], shifts: Sequence[tuple[float, float]]) -> Forward:
        span = self.span(domain) if any(isinstance(geometry, Radial) for geometry in geometries) else None
        plans = [functional(geometry, shift, span) for geometry, shift in zip(geometries, shifts, strict=True)]
        return SpectralForward(self, tuple(geometries), tuple(plans))


Numbers = TypeVar("Numbers")


def aperture(geometry: Geometry) -> float | None:
    """Numerical aperture of a geometry, None where all directions are collected."""
    if isinstance(geometry, Radial) and geometry.detector.na < 1.0:
        return geometry.detector.na
    return None


def over_incidence(at, geometry: Geometry) -> Spectrum:
    """The spectrum for a geometry's incidence: normal, one angle, or the average over a Lambertian source."""
    if not isinstance(geometry, Total):
        return at(1.0)
    mu, weight = geometry.cosines()
    if len(mu) == 1:
        return at(float(mu[0]))
    spectra = jax.vmap(at)(jnp.asarray(mu))
    return jax.tree.map(lambda x: jnp.tensordot(jnp.asarray(weight), x, axes=1), spectra)


def by_frequency(function: Callable[[Numbers, Float[Array, "*k"]], Float[Array, "*k"]], numbers: Numbers, k: Float[Array, "k"]) -> Float[Array, "k"]:
    """function(numbers, k) where every frequency stands alone, with a derivative rule that makes use of it.

    Each value depends on a handful of numbers (the leaves, all scalars), so its gradient is taken in reverse, at all frequencies side by side,
    and once, however many directions are asked for afterwards: a Jacobian costs a few evaluations. k itself is a constant.
    """
    leaves, structure = jax.tree.flatten(numbers)

    def at(leaves: list[Float[Array, "*copies"]], k: Float[Array, "*k"]) -> Float[Array, "*k"]:
        return function(jax.tree.unflatten(structure, leaves), k)

    @jax.custom_jvp
    def evaluate(leaves: list[Float[Array, ""]], k: Float[Array, "k"]) -> Float[Array, "k"]:
        return at(leaves, k)

    @evaluate.defjvp
    def rule(primals, tangents):
        leaves, k = primals
        # one copy of the numbers for each frequency: what comes back for a copy is the slope at that frequency
        value, pull_back = jax.vjp(lambda copies: at(copies, k), [jnp.broadcast_to(leaf, k.shape) for leaf in leaves])
        (gradient,) = pull_back(jnp.ones_like(value))
        return value, sum((g * t for g, t in zip(gradient, tangents[0], strict=True)), jnp.zeros_like(value))

    return evaluate(leaves, jax.lax.stop_gradient(k))


class Functional(eqx.Module):
    """A geometry as a linear functional of the spectrum: weights @ diffuse(k) + direct unscattered; with a free offset of its distances one set of
    weights for each Chebyshev node."""

    k: Float[AnyArray, "k"]
    weights: Float[AnyArray, "..."]
    direct: Float[AnyArray, "..."]
    nodes: Float[AnyArray, "c"] | None
    barycentric: Float[AnyArray, "c"] | None
    shifted: tuple[Geometry, ...]

    def at(self, shift: Float[Array, ""] | None, values: Float[Array, "..."]) -> Float[Array, "values"]:
        """Values at an offset from those at the nodes."""
        if self.nodes is None:
            return values
        assert self.barycentric is not None and shift is not None
        return _barycentric(shift, self.nodes, self.barycentric) @ values


def functional(geometry: Geometry, shift: tuple[float, float], span: Span | None) -> Functional:
    """shift : range of the offset [mm]. span : for distances, what spectra need. shifted : the geometry at each node (one without an offset)."""
    if isinstance(geometry, SpatialFrequency):
        return Functional(geometry.k, np.eye(geometry.size), np.ones(geometry.size), None, None, (geometry,))
    if not isinstance(geometry, Radial):
        return Functional(np.zeros(1), np.ones((1, 1)), np.ones(1), None, None, (geometry,))
    assert span is not None
    low, high = shift
    if low == high:
        moved = geometry if low == 0.0 else geometry.shifted(low)
        rule = quadrature(moved.kernel(), span)
        return Functional(rule.k, rule.weights, moved.direct(), None, None, (moved,))
    angle = np.pi * (np.arange(_SHIFT_NODES) + 0.5) / _SHIFT_NODES
    nodes = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(angle)
    # one common set of panels for all nodes: that of the largest distances
    far = geometry.shifted(high)
    moved = tuple(geometry.shifted(float(t)) for t in nodes)
    rules = [quadrature(one.kernel(), span, r_max=_reach(far)) for one in moved]
    return Functional(
        rules[0].k,
        np.stack([rule.weights for rule in rules]),
        np.stack([one.direct() for one in moved]),
        nodes,
        (-1.0) ** np.arange(_SHIFT_NODES) * np.sin(angle),
        moved,
    )


def _reach(geometry: Radial) -> float:
    return max(float(np.max(np.abs(values))) for values in geometry.places().values())


class SpectralForward(Forward):
    """See `Forward`."""

    solver: SpectralSolver
    geometries: tuple[Geometry, ...]
    plans: tuple[Functional, ...]

    def __call__(self, columns: Columns, shifts: Sequence[Float[Array, ""] | None] | None = None) -> tuple[Array, ...]:
        shifts = [None] * len(self.plans) if shifts is None else shifts
        return tuple(self._one(columns, geometry, plan, shift) for geometry, plan, shift in zip(self.geometries, self.plans, shifts, strict=True))

    def error(self, columns: Columns) -> tuple[np.ndarray | None, ...] | None:
        shares = [self.solver.relative_error(columns, geometry) for geometry in self.geometries]
        if all(share is None for share in shares):
            return None
        values = self.run(columns)
        return tuple(None if share is None else share * np.abs(np.asarray(value)) for share, value in zip(shares, values, strict=True))

    def _one(self, columns: Columns, geometry: Geometry, plan: Functional, shift: Float[Array, ""] | None) -> Float[Array, "values"]:
        images = images_of(self.solver, columns, geometry, plan)
        spectrum = self.solver.spectrum(columns, jnp.asarray(plan.k), geometry, without_images=images is not None)
        values = plan.weights @ spectrum.diffuse + plan.direct * spectrum.unscattered
        values = plan.at(shift, values)
        if images is not None:
            values = values + images.profile(geometry)
        if isinstance(geometry, TotalReflectance) and geometry.specular == "included":
            values = values + spectrum.specular
        return values


def images_of(solver: SpectralSolver, columns: Columns, geometry: Geometry, plan: Functional) -> Images | None:
    """The images that are added in closed form: under a pencil, at points and in rings whose distances are fixed."""
    closed = isinstance(geometry, Radial) and isinstance(geometry.source, Pencil) and geometry.detector.radius == 0.0 and plan.nodes is None
    return solver.images(columns, geometry) if closed else None


def _barycentric(x: Float[Array, ""], nodes: Float[Array, "c"], weights: Float[Array, "c"]) -> Float[Array, "c"]:
    """Values of the Lagrange polynomials at x."""
    gap = x - nodes
    gap = jnp.where(jnp.abs(gap) < 1e-14, 1e-14, gap)
    terms = weights / gap
    return terms / jnp.sum(terms)
