"""What a packet adds to the tallies at the moment it leaves (or is reflected by the first surface)."""

from __future__ import annotations

import math

from .streams import compiled

# Positions in TallyTable.start
_R_CELLS, _R_K, _R_FIBRES, _R_ANGLE, R_SPECULAR_ANGLE = 2, 4, 6, 8, 10
_CELLS_PER_UNIT, _END = 4.0, 32.0  # of the table of J0: 1 / BESSEL_CELL, BESSEL_END


@compiled
def bessel_j0(x, cells, series):
    """J0(x) for x >= 0 from the tables of `tallies.bessel_tables`; absolute error below 1e-15."""
    if x < _END:
        place = x * _CELLS_PER_UNIT
        index = int(place)
        t = 2.0 * (place - index) - 1.0
        value = cells[index, 9]
        for power in range(8, -1, -1):
            value = value * t + cells[index, power]
        return value
    inverse = 1.0 / (x * x)
    p = series[0, 7]
    q = series[1, 7]
    for power in range(6, -1, -1):
        p = p * inverse + series[0, power]
        q = q * inverse + series[1, power]
    angle = x - 0.25 * math.pi
    return math.sqrt(2.0 / (math.pi * x)) * (p * math.cos(angle) - q / x * math.sin(angle))


@compiled
def interval(edges, value):
    """Index i with edges[i] <= value < edges[i + 1]; -1 below the first edge, len(edges) - 1 from the last one on."""
    low, high = -1, edges.size
    while high - low > 1:
        middle = (low + high) // 2
        if edges[middle] <= value:
            low = middle
        else:
            high = middle
    return low


@compiled
def covered_fraction(r, distance, radius):
    """Fraction of the circle of radius `r` about the origin inside a disk of `radius` whose centre is `distance` away."""
    if r <= radius - distance:
        return 1.0
    if r >= distance + radius or r <= distance - radius:
        return 0.0
    cosine = (r * r + distance * distance - radius * radius) / (2.0 * r * distance)
    return math.acos(min(1.0, max(-1.0, cosine))) / math.pi


@compiled
def add(sums, row, value, scores):
    """Add a weight to a row, and its products with the scores to the row's derivative columns."""
    sums[row, 0] += value
    for column in range(scores.size):
        sums[row, 1 + column] += value * scores[column]


@compiled
def score_direction(table, block, weight, ux, uy, scores, sums):
    """Add a weight to the bin of its direction; (ux, uy) are the horizontal components in the outer medium."""
    square = ux * ux + uy * uy
    last = table.sine2.size - 1
    polar = interval(table.sine2, square)
    if polar == last and square <= table.sine2[last] + 1e-12:
        polar = last - 1  # the last edge belongs to the last bin: at 90 degrees rounding may reach it
    if polar < 0 or polar >= last:
        return
    minus_cosine = max(-1.0, min(1.0, -ux / math.sqrt(square))) if square > 0.0 else -1.0
    azimuths = table.minus_cosine.size - 1
    azimuth = min(interval(table.minus_cosine, minus_cosine), azimuths - (1 if table.minus_cosine[azimuths] >= 1.0 else 0))
    if azimuth < 0 or azimuth >= azimuths:
        return
    add(sums, table.start[block] + polar * azimuths + azimuth, weight, scores)


@compiled
def score_exit(table, below, unscattered, weight, x, y, ux, uy, scores, sums):
    """Add a leaving packet to all tallies of one face.

    Parameters
    ----------
    table : TallyTable
    below : int
        0 at the top face, 1 at the bottom face.
    unscattered : bool
        No scattering in any layer.
    weight : float
    x, y : float
        Place [mm].
    ux, uy : float
        Horizontal components of the direction in the outer medium.
    scores : array, shape (0,) or (2 N,)
        Derivatives of the logarithm of the weight.
    sums : array, shape (rows, columns)
        Changed.
    """
    add(sums, 2 * below, weight, scores)
    if unscattered:
        add(sums, 2 * below + 1, weight, scores)
    start = table.start
    r2 = x * x + y * y
    if ux * ux + uy * uy < table.aperture[below]:
        if table.radius2.size > 0:
            add(sums, start[_R_CELLS + below] + interval(table.radius2, r2), weight, scores)
        r = math.sqrt(r2)
        for index in range(table.k.size):
            add(
                sums,
                start[_R_K + below] + index,
                weight * bessel_j0(table.k[index] * r, table.bessel, table.hankel),
                scores,
            )
    for index in range(table.fibre.shape[0]):
        if ux * ux + uy * uy < table.fibre[index, 4 + below]:
            distance, radius = table.fibre[index, 0], table.fibre[index, 1]
            fraction = 0.0
            if table.symmetric:
                fraction = covered_fraction(math.sqrt(r2), distance, radius)
            else:
                # the scene is its own mirror image in y, so the fibre and its mirror image see the same light
                away, up, down = x - table.fibre[index, 2], y - table.fibre[index, 3], y + table.fibre[index, 3]
                fraction = 0.5 * (away * away + up * up < radius * radius) + 0.5 * (away * away + down * down < radius * radius)
            if fraction > 0.0:
                add(sums, start[_R_FIBRES + below] + index, weight * fraction, scores)
    if table.sine2.size > 0:
        score_direction(table, _R_ANGLE + below, weight, ux, uy, scores, sums)
