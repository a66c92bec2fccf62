"""Interfaces between two indices: smooth (Fresnel), and rough (a random walk on microfacets).

Rough interface. The height field is Gaussian in its slopes (`slope` is the RMS slope per axis, sigma; Beckmann
alpha = sqrt(2) sigma), heights and slopes are independent, and neighbouring heights are uncorrelated (Smith). Then a ray has an
exponential free path in the variable l = ln C(h), with C the cumulative distribution of heights, whatever that distribution
is: between two heights a ray of direction w advances by E / Lambda(w), E an exponential deviate; l = 0 is the outside. Rising
rays have Lambda > 0 and leave where l would pass 0; falling rays have Lambda < -1. At a hit the facet's normal follows the
projected-area (visible) distribution, and Fresnel's law on the facet decides between reflection and refraction. A refracted
ray goes on in the mirror image: heights and z reversed, C becomes 1 - C. All choices are analogue, so no energy is lost.

References
----------
Heitz, Hanika, d'Eon and Dachsbacher, ACM Trans. Graph. 35, 58 (2016): the model. Smith, IEEE Trans. Antennas Propag. 15, 668 (1967).
The height enters here only through ln C, which makes the free path a plain exponential and the height distribution irrelevant; normals
are drawn by rejection. Both are derived from the model, not taken from its published code.
"""

from __future__ import annotations

import math

from .scattering import azimuth
from .streams import compiled, exponential, uniform

_SQRT_2 = math.sqrt(2.0)
_SQRT_PI = math.sqrt(math.pi)
_HALF_NORMAL = math.sqrt(2.0 / math.pi)
BOUNCES = 1_000_000


@compiled
def fresnel(n_in, n_out, cosine):
    """Unpolarised reflectance and the cosine of refraction, for light in `n_in` at `cosine` (of incidence, above 0).

    Born and Wolf, Principles of Optics, 7th edition, section 1.5.2. Total reflection gives (1, 0).
    """
    ratio = n_in / n_out
    squared = 1.0 - ratio * ratio * (1.0 - cosine * cosine)
    if squared <= 0.0:
        return 1.0, 0.0
    refracted = math.sqrt(squared)
    s = (n_in * cosine - n_out * refracted) / (n_in * cosine + n_out * refracted)
    p = (n_out * cosine - n_in * refracted) / (n_out * cosine + n_in * refracted)
    return 0.5 * (s * s + p * p), refracted


@compiled
def smith_lambda(cosine, sine, slope):
    """Smith's Lambda for a Gaussian surface, for a direction at any angle; `cosine` above 0 points away from the surface.

    Smith 1967, in the form of Walter et al., EGSR 2007, and continued to falling rays by Lambda(-w) = -1 - Lambda(w).
    """
    a = abs(cosine) / (_SQRT_2 * slope * sine)
    # Above 10, Lambda is below 1e-46; above 26, where both terms leave the normal numbers, their difference may come out as -0, which
    # sends a rising ray down without end.
    up = 0.5 * (math.exp(-a * a) / (a * _SQRT_PI) - math.erfc(a)) if a < 10.0 else 0.0
    return up if cosine > 0.0 else -1.0 - up


@compiled
def visible_slope(cosine, sine, slope, state):
    """Slope along the viewing azimuth of a facet seen from (`sine`, `cosine`), in the plane of view.

    Its density is the normal density times the projected area max(0, cosine - x sine); see the tests for the acceptance rates
    (never below 0.34).
    """
    if cosine >= 0.0:
        # mixture of a normal (weight cosine) and a signed Rayleigh deviate (weight sine E|x|), which bounds the density
        signed = sine * slope * _HALF_NORMAL
        while True:
            radius = math.sqrt(2.0 * exponential(state))
            if uniform(state) * (cosine + signed) < cosine:
                x = slope * radius * azimuth(uniform(state))[0]
            else:
                x = slope * radius
                if uniform(state) < 0.5:
                    x = -x
            if uniform(state) * (cosine + abs(x) * sine) <= cosine - x * sine:
                return x
    # seen from below the horizon: x = -slope (tilt + v), density of v: v exp(-v^2/2 - tilt v)
    tilt = -cosine / (sine * slope)
    while True:
        if tilt < 1.0:
            v = math.sqrt(2.0 * exponential(state))
            accept = math.exp(-tilt * v)
        else:
            v = (exponential(state) + exponential(state)) / tilt
            accept = math.exp(-0.5 * v * v)
        if uniform(state) <= accept:
            return -slope * (tilt + v)


@compiled
def normal_deviate(state):
    """A standard normal deviate."""
    return math.sqrt(2.0 * exponential(state)) * azimuth(uniform(state))[0]


@compiled
def facet_walk(ux, uy, cosine, n_in, n_out, slope, state, most=BOUNCES):
    """Follow a ray that meets a rough interface until it leaves.

    Parameters
    ----------
    ux, uy, cosine : float
        Direction of travel: horizontal components, and the cosine with the mean normal towards the far side (above 0).
    n_in, n_out : float
        Index on the side of arrival and on the far side.
    slope : float
        RMS slope per axis, above 0.
    state : array
        Random stream.
    most : int
        Number of facets after which the walk is cut.

    Returns
    -------
    crossed : bool
        True if the ray leaves on the far side.
    ux, uy, cosine : float
        Direction of travel; `cosine` (above 0) is with the mean normal pointing away from the surface.
    bounces : int
        Number of facets met. If the walk was cut, `cosine` is -1, and the caller must raise.
    """
    crossed = False
    uz = -cosine
    level = 0.0
    bounces = 0
    while bounces <= most:
        sine = math.sqrt(ux * ux + uy * uy)
        if uz > 0.0 and sine == 0.0:
            break
        advance = -exponential(state) if sine == 0.0 else exponential(state) / smith_lambda(uz, sine, slope)
        if uz > 0.0 and level + advance >= 0.0:
            break
        level = min(level + advance, -1e-300)  # a hit is below the outside, also where rounding would lose it
        bounces += 1

        # facet normal towards the ray's origin; (ex, ey) is the horizontal direction towards that origin
        ex, ey = 1.0, 0.0
        if sine > 0.0:
            ex, ey = -ux / sine, -uy / sine
        along = visible_slope(-uz, sine, slope, state)
        across = slope * normal_deviate(state)
        mz = 1.0 / math.sqrt(1.0 + along * along + across * across)
        mx = (-along * ex + across * ey) * mz
        my = (-along * ey - across * ex) * mz
        facet = -(ux * mx + uy * my + uz * mz)
        if facet <= 0.0:
            facet = 1e-16  # rounding at grazing incidence on the facet
        reflectance, refracted = fresnel(n_in, n_out, facet)
        if reflectance >= 1.0 or uniform(state) < reflectance:
            ux += 2.0 * facet * mx
            uy += 2.0 * facet * my
            uz += 2.0 * facet * mz
        else:
            ratio = n_in / n_out
            shift = ratio * facet - refracted
            ux = ratio * ux + shift * mx
            uy = ratio * uy + shift * my
            uz = -(ratio * uz + shift * mz)
            level = math.log(-math.expm1(level))
            n_in, n_out = n_out, n_in
            crossed = not crossed
    if bounces > most:
        return crossed, 0.0, 0.0, -1.0, bounces
    # unit length, so that a long walk hands no drift to the layers; uz > 0 here
    scale = 1.0 / math.sqrt(ux * ux + uy * uy + uz * uz)
    return crossed, ux * scale, uy * scale, uz * scale, bounces
