"""Distances between source and detector: what a measurement sees of light whose profile about a pencil beam is known ring by ring."""

import numpy as np
from scipy import special

from ..optics.gauss import unit_gauss
from .geometry import Radial
from .overlap import lens_area
from .source import Disk, Edge, Gaussian, Line, Pencil

_NARROW = 5e-4  # relative half width of the ring that stands for a distance
_SHARED = 240
_FAR = 20.0  # how far along a line or behind an edge rings go, in units of the largest distance


def rings(geometry: Radial) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inner and outer radii of rings about a pencil beam [mm], and the weight of the mean over each ring in each value: (values, rings).

    Under a pencil each value has its ring (a distance, a narrow one); other sources and fibres share many.

    >>> import layerfit as lf
    >>> low, high, weights = rings(lf.RadialReflectance(r=[1.0], detector=lf.Detector(radius=0.2)))
    >>> bool(abs(weights.sum() - 1.0) < 1e-12), float(low[weights[0] > 0].min()) < 0.81
    (True, True)
    """
    if isinstance(geometry.source, Pencil) and geometry.detector.radius == 0.0:
        if geometry.r is None:
            assert geometry.r_min is not None and geometry.r_max is not None
            return geometry.r_min, geometry.r_max, np.eye(geometry.size)
        return geometry.r * (1.0 - _NARROW), geometry.r * (1.0 + _NARROW), np.eye(geometry.size)
    places = np.concatenate(list(geometry.places().values()))
    spread = geometry.detector.radius + 4.0 * float(getattr(geometry.source, "radius", 0.0))
    reach = float(np.max(np.abs(places))) + spread or 1.0  # an edge alone, at 0, has no length of its own
    if isinstance(geometry.source, Line | Edge):
        reach *= _FAR
    edges = np.concatenate([[0.0], np.geomspace(1e-4 * reach, reach, _SHARED)])
    within = np.stack([_seen_within(geometry, rho) for rho in edges[1:]], axis=1)
    return edges[:-1], edges[1:], np.diff(within, axis=1, prepend=0.0)


def _seen_within(geometry: Radial, rho: float) -> np.ndarray:
    """Mean over each detector of the source's power within a distance rho of a point of it."""
    if geometry.r is None:
        assert geometry.r_min is not None and geometry.r_max is not None
        x, w = unit_gauss(24)
        low, high = geometry.r_min[:, None] ** 2, geometry.r_max[:, None] ** 2
        return _near(geometry, np.sqrt(low + (high - low) * x), rho) @ w
    a = geometry.detector.radius
    if a == 0.0:
        return _near(geometry, geometry.r, rho)
    if isinstance(geometry.source, Pencil):
        return np.array([lens_area(float(r), a, rho) for r in geometry.r]) / (np.pi * a**2)
    x, w = unit_gauss(16)
    offset, angle = a * np.sqrt(x)[:, None], np.pi * x
    r = geometry.r[:, None, None]
    if isinstance(geometry.source, Line | Edge):
        places = r + offset * np.cos(angle)
    else:
        places = np.sqrt(np.maximum(r**2 + offset**2 + 2.0 * r * offset * np.cos(angle), 0.0))
    return np.einsum("rab,a,b->r", _near(geometry, places, rho), w, w)


def _near(geometry: Radial, x: np.ndarray, rho: float) -> np.ndarray:
    """Power of the source within rho of a point at distance x from its centre (of a line, an edge: per mm, per mm^2)."""
    source = geometry.source
    if isinstance(source, Disk):
        return np.vectorize(lens_area, otypes=[float])(x, rho, source.radius) / (np.pi * source.radius**2)
    if isinstance(source, Gaussian):
        return special.chndtr((2.0 * rho / source.radius) ** 2, 2.0, (2.0 * x / source.radius) ** 2)
    if isinstance(source, Line):
        return 2.0 * np.sqrt(np.maximum(rho**2 - x**2, 0.0))
    t = np.clip(x / rho, -1.0, 1.0)
    return rho**2 * (0.5 * np.pi + np.arcsin(t) + t * np.sqrt(1.0 - t**2))
