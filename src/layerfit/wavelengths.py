"""A scene at many wavelengths: which plain scenes it stands for, and what predicts them together."""

from collections.abc import Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.custom_derivatives import SymbolicZero
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
    return jax.vmap(lambda w: to_columns(stack.at(w), rough_faces=rough_faces))(jnp.asarray(wavelength))


def over_wavelengths(forward: Forward, columns: Columns, numbers: int) -> tuple[Float[Array, "wn"], ...]:
    """Values of all geometries of a forward model at all wavelengths, the places of the first wavelength first.

    numbers : how many free numbers the columns are made of. Where these are more than the columns that move with them, derivatives are taken to the
    columns, of which each wavelength has its own few: amounts of many substances cost no more than sigma_a.
    """
    straight = jax.vmap(lambda one: forward(one))
    values = jax.custom_jvp(straight)

    @partial(values.defjvp, symbolic_zeros=True)
    def slope(primals: tuple[Columns], tangents: tuple[Columns]) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        leaves, structure = jax.tree.flatten(primals[0])
        given = structure.flatten_up_to(tangents[0])
        moving = [i for i, tangent in enumerate(given) if not isinstance(tangent, SymbolicZero)]
        sizes = [leaves[i][0].size for i in moving]

        def moved(parts: Sequence[Array]) -> tuple[Array, ...]:
            mine = list(leaves)
            for i, part in zip(moving, parts, strict=True):
                mine[i] = part
            return straight(jax.tree.unflatten(structure, mine))

        here = [leaves[i] for i in moving]
        if sum(sizes) >= numbers:
            return jax.jvp(moved, (here,), ([given[i] for i in moving],))
        ends = np.cumsum(sizes)[:-1]

        def along(direction: Float[Array, "q"]) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
            parts = jnp.split(direction, ends)
            same = [jnp.broadcast_to(part.reshape(x.shape[1:]), x.shape) for part, x in zip(parts, here, strict=True)]
            return jax.jvp(moved, (here,), (same,))

        found, slopes = jax.vmap(along, out_axes=(None, -1))(jnp.eye(sum(sizes)))  # slopes: wavelength, place, column
        rates = jnp.concatenate([given[i].reshape(len(given[i]), -1) for i in moving], axis=1)
        return found, tuple(jnp.einsum("wnq,wq->wn", part, rates) for part in slopes)

    return tuple(found.reshape(-1) for found in values(columns))
