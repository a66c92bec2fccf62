"""A phantom of two layers as a spatial-frequency camera would see it: a thickness wedge, inclusions that absorb, noise, dead and saturated pixels.

Thin enough that the data determine its numbers nearly everywhere: with a top layer of 0.5 to 2.5 mm, tried first, they do not in half of the pixels.
"""

import numpy as np
import xarray as xr

import layerfit as lf
from layerfit.inference.batch import predictions_at

FX = [0.0, 0.05, 0.1, 0.25, 0.5]  # 1/mm
NOISE = 0.005
SATURATED = 0.98
STACK = lf.Layer("top", sigma_a=0.05, sigma_s_prime=1.5, g=0.8, n=1.4, thickness=0.6) | lf.HalfSpace(
    "deep", sigma_a=0.03, sigma_s_prime=1.0, g=0.8, n=1.4
)
FREE = {"top.sigma_a": (1e-3, 0.5), "top.thickness": (0.1, 5.0), "deep.sigma_a": (1e-3, 0.5)}


def problem(solver=None) -> lf.Problem:
    """That of one pixel."""
    geometry = lf.SpatialFrequency(fx=FX)
    values = lf.predict(STACK, geometry, solver=lf.LayeredDiffusion())[0].values
    return lf.Problem(
        STACK, lf.Dataset(geometry, values, noise=lf.Noise(NOISE)), free=FREE, solver=lf.LayeredDiffusion() if solver is None else solver
    )


def truth(size: int, wavelengths=(600.0,)) -> xr.Dataset:
    """Numbers of each pixel, over y, x, wavelength."""
    y, x = np.mgrid[0 : 1 : size * 1j, 0 : 1 : size * 1j]
    dye = 0.4 + 0.6 * np.exp(-(((np.array(wavelengths) - 620.0) / 60.0) ** 2))
    shallow = ((x - 0.3) ** 2 + (y - 0.3) ** 2 < 0.12**2) | ((x - 0.75) ** 2 + (y - 0.35) ** 2 < 0.08**2)
    deep = ((x - 0.3) ** 2 + (y - 0.75) ** 2 < 0.15**2) | ((x - 0.7) ** 2 + (y - 0.75) ** 2 < 0.1**2)
    numbers = {
        "top.sigma_a": (0.06 + 0.09 * shallow)[..., None] * dye,
        "top.thickness": (0.3 + 0.6 * x)[..., None] * np.ones(dye.size),
        "deep.sigma_a": (0.03 + 0.05 * deep)[..., None] * dye,
    }
    dims = ("y", "x", "wavelength")
    return xr.Dataset({name: (dims, v) for name, v in numbers.items()}, coords={"wavelength": list(wavelengths)})


def cube(known: xr.Dataset, stated: lf.Problem, seed: int = 0) -> xr.DataArray:
    """What the camera sees: 0.5 % noise, one pixel in 200 dead (0), one in 200 saturated."""
    names = list(known.data_vars)
    x = np.stack([known[name].values.reshape(-1) for name in names], axis=1)
    values = predictions_at(stated.model, x)[0]
    random = np.random.default_rng(seed)
    values *= 1.0 + NOISE * random.standard_normal(values.shape)
    spoilt = random.random(len(values))
    values[spoilt < 0.005] = 0.0
    values[spoilt > 0.995, 0] = SATURATED
    first = known[names[0]]
    frequencies = xr.DataArray(FX, dims="fx", attrs={"units": "1/mm"})
    return xr.DataArray(
        values.reshape(*first.shape, len(FX)), dims=(*first.dims, "fx"), coords={**first.coords, "fx": frequencies}, attrs={"units": "1"}
    )
