"""Light scattered once that leaves without another reflection, under a pencil beam at normal incidence.

It carries all the fine structure near the source: its spectrum falls as 1/k. Discrete ordinates get it wrong there, so that what they make of it is
taken out (`spectrum` of a `Path` over their directions and azimuths) and its exact value put in (`profile`, or `spectrum` of a fine `Path`).
The extinction is that of delta-M, the phase function the exact one.

References
----------
T. Nakajima, M. Tanaka, J. Quant. Spectrosc. Radiat. Transfer 40, 51 (1988), eq 22.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..arrays import AnyArray
from ..optics.phase import henyey_greenstein, legendre_series
from ..scene.columns import Columns
from .crossing import Crossing
from .discrete_ordinates_interface import fresnel_shares
from .frequency_layer import Closing, Sheet
from .ordinate_stack import Grid, Layout, Medium


class Path(eqx.Module):
    """What happens to the beam and to once-scattered light, by layer and direction of exit.

    strength : light scattered per depth in each layer into each direction, all attenuation left out [1/mm]. faces : share of it that passes the face
    which it meets after the layer, or is collected there. out, beam : attenuation of the two [1/mm]. tangent : of the direction. thickness : [mm].
    """

    strength: Float[AnyArray, "layers d"]
    faces: Float[AnyArray, "layers d"]
    out: Float[AnyArray, "layers d"]
    beam: Float[AnyArray, "layers"]
    tangent: Float[AnyArray, "layers d"]
    thickness: Float[AnyArray, "finite"]
    above: bool = eqx.field(static=True)

    def flights(self) -> list[tuple[int, list[int]]]:
        """Each layer and the layers that its light still has to cross, in this order."""
        count = self.strength.shape[0]
        return [(i, list(reversed(range(i))) if self.above else list(range(i + 1, count))) for i in range(count)]

    def leaving(self, i: int, ahead: list[int]) -> Float[Array, "d"]:
        """Strength of layer i's light when it has left the stack."""
        return self.strength[i] * jnp.prod(self.faces[np.array([i, *ahead])], axis=0)

    def entered(self, i: int) -> Float[Array, ""]:
        """Optical thickness that the beam has crossed when it gets to layer i."""
        return jnp.sum(self.beam[:i] * self.thickness[:i])

    def emitted(self, i: int, wave: Array) -> Array:
        """Integral over the depth of layer i, of the beam there and what its light still meets in this layer. wave : phase a depth (d, modes)."""
        out = self.out[i][:, None] + wave
        if i >= self.thickness.shape[0]:
            return 1.0 / (self.beam[i] + out)
        t, beam = self.thickness[i], self.beam[i] + 0.0 * out
        ends = (0.0 * out, beam + out) if self.above else (out, beam)  # exponents of light scattered first and last
        rate = ends[1] - ends[0]
        small = jnp.abs(rate * t) < 1e-5
        integral = (jnp.exp(-ends[0] * t) - jnp.exp(-ends[1] * t)) / jnp.where(small, 1.0, rate)
        return jnp.where(small, t * jnp.exp(-ends[0] * t) * (1.0 - 0.5 * rate * t), integral)


def ordinate_path(columns: Columns, grid: Grid, numbers: Medium, sheets: tuple[Sheet, ...], collected: Float[Array, "n"], above: bool) -> Path:
    """What the ordinates make of it: their own phase function, their own few orders."""
    n = collected.shape[0]
    fed = jnp.stack([0.5 * (sheet.q - sheet.p if above else sheet.q + sheet.p) for sheet in sheets])
    return _path(columns, numbers, grid.mu[:, :n], grid.real[:, :n], grid.rule.n, fed, above, collected)


def exact_path(columns: Columns, numbers: Medium, layout: Layout, na: float | None, above: bool, directions: int) -> Path:
    """A fine rule over the directions of exit, with the exact phase function."""
    u, w = np.polynomial.legendre.leggauss(directions)
    angle = 0.25 * np.pi * (u + 1.0)
    largest = jnp.minimum(columns.n_above, columns.n[0]) if above else jnp.minimum(columns.n_below, columns.n[-1])
    if na is not None:
        largest = jnp.minimum(largest, na)
    p = largest * np.sin(angle)
    dp = 0.25 * np.pi * w * largest * np.cos(angle)
    below = [] if columns.half_space else [columns.n_below[None]]
    n = jnp.concatenate([columns.n_above[None], columns.n, *below])
    mu = jnp.sqrt(jnp.maximum((n[:, None] - p) * (n[:, None] + p), 1e-24)) / n[:, None]
    real = p < n[:, None]
    strength = []
    for i in range(columns.count):
        cosine = -mu[i + 1] if above else mu[i + 1]
        table = layout.tables[i]
        phase = henyey_greenstein(cosine, columns.g[i]) if table is None else legendre_series(cosine, np.array(table))
        scattering = columns.sigma_s_prime[i] / (1.0 - columns.g[i])
        strength.append(0.5 * scattering * phase * p * dp / (columns.n[i] ** 2 * mu[i + 1]))
    return _path(columns, numbers, mu, real, n, jnp.stack(strength), above, 1.0)


def even_azimuths(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Cosines of azimuths, times i, with their weights."""
    return 1j * np.cos((np.arange(count) + 0.5) * np.pi / count), np.full(count, 1.0 / count)


def _path(columns: Columns, numbers: Medium, mu, real, n, strength, above: bool, collected: Float[AnyArray, "d"] | float) -> Path:
    """With the faces on the way: the beam's to the layer, the light's from it."""
    count = columns.count
    one = jnp.ones(1)

    def through(i: int, mu_i, mu_j, real_i, real_j):
        if not columns.smooth[i]:
            return jnp.zeros_like(mu_i)  # a rough face lets no beam through
        return fresnel_shares(n[i], n[i + 1], mu_i, mu_j, real_i, real_j)[2]

    crossed = [through(i, mu[i], mu[i + 1], real[i], real[i + 1]) for i in range(len(n) - 1)]
    straight = [through(i, one, one, one > 0, one > 0) for i in range(len(n) - 1)]
    rows = [strength[i] * jnp.prod(jnp.concatenate(straight[: i + 1])) * real[i + 1] for i in range(count)]
    crossed = crossed[:count] if above else [*crossed[1:], *[jnp.zeros(mu.shape[1])] * columns.half_space]
    crossed[0 if above else count - 1] = crossed[0 if above else count - 1] * collected
    inside = slice(1, count + 1)
    tangent = jnp.where(real[inside], jnp.sqrt(jnp.maximum(1.0 - mu[inside] ** 2, 0.0)) / mu[inside], 0.0)
    sigma = numbers.extinction
    return Path(jnp.stack(rows), jnp.stack(crossed), sigma[:, None] / mu[inside], sigma, tangent, columns.thickness, above)


def spectrum(path: Path, k: Float[Array, ""], modes: AnyArray, shares: AnyArray) -> Float[Array, ""]:
    """At spatial frequency k. modes, shares : of azimuths."""
    wave = k * path.tangent[:, :, None] * modes  # layers, directions, azimuths
    total = jnp.zeros(())
    for i, ahead in path.flights():
        lost = path.entered(i) + sum(((path.out[j][:, None] + wave[j]) * path.thickness[j] for j in ahead), jnp.zeros(()))
        total = total + path.leaving(i, ahead) @ jnp.sum(path.emitted(i, wave[i]) * jnp.exp(-lost) * shares, axis=-1).real
    return total


def spectrum_of_ordinates(path: Path, k: Float[Array, ""], closing: Closing, crossings: list[Crossing]) -> Float[Array, ""]:
    """What ordinates make of it, with their chain of azimuthal orders and the same crossings as their other light."""
    total = jnp.zeros(())
    for i, ahead in path.flights():
        emitted = path.emitted(i, k * path.tangent[i][:, None] * closing.modes) * closing.inverse[:, :, 0]
        light = jnp.einsum("nom,nm->on", closing.vectors, emitted).real * path.strength[i] * path.faces[i]
        for j in ahead:
            light = crossings[j](light) * path.faces[j]
        total = total + jnp.exp(-path.entered(i)) * jnp.sum(light[0])
    return total


def profile(path: Path, low: Float[AnyArray, "rings"], high: Float[AnyArray, "rings"]) -> Float[Array, "rings"]:
    """Mean over rings [1/mm^2], by one quadrature: for a direction of exit, depth and distance go together."""
    finite = path.thickness.shape[0]
    edges = jnp.stack([low, high])[:, :, None]
    total = jnp.zeros(low.shape[0])
    for i, ahead in path.flights():
        lost = path.entered(i) + sum((path.out[j] * path.thickness[j] for j in ahead), jnp.zeros(()))
        shift = sum((path.tangent[j] * path.thickness[j] for j in ahead), jnp.zeros(()))
        t = path.thickness[i] if i < finite else jnp.inf
        tangent = jnp.maximum(path.tangent[i], 1e-30)
        s = jnp.clip((edges - shift) / tangent, 0.0, t)  # depth in the layer, from the side of exit
        if path.above:
            rate, before = path.beam[i] + path.out[i], 0.0
        else:
            rate, before = path.out[i] - path.beam[i], path.beam[i] * t
        step = s[1] - s[0]
        x = rate * step
        small = jnp.abs(x) < 1e-5
        safe = jnp.where(small, 1.0, x)
        share = jnp.where(small, 1.0 - 0.5 * x, -jnp.expm1(-safe) / safe)
        along = jnp.exp(-rate * s[0] - before - lost) * jnp.where(jnp.isfinite(step), step, 1.0) * share
        total = total + along @ path.leaving(i, ahead)
    return total / (np.pi * (high - low) * (high + low))
