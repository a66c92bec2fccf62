"""Successive orders of scattering: light that has been scattered or reflected a few times, one event after the other, under a pencil beam.

In a thin sample most light leaves after a few events. Each of them costs products with vectors only, so that many more directions, azimuthal
orders and frequencies can be had than where all light is followed. What a coarse setting makes of these events is taken out of its spectrum, what a
fine one makes of them put in: near the source, light reflected between the faces then does not show the few directions and orders of the coarse one.

Between two events light crosses each layer in one step of the Lobatto IIIC method, the source given at its stages. Waves too short for these are
damped.

References
----------
H. C. van de Hulst, Multiple Light Scattering (1980), section 4.1.
E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996), section IV.5.
"""

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Complex, Float

from .frequency_layer import Closing, Sheet
from .frequency_response import Sample, beam_face
from .matrix import Matrix
from .response import Response

_STAGES = 8


class _Stages(NamedTuple):
    """Lobatto's method in the basis of its eigenvectors. place : from 0 to 1. matrix : of the method."""

    place: np.ndarray
    matrix: np.ndarray
    eigenvalues: np.ndarray
    vectors: np.ndarray
    inverse: np.ndarray


@cache
def _stages(count: int) -> _Stages:
    """The matrix integrates polynomials of less than count - 1 degrees from 0 to each place, its first column is the first weight."""
    last = np.polynomial.legendre.Legendre.basis(count - 1)
    place = 0.5 + 0.5 * np.concatenate([[-1.0], np.sort(last.deriv().roots().real), [1.0]])
    weight = 1.0 / (count * (count - 1) * last(2.0 * place - 1.0) ** 2)
    power = np.arange(count - 1)
    integral = place[:, None] ** (power + 1) / (power + 1) - weight[0] * (power == 0)
    matrix = np.concatenate([np.full((count, 1), weight[0]), integral @ np.linalg.inv(place[1:, None] ** power)], axis=1)
    eigenvalues, vectors = np.linalg.eig(matrix)
    return _Stages(place, matrix, eigenvalues, vectors, np.linalg.inv(vectors))


def endless_chain(orders: int, count: int) -> Closing:
    """The chain of azimuthal orders as it is without an end, by its values at ``count`` azimuths from 0 to pi, the same for all directions.

    Of each pair of conjugates one stands for both.
    """
    phi = (np.arange(count // 2) + 0.5) * np.pi / count
    m = np.arange(orders)[:, None]
    vectors = np.where(m == 0, 1.0, np.sqrt(2.0)) * 1j**m * np.cos(m * phi)
    return Closing(np.ones(1), -1j * np.cos(phi)[None], vectors[None], 2.0 * np.conj(vectors.T)[None] / count)


Light = list[Complex[Array, "ways n q s"]]  # of each layer, down and up, by azimuth (mode of the chain), at the stages from top to bottom


class _Way(NamedTuple):
    """One layer for light between two events.

    out : attenuation of each direction, per depth [1/mm]. modes : 1 + what each stage, direction and azimuth loses on the way. passed : share of
    light that a clear layer lets through.
    """

    sheet: Sheet
    out: Float[Array, "n"]
    modes: Complex[Array, "n q s"]
    passed: Complex[Array, "n q"]
    clear: bool
    chain: Closing

    def crossed(self, source: Complex[Array, "n q s"], entering: Complex[Array, "n q"]) -> Complex[Array, "n q s"]:
        """Light at the stages, in the direction of travel. source : [1/mm]."""
        rule = _stages(_STAGES)
        if self.clear:
            return jnp.stack([entering, entering * self.passed], axis=-1)[..., (0,) * (_STAGES - 1) + (1,)]
        right = entering[:, :, None] + self.sheet.depth * (source @ rule.matrix.T)
        return ((right @ rule.inverse.T) / self.modes) @ rule.vectors.T

    def scattered(self, light: Complex[Array, "ways n q s"]) -> Complex[Array, "ways n q s"]:
        """Source that light at the stages is to the next event: by azimuthal order."""
        same = jnp.diag(self.out) - 0.5 * (self.sheet.P + self.sheet.M)
        other = 0.5 * (self.sheet.P - self.sheet.M)
        orders = jnp.einsum("noq,wnqs->wons", self.chain.vectors, light).real
        orders = jnp.einsum("onm,woms->wons", same, orders) + jnp.einsum("onm,woms->wons", other, orders[::-1])
        return jnp.einsum("nqo,wons->wnqs", self.chain.inverse, orders)

    def of_beams(self, down: Float[Array, ""], up: Float[Array, ""]) -> tuple[Complex[Array, "ways n q s"], Complex[Array, "ways n q s"]]:
        """Sources that the two beams are. down, up : their powers where they enter the layer."""
        beam = jnp.exp(-self.sheet.rate * self.sheet.depth * _stages(_STAGES).place)
        ways = 0.5 * jnp.stack([self.sheet.q + self.sheet.p, self.sheet.q - self.sheet.p])[:, :, None]
        of_down, of_up = down * ways * beam, up * ways[::-1] * beam[::-1]
        in_order_0 = self.chain.inverse[:, :, 0]
        return jnp.einsum("nq,wns->wnqs", in_order_0, of_down), jnp.einsum("nq,wns->wnqs", in_order_0, of_up)


class _Faces(NamedTuple):
    """Shares of each direction at each face, top first: reflected from above, from below, and passed."""

    above: Float[Array, "faces n"]
    below: Float[Array, "faces n"]
    passed: Float[Array, "faces n"]


def _shares(faces: tuple[Response[Matrix], ...], n: int) -> _Faces:
    def of(face: Response[Matrix]) -> tuple[Array, ...]:
        return tuple(jnp.diagonal(operator.value[0])[:n] for operator in (face.R_above, face.R_below, face.T_down))

    return _Faces(*(jnp.stack(rows) for rows in zip(*map(of, faces), strict=True)))


def _beams(sample: Sample) -> list[tuple[Float[Array, ""], Float[Array, ""]]]:
    """Power of the beam where it enters each layer from the top, and from the bottom after one reflection at any face below."""
    faces = [beam_face(face) for face in sample.faces]
    left = [jnp.exp(-sheet.rate * sheet.depth) for sheet in sample.sheets]
    down, up = [faces[0].T_down.value[0, 0]], []
    for i, share in enumerate(left[:-1]):
        down.append(down[i] * share * faces[i + 1].T_down.value[0, 0])
    rising = jnp.zeros(())
    for i in reversed(range(len(left))):
        up.insert(0, down[i] * left[i] * faces[i + 1].R_above.value[0, 0] + rising * faces[i + 1].T_up.value[0, 0])
        rising = up[0] * left[i]
    return list(zip(down, up, strict=True))


def successive(sample: Sample, k: Float[Array, ""], chain: Closing, events: int, clear: tuple[bool, ...]) -> Float[Array, ""]:
    """What leaves one side at spatial frequency k after 2 to ``events`` events; a reflection is an event, of the beam too, which has one at most.

    clear : layers that do not scatter. All layers are finite, all faces smooth.
    """
    path, n = sample.path, sample.path.out.shape[1]
    rule, faces = _stages(_STAGES), _shares(sample.faces, n)
    chain = Closing(chain.share, *(jnp.broadcast_to(x, (n, *x.shape[1:])) for x in chain[1:]))
    ways = []
    for i, sheet in enumerate(sample.sheets):
        lost = (path.out[i][:, None] + k * path.tangent[i][:, None] * chain.modes) * sheet.depth
        ways.append(_Way(sheet, path.out[i], 1.0 + lost[:, :, None] * rule.eigenvalues, jnp.exp(-lost), clear[i], chain))

    def crossed(sources: Light, down_from: list[Array], up_from: list[Array]) -> Light:
        """Light from sources, and what faces send into each layer from its top and from its bottom."""
        down, up = [], []
        entering = jnp.zeros_like(down_from[0])
        for i, way in enumerate(ways):
            down.append(way.crossed(sources[i][0], entering + down_from[i]))
            entering = down[i][..., -1] * faces.passed[i + 1][:, None]
        entering = jnp.zeros_like(entering)
        for i, way in reversed(list(enumerate(ways))):
            up.insert(0, way.crossed(sources[i][1][..., ::-1], entering + up_from[i])[..., ::-1])
            entering = up[0][..., 0] * faces.passed[i][:, None]
        return [jnp.stack(pair) for pair in zip(down, up, strict=True)]

    def event(light: Light, _) -> tuple[Light, Float[Array, ""]]:
        sources = [way.scattered(found) for way, found in zip(ways, light, strict=True)]
        down_from = [found[1][..., 0] * faces.below[i][:, None] for i, found in enumerate(light)]
        up_from = [found[0][..., -1] * faces.above[i + 1][:, None] for i, found in enumerate(light)]
        light = crossed(sources, down_from, up_from)
        return light, leaving(light)

    def leaving(light: Light) -> Float[Array, ""]:
        found = light[0][1][..., 0] if sample.above else light[-1][0][..., -1]
        passed = faces.passed[0 if sample.above else -1] * sample.collected
        return jnp.sum(chain.vectors[:, 0] * found * passed[:, None]).real

    none = [jnp.zeros_like(chain.modes)] * len(ways)
    sources = [way.of_beams(*powers) for way, powers in zip(ways, _beams(sample), strict=True)]
    once, mirrored = (crossed([pair[way] for pair in sources], none, none) for way in (0, 1))
    start = jax.tree.map(jnp.add, once, mirrored)
    return leaving(mirrored) + jnp.sum(jax.lax.scan(event, start, length=events - 1)[1])
