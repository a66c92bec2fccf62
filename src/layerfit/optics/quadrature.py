"""Directions shared by media of different refractive index.

What Snell's law conserves is p = n sin(theta). The range of p is cut into panels between successive indices; in each panel Gauss-Legendre nodes
are taken in the cosine of the lowest-index medium that it reaches (which is 0 at the panel's end), and mapped to the other media by Snell. A
direction is then one ordinate in all media, and W = w mu n^2 is the same in all of them: W is the weight of p dp.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from ..arrays import AnyArray
from .gauss import legendre, unit_gauss

_GAP = 1e-6  # two indices that are free to differ are kept this far apart, or a panel would have no width (and its weights no derivative)


class Ordinates(NamedTuple):
    """Directions of one hemisphere in several media.

    n : refractive index of each medium. W : weight w mu n^2, the same in all media; the sum over the directions of a medium is n^2/2.
    p : n sin(theta). mu : cosine in each medium (1 where there is no such direction). real : whether the medium has the direction.
    edges : upper ends of the panels, in p.
    """

    n: Float[Array, "media"]
    W: Float[Array, "ordinates"]
    p: Float[Array, "ordinates"]
    mu: Float[Array, "media ordinates"]
    real: Bool[Array, "media ordinates"]
    edges: Float[Array, "panels"]


def allot(nodes: int, edges: np.ndarray) -> tuple[int, ...]:
    """How many of about ``nodes`` directions each panel gets: by its width in angle in the densest medium, at least 4.

    edges : increasing values of p, 0 not among them. The sum may exceed ``nodes``.

    >>> allot(16, np.array([1.0, 1.5]))
    (7, 9)
    """
    return tuple(int(max(min(4, nodes), np.ceil(nodes * share - 0.5))) for share in panel_shares(edges))


def panel_shares(edges: np.ndarray) -> np.ndarray:
    """Width of each panel in angle in the densest medium, as a share of the right angle."""
    return np.diff(np.arcsin(np.minimum(np.concatenate([[0.0], edges]) / edges[-1], 1.0))) / (0.5 * np.pi)


def ordinates(n: Float[Array, "media"], groups: tuple[int, ...], counts: tuple[int, ...]) -> Ordinates:
    """The common directions of media of refractive index n.

    groups : for each medium the number of its index among the distinct ones (0, 1 ...); media known to share an index share the number.
    counts : directions in each panel, from p = 0 outwards, one panel a distinct index.

    >>> slab = ordinates(jnp.array([1.0, 1.5, 1.0]), (0, 1, 0), (4, 4))
    >>> [round(float(jnp.sum(jnp.where(real, slab.W, 0.0))), 6) for real in slab.real]
    [0.5, 1.125, 0.5]
    """
    distinct = jnp.stack([n[groups.index(group)] for group in range(len(counts))])
    order = jnp.argsort(distinct)
    edges = [distinct[order[0]]]
    for k in range(1, len(counts)):
        following = distinct[order[k]]
        edges.append(following + jax.lax.stop_gradient(jnp.maximum(edges[-1] + _GAP - following, 0.0)))
    rank = jnp.argsort(order)
    top = jnp.stack(edges)
    n = top[rank[jnp.array(groups)]]
    W, p, inner = [], [], []
    low = jnp.zeros(())
    for k, count in enumerate(counts):
        high = edges[k]
        mu, weight, place = in_panel(low, high, *unit_gauss(count))
        W.append(weight)
        p.append(place)
        inner.append((high * mu) ** 2)  # high^2 - p^2 without its cancellation
        low = high
    panel = np.repeat(np.arange(len(counts)), counts)
    above = (n[:, None] - top[panel]) * (n[:, None] + top[panel]) + jnp.concatenate(inner)  # n^2 - p^2
    real = rank[jnp.array(groups)][:, None] >= panel
    mu = jnp.where(real, jnp.sqrt(jnp.where(real, above, 1.0)) / n[:, None], 1.0)
    return Ordinates(n, jnp.concatenate(W), jnp.concatenate(p), mu, real, top)


def in_panel(
    low: Float[Array, ""], high: Float[Array, ""], x: Float[AnyArray, "k"], weight: Float[AnyArray, "k"]
) -> tuple[Float[Array, "k"], Float[Array, "k"], Float[Array, "k"]]:
    """A rule on (0, 1) laid over the panel from p = low to high: cosines in the medium of index high, weights W of p dp, places p."""
    span = jnp.sqrt((high - low) * (high + low)) / high
    mu = span * x
    return mu, span * weight * mu * high**2, high * jnp.sqrt(1.0 - mu**2)


def node_polynomials(count: int, y: AnyArray) -> AnyArray:
    """Lagrange polynomials of the nodes of a panel, at y in (0, 1): (count, *y.shape).

    >>> node_polynomials(3, unit_gauss(3)[0]).round(12) + 0.0
    array([[1., 0., 0.],
           [0., 1., 0.],
           [0., 0., 1.]])
    """
    x, weight = unit_gauss(count)
    table = np.polynomial.legendre.legvander(2.0 * x - 1.0, count - 1) * weight[:, None] * (2.0 * np.arange(count) + 1.0)
    return sum(np.expand_dims(table[:, l], tuple(range(1, np.ndim(y) + 1))) * value for l, value in enumerate(legendre(2.0 * y - 1.0, count)))  # pyright: ignore[reportReturnType]


def collected_share(rule: Ordinates, counts: tuple[int, ...], medium: int, na: float) -> Float[Array, "ordinates"]:
    """Share of each direction's weight for light that leaves with n sin(theta) up to na: radiance is interpolated within the panel that na cuts.

    medium : the one that light leaves to.
    """
    n = rule.n[medium]
    shares, low = [], jnp.zeros(())
    for k, count in enumerate(counts):
        x, weight = unit_gauss(count)
        high = rule.edges[k]
        span2 = (high - low) * (high + low)
        cut = jnp.sqrt(jnp.clip((high - na) * (high + na) / span2, 0.0, 1.0))  # directions are collected from this x to 1
        y, w = unit_gauss(count + 1)
        y = cut + (1.0 - cut) * y
        shares.append(node_polynomials(count, y) @ ((1.0 - cut) * w * y) / (weight * x) * (high <= n))
        low = high
    return jnp.concatenate(shares)


def cosine(n: Float[Array, "..."], p: Float[Array, "..."]) -> tuple[Float[Array, "..."], Bool[Array, "..."]]:
    """Cosine of the direction p = n sin(theta) in a medium of index n, and whether it exists there (else the cosine is given as 1)."""
    square = (n - p) * (n + p) / n**2
    real = square > 0.0
    return jnp.where(real, jnp.sqrt(jnp.where(real, square, 1.0)), 1.0), real
