"""The multipole of Donner & Jensen 2005 (DJ05) in closed form, and layers of it composed by frequency-space Kubelka-Munk."""

from typing import ClassVar, Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..errors import InputError, one_of
from ..measurement.geometry import Geometry, Total
from ..optics.hankel import Span
from ..optics.special import expc, log_cosh, tanhc
from ..scene.columns import Columns
from ..scene.layer import HalfSpace
from ..scene.stack import Stack
from ..solver import Domain
from .diffusion_layer import decay_rate, exponential_source_layer
from .diffusion_limits import check_aperture, diffusion_notes
from .faces import Reflection, beam_reflectance, face
from .images import Images
from .response import Beamed, Response, Scalar, between, compose, compose_all, reflection
from .spectral import SpectralSolver, Spectrum, aperture, by_frequency


class Multipole(SpectralSolver):
    """DJ05: each layer is a slab with an array of dipoles, and layers compose as scalars in spatial frequency.

    A source of strength alpha' at height z contributes alpha'/2 sign(z) exp(-gamma |z|) at frequency k, gamma^2 = k^2 + sigma_tr^2, so that the
    infinite array of images (eqs 11 to 16) is a geometric series with the sum, L = d + zb0 + zb1 and l = 1/sigma_t',

        R(k) = alpha' sinh(gamma (d + zb1 - l)) cosh(gamma zb0)/sinh(gamma L)
        T(k) = alpha' sinh(gamma (l + zb0))     cosh(gamma zb1)/sinh(gamma L)

    without truncation. From below zb0 and zb1 are exchanged. Layers compose by eqs 21 and 22. Everything that leaves a layer enters the next as
    if it were the incident beam: this, and not the multipole, limits the method for several layers.

    Arguments
    ---------
    source : "point" (published) needs every layer at least one transport mean free path l thick: a thinner one would have its source outside, and
        is refused. "exponential" has no such limit; the unscattered part of the beam then counts as transmitted.
    reflection : "exact" Fresnel moments, or "egan-hilgeman": the polynomial of the paper.
    subtract : take the first dipole out of the spectrum and add it in closed form; the result is the same, distant values keep more digits.

    >>> import layerfit as lf
    >>> slab = lf.Stack([lf.Layer("slab", sigma_a=0.001196, sigma_s_prime=0.998804, n=1, thickness=10)])
    >>> [float(p.values[0].round(5)) for p in lf.predict(slab, [lf.TotalReflectance(), lf.TotalTransmittance()], solver=lf.Multipole())]
    [0.83539, 0.13651]
    """

    name: ClassVar[str] = "multipole"
    references: ClassVar[tuple[str, ...]] = ("C. Donner, H. W. Jensen, ACM Trans. Graph. 24, 1032 (2005)",)
    source: Literal["point", "exponential"] = eqx.field(default="point", static=True)
    reflection: Reflection = eqx.field(default="exact", static=True)
    subtract: bool = eqx.field(default=True, static=True)

    def __check_init__(self):
        one_of(self.source, ("point", "exponential"), f"{type(self).__name__}: source")
        one_of(self.reflection, get_args(Reflection), f"{type(self).__name__}: reflection")

    def check(self, stack: Stack, geometry: Geometry) -> None:
        check_normal_incidence(self.name, geometry)
        check_aperture(stack, geometry)
        for layer in stack.layers:
            if float(layer.sigma_s_prime) == 0.0:
                raise InputError(f"layer '{layer.name}' is clear (sigma_s' = 0): diffusion does not describe it; use a transport solver")
            if self.source == "point" and not isinstance(layer, HalfSpace):
                l, d = float(layer.transport_mfp), float(layer.thickness)
                if d < l * (1.0 - 1e-12):
                    raise InputError(
                        f"layer '{layer.name}' is outside the range of solver multipole: its thickness {d:g} mm is below one transport mean free "
                        f"path, {l:.4g} mm, and the source would lie outside it; allowed is {l:.4g} mm or more, or another solver"
                    )

    def notes(self, stack: Stack, geometry: Geometry) -> tuple[str, ...]:
        return diffusion_notes(stack)

    def response(self, columns: Columns, k: Float[Array, "*k"]) -> Response[Scalar]:
        """The four operators of the whole sample for light that has passed the first surface."""
        return compose_all([self._layer(slab, k) for slab in slabs(columns, self.reflection)])

    def _layer(self, slab: "_Slab", k: Float[Array, "*k"]) -> Response[Scalar]:
        """One layer between its neighbours."""
        q = k**2 + slab.sigma_a / slab.D
        if slab.d is None:
            half = half_space_dipole(slab, q) if self.source == "point" else half_space_line(slab, q)
            zero = jnp.zeros_like(k)
            return Response(Scalar(half), Scalar(zero), Scalar(zero), Scalar(zero))
        if self.source == "exponential":
            return _exponential_slab(slab, q, slab.d)
        R_above, T_down = _point_slab(slab.alpha, slab.l, slab.zb0, slab.zb1, q, slab.d)
        R_below, T_up = _point_slab(slab.alpha, slab.l, slab.zb1, slab.zb0, q, slab.d)
        return Response(Scalar(R_above), Scalar(R_below), Scalar(T_down), Scalar(T_up))

    def spectrum(self, columns: Columns, k: Float[Array, "k"], geometry: Geometry, *, without_images: bool = False) -> Spectrum:
        # what stays of the beam at all frequencies leaves where it entered
        ballistic = self.source == "exponential" and geometry.side == "below" and not columns.half_space
        unscattered = jnp.exp(-jnp.sum(columns.sigma_t_prime * columns.thickness)) if ballistic else jnp.zeros(())

        def leaving(layers: tuple[_Slab, ...], k: Float[Array, "*k"]) -> Float[Array, "*k"]:
            if without_images:
                return self._beyond_images(layers, k)
            pieces = [self._layer(slab, k) for slab in layers]
            return (reflection(pieces) if geometry.side == "above" else compose_all(pieces).T_down).value

        share = entering_share(columns) * collected_share(columns, geometry)
        diffuse = by_frequency(leaving, slabs(columns, self.reflection), k) - unscattered
        return Spectrum(share * diffuse, share * unscattered, 1.0 - entering_share(columns))

    def _beyond_images(self, layers: "tuple[_Slab, ...]", k: Float[Array, "*k"]) -> Float[Array, "*k"]:
        """The reflected spectrum less the first dipole."""
        first = layers[0]
        if first.d is None:
            return jnp.zeros_like(k)
        more = _slab_beyond_dipole(first, k**2 + first.sigma_a / first.D, first.d)
        if len(layers) == 1:
            return more
        upper, lower = self._layer(first, k), reflection([self._layer(slab, k) for slab in layers[1:]])
        return more + (upper.T_up @ lower @ between(upper, lower)).value

    def images(self, columns: Columns, geometry: Geometry) -> Images | None:
        if not self.subtract or self.source != "point" or geometry.side == "below":
            return None
        slab = slabs(columns, self.reflection)[0]
        flux = 0.5 * slab.alpha * entering_share(columns) * collected_share(columns, geometry)
        z = jnp.stack([slab.l, slab.l + 2.0 * slab.zb0])
        return Images(z, flux * jnp.ones(2), jnp.zeros(2), decay_rate(slab.sigma_a / slab.D))

    def span(self, domain: Domain) -> Span:
        low, high = domain.low, domain.high
        extinction = float(np.max(high.sigma_t_prime))
        k_low = float(np.min(low.sigma_tr))
        k_high = 38.0 * extinction
        if low.thickness.shape[0] > 0:  # the source's distance from the lower face
            l = 1.0 / np.asarray(high.sigma_t_prime)[: low.thickness.shape[0]]
            gap = float(np.min(np.where(low.thickness > l, low.thickness - l, 0.1 * l)))
            k_high = max(k_high, 38.0 / max(gap, 1e-4 / extinction))
        return Span(k_low, k_high, self.source == "exponential")


class Dipole(SpectralSolver):
    """One half space: the dipole of Jensen et al. 2001, the multipole without a lower face.

    reflection : "exact" Fresnel moments, or "egan-hilgeman", the polynomial of DJ05.
    """

    name: ClassVar[str] = "dipole"
    references: ClassVar[tuple[str, ...]] = ("H. W. Jensen, S. R. Marschner, M. Levoy, P. Hanrahan, Proc. SIGGRAPH 2001, 511",)
    reflection: Reflection = eqx.field(default="exact", static=True)

    def __check_init__(self):
        one_of(self.reflection, get_args(Reflection), "Dipole: reflection")

    def _multipole(self) -> Multipole:
        return Multipole(reflection=self.reflection)

    def check(self, stack: Stack, geometry: Geometry) -> None:
        if len(stack.layers) != 1 or not stack.half_space:
            raise InputError(
                f"solver dipole: the scene has layers {', '.join(layer.name for layer in stack.layers)}; allowed is one half space alone"
            )
        self._multipole().check(stack, geometry)

    def notes(self, stack: Stack, geometry: Geometry) -> tuple[str, ...]:
        return diffusion_notes(stack)

    def spectrum(self, columns: Columns, k: Float[Array, "k"], geometry: Geometry, *, without_images: bool = False) -> Spectrum:
        return self._multipole().spectrum(columns, k, geometry, without_images=without_images)

    def images(self, columns: Columns, geometry: Geometry) -> Images | None:
        return self._multipole().images(columns, geometry)

    def span(self, domain: Domain) -> Span:
        return self._multipole().span(domain)


class _Slab(eqx.Module):
    """The constants of one layer: l = 1/sigma_t', D = l/3, zb = 2 A D of both faces, thickness (None: half space)."""

    sigma_a: Float[Array, "*copies"]
    sigma_s_prime: Float[Array, "*copies"]
    l: Float[Array, "*copies"]
    D: Float[Array, "*copies"]
    zb0: Float[Array, "*copies"]
    zb1: Float[Array, "*copies"]
    d: Float[Array, "*copies"] | None

    @property
    def alpha(self) -> Float[Array, "*copies"]:
        """alpha' = sigma_s'/sigma_t'."""
        return self.sigma_s_prime * self.l


def slabs(columns: Columns, reflection: Reflection) -> tuple[_Slab, ...]:
    """Each layer with the extrapolation lengths that its neighbours' indices give it (DJ05: eta = n/n_neighbour at each face)."""
    n = [columns.n_above, *columns.n, columns.n_below]
    faces = columns.roughness.shape[0]

    def A(i: int, neighbour: Float[Array, ""], between: int) -> Float[Array, ""]:
        return face(columns.n[i], neighbour, columns.roughness[between], smooth=columns.smooth[between], reflection=reflection).A

    layers = []
    for i in range(columns.count):
        l = 1.0 / columns.sigma_t_prime[i]
        D = l / 3.0
        zb0 = 2.0 * D * A(i, n[i], i)
        finite = i + 1 < faces
        zb1 = 2.0 * D * A(i, n[i + 2], i + 1) if finite else zb0
        d = columns.thickness[i] if finite else None
        layers.append(_Slab(columns.sigma_a[i], columns.sigma_s_prime[i], l, D, zb0, zb1, d))
    return tuple(layers)


def entering_share(columns: Columns) -> Float[Array, ""]:
    """Share of a beam at normal incidence that passes the first surface."""
    n = columns.n[0] / columns.n_above
    return 1.0 - beam_reflectance(jnp.ones(()), n, columns.roughness[0], smooth=columns.smooth[0])


def _point_slab(
    alpha: Float[Array, "*#k"],
    l: Float[Array, "*#k"],
    zb0: Float[Array, "*#k"],
    zb1: Float[Array, "*#k"],
    q: Float[Array, "*k"],
    d: Float[Array, "*#k"],
) -> tuple[Float[Array, "*k"], Float[Array, "*k"]]:
    """R and T of a slab for light from the side of zb0, as even functions of gamma without growing exponentials."""
    L = d + zb0 + zb1
    whole = L * tanhc(q * L**2)

    def part(x: Float[Array, "*copies"], zb: Float[Array, "*copies"]) -> Float[Array, "*s"]:
        # sinh(gamma x) cosh(gamma zb)/sinh(gamma L)
        return x * tanhc(q * x**2) / whole * jnp.exp(log_cosh(q * x**2) + log_cosh(q * zb**2) - log_cosh(q * L**2))

    return alpha * part(d + zb1 - l, zb0), alpha * part(l + zb0, zb1)


def half_space_dipole(slab: _Slab, q: Float[Array, "*k"]) -> Float[Array, "*k"]:
    """R(k) of a half space, point source: alpha' (exp(-gamma l) + exp(-gamma (l + 2 zb)))/2."""
    gamma = decay_rate(q)
    return 0.5 * slab.alpha * jnp.exp(-gamma * slab.l) * (1.0 + jnp.exp(-2.0 * gamma * slab.zb0))


def _slab_beyond_dipole(slab: _Slab, q: Float[Array, "*k"], d: Float[Array, "*#k"]) -> Float[Array, "*k"]:
    """R of a slab less that of the half space, as a product: minus the dipole times
    exp(-2 gamma (d + zb1 - l)) (1 - exp(-2 gamma (zb0 + l)))/(1 - exp(-2 gamma L))."""
    gamma = decay_rate(q)
    L = d + slab.zb0 + slab.zb1
    ratio = (slab.zb0 + slab.l) / L * expc(2.0 * gamma * (slab.zb0 + slab.l)) / expc(2.0 * gamma * L)
    return -half_space_dipole(slab, q) * jnp.exp(-2.0 * gamma * (d + slab.zb1 - slab.l)) * ratio


def half_space_line(slab: _Slab, q: Float[Array, "*k"]) -> Float[Array, "*k"]:
    """R(k) of a half space, source sigma_s' exp(-sigma_t' z)."""
    gamma = decay_rate(q)
    return 0.5 * slab.sigma_s_prime / (gamma + 1.0 / slab.l) * (1.0 + jnp.exp(-2.0 * gamma * slab.zb0))


def _exponential_slab(slab: _Slab, q: Float[Array, "*k"], d: Float[Array, "*#k"]) -> Response[Scalar]:
    """A slab with a source along the beam: an exact diffusion layer between two extrapolated boundaries, exitance equal to the flux there."""
    one = jnp.ones_like(q)
    inner = exponential_source_layer(slab.D * one, q, d * one, one / slab.l, slab.sigma_s_prime * one)

    def boundary(zb: Float[Array, "*#k"]) -> Response[Beamed]:
        ratio = zb / (2.0 * slab.D) * tanhc(q * zb**2)  # phi/(2 J)
        zero = jnp.zeros_like(q)
        through = Beamed(2.0 / (ratio + 1.0), zero, one)
        return Response(Beamed(zero, zero, zero), Beamed((ratio - 1.0) / (ratio + 1.0), zero, zero), through, through)

    whole = compose(boundary(slab.zb0), compose(inner, boundary(slab.zb1).reversed()))
    return jax.tree.map(lambda o: Scalar(o.source + o.beam), whole, is_leaf=lambda x: isinstance(x, Beamed))


def collected_share(columns: Columns, geometry: Geometry) -> Float[Array, ""]:
    """Share of the exitance within the detector's aperture, its angles as in DJ05 eq 2: proportional to the Fresnel transmittance."""
    na = aperture(geometry)
    if na is None:
        return jnp.ones(())
    inside, outside = (columns.n[0], columns.n_above) if geometry.side == "above" else (columns.n[-1], columns.n_below)
    all_directions = face(inside, outside, jnp.zeros(()), smooth=True)
    return face(inside, outside, jnp.zeros(()), smooth=True, na=na).exit_fluence / all_directions.exit_fluence


def check_normal_incidence(name: str, geometry: Geometry) -> None:
    """Raise InputError for oblique or diffuse incidence."""
    if isinstance(geometry, Total) and geometry.incidence not in ("normal", 0, 0.0):
        raise InputError(f'solver {name}: incidence = {geometry.incidence!r}; allowed is "normal" (solver layered-diffusion takes others)')
