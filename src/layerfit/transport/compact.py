"""A stack's R_k and T_k in compact form: few cosine orders, reciprocal bicubic splines over angles, splines over free numbers of the stack."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer
from jaxtyping import Float

from ..arrays import AnyArray
from ..errors import InputError, one_of
from ..optics.microfacet_paths import brdf as facet_brdf
from ..optics.quadrature import cosine
from ..optics.splines import basis, clamped_knots
from ..scene.columns import Columns, to_columns
from ..scene.stack import Stack
from .compact_axis import Axis
from .compact_file import from_json, read, to_json, write
from .ordinate_stack import Layout, media, medium
from .regular import SIDES, Face, Regular, regular

ARRAYS = ("R_above", "R_below", "T", "surface_above", "surface_below")
_KNOTS = ("knots_above", "knots_below")
_NODE, _WEIGHT = np.polynomial.legendre.leggauss(6)
_U = 0.5 * (_NODE + 1.0)


class Angles(eqx.Module):
    """How a kernel depends on two cosines: a bicubic spline C times sin^p sin'^p (p by azimuthal order: 0, then 1, 2, 1, 2 ...), which makes it
    smooth at normal incidence; and over mu + mu' where light grazes both faces without being refracted (``grazing``)."""

    knots: Float[AnyArray, "t"]

    @staticmethod
    def over(ends: np.ndarray, counts: np.ndarray) -> "Angles":
        """counts intervals between successive ends, crowding towards them; at inner ends (critical angles) only the value is continuous."""
        parts = []
        for low, high, count in zip(ends[:-1], ends[1:], counts, strict=True):
            breaks = low + (high - low) * np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, count + 1)) ** 2
            parts += [breaks] if low == ends[0] else [breaks[:1], breaks[:1], breaks[1:]]
        return Angles(clamped_knots(np.concatenate(parts)))

    def quadrature(self) -> tuple[Float[Array, "q"], Float[Array, "q"]]:
        """Nodes and weights over the cosine, a Gauss rule an interval."""
        left, width = jnp.asarray(self.knots)[3:-4], jnp.diff(jnp.asarray(self.knots)[3:-3])
        return (left[:, None] + width[:, None] * _U).ravel(), (width[:, None] * (0.5 * _WEIGHT)).ravel()

    def rows(self, mu: Float[Array, "*s"], orders: int) -> Float[Array, "k *s j"]:
        """Basis functions of one cosine, with the power of the sine, by azimuthal order."""
        sine2 = jnp.maximum(1.0 - mu**2, 0.0)
        odd = jnp.sqrt(jnp.where(sine2 > 0.0, sine2, 1.0)) * (sine2 > 0.0)
        power = jnp.stack([jnp.ones_like(mu) if k == 0 else odd if k % 2 else sine2 for k in range(orders)])
        return power[..., None] * basis(mu, self.knots, 3)


class Errors(eqx.Module):
    """What a compact form may be wrong by, against the matrices it stands for: twice the largest difference found between the grid's points, at
    other ordinates.

    absolute : of BRDF from above, from below and BTDF from above [1/sr]. relative : the same over the value, where it is above a hundredth of the
    largest at those free numbers. total : of directional-hemispherical reflectance from above and below and transmittance from above [1].
    tested : sets of free numbers that were tried.
    """

    absolute: tuple[float, ...] = eqx.field(static=True)
    relative: tuple[float, ...] = eqx.field(static=True)
    total: tuple[float, ...] = eqx.field(static=True)
    tested: int = eqx.field(static=True)


class CompactForm(eqx.Module):
    """BRDF, BTDF and their totals of a stack at any pair of angles and any values of its free numbers, in a few products. Made by `compact_form`.

    It holds what the matrices of `reciprocal_matrices` hold: the subsurface reflection and the transmission that are not beams, in a few azimuthal
    orders; light scattered once is exact in reflection, and without its forward peak in transmission (beams include what delta-M counts as not
    scattered). Beams and what the first face reflects are not fitted: they are computed exactly, but for the hemispherical total of a rough first
    face, which is. Reciprocity is exact: the coefficients of reflection are symmetric, and transmission up is transmission down transposed.

    ``free`` in its methods: a value for each free number, by name; scalars. All methods can be compiled, mapped and differentiated. Values outside
    the range of the form raise InputError where they are known, and give NaN where they are traced. So do cosines outside 0 to 1.
    """

    VERSION: ClassVar[int] = 1

    stack: Stack
    axes: tuple[Axis, ...] = eqx.field(static=True)
    layout: Layout
    rough: tuple[bool, ...] = eqx.field(static=True)
    grazing: tuple[bool, bool, bool] = eqx.field(static=True)
    angles: tuple[Angles, Angles]
    R_above: Float[AnyArray, "k a a *p"]
    R_below: Float[AnyArray, "k b b *p"]
    T: Float[AnyArray, "k b a *p"]
    surface_above: Float[AnyArray, "a *p"]
    surface_below: Float[AnyArray, "b *p"]
    errors: Errors

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free numbers."""
        return tuple(axis.name for axis in self.axes)

    @property
    def orders(self) -> int:
        """Azimuthal orders."""
        return self.R_above.shape[0]

    def brdf(self, mu_in: Any, mu_out: Any, azimuth: Any, free: Mapping[str, Any], *, side: Face = "above", surface: bool = False) -> Array:
        """Reflected radiance per irradiance [1/sr].

        mu_in, mu_out : cosines outside; azimuth : between the ways of travel [rad], 0 on the side of the mirror reflection; arrays that broadcast.
        surface : whether what a rough first face reflects is added (light that meets one facet). Raises InputError, see above.
        """
        one_of(side, SIDES, "side")
        weights, inside = self._weights(free)
        C, i = (self.R_above, 0) if side == "above" else (self.R_below, 1)
        value = self._kernel(_contract(C, weights), mu_out, mu_in, azimuth, self.grazing[i], (i, i))
        face = -i
        if surface and self.rough[face] and (side == "above" or not self.stack.half_space):
            columns = self._columns(free)
            n = media(columns)
            ratio = n[0] / n[1] if side == "above" else n[-1] / n[-2]
            into, out, phi = jnp.broadcast_arrays(_cosine(mu_in), _cosine(mu_out), jnp.asarray(azimuth, dtype=float))
            value = value + facet_brdf(into, out, phi, ratio, columns.roughness[face])
        return jnp.where(inside, value, jnp.nan)

    def btdf(self, mu_in: Any, mu_out: Any, azimuth: Any, free: Mapping[str, Any], *, side: Face = "above") -> Array:
        """Transmitted radiance, in the medium where it leaves, per irradiance on ``side`` [1/sr]; arguments as for `brdf`."""
        one_of(side, SIDES, "side")
        weights, inside = self._weights(free)
        below, above = (mu_out, mu_in) if side == "above" else (mu_in, mu_out)
        value = self._kernel(_contract(self.T, weights), below, above, azimuth, self.grazing[2], (1, 0))  # over n^2 of the medium below
        columns = self._columns(free)
        return jnp.where(inside, value * (columns.n_below if side == "above" else columns.n_above) ** 2, jnp.nan)

    def reflectance(self, mu: Any, free: Mapping[str, Any], *, side: Face = "above", surface: bool = True) -> Array:
        """Share of a beam that is reflected in all directions, beams included; without what the first face reflects on request."""
        one_of(side, SIDES, "side")
        weights, inside = self._weights(free)
        mu = _cosine(mu)
        C, S, i = (self.R_above, self.surface_above, 0) if side == "above" else (self.R_below, self.surface_below, 1)
        beams = self.regular(mu, free, side=side)
        total = self._hemispherical(_contract(C, weights), mu, self.grazing[i], (i, i))
        total = total + (beams.above if side == "above" else beams.below)
        if surface:
            first = beams.surface_above if side == "above" else beams.surface_below
            total = total + first + basis(mu, self.angles[i].knots, 3) @ _contract(S, weights)
        return jnp.where(inside, total, jnp.nan)

    def transmittance(self, mu: Any, free: Mapping[str, Any], *, side: Face = "above") -> Array:
        """Share of a beam on ``side`` that is transmitted in all directions, beams included."""
        one_of(side, SIDES, "side")
        weights, inside = self._weights(free)
        mu, columns = _cosine(mu), self._columns(free)
        C = _contract(self.T, weights)
        beams = self.regular(mu, free, side=side)
        if side == "above":
            total = columns.n_below**2 * self._hemispherical(C, mu, self.grazing[2], (1, 0)) + beams.down
        else:
            total = columns.n_above**2 * self._hemispherical(jnp.swapaxes(C, 1, 2), mu, self.grazing[2], (0, 1)) + beams.up
        return jnp.where(inside, total, jnp.nan)

    def regular(self, mu: Any, free: Mapping[str, Any], *, side: Face = "above") -> Regular:
        """Shares of beams that arrive on ``side`` at cosines mu and stay beams: exact."""
        one_of(side, SIDES, "side")
        mu, columns = _cosine(mu), self._columns(free)
        n = media(columns)
        outer = n[0] if side == "above" else n[-1]
        p = outer * jnp.sqrt(jnp.maximum(1.0 - mu.ravel() ** 2, 1e-300))
        inner, real = cosine(n[:, None], p[None, :])
        shares = regular(columns, medium(self.layout, columns).tau, n, inner, real)
        return Regular(*(share.reshape(mu.shape) for share in shares))

    def save(self, path: str | Path) -> None:
        """Write the form to one file (npz), whole or not at all. Raises InputError where it cannot be written."""
        arrays = {name: np.asarray(getattr(self, name)) for name in ARRAYS}
        write(path, self.VERSION, {name: np.asarray(a.knots) for name, a in zip(_KNOTS, self.angles, strict=True)} | arrays, to_json(self))

    @classmethod
    def load(cls, path: str | Path) -> "CompactForm":
        """A form from its file. Raises InputError for a file that is none, or of another version."""
        arrays, text = read(path, cls.VERSION, (*_KNOTS, *ARRAYS))
        parts: dict[str, Any] = {**from_json(text, path), **arrays}
        parts["angles"] = tuple(Angles(parts.pop(name)) for name in _KNOTS)
        return cls(errors=Errors(**parts.pop("said")), **parts)

    def _weights(self, free: Mapping[str, Any]) -> tuple[list[Array], Array]:
        """Weights of the coefficients along each axis; whether all values are in range."""
        if set(free) != set(self.names):
            raise InputError(f"free = {', '.join(map(str, free)) or 'nothing'}; needed is a value for each of {', '.join(self.names)}")
        inside, weights = jnp.asarray(True), []
        for axis in self.axes:
            share = axis.share(free[axis.name])
            inside = inside & (share >= -1e-9) & (share <= 1.0 + 1e-9)
            weights.append(basis(share, axis.knots, axis.degree))
        return weights, inside

    def _columns(self, free: Mapping[str, Any]) -> Columns:
        return to_columns(self.stack.set({name: jnp.asarray(value, dtype=float) for name, value in free.items()}), rough_faces=self.rough)

    def _kernel(self, C: Float[Array, "k j l"], mu_out: Any, mu_in: Any, azimuth: Any, grazing: bool, sides: tuple[int, int]) -> Array:
        out, into, phi = jnp.broadcast_arrays(_cosine(mu_out), _cosine(mu_in), jnp.asarray(azimuth, dtype=float))
        a, b = self.angles[sides[0]].rows(out, self.orders), self.angles[sides[1]].rows(into, self.orders)
        order = np.arange(self.orders).reshape(-1, *(1,) * phi.ndim)
        value = jnp.sum(jnp.einsum("k...j,kjl,k...l->k...", a, C, b) * jnp.cos(order * phi), axis=0)
        return value / (out + into) if grazing else value

    def _hemispherical(self, C: Float[Array, "k j l"], mu: Float[Array, "*s"], grazing: bool, sides: tuple[int, int]) -> Float[Array, "*s"]:
        """Integral of the kernel over the directions of its rows, with their cosine."""
        node, weight = self.angles[sides[0]].quadrature()
        value = basis(mu, self.angles[sides[1]].knots, 3) @ (basis(node, self.angles[sides[0]].knots, 3) @ C[0]).T
        if grazing:
            value = value / (mu[..., None] + node)
        return 2.0 * jnp.pi * value @ (node * weight)


def _contract(C: Float[AnyArray, "*c"], weights: list[Array]) -> Array:
    for weight in reversed(weights):
        C = C @ weight
    return C


def _cosine(mu: Any) -> Array:
    """Cosines, NaN outside 0 to 1; InputError where they are known."""
    mu = jnp.asarray(mu, dtype=float)
    inside = (mu >= 0.0) & (mu <= 1.0)
    if not isinstance(inside, Tracer) and not bool(jnp.all(inside)):
        raise InputError(f"a cosine of {mu.ravel()[int(jnp.argmin(inside.ravel()))]:g} was given; allowed is 0 to 1")
    return jnp.where(inside, mu, jnp.nan)
