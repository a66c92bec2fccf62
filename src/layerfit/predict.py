"""What a measurement of a known stack would give."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np

from .errors import InputError
from .measurement.geometry import Geometry
from .measurement.spectrum import Spectrum
from .scene.columns import to_columns
from .scene.stack import Stack
from .solver import Domain, Solver
from .transport.auto import Auto
from .wavelengths import check_kinds, posed


class Prediction(eqx.Module):
    """Predicted values of one measurement.

    values : in the unit of the geometry. estimated_error : absolute, in the same unit; None where the solver does not know its error.
    """

    geometry: Geometry
    values: np.ndarray
    estimated_error: np.ndarray | None
    solver: Solver
    notes: tuple[str, ...] = eqx.field(static=True)


def predict(stack: Stack, geometries: Geometry | Sequence[Geometry], *, solver: Solver | None = None) -> list[Prediction]:
    """Predicted values for one geometry or several.

    Returns one Prediction a geometry. Raises InputError where the solver cannot do the scene or a geometry, or where its result is not finite.

    >>> import layerfit as lf
    >>> skin = lf.HalfSpace("skin", sigma_a=0.01, sigma_s_prime=1, n=1.4)
    >>> lf.predict(lf.Stack([skin]), lf.SpatialFrequency(fx=[0, 0.1, 0.2]))[0].values.round(4)
    array([0.6002, 0.2166, 0.0793])
    """
    geometries = [geometries] if isinstance(geometries, Geometry) else list(geometries)
    solver = Auto() if solver is None else solver
    check_kinds(stack, geometries)
    if stack.spectral:
        return [_spectrum(stack, geometry, solver) for geometry in geometries if isinstance(geometry, Spectrum)]
    for geometry in geometries:
        solver.check(stack, geometry)
    columns = to_columns(stack)
    domain = Domain(stack, columns, columns)
    chosen, why, _ = solver.choose(stack, geometries, domain=domain)
    notes = [(*why, *chosen.notes(stack, geometry)) for geometry in geometries]
    forward = chosen.forward(domain, geometries, [(0.0, 0.0)] * len(geometries))
    values, errors, said = forward.evaluate(columns)
    for geometry, value in zip(geometries, values, strict=True):
        if not np.all(np.isfinite(value)):
            raise InputError(f"solver {chosen.name}: {geometry.kind} is not finite for {stack!r}; another solver may do")
    notes = [(*note, *said) for note in notes]
    return [Prediction(*row) for row in zip(geometries, values, errors, [chosen] * len(values), notes, strict=True)]


def _spectrum(stack: Stack, geometry: Spectrum, solver: Solver) -> Prediction:
    """Wavelength by wavelength."""
    found = [predict(*one, solver=solver)[0] for one in posed(stack, geometry)]
    errors = [one.estimated_error for one in found]
    known = [error for error in errors if error is not None]
    last = max(found, key=lambda one: one.solver.label)
    notes = tuple(dict.fromkeys(note for one in found for note in one.notes))
    return Prediction(
        geometry, np.concatenate([one.values for one in found]), np.concatenate(known) if len(known) == len(errors) else None, last.solver, notes
    )
