"""Bins of direction that stand for single directions: their edges, and the weights that undo what the width of a bin does."""

import numpy as np

WIDTH, AZIMUTH_WIDTH = 3.0, 12.0  # half widths of the wider bins [deg]
_OF_LOBE = 0.8  # and at most so much of the standard deviation of a lobe: the value at its top is then 0.5 % too small


def lobe_width(n: np.ndarray, roughness: np.ndarray) -> float:
    """Standard deviation [deg] of the narrowest lobe that one rough face makes of a beam near its normal, infinite without rough faces.

    n : of the media, from above to below. A facet of slope m turns light that crosses from n1 to n2 by m (1 - n1/n2), more at grazing.
    """
    turn = roughness * np.abs(np.diff(n)) / np.maximum(n[:-1], n[1:])
    return float(np.degrees(np.min(turn[turn > 0.0], initial=np.inf)))


def polar_bins(angle: np.ndarray, lobe: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
    """Edges of bins in s = sin^2 (angle), and weights (angles, bins) by which the means over the bins give the values at the angles.

    Power over projected solid angle is a mean that is even in s, and radiance is a smooth function of s, at 0 as well. Away from 0 twice the
    mean over s +- d/sqrt 2 less that over s +- d drops the curvature of the radiance; near 0 the means over (0, 2 d) and (0, d) are
    extrapolated as a straight line. lobe : see `lobe_width`.
    """
    width = np.radians(min(WIDTH, _OF_LOBE * lobe))
    s = np.sin(np.radians(angle)) ** 2
    least = np.sin(width) ** 2
    d = np.minimum(np.maximum(np.sin(np.radians(2.0 * angle)) * width, least), 1.0 - s)
    d = np.where(s < d, least, d)
    near = s < d
    parts = [
        (np.where(near, 0.0, s - d), np.where(near, 2.0 * d, s + d), np.where(near, 2.0 * s / d - 1.0, -1.0)),
        (np.where(near, 0.0, s - d / np.sqrt(2.0)), np.where(near, d, s + d / np.sqrt(2.0)), np.where(near, 2.0 - 2.0 * s / d, 2.0)),
    ]
    edges = np.unique(np.concatenate([[0.0, 1.0], *(side for low, high, _ in parts for side in (low, high))]))
    edges = edges[np.append(np.diff(edges) > 1e-12, True)]
    edges[0] = 0.0
    return edges, sum((factor[:, None] * _overlap(edges, low, high) for low, high, factor in parts), np.zeros(()))


def azimuth_bins(azimuth: float, lobe: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
    """Edges of bins in azimuth from 0 to 180 degrees, and the weights (bins,) for one direction; what lies beyond is the mirror image.

    lobe : see `lobe_width`, here in azimuth.
    """
    at = abs((azimuth + 180.0) % 360.0 - 180.0)
    wide = min(AZIMUTH_WIDTH, _OF_LOBE * lobe)
    parts = [(wide, -1.0), (wide / np.sqrt(2.0), 2.0)]
    images = (at, -at, 360.0 - at)
    sides = [image + sign * width for width, _ in parts for image in images for sign in (-1.0, 1.0)]
    edges = np.unique([0.0, 180.0, *(side for side in sides if 0.0 < side < 180.0)])
    weights = np.zeros(edges.size - 1)
    for width, factor in parts:
        for image in images:
            low, high = np.array([image - width]), np.array([image + width])
            weights += factor * _overlap(edges, low, high)[0]
    return edges, weights


def _overlap(edges: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Share of each interval (rows) that lies in each bin (columns)."""
    shared = np.minimum(edges[1:], high[:, None]) - np.maximum(edges[:-1], low[:, None])
    return np.maximum(shared, 0.0) / (high - low)[:, None]
