"""Exact diffusion in N layers, at each spatial frequency."""

from typing import ClassVar, Literal, get_args

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer
from jaxtyping import Float

from ..errors import InputError, one_of
from ..measurement.geometry import Geometry
from ..optics.diffusion import DiffusionCoefficient, diffusion_coefficient, exponential_share
from ..optics.fresnel import reflectance
from ..optics.hankel import Span
from ..optics.special import tanhc
from ..scene.columns import Columns
from ..scene.stack import Stack
from ..solver import Domain
from .beam import point_sources, refracted, seen_from_above, seen_from_below
from .diffusion_error import known_error
from .diffusion_layer import decay_rate
from .diffusion_limits import check_aperture, diffusion_notes
from .diffusion_pieces import Numbers, beam_alone, first_boundary, first_medium, half_space_piece, interface_piece, layer_piece
from .faces import beam_reflectance, face
from .images import Images
from .response import Beamed, Response, compose, compose_all, excess_reflection, reflection
from .spectral import SpectralSolver, Spectrum, aperture, by_frequency, over_incidence

SourceModel = Literal["mixed", "point", "exponential"]
Boundary = Literal["averaged", "extrapolated", "partial_current"]


class LayeredDiffusion(SpectralSolver):
    """Diffusion of light in any number of layers, solved exactly at each spatial frequency.

    Across faces phi/n^2 and D phi' are continuous. What is approximate is diffusion itself: near the source (below about 2 transport mean
    free paths), in thin and in strongly absorbing layers it is wrong by tens of percent; clear layers are refused. See the error map in the
    documentation.

    Arguments
    ---------
    source : where the beam turns into diffuse light.
        "point": all that is scattered, at the mean transport optical depth (1 for a thick sample) in whichever layer that lies.
        "exponential": along the beam, sigma_s' exp(-integral of sigma_t').
        "mixed" (default): the mixture of both that has the quadrupole moment of transport theory (see `optics.diffusion`); a layer of unknown
        g counts as strongly forward scattering, for which the mixture is the point.
    boundary : "extrapolated": phi = 0 at zb = 2 A D beyond the face; "partial_current": phi = 2 A J at the face; "averaged" (default): the mean
        of both ratios phi/J. With the partial-current boundary the exitance equals the flux and energy is conserved exactly.
    diffusion : the coefficient D, one of "asymptotic" (default), "transport", "scattering", "grosjean" (see `optics.diffusion`).
    subtract : take the source nearest to the face and its image out of the spectrum and add them in closed form (point source and
        extrapolated boundary only; the others have no image in closed form). The result is the same; distant values keep more digits.

    The defaults were chosen by comparing all variants with Monte Carlo: see the documentation.

    >>> import layerfit as lf
    >>> skin = lf.Layer("top", sigma_a=0.02, sigma_s=20, g=0.9, n=1.4, thickness=1.5) | lf.HalfSpace("fat", sigma_a=0.005, sigma_s=12, g=0.9, n=1.44)
    >>> lf.predict(skin, lf.TotalReflectance(), solver=lf.LayeredDiffusion())[0].values.round(4)
    array([0.6358])
    """

    name: ClassVar[str] = "layered-diffusion"
    references: ClassVar[tuple[str, ...]] = (
        "T. J. Farrell, M. S. Patterson, B. Wilson, Med. Phys. 19, 879 (1992)",
        "A. Kienle et al., Appl. Opt. 37, 779 (1998)",
        "R. Aronson, N. Corngold, J. Opt. Soc. Am. A 16, 1066 (1999)",
    )
    source: SourceModel = eqx.field(default="mixed", static=True)
    boundary: Boundary = eqx.field(default="averaged", static=True)
    diffusion: DiffusionCoefficient = eqx.field(default="asymptotic", static=True)
    subtract: bool = eqx.field(default=True, static=True)

    def __check_init__(self):
        one_of(self.source, get_args(SourceModel), "LayeredDiffusion: source")
        one_of(self.boundary, get_args(Boundary), "LayeredDiffusion: boundary")
        one_of(self.diffusion, get_args(DiffusionCoefficient), "LayeredDiffusion: diffusion")

    def check(self, stack: Stack, geometry: Geometry) -> None:
        for layer in stack.layers:
            if not isinstance(layer.sigma_s_prime, Tracer) and float(layer.sigma_s_prime) == 0.0:
                raise InputError(
                    f"layer '{layer.name}' is clear (sigma_s' = 0): light walks sideways there, which diffusion does not describe; "
                    "use a transport solver, or leave the layer out"
                )
        check_aperture(stack, geometry)

    def notes(self, stack: Stack, geometry: Geometry) -> tuple[str, ...]:
        return diffusion_notes(stack)

    def coefficient(self, columns: Columns) -> Float[Array, "layers"]:
        """D of each layer [mm]."""
        g = jnp.where(jnp.asarray(columns.g_unknown), 1.0, columns.g)
        return diffusion_coefficient(self.diffusion, columns.sigma_a, columns.sigma_s_prime, g)

    def shares(self, columns: Columns) -> Float[Array, "layers"] | None:
        """Share of the exponential source in each layer; None where it is 0 everywhere by construction."""
        if not self._spread(columns):
            return None
        if self.source == "exponential":
            return jnp.ones_like(columns.g)
        return jnp.where(jnp.asarray(columns.g_unknown), 0.0, exponential_share(columns.g))

    def _spread(self, columns: Columns) -> bool:
        """Whether part of the source follows the beam."""
        return self.source == "exponential" or (self.source == "mixed" and not all(columns.g_unknown))

    def ratio(self, q: Float[Array, "*s"], A: Float[Array, "*#s"], D: Float[Array, "*#s"]) -> Float[Array, "*s"]:
        """phi/(2 J) at a face, J outward: A for the partial current, A tanh(gamma zb)/(gamma zb) for the extrapolated boundary."""
        if self.boundary == "partial_current":
            return A * jnp.ones_like(q)
        extrapolated = A * tanhc(q * (2.0 * A * D) ** 2)
        return extrapolated if self.boundary == "extrapolated" else 0.5 * (A + extrapolated)

    def numbers(
        self, columns: Columns, *, mu: Float[Array, ""] | float = 1.0, na_above: float | None = None, na_below: float | None = None
    ) -> Numbers:
        """All that the spectrum needs of a stack and does not depend on k.

        mu : cosine of incidence in the medium above.
        """
        D = self.coefficient(columns)
        cosines = refracted(columns, mu)
        share = self.shares(columns)
        zero = jnp.zeros_like(columns.sigma_a)
        fed = zero if share is None else share * columns.sigma_s_prime / cosines
        planes = point_sources(columns, cosines, share) if self.source != "exponential" else ((zero, zero), (zero, zero))
        # a point source stands for a beam that crosses the whole sample; reflections inside (a few 1e-4) would start beams it does not feed
        inner = reflectance(cosines[:-1], columns.n[:-1] / columns.n[1:]) if self.source == "exponential" else zero[1:]
        outside = [(columns.n_above, 0, na_above)] + ([] if columns.half_space else [(columns.n_below, -1, na_below)])
        optics = [face(columns.n[i], n_outside, columns.roughness[i], smooth=columns.smooth[i], na=na) for n_outside, i, na in outside]
        seen = [seen_from_above(columns)] + ([] if columns.half_space else [seen_from_below(columns)])
        edge_beams = [
            beam_reflectance(cosines[i], columns.n[i] / n_outside, columns.roughness[i], smooth=columns.smooth[i]) for n_outside, i, _ in outside
        ]
        return Numbers(
            N=tuple(columns.n**2 * D),
            decay2=tuple(columns.sigma_a / D),
            thickness=tuple(columns.thickness),
            extinction=tuple(columns.sigma_t_prime / cosines),
            fed=tuple(fed),
            down=(tuple(planes[0][0]), tuple(planes[0][1])),
            up=(tuple(planes[1][0]), tuple(planes[1][1])),
            inner_beam=tuple(inner),
            edge_beam=tuple(edge_beams),
            edge_A=tuple(o.A for o in optics),
            edge_D=tuple(jnp.sum(w * D) for w in seen),
            edge_decay2=tuple(jnp.sum(w * columns.sigma_a) / jnp.sum(w * D) for w in seen),
            edge_n2=tuple(columns.n[i] ** 2 for _, i, _ in outside),
            exit_fluence=tuple(o.exit_fluence for o in optics),
            exit_flux=tuple(o.exit_flux for o in optics),
            half_space=columns.half_space,
            spread=share is not None,
            pointed=self.source != "exponential",
        )

    def pieces(self, numbers: Numbers, k: Float[Array, "*k"]) -> list[Response[Beamed]]:
        """Responses from top to bottom: face, layer, (interface, layer) ..., face.

        The diffuse channels are the partial currents of `diffusion_layer`.
        """
        one = jnp.ones_like(k)
        pieces = [self._face(numbers, 0, k)]
        for i in range(len(numbers.N)):
            if i > 0:
                pieces.append(interface_piece(numbers.inner_beam[i - 1] * one))
            if i < len(numbers.thickness):
                pieces.append(layer_piece(numbers, i, k))
            else:
                pieces.append(half_space_piece(numbers, i, k))
        if not numbers.half_space:
            pieces.append(self._face(numbers, 1, k).reversed())
        return pieces

    def _face(self, numbers: Numbers, side: int, k: Float[Array, "*k"]) -> Response[Beamed]:
        """An outer face, light coming from outside first."""
        A, n2 = numbers.edge_A[side], numbers.edge_n2[side]
        ratio = self.ratio(k**2 + numbers.edge_decay2[side], A, numbers.edge_D[side])
        inside = (ratio - n2) / (ratio + n2)
        leaving = 2.0 * n2 / (ratio + n2) * (2.0 * numbers.exit_fluence[side] * ratio + numbers.exit_flux[side])
        one = jnp.ones_like(k)
        beam = one * numbers.edge_beam[side]
        zero = jnp.zeros_like(k)
        through = Beamed(leaving, zero, one - beam)
        return Response(Beamed(one - leaving, zero, beam), Beamed(inside, zero, beam), through, through)

    def response(self, columns: Columns, k: Float[Array, "*k"], *, mu: Float[Array, ""] | float = 1.0) -> Response[Beamed]:
        """The four operators of the whole sample, its faces included."""
        return compose_all(self.pieces(self.numbers(columns, mu=mu), k))

    def spectrum(self, columns: Columns, k: Float[Array, "k"], geometry: Geometry, *, without_images: bool = False) -> Spectrum:
        na = aperture(geometry)
        na_above, na_below = (na, None) if geometry.side == "above" else (None, na)

        def diffuse(numbers: Numbers, k: Float[Array, "*k"]) -> Float[Array, "*k"]:
            if without_images:
                return self._beyond_images(numbers, k)
            pieces = self.pieces(numbers, k)
            return (reflection(pieces) if geometry.side == "above" else compose_all(pieces).T_down).source

        def at(mu: Float[Array, ""] | float) -> Spectrum:
            numbers = self.numbers(columns, mu=mu, na_above=na_above, na_below=na_below)
            beam = beam_alone(numbers)
            specular = numbers.edge_beam[0]
            unscattered = beam.R_above.value - specular if geometry.side == "above" else beam.T_down.value
            return Spectrum(by_frequency(diffuse, numbers, k), unscattered, specular)

        return over_incidence(at, geometry)

    def _beyond_images(self, numbers: Numbers, k: Float[Array, "*k"]) -> Float[Array, "*k"]:
        """The reflected spectrum less that of a half space of the first medium, which is what `images` describes."""
        if len(numbers.thickness) == 0:
            return jnp.zeros_like(k)
        pieces = self.pieces(numbers, k)
        reference = first_medium(numbers, k)
        more = excess_reflection(compose(*pieces[:2]), reflection(pieces[2:]), reference).source
        if len(numbers.N) == 1:
            return more
        textbook = self.pieces(first_boundary(numbers), k)
        below = Response(reference, reference.zero(), reference.zero(), reference.zero())
        return more + (reflection([*pieces[:2], below]) - reflection([*textbook[:2], below])).source

    def relative_error(self, columns: Columns, geometry: Geometry) -> np.ndarray | None:
        return known_error(columns, geometry)

    def images(self, columns: Columns, geometry: Geometry) -> Images | None:
        if not self.subtract or self.boundary != "extrapolated" or self._spread(columns) or geometry.side == "below":
            return None
        numbers = self.numbers(columns, na_above=aperture(geometry))
        (strength, depth), D = numbers.down, first_boundary(numbers).edge_D[0]
        power = strength[0] * (1.0 - numbers.edge_beam[0])
        return Images(
            z=jnp.stack([depth[0], depth[0] + 4.0 * numbers.edge_A[0] * D]),
            flux=0.5 * power * numbers.exit_flux[0] * jnp.ones(2),
            fluence=0.5 * power * numbers.exit_fluence[0] / D * jnp.array([1.0, -1.0]),
            sigma=decay_rate(numbers.decay2[0]),
        )

    def span(self, domain: Domain) -> Span:
        low, high = domain.low, domain.high
        extinction = float(np.max(high.sigma_t_prime))
        # every definition of D is near 1/(3 sigma_t') or above it; half of that decay is a safe lower limit
        k_low = 0.5 * float(np.min(low.sigma_tr))
        thickness = float(np.sum(low.thickness)) if not low.half_space else np.inf
        source_depth = min(1.0 / extinction, 0.5 * max(thickness, 1e-9 / extinction))
        k_high = 38.0 / source_depth
        tail = self._spread(high)
        if tail and low.thickness.shape[0] > 0:  # the tail belongs to the outermost layers alone
            ends = (low.thickness[0], low.thickness[-1])
            k_high = max(k_high, 20.0 / max(float(min(ends)), 1e-6 / extinction))
        return Span(k_low, k_high, tail)
