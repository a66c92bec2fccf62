"""Where diffusion does not apply: what is refused, and what is said beside a result."""

import numpy as np

from ..errors import InputError
from ..measurement.geometry import Angular, Geometry
from ..scene.stack import Stack
from .spectral import aperture


def check_aperture(stack: Stack, geometry: Geometry) -> None:
    """Raise InputError for what needs directions, which diffusion does not know: radiances, a numerical aperture behind a rough face."""
    if isinstance(geometry, Angular):
        raise InputError(f"{geometry.kind}: diffusion knows no directions; use solver discrete-ordinates")
    if aperture(geometry) is not None and any(float(layer.roughness) > 0 for layer in stack.layers[:1]):
        raise InputError("detector na below 1 with a rough surface: diffusion cannot tell which directions are collected; allowed is na = 1")


def diffusion_notes(stack: Stack) -> tuple[str, ...]:
    """Where diffusion is known to be poor."""
    notes = []
    for layer in stack.layers:
        scattering, absorption = float(layer.sigma_s_prime), float(layer.sigma_a)
        if scattering < 10.0 * absorption:
            notes.append(
                f"layer '{layer.name}': sigma_s'/sigma_a = {scattering / absorption:.2g} is below 10, where diffusion is off by 10 % and more"
            )
        thickness = float(getattr(layer, "thickness", np.inf))
        if thickness * (scattering + absorption) < 2.0:
            optical = thickness * (scattering + absorption)
            notes.append(f"layer '{layer.name}' is {optical:.2g} transport mean free paths thick; below 2 diffusion is off by 10 % and more")
    return tuple(notes)
