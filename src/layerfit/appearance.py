"""Colour: what an eye makes of a reflectance spectrum. The only place where colour-science is used."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from .errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OBSERVERS = {2: "CIE 1931 2 Degree Standard Observer", 10: "CIE 1964 10 Degree Standard Observer"}
FIRST, LAST, STEP = 380, 780, 5  # nm: where the integrals run
_NEEDED = (420.0, 680.0)  # beyond, the eye sees 0.1 % and less: the spectrum may end, and goes on with its last value
_GAMUT = 1e-9


@dataclass(frozen=True, repr=False)
class Colour:
    """A colour, or an array of colours: all attributes but the last two have the shape of the array, and 3 last.

    XYZ : tristimulus values, Y = 1 for a perfect white. Lab : CIE 1976, against a perfect white under the same illuminant.
    sRGB : 0 to 1, adapted to the white of sRGB (Bradford) and cut off where the colour lies outside. in_gamut : whether nothing was cut off.
    illuminant, observer : CIE name, and degrees (2 or 10).
    """

    XYZ: np.ndarray
    Lab: np.ndarray
    sRGB: np.ndarray
    in_gamut: np.ndarray
    illuminant: str
    observer: int

    @property
    def hex(self) -> np.ndarray | str:
        """sRGB as on the web, such as "#c68863"."""
        codes = np.apply_along_axis(_code, -1, self.sRGB)
        return str(codes) if codes.ndim == 0 else codes

    def delta_e(self, other: "Colour") -> np.ndarray:
        """CIEDE2000 colour difference (CIE 142-2001; Sharma, Wu and Dalal 2005). Raises InputError for another illuminant or observer."""
        if (self.illuminant, self.observer) != (other.illuminant, other.observer):
            mine, theirs = (f"{one.illuminant} and {one.observer} degrees" for one in (self, other))
            raise InputError(f"delta_e: {mine} against {theirs}; allowed are two alike")
        return delta_e(self.Lab, other.Lab)

    def __repr__(self) -> str:
        told = f"under {self.illuminant}, {self.observer} degrees"
        if self.XYZ.ndim > 1:
            return f"{self.XYZ[..., 0].size} colours of shape {self.XYZ.shape[:-1]} {told}, {int(np.sum(~self.in_gamut))} outside sRGB"
        lightness, a, b = np.round(self.Lab, 2) + 0.0
        return f"Lab {lightness:.2f} {a:.2f} {b:.2f} {told}, sRGB {self.hex}" + ("" if self.in_gamut else " (cut off)")

    def _repr_html_(self) -> str:
        from .report.swatches import swatches_html

        return swatches_html(self)


@cache
def _science() -> Any:
    """colour-science, which takes a second to import and on the way changes how numpy prints: that is undone."""
    with np.printoptions():
        import colour
    return colour


def _code(rgb: np.ndarray) -> str:
    return "#" + "".join(f"{round(255 * float(v)):02x}" for v in rgb)


def colour(wavelength: Any, reflectance: Any, *, illuminant: str = "D65", observer: int = 2) -> Colour:
    """Colour of reflectance spectra.

    Arguments
    ---------
    wavelength : [nm], increasing, at least from 420 to 680; beyond its ends the last values are taken, between its points a monotone cubic.
    reflectance : one value a wavelength, 0 to 1 or a little outside for noise; shape (..., wavelengths) for many spectra at once. A transmittance
        gives the colour of light that went through.
    illuminant : CIE name ("A", "D50", "D65", "F2", ...). observer : 2 or 10 degrees.

    The integrals are sums over 380 to 780 nm in steps of 5 nm (CIE 15:2004, 7.1). Raises InputError for spectra that are too short, not finite or
    in per cent, and for unknown illuminants and observers.

    >>> import layerfit as lf
    >>> lf.colour([400, 500, 600, 700], [0.5, 0.5, 0.5, 0.5])
    Lab 76.07 0.00 0.00 under D65, 2 degrees, sRGB #bcbcbc
    """
    known, values = _checked(wavelength, reflectance)
    cmfs, light = _tables(illuminant, observer)
    grid = np.arange(FIRST, LAST + 1, STEP, dtype=float)
    with np.errstate(over="ignore"):  # slopes of 1e-308, as an empty band has them
        spectra = PchipInterpolator(known, values, axis=-1)(np.clip(grid, known[0], known[-1]))
    weights = light[:, None] * cmfs / np.sum(light * cmfs[:, 1])
    return _seen(spectra @ weights, np.sum(weights, axis=0), illuminant, observer)


def colour_of_rgb(rgb: Any) -> Colour:
    """Colour of reflectances in three bands, red, green and blue, taken as linear sRGB: shape (..., 3).

    What pictures of published skin tables are made with. Raises InputError for other shapes or values that are not finite.

    >>> import layerfit as lf
    >>> lf.colour_of_rgb([0.4, 0.3, 0.25]).hex
    '#aa9589'
    """
    science = _science()
    try:
        linear = np.asarray(rgb, dtype=float)
    except (TypeError, ValueError):
        raise InputError("colour_of_rgb: something is not a number") from None
    if linear.ndim == 0 or linear.shape[-1] != 3 or not np.all(np.isfinite(linear)):
        raise InputError(f"colour_of_rgb: shape {linear.shape}; allowed are finite numbers of shape (..., 3)")
    to_xyz = science.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ
    return _seen(linear @ to_xyz.T, np.sum(to_xyz, axis=1), "D65", 2)


def delta_e(lab: Any, other: Any) -> np.ndarray:
    """CIEDE2000 difference of CIE Lab colours (CIE 142-2001; Sharma, Wu and Dalal 2005): shapes (..., 3), result (...).

    >>> import layerfit as lf
    >>> lf.delta_e([50.0, 2.6772, -79.7751], [50.0, 0.0, -82.7485]).round(4).item()
    2.0425
    """
    science = _science()
    return np.asarray(science.delta_E(np.asarray(lab, dtype=float), np.asarray(other, dtype=float), method="CIE 2000"))


def swatches(colours: Mapping[str, Colour]) -> "Figure":
    """Labelled patches, one a name; several colours of one name stand side by side. Those outside sRGB are marked.

    Raises InputError where there is none.
    """
    from .report.swatches import swatches_figure

    if not colours:
        raise InputError("swatches: no colour; allowed is at least one")
    return swatches_figure(colours)


def _seen(xyz: np.ndarray, white: np.ndarray, illuminant: str, observer: int) -> Colour:
    """From tristimulus values, and those of a perfect white."""
    science = _science()
    lab = science.XYZ_to_Lab(xyz, science.XYZ_to_xy(white))
    space = science.RGB_COLOURSPACES["sRGB"]
    adapted = science.chromatic_adaptation(xyz, white, np.sum(space.matrix_RGB_to_XYZ, axis=1), method="Von Kries", transform="Bradford")
    linear = adapted @ np.linalg.inv(space.matrix_RGB_to_XYZ).T
    inside = np.all((linear >= -_GAMUT) & (linear <= 1.0 + _GAMUT), axis=-1)
    return Colour(xyz, np.asarray(lab), space.cctf_encoding(np.clip(linear, 0.0, 1.0)), inside, illuminant, observer)


def _tables(illuminant: str, observer: int) -> tuple[np.ndarray, np.ndarray]:
    """Colour matching functions (wavelengths, 3) and the illuminant's power, on the grid."""
    science = _science()
    if observer not in OBSERVERS:
        raise InputError(f"observer = {observer!r}; allowed: 2, 10 (degrees)")
    if illuminant not in science.SDS_ILLUMINANTS:
        raise InputError(f"illuminant {illuminant!r}; allowed: {', '.join(science.SDS_ILLUMINANTS)}")
    shape = science.SpectralShape(FIRST, LAST, STEP)
    cmfs = science.MSDS_CMFS[OBSERVERS[observer]].copy().align(shape).values
    return np.asarray(cmfs), np.asarray(science.SDS_ILLUMINANTS[illuminant].copy().align(shape).values)


def _checked(wavelength: Any, reflectance: Any) -> tuple[np.ndarray, np.ndarray]:
    try:
        known, values = np.asarray(wavelength, dtype=float), np.asarray(reflectance, dtype=float)
    except (TypeError, ValueError):
        raise InputError("colour: a wavelength or a reflectance is not a number") from None
    if known.ndim != 1 or known.size < 2 or not np.all(np.isfinite(known)) or np.any(np.diff(known) <= 0):
        raise InputError("colour: wavelengths; allowed are two or more increasing numbers of nm")
    if known[0] > _NEEDED[0] or known[-1] < _NEEDED[1]:
        raise InputError(f"colour: wavelengths {known[0]:g} to {known[-1]:g} nm; allowed are spectra that hold {_NEEDED[0]:g} to {_NEEDED[1]:g} nm")
    if values.ndim == 0 or values.shape[-1] != known.size:
        raise InputError(f"colour: values of shape {values.shape} for {known.size} wavelengths; allowed is one a wavelength, on the last axis")
    if not np.all(np.isfinite(values)):
        raise InputError("colour: a value is not finite")
    if np.max(values) > 3.0:
        raise InputError(f"colour: a value of {np.max(values):g}; allowed are shares of a perfect white (1, not 100)")
    return known, values
