"""The way of a packet inside one layer, and what it leaves there.

See `engine` for the weights and the scores.
"""

from __future__ import annotations

import math

from .medium import HENYEY_GREENSTEIN, ISOTROPIC
from .scattering import azimuth, henyey_greenstein, tabulated, turn
from .streams import compiled, draw, uniform
from .tallies import FIRST_LAYER, ROULETTE

FLATTEST = 1e-12  # least cosine in a clear layer: light along it must come to a face at a finite distance


@compiled
def set_scores(scores, path, hits, sigma_s):
    """Scores of the packet as it is now; without scattering in a layer only the part from its length."""
    layers = path.size
    for layer in range(layers):
        scores[layer] = -path[layer]
        scores[layers + layer] = -path[layer]
        if sigma_s[layer] > 0.0:
            scores[layers + layer] += hits[layer] / sigma_s[layer]


@compiled
def absorption_scores(sums, layer, mean, own, path, hits, sigma_s):
    """Derivatives of the absorption in `layer`: `mean` is the mean weight left there now, `own` its derivative in sigma_a."""
    row = FIRST_LAYER + layer
    layers = path.size
    sums[row, 1 + layer] += own
    for other in range(layers):
        sums[row, 1 + other] -= mean * path[other]
        score = -path[other]
        if sigma_s[other] > 0.0:
            score += hits[other] / sigma_s[other]
        sums[row, 1 + layers + other] += mean * score


@compiled
def wander(
    medium, layer, ray, weight, depth, scatterings, limit, analogue_below, derivatives, path, hits, sums, state
):  # fmt: skip
    """Follow a packet through a scattering layer until it dies or is about to pass a face.

    Parameters
    ----------
    medium : MediumTable
    layer : int
    ray : tuple of 6 floats
        Place x, y, z [mm] and direction ux, uy, uz.
    weight : float
    depth : float
        Optical depth left before the next collision [1]; 0: not drawn yet.
    scatterings, limit : int
        Scatterings so far in all layers, and the number at which the packet plays roulette.
    analogue_below : float
        Weight below which absorption is decided whole.
    derivatives : bool
    path, hits, sums, state : arrays
        Length and scatterings in each layer, raw sums, random stream; changed.

    Returns
    -------
    way : int
        0: dead; -1, 1: the next step passes the upper, the lower face. The packet stands at its last collision.
    ray, weight, depth, scatterings, limit
        As they are now.
    """
    x, y, z, ux, uy, uz = ray
    top, bottom = medium.top[layer], medium.bottom[layer]
    sigma_a = medium.sigma_a[layer]
    mean_path = 1.0 / (sigma_a + medium.sigma_s[layer])
    absorbed = sigma_a * mean_path
    kind, g = medium.kind[layer], medium.g[layer]
    # Running sums and the random state are kept out of memory in this loop, where nearly all the time is spent.
    length, fluence, left, before = 0.0, 0.0, 0.0, scatterings
    start = path[layer]
    start_hits = hits[layer]
    words = (state[0], state[1], state[2], state[3])
    number = 0.0
    way = 0
    while True:
        if depth <= 0.0:
            words, number = draw(words)
            depth = -math.log(number)
        step = depth * mean_path
        deep = z + step * uz
        if uz > 0.0:
            if deep >= bottom:
                way = 1
                break
        elif uz < 0.0 and deep <= top:
            way = -1
            break
        x += step * ux
        y += step * uy
        z = deep
        depth = 0.0
        length += step
        fluence += weight
        if derivatives:
            path[layer] = start + length
            hits[layer] = start_hits + (scatterings - before)
            absorption_scores(sums, layer, weight * absorbed, weight * mean_path, path, hits, medium.sigma_s)
        if weight > analogue_below:
            part = weight * absorbed
            left += part
            weight -= part
        elif absorbed > 0.0:
            words, number = draw(words)
            if number < absorbed:
                left += weight
                break
        scatterings += 1
        if scatterings == limit:
            limit *= 2
            words, number = draw(words)
            if number < 0.5:
                sums[ROULETTE, 0] += weight
                break
            sums[ROULETTE, 0] -= weight
            weight *= 2.0
        words, number = draw(words)
        if kind == ISOTROPIC:
            uz = 2.0 * number - 1.0
            sine = math.sqrt(1.0 - uz * uz)
            words, number = draw(words)
            c, s = azimuth(number)
            ux, uy = sine * c, sine * s
            continue
        cosine = 0.0
        if kind == HENYEY_GREENSTEIN:
            cosine = henyey_greenstein(g, number)
        else:
            first, last = medium.first[layer], medium.last[layer]
            cosine = tabulated(medium.node, medium.density, medium.cumulative, first, last, number)
        words, number = draw(words)
        c, s = azimuth(number)
        ux, uy, uz = turn(ux, uy, uz, cosine, c, s)
    state[0], state[1], state[2], state[3] = words
    path[layer] = start + length
    hits[layer] = start_hits + (scatterings - before)
    sums[FIRST_LAYER + layer, 0] += left
    sums[FIRST_LAYER + medium.top.size + layer, 0] += fluence * mean_path
    return way, (x, y, z, ux, uy, uz), weight, depth, scatterings, limit


@compiled
def cross_clear(medium, layer, length, weight, analogue_below, derivatives, path, hits, sums, state):
    """Take a packet over `length` [mm] through a layer without scattering; returns its weight, 0 if it is absorbed.

    The other arguments are those of `wander`; the length is not added to `path` yet.
    """
    sigma_a = medium.sigma_a[layer]
    row = FIRST_LAYER + layer
    fluence = row + medium.top.size
    if sigma_a == 0.0:
        sums[fluence, 0] += weight * length
        if derivatives:
            absorption_scores(sums, layer, 0.0, weight * length, path, hits, medium.sigma_s)
        return weight
    fraction = -math.expm1(-sigma_a * length)
    sums[fluence, 0] += weight * fraction / sigma_a
    if derivatives:
        own = weight * length * (1.0 - fraction) if fraction < 1.0 else 0.0
        absorption_scores(sums, layer, weight * fraction, own, path, hits, medium.sigma_s)
    part = weight
    if weight > analogue_below:
        part = weight * fraction
    elif uniform(state) >= fraction:
        part = 0.0
    sums[row, 0] += part
    return weight - part
