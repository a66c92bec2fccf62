"""Areas that a source and a detector share, and the light in them."""

import numpy as np

from ..optics.gauss import unit_gauss
from .source import Disk, Edge, Gaussian, Line, Pencil, Source


def lens_area(distance: float, a: float, b: float) -> float:
    """Area common to two disks [mm^2]: distance of their centres, radii a and b [mm].

    >>> round(lens_area(0.0, 1.0, 2.0) / 3.141592653589793, 12)
    1.0
    """
    if distance >= a + b:
        return 0.0
    if distance <= abs(a - b):
        return float(np.pi * min(a, b) ** 2)
    at_a = np.arccos((distance**2 + a**2 - b**2) / (2.0 * distance * a))
    at_b = np.arccos((distance**2 + b**2 - a**2) / (2.0 * distance * b))
    kite = (-distance + a + b) * (distance + a - b) * (distance - a + b) * (distance + a + b)
    return float(a**2 * at_a + b**2 * at_b - 0.5 * np.sqrt(kite))


def enclosed(source: Source, radius: np.ndarray) -> np.ndarray:
    """Share of a source's power within a radius [mm] of its axis."""
    if isinstance(source, Disk):
        return np.minimum(radius / source.radius, 1.0) ** 2
    if isinstance(source, Gaussian):
        return -np.expm1(-2.0 * (radius / source.radius) ** 2)
    return np.where(radius > 0, 1.0, 0.0)


def under_fibre(source: Source, a: float, r: float) -> float:
    """Mean of a source's pattern over a fibre of radius a [mm] at r, in the unit of the pattern."""
    if isinstance(source, Pencil):
        return 1.0 / (np.pi * a**2) if r < a else 0.0
    if isinstance(source, Line):
        return 2.0 * np.sqrt(max(a**2 - r**2, 0.0)) / (np.pi * a**2)
    if isinstance(source, Edge):
        t = np.clip(r / a, -1.0, 1.0)
        return float(0.5 + (t * np.sqrt(1.0 - t**2) + np.arcsin(t)) / np.pi)
    if isinstance(source, Disk):
        return lens_area(r, a, source.radius) / (np.pi * a**2 * np.pi * source.radius**2)
    rho, w_rho = unit_gauss(64)
    angle, w_angle = unit_gauss(64)
    rho, angle = a * rho[:, None], np.pi * angle
    value = source.density(np.sqrt(r**2 + rho**2 + 2.0 * r * rho * np.cos(angle)))
    return float(2.0 * np.sum(w_rho[:, None] * w_angle * value * rho) / a)
