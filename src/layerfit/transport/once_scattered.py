"""Light scattered once that leaves without another reflection, under a pencil beam at normal incidence.

It carries all the fine structure near the source: its spectrum falls as 1/k. Discrete ordinates get it wrong there, so that what they make of it is
taken out (`spectrum` of a `Path` over their directions and azimuths) and its exact value put in (`profile`, or `spectrum` of a fine `Path`).
The extinction is that of delta-M, the phase function the exact one.

References
----------
T. Nakajima, M. Tanaka, J. Quant. Spectrosc. Radiat. Transfer 40, 51 (1988), eq 22.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..arrays import AnyArray
from ..optics.gauss import unit_gauss
from ..optics.phase import henyey_greenstein, legendre_series
from ..optics.special import expc
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


class Lit(eqx.Module):
    """What the exact part needs of a stack. na : of the detector, None where it takes all light."""

    columns: Columns
    numbers: Medium
    layout: Layout
    na: float | None = eqx.field(static=True)
    above: bool = eqx.field(static=True)

    @property
    def outwards(self) -> list[int]:
        """Finite layers from the side of exit on."""
        finite = list(range(self.columns.thickness.shape[0]))
        return finite if self.above else finite[::-1]

    def largest(self) -> Float[Array, ""]:
        """n sin(theta) up to which light is seen."""
        columns = self.columns
        largest = jnp.minimum(columns.n_above, columns.n[0]) if self.above else jnp.minimum(columns.n_below, columns.n[-1])
        return largest if self.na is None else jnp.minimum(largest, self.na)


def exact_path(lit: Lit, angle: Float[AnyArray, "d"], weight: Float[AnyArray, "d"]) -> Path:
    """With the exact phase function, for directions n sin(theta) = largest sin(angle) of any rule from 0 to pi/2."""
    columns, largest = lit.columns, lit.largest()
    p, dp = largest * jnp.sin(angle), weight * largest * jnp.cos(angle)
    below = [] if columns.half_space else [columns.n_below[None]]
    n = jnp.concatenate([columns.n_above[None], columns.n, *below])
    mu = jnp.sqrt(jnp.maximum((n[:, None] - p) * (n[:, None] + p), 1e-24)) / n[:, None]
    real = p < n[:, None]
    strength = []
    for i in range(columns.count):
        cosine = -mu[i + 1] if lit.above else mu[i + 1]
        table = lit.layout.tables[i]
        phase = henyey_greenstein(cosine, columns.g[i]) if table is None else legendre_series(cosine, np.array(table))
        scattering = columns.sigma_s_prime[i] / (1.0 - columns.g[i])
        strength.append(0.5 * scattering * phase * p * dp / (columns.n[i] ** 2 * mu[i + 1]))
    return _path(columns, lit.numbers, mu, real, n, jnp.stack(strength), lit.above, 1.0)


def even_directions(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Angles of `exact_path`, with their weights."""
    u, w = unit_gauss(count)
    return 0.5 * np.pi * u, 0.5 * np.pi * w


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


_PIECE = 24  # directions of each piece
_HALVINGS = 52


def profile(lit: Lit, low: Float[AnyArray, "rings"], high: Float[AnyArray, "rings"]) -> Float[Array, "rings"]:
    """Mean over rings [1/mm^2], by one quadrature: for a direction of exit, depth and distance go together.

    Light of a layer gets to a ring in three pieces of directions: between those that meet one edge from the layer's top and from its bottom. In each
    of them all is smooth, however narrow the ring.
    """
    bends = _bends(lit, low, high)
    count, (u, w) = lit.columns.count, unit_gauss(_PIECE)
    angle, weight, within, used = [], [], [], []
    for i in range(count):
        m = i if lit.above else count - 1 - i
        bottom, top = bends[m + 1], bends[m]
        narrow = bottom[1] < top[0]
        bounds = jnp.stack([bottom[0], jnp.minimum(bottom[1], top[0]), jnp.maximum(bottom[1], top[0]), top[1]], axis=1)
        start, width = bounds[:, :-1], jnp.diff(bounds)
        angle.append(start[:, :, None] + width[:, :, None] * u)
        weight.append(width[:, :, None] * w)
        within.append(narrow[:, None])
        used.append(width[:, :, None] > 0.0)
    path = exact_path(lit, jnp.stack(angle).ravel(), jnp.stack(weight).ravel())
    total = jnp.zeros(low.shape[0])
    for i, ahead in path.flights():

        def mine(x: Float[Array, "d"], i: int = i) -> Float[Array, "rings pieces directions"]:
            return x.reshape(count, low.shape[0], 3, _PIECE)[i]

        lost = path.entered(i) + sum((mine(path.out[j]) * path.thickness[j] for j in ahead), jnp.zeros(()))
        shift = sum((mine(path.tangent[j]) * path.thickness[j] for j in ahead), jnp.zeros(()))
        # depths in the layer, from the side of exit, that light of each direction gets to the ring from
        inner, outer = ((edge[:, None, None] - shift) / jnp.maximum(mine(path.tangent[i]), 1e-30) for edge in (low, high))
        near = jnp.zeros_like(inner[:, 0])
        far = near + path.thickness[i] if i < path.thickness.shape[0] else outer[:, 0]
        from_ = jnp.stack([inner[:, 0], jnp.where(within[i], inner[:, 1], near), near], axis=1)
        to = jnp.stack([far, jnp.where(within[i], outer[:, 1], far), outer[:, 2]], axis=1)
        from_, step = jnp.where(used[i], from_, 0.0), jnp.where(used[i], to - from_, 0.0)
        out = mine(path.out[i])
        rate, before = (path.beam[i] + out, 0.0) if path.above else (out - path.beam[i], path.beam[i] * path.thickness[i])
        along = jnp.exp(-rate * from_ - before - lost) * step * expc(rate * step)
        total = total + jnp.sum(along * mine(path.leaving(i, ahead)), axis=(1, 2))
    return total / (np.pi * (high - low) * (high + low))


def _bends(lit: Lit, low: Float[AnyArray, "rings"], high: Float[AnyArray, "rings"]) -> list[Float[Array, "2 rings"]]:
    """Angles of `exact_path` at which light from the near side of each layer, counted from the side of exit, gets to a ring's edges; at last of the
    far side of all. They only part the quadrature, whose sum does not change with them: no derivative is taken.
    """
    edges = jnp.stack([jnp.asarray(low), jnp.asarray(high)])
    straight, grazing = jnp.zeros_like(edges), jnp.full_like(edges, 0.5 * np.pi)
    columns, order = lit.columns, np.array(lit.outwards, int)
    if order.size == 0:
        return [grazing, straight]
    n, thickness, largest = (jax.lax.stop_gradient(x) for x in (columns.n[order], columns.thickness[order], lit.largest()))

    def reached(angle: Float[Array, "layers 2 rings"]) -> Float[Array, "layers 2 rings"]:
        """Distance from the far side of the first, second ... layer."""
        p = largest * jnp.sin(angle)[:, None]
        square = (n[:, None, None] - p) * (n[:, None, None] + p)
        tangent = jnp.where(square > 0.0, p / jnp.sqrt(jnp.maximum(square, 1e-24)), 1e12)
        crossed = np.tri(order.size)[:, :, None, None] * thickness[:, None, None]
        return jnp.sum(crossed * tangent, axis=1)

    def halve(_, bounds):
        below, above = bounds
        middle = 0.5 * (below + above)
        far = reached(middle) > edges
        return jnp.where(far, below, middle), jnp.where(far, middle, above)

    start = (jnp.zeros((order.size, *edges.shape)), jnp.full((order.size, *edges.shape), 0.5 * np.pi))
    found = jax.lax.fori_loop(0, _HALVINGS, halve, start)[1]
    return [grazing, *found, straight] if columns.half_space else [grazing, *found]
