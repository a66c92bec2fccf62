"""Rough interfaces in discrete ordinates.

For each direction of arrival the facets met (a quadrature over their slopes) send light into directions off the ordinates. What arrives between
ordinates is shared among those of its panel by Lagrange interpolation in the panel's own variable: power is conserved exactly, integrals of
smooth functions keep the accuracy of the Gauss rule, and at zero roughness each direction meets its own image: the operator becomes the Fresnel one.

One facet is followed, with Smith's shadowing. What another facet catches is handed back by one more reciprocal term of rank one, in proportion to
what each direction loses (C. Kulla, A. Conty, SIGGRAPH course 2017), on both sides together: reciprocity holds and no energy is lost, but how the
caught light divides between the two sides is a model.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from ..optics.microfacet import facets
from ..optics.microfacet_paths import Paths, brdf, btdf, paths
from .matrix import Matrix
from .response import Response

# nodes for the slopes of facets: light through two faces feels those of both, and where both are the same, errors that alternate add up
_FACETS = (20, 24)
_AZIMUTHS = 256  # for the Fourier coefficients of what a beam sends into a line of sight


class Side(NamedTuple):
    """One side of the interface. mu, real : of ordinates, then lines of sight, then beams. root : sqrt(W) of the ordinates, 0 where absent."""

    n: Float[Array, ""]
    mu: Float[Array, "c"]
    real: Bool[Array, "c"]
    root: Float[Array, "n"]


class _Scattered(NamedTuple):
    """Power from each direction into each ordinate, by azimuthal order, on the side of arrival and beyond; and what was caught."""

    back: Float[Array, "m c n"]
    through: Float[Array, "m c n"]
    caught: Float[Array, "c"]


def rough_interfaces(
    faces: Sequence[tuple[Side, Side, Float[Array, ""]]], edges: Float[Array, "panels"], counts: tuple[int, ...], orders: int, beams: int
) -> list[Response[Matrix]]:
    """Responses of rough interfaces (side above, side below, roughness), azimuthal orders leading.

    edges : upper ends of the panels in p; counts : ordinates in each.
    """
    runs = [(a, b, roughness) for above, below, roughness in faces for a, b in ((above, below), (below, above))]
    light = _scatter(runs, edges, counts, orders) if runs else []
    return [_rough_interface(*face, light[2 * i : 2 * i + 2], orders, beams) for i, face in enumerate(faces)]


def _rough_interface(above: Side, below: Side, roughness: Float[Array, ""], runs: list[_Scattered], orders: int, beams: int) -> Response[Matrix]:
    n = above.root.shape[0]
    end = above.mu.shape[0] - beams
    views, sources = slice(n, end), slice(end, None)
    weight = [jnp.concatenate([side.root, jnp.ones(side.mu.shape[0] - n)]) for side in (above, below)]  # W^1/2 of every channel
    inverse = [jnp.where(side.root > 0.0, 1.0 / jnp.where(side.root > 0.0, side.root, 1.0), 0.0) for side in (above, below)]
    # [to side][from side]: ordinate x channel
    K: Any = [[None, None], [None, None]]
    for i, run in enumerate(runs):
        K[i][i] = jnp.swapaxes(run.back, 1, 2) * inverse[i][:, None] * weight[i]
        K[1 - i][i] = jnp.swapaxes(run.through, 1, 2) * inverse[1 - i][:, None] * weight[i]
    K = _reciprocal(K, n)
    K = _closed(K, [w * run.caught for w, run in zip(weight, runs, strict=True)], weight, [a.real for a in (above, below)], n)
    corner: Any = [[None, None], [None, None]]
    for i, (a, b) in enumerate(((above, below), (below, above))):
        for j, (out, function) in ((i, (a, brdf)), (1 - i, (b, btdf))):
            corner[j][i] = _fourier(function, a, out, a.n / b.n, roughness, views, sources, orders)

    def whole(j: int, i: int) -> Matrix:
        """Operator from side i to side j; lines of sight by reciprocity from the same directions as beams."""
        rows = jnp.swapaxes(K[i][j][:, :, views], 1, 2)
        return Matrix(_blocks(rows, K[j][i][:, :, :n], K[j][i][:, :, sources], corner[j][i]))

    return Response(R_above=whole(0, 0), R_below=whole(1, 1), T_down=whole(1, 0), T_up=whole(0, 1))


def _blocks(
    rows: Float[Array, "m v n"], ordinates: Float[Array, "m n n"], columns: Float[Array, "m n b"], corner: Float[Array, "m v b"]
) -> Float[Array, "m c c"]:
    m, v, b = corner.shape
    n = ordinates.shape[-1]
    top = jnp.concatenate([jnp.zeros((m, v, v)), rows, corner], axis=2)
    middle = jnp.concatenate([jnp.zeros((m, n, v)), ordinates, columns], axis=2)
    return jnp.concatenate([top, middle, jnp.zeros((m, b, v + n + b))], axis=1)


def _reciprocal(K: Any, n: int) -> Any:
    """The symmetric part among ordinates."""
    back = [K[i][i].at[:, :, :n].set(0.5 * (K[i][i][:, :, :n] + jnp.swapaxes(K[i][i][:, :, :n], 1, 2))) for i in (0, 1)]
    down = 0.5 * (K[1][0][:, :, :n] + jnp.swapaxes(K[0][1][:, :, :n], 1, 2))
    return [[back[0], K[0][1].at[:, :, :n].set(jnp.swapaxes(down, 1, 2))], [K[1][0].at[:, :, :n].set(down), back[1]]]


def _closed(K: Any, caught: list[Array], weight: list[Array], real: list[Array], n: int) -> Any:
    """At order 0: the rank-one term for what was caught, and a symmetric correction of what is then left of the quadrature's error."""
    e = [w[:n] for w in weight]
    d = [c[:n] for c in caught]
    norm = sum(jnp.sum(a * b) for a, b in zip(e, d, strict=True))
    first = [[K[j][i][0] + d[j][:, None] * caught[i] / jnp.maximum(norm, 1e-300) for i in (0, 1)] for j in (0, 1)]
    missing = [w * r - e[0] @ first[0][i] - e[1] @ first[1][i] for i, (w, r) in enumerate(zip(weight, real, strict=True))]
    total = sum(jnp.sum(a**2) for a in e)
    mean = sum(jnp.sum(a * b[:n]) for a, b in zip(e, missing, strict=True)) / total**2
    for i in (0, 1):
        source = weight[i] * real[i]
        for j in (0, 1):
            change = (e[j][:, None] * missing[i] + missing[j][:n, None] * source) / total - e[j][:, None] * source * mean
            K[j][i] = K[j][i].at[0].set(first[j][i] + change)
    return K


def _scatter(
    runs: list[tuple[Side, Side, Float[Array, ""]]], edges: Float[Array, "panels"], counts: tuple[int, ...], orders: int
) -> list[_Scattered]:
    """What each side of each face scatters (side of the light, side beyond, roughness).

    Direction by direction: the paths of one fit into a processor's cache, and one program serves all of them.
    """

    def one(given: tuple[Array, ...]) -> _Scattered:
        mu, real, n, beyond, roughness = given
        reflected, refracted = paths(facets(mu, n / beyond, roughness, _FACETS), mu, n / beyond, roughness)
        lit = real.astype(float)
        caught = jnp.sum(reflected.caught + refracted.caught) * lit
        return _Scattered(_deposit(reflected, n, edges, counts, orders) * lit, _deposit(refracted, beyond, edges, counts, orders) * lit, caught)

    size = runs[0][0].mu.shape[0]
    single = [jnp.repeat(jnp.stack(v), size) for v in zip(*((a.n, b.n, roughness) for a, b, roughness in runs), strict=True)]
    light = jax.lax.map(one, (jnp.concatenate([a.mu for a, _, _ in runs]), jnp.concatenate([a.real for a, _, _ in runs]), *single))
    split = [jax.tree.map(lambda x, i=i: x[i * size : (i + 1) * size], light) for i in range(len(runs))]
    return [_Scattered(jnp.moveaxis(s.back, 1, 0), jnp.moveaxis(s.through, 1, 0), s.caught) for s in split]


def _deposit(light: Paths, n: Float[Array, ""], edges: Float[Array, "panels"], counts: tuple[int, ...], orders: int) -> Float[Array, "m n"]:
    """Power into each ordinate, times cos(m azimuth)."""
    share, cosine, azimuth = (v.ravel() for v in (light.share, light.cosine, light.azimuth))
    p2 = n**2 * (1.0 - cosine**2)
    modes = _chebyshev(azimuth, orders) * share
    result = []
    low = jnp.zeros(())
    for k, count in enumerate(counts):
        high = edges[k]
        inside = (p2 >= low**2) & (p2 < high**2) if k + 1 < len(counts) else p2 >= low**2
        x = jnp.sqrt(jnp.clip((high**2 - p2) / ((high - low) * (high + low)), 1e-30, 1.0))
        basis, to_nodes = _legendre(x, count)
        result.append((modes @ (basis * inside).T) @ to_nodes)
        low = high
    return jnp.concatenate(result, axis=-1)


def _chebyshev(c: Float[Array, "*s"], orders: int) -> Float[Array, "m *s"]:
    """cos(m phi) from cos(phi)."""

    def step(last, _):
        before, now = last
        return (now, 2.0 * c * now - before), before

    return jax.lax.scan(step, (jnp.ones_like(c), c), length=orders)[1]


def _legendre(x: Float[Array, "*s"], count: int) -> tuple[Float[Array, "k *s"], np.ndarray]:
    """Legendre polynomials on (0, 1) at x, and the matrix from their moments to the shares of Gauss nodes (Lagrange polynomials)."""
    node, weight = np.polynomial.legendre.leggauss(count)
    k = np.arange(count)
    to_nodes = 0.5 * (2 * k[:, None] + 1) * np.polynomial.legendre.legvander(node, count - 1).T * weight
    t = 2.0 * x - 1.0

    def step(last, l):
        before, now = last
        return (now, ((2.0 * l + 1.0) * t * now - l * before) / (l + 1.0)), before

    return jax.lax.scan(step, (jnp.ones_like(t), t), jnp.arange(1.0, count + 1.0))[1], to_nodes


def _fourier(
    function: Callable[..., Array], a: Side, out: Side, n: Float[Array, ""], roughness: Float[Array, ""], views: slice, sources: slice, orders: int
) -> Float[Array, "m v b"]:
    """What a beam sends into a line of sight after one facet, by azimuthal order."""
    if out.mu[views].size == 0 or a.mu[sources].size == 0:
        return jnp.zeros((orders, out.mu[views].size, a.mu[sources].size))
    phi = jnp.asarray(2.0 * np.pi * (np.arange(_AZIMUTHS) + 0.5) / _AZIMUTHS)
    mu_out, mu_in = out.mu[views][:, None, None], a.mu[sources][None, :, None]
    value = function(mu_in, mu_out, phi, n, roughness)
    value = jnp.where((out.real[views][:, None] & a.real[sources])[:, :, None], value, 0.0)
    value = value / (out.n if function is brdf else a.n) ** 2
    modes = jnp.cos(np.arange(orders)[:, None] * phi) * (2.0 * np.pi / _AZIMUTHS)
    return jnp.einsum("vbf,mf->mvb", value, modes)
