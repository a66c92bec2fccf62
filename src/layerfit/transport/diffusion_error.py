"""How far diffusion is from transport theory, from the properties of a stack alone.

Laid by eye over the errors of `LayeredDiffusion` against Monte Carlo on the open cases (docs/diffusion-errors.md), on the safe side: it grows
towards the source, with absorption, and with layers that are thin and unlike what is under them.
"""

import numpy as np

from ..measurement.geometry import Geometry, Radial, SpatialFrequency
from ..scene.columns import Columns

# relative error of thick, weakly absorbing samples by distance in transport mean free paths of the first layer
_DISTANCE = np.array([0.05, 0.3, 0.7, 1.4, 2.8, 5.6, 11.0])
_ERROR = np.array([1.0, 0.5, 0.16, 0.18, 0.11, 0.04, 0.03])
_ABSORPTION = 4.0  # growth of it per sigma_a/sigma_s'
_THIN, _FADES = 1.0, 2.5  # error through a layer of no thickness, and transport optical thickness over which it falls to 1/e
_EVENLY_LIT = 0.02


def known_error(columns: Columns, geometry: Geometry) -> np.ndarray:
    """Relative error of each value that diffusion is known to make in such a sample [1]."""
    extinction = np.asarray(columns.sigma_t_prime)
    scattering = np.asarray(columns.sigma_s_prime)
    absorption = float(np.max(np.asarray(columns.sigma_a) / np.maximum(scattering, 1e-300)))
    depth = np.asarray(columns.thickness) * extinction[: columns.thickness.shape[0]]
    beyond = np.append(extinction[1:], 0.0)[: depth.size]
    unlike = np.minimum(1.0, np.abs(np.log(np.maximum(beyond, 1e-3 * extinction[: depth.size]) / np.maximum(extinction[: depth.size], 1e-300))))
    thin = float(np.max(_THIN * unlike * np.exp(-depth / _FADES), initial=0.0))
    if isinstance(geometry, Radial):
        places = np.mean(np.stack(list(geometry.places().values())), axis=0)
        distance = np.abs(places) * extinction[0]
    elif isinstance(geometry, SpatialFrequency):
        distance = extinction[0] / np.maximum(geometry.k, 1e-9)
    else:
        return np.full(geometry.size, _EVENLY_LIT * (1.0 + _ABSORPTION * absorption) + 0.1 * thin)
    base = np.exp(np.interp(np.log(np.maximum(distance, 1e-3)), np.log(_DISTANCE), np.log(_ERROR)))
    return np.minimum(base * (1.0 + _ABSORPTION * absorption) + thin, 3.0)
