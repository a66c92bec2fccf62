"""The random walk itself, compiled once by Numba.

A packet starts with weight 1 and is followed until it leaves or is absorbed. Its free path is drawn from
sigma_t = sigma_a + sigma_s. At each collision it leaves the fraction sigma_a / sigma_t of its weight in the layer and scatters
with the rest; once the weight has fallen below `analogue_below`, the choice becomes analogue: absorbed as a whole with probability
sigma_a / sigma_t, or scattered whole. That ends every walk in an absorbing medium without Russian roulette, so that what leaves
and what is absorbed add up to what came in, packet by packet, to rounding. A clear layer (sigma_s = 0) is crossed in one step.

Only where nothing absorbs can a walk be endless. After `roulette_after` scatterings, and again each time that number has doubled,
half of the packets are ended and the others count double. The row ROULETTE holds the weight ended minus the weight added, so that
R_specular + R + T + A + roulette = 1 still holds to rounding, while its mean is 0. (In a half space without absorption a fraction
of about 1/sqrt(m) outlives m scatterings; an unbiased estimate with a finite mean cost then has a slowly growing variance, whatever
the rule of ending. The other choice, to cut the walks, would bias R by 1/sqrt(m).)

Derivatives. A path with N_l scatterings and the length L_l in each layer l contributes with the density
f ~ product over l of sigma_s,l^N_l exp(-(sigma_a,l + sigma_s,l) L_l), whatever the scheme by which it was drawn, so that
d ln f / d sigma_a,l = -L_l and d ln f / d sigma_s,l = N_l / sigma_s,l - L_l. These scores, times the weight, give the derivative of
every tally of leaving light. Absorption in layer m at a collision has the density sigma_a,m f of the path up to there: its derivative
is taken from the mean of what is left behind, w / sigma_t,m, times (1 if l = m else 0) - sigma_a,m L_l, and times
sigma_a,m (N_l / sigma_s,l - L_l); finite at sigma_a = 0.

References
----------
Wang, Jacques and Zheng, Comput. Methods Programs Biomed. 47, 131 (1995): walk in layers. Rief, Ann. Nucl. Energy 11, 455 (1984), and
Hayakawa et al., Opt. Lett. 26, 1335 (2001): derivatives from the paths; the scores above are derived here.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from .flight import FLATTEST, cross_clear, set_scores, wander
from .scattering import azimuth
from .scoring import R_SPECULAR_ANGLE, score_direction, score_exit
from .source import DISK, POINT
from .streams import OPTIONS, compiled, exponential, stream, uniform
from .surface import facet_walk, fresnel
from .tallies import FIRST_LAYER, R_SPECULAR

# Raise it whenever a change of the code changes the numbers of a given seed: stored runs of another engine cannot be continued.
ENGINE = 1

STOPPED, LOST = -1, -2
_FILES = ("engine", "flight", "medium", "scattering", "scoring", "source", "streams", "surface", "tallies")


@compiled
def launch(source, state):
    """Place and direction of one packet in the outer medium: x, y, ux, uy, uz."""
    x, y = 0.0, 0.0
    shape, radius, uz = source[0], source[1], source[2]
    if shape != POINT:
        r = radius * math.sqrt(uniform(state) if shape == DISK else 0.5 * exponential(state))
        cosine, sine = azimuth(uniform(state))
        x, y = r * cosine, r * sine
    if uz > 0.0:
        return x, y, math.sqrt(max(0.0, 1.0 - uz * uz)), 0.0, uz
    square = source[3] + (source[4] - source[3]) * uniform(state)
    c, s = azimuth(uniform(state))
    sine = math.sqrt(square)
    return x, y, sine * c, sine * s, math.sqrt(1.0 - square)


@compiled
def settle(sums, total, rest):
    """Move the weights (column 0) of the first rows into `total`, with the rounding error kept in `rest` (Neumaier's sum)."""
    for row in range(total.size):
        value = sums[row, 0]
        new = total[row] + value
        if abs(total[row]) >= abs(value):
            rest[row] += (total[row] - new) + value
        else:
            rest[row] += (value - new) + total[row]
        total[row] = new
        sums[row, 0] = 0.0


@functools.cache
def kernel() -> Callable[..., int]:
    """The compiled function; compiles on its first call, or loads what an earlier process has compiled.

    Numba's cache looks only at the file of the function itself. The digest of all files that the walk is made of is therefore put
    into a closure cell, which is part of the cache's key: a change of any of them compiles anew.
    """
    digest = hashlib.sha256()
    for name in _FILES:
        digest.update((Path(__file__).parent / f"{name}.py").read_bytes())
    source_digest = int.from_bytes(digest.digest()[:7], "big")

    @njit(cache=True, **OPTIONS)
    def run(medium, source, table, seed, batch, photons, analogue_below, roulette_after, sums, stop):
        """Follow `photons` packets; returns their number, STOPPED if `stop[0]` was set, LOST if a walk on facets did not end."""
        if source_digest < 0:
            return LOST
        state = stream(seed, batch)
        layers = medium.top.size
        n, slope = medium.n, medium.slope
        path, hits = np.zeros(layers), np.zeros(layers)
        scores = np.zeros(2 * layers if table.derivatives else 0)
        derivatives = table.derivatives
        angles = table.sine2.size > 0
        fluence_row = FIRST_LAYER + layers
        # A plain sum of many equal weights rounds the same way each time; the balance of a large batch would show it.
        total, rest = np.zeros(fluence_row), np.zeros(fluence_row)

        for packet in range(photons):
            if stop[0] != 0:
                return STOPPED
            if packet % 256 == 0:
                settle(sums, total, rest)
            x, y, ux, uy, uz = launch(source, state)
            weight = 1.0
            reflected = 0.0

            # First surface. Smooth: the reflected part is split off as a number. Rough: one of the two ways is drawn.
            if n[0] != n[1]:
                if slope[0] == 0.0:
                    reflected, refracted = fresnel(n[0], n[1], uz)
                    weight = 1.0 - reflected
                    if reflected > 0.0 and angles:
                        score_direction(table, R_SPECULAR_ANGLE, reflected, ux, uy, scores[:0], sums)
                    ux *= n[0] / n[1]
                    uy *= n[0] / n[1]
                    uz = refracted
                else:
                    crossed, ux, uy, uz, _ = facet_walk(ux, uy, uz, n[0], n[1], slope[0], state)
                    if uz <= 0.0:
                        return LOST
                    if not crossed:
                        reflected, weight = 1.0, 0.0
                        if angles:
                            score_direction(table, R_SPECULAR_ANGLE, 1.0, ux, uy, scores[:0], sums)
            sums[R_SPECULAR, 0] += reflected
            if weight == 0.0:
                continue

            path[:] = 0.0
            hits[:] = 0.0
            scatterings = 0
            limit = roulette_after
            depth = 0.0  # optical depth left before the next collision; 0: not drawn
            layer = 0
            z = 0.0
            if layers == 0:
                score_exit(table, 1, True, weight, x, y, ux, uy, scores, sums)
                continue

            while True:
                # ---- inside a layer, until the packet dies (way = 0) or meets the face above (-1) or below (1)
                top, bottom = medium.top[layer], medium.bottom[layer]
                sigma_a, sigma_s = medium.sigma_a[layer], medium.sigma_s[layer]
                if sigma_s > 0.0:
                    way, (x, y, z, ux, uy, uz), weight, depth, scatterings, limit = wander(
                        medium, layer, (x, y, z, ux, uy, uz), weight, depth, scatterings, limit, analogue_below,
                        derivatives, path, hits, sums, state
                    )  # fmt: skip
                    if way == 0:
                        break
                    length = ((bottom if way > 0 else top) - z) / uz
                    depth -= length * (sigma_a + sigma_s)
                else:
                    way = 1 if uz >= 0.0 else -1
                    length = (bottom - z if way > 0 else z - top) / max(abs(uz), FLATTEST)
                    weight = cross_clear(medium, layer, length, weight, analogue_below, derivatives, path, hits, sums, state)
                    if weight == 0.0:
                        break

                # ---- at a face
                x += length * ux
                y += length * uy
                path[layer] += length
                z = bottom if way > 0 else top
                inside, outside = n[layer + 1], n[layer + 1 + way]
                crossed = True
                if inside != outside:
                    face = layer + 1 if way > 0 else layer
                    cosine = max(abs(uz), 1e-300)
                    if slope[face] == 0.0:
                        reflectance, refracted = fresnel(inside, outside, cosine)
                        if reflectance >= 1.0 or uniform(state) < reflectance:
                            crossed = False
                            uz = -uz
                        else:
                            ux *= inside / outside
                            uy *= inside / outside
                            uz = way * refracted
                    else:
                        crossed, ux, uy, cosine, _ = facet_walk(ux, uy, cosine, inside, outside, slope[face], state)
                        if cosine <= 0.0:
                            return LOST
                        uz = way * cosine if crossed else -way * cosine
                if crossed:
                    layer += way
                    if layer < 0 or layer == layers:
                        if derivatives:
                            set_scores(scores, path, hits, medium.sigma_s)
                        score_exit(table, 0 if layer < 0 else 1, scatterings == 0, weight, x, y, ux, uy, scores, sums)
                        break
        settle(sums, total, rest)
        for row in range(fluence_row):
            sums[row, 0] = total[row] + rest[row]
        return photons

    return run


def run_batch(
    medium: Any,
    source: Any,
    table: Any,
    seed: int,
    batch: int,
    photons: int,
    analogue_below: float,
    roulette_after: int,
    rows: int,
    columns: int,
    stop: np.ndarray,
) -> np.ndarray | None:
    """Raw sums of one batch, shape (rows, columns); None if stopped.

    Raises
    ------
    RuntimeError
        If a walk on the facets of a rough interface did not end within a million bounces.
    """
    sums = np.zeros((rows, columns))
    done = kernel()(medium, source, table, np.uint64(seed), np.uint64(batch), photons, analogue_below, roulette_after, sums, stop)
    if done == LOST:
        raise RuntimeError("a ray met over 1,000,000 facets of a rough interface without leaving; please report the scene")
    return None if done == STOPPED else sums
