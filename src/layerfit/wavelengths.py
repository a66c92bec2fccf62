"""A scene at many wavelengths: which plain scenes it stands for, and what predicts them together."""

from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np
from jax import Array
from jaxtyping import Float

from .arrays import AnyArray
from .errors import InputError
from .measurement.geometry import Geometry
from .measurement.spectrum import Spectrum
from .scene.columns import Columns, to_columns
from .scene.stack import Stack
from .solver import Forward

_LOOKED_AT = 3  # wavelengths at which a solver that chooses is asked


def check_kinds(stack: Stack, geometries: Sequence[Geometry]) -> None:
    """Raise InputError where a stack of tissue meets a measurement without wavelengths, or the other way round."""
    for geometry in geometries:
        if stack.spectral and not isinstance(geometry, Spectrum):
            raise InputError(
                f"{geometry.kind}: the stack has layers of tissue, whose optics depend on the wavelength; allowed is lf.Spectrum(wavelength, ...)"
            )
        if isinstance(geometry, Spectrum) and not stack.spectral:
            raise InputError(
                "spectrum: no layer of the stack depends on the wavelength; allowed are stacks with lf.TissueLayer or lf.TissueHalfSpace"
            )


def posed(stack: Stack, geometry: Geometry) -> list[tuple[Stack, Geometry]]:
    """The plain stacks and geometries that a measurement stands for: one a wavelength."""
    if not isinstance(geometry, Spectrum):
        return [(stack, geometry)]
    return [(stack.at(w), geometry.geometry) for w in geometry.wavelength.tolist()]


def some(stack: Stack, geometries: Sequence[Geometry]) -> list[tuple[Stack, list[Geometry]]]:
    """Plain scenes at a few wavelengths, those at the ends included; the scene itself where it has none."""
    if not stack.spectral:
        return [(stack, list(geometries))]
    spectra = [geometry for geometry in geometries if isinstance(geometry, Spectrum)]
    known = np.unique(np.concatenate([spectrum.wavelength for spectrum in spectra]))
    chosen = known[np.unique(np.linspace(0, known.size - 1, _LOOKED_AT).astype(int))]
    return [(stack.at(w), [spectrum.geometry for spectrum in spectra]) for w in chosen.tolist()]


class Group(eqx.Module):
    """Measurements at the same wavelengths. members : their numbers. geometries : what is measured at each wavelength."""

    wavelength: Float[AnyArray, "w"]
    members: tuple[int, ...] = eqx.field(static=True)
    geometries: tuple[Geometry, ...] = eqx.field(static=True)


def groups(geometries: Sequence[Geometry]) -> tuple[Group, ...]:
    """Spectra by their wavelengths."""
    found: list[tuple[np.ndarray, list[int]]] = []
    for i, geometry in enumerate(geometries):
        assert isinstance(geometry, Spectrum)
        known = next((members for wavelength, members in found if np.array_equal(wavelength, geometry.wavelength)), None)
        if known is None:
            found.append((geometry.wavelength, [i]))
        else:
            known.append(i)
    return tuple(Group(w, tuple(m), tuple(geometries[i].geometry for i in m)) for w, m in found)  # pyright: ignore[reportAttributeAccessIssue]


def columns_at(stack: Stack, wavelength: Float[AnyArray, "w"], rough_faces: tuple[bool, ...] | None = None) -> Columns:
    """Columns of a stack of tissue at many wavelengths, which are the first axis of each."""
    return jax.vmap(lambda w: to_columns(stack.at(w), rough_faces=rough_faces))(jax.numpy.asarray(wavelength))


def over_wavelengths(forward: Forward, columns: Columns) -> tuple[Float[Array, "wn"], ...]:
    """Values of all geometries of a forward model at all wavelengths, the places of the first wavelength first."""
    return tuple(values.reshape(-1) for values in jax.vmap(lambda one: forward(one))(columns))
