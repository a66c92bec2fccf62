"""Layers whose optics follow from what they hold, at every wavelength."""

from collections.abc import Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from ..errors import InputError
from .chromophores import MELANOSOME, UNITS, Spectrum, interpolated, packaging, spectrum
from .layer import HalfSpace, Layer, Number, Part, as_number, check_range

FRACTIONS = ("blood", "saturation", "melanin", "water", "fat", "rayleigh")
_SCATTERING = ("a", "b", "rayleigh")
_HIDDEN = ("rayleigh", "roughness")  # not shown where they are 0
_DEFAULTS = {"saturation": 0.7, "melanin_slope": 3.0}


class _Tissue(Part):
    """What a tissue layer and a tissue half space share."""

    name: str = eqx.field(static=True)
    numbers: dict[str, Number]
    chromophores: tuple[tuple[str, Spectrum], ...] = eqx.field(static=True)
    index: tuple[tuple[float, ...], tuple[float, ...]] | None = eqx.field(static=True)
    reference: float = eqx.field(static=True)

    def __init__(self, name: str, *, n: Any, g: Any, reference: float, chromophores: Mapping[str, Spectrum] | None, numbers: Mapping[str, Any]):
        self._take_name(name)
        self.chromophores = tuple((chromophores or {}).items())
        self.reference = float(reference)
        if not self.reference > 0:
            raise InputError(f"layer '{name}': reference = {reference!r}; allowed is a wavelength in nm")
        taken = {*UNITS, "vessel_radius", "melanin_slope", "thickness", "roughness", "n", "g", *_SCATTERING}
        for own, table in self.chromophores:
            if own in taken or not isinstance(table, Spectrum):
                raise InputError(
                    f"layer '{name}': chromophores '{own}'; allowed are other names than {', '.join(sorted(taken))}, with lf.chromophore(...)"
                )
        allowed = (*UNITS, "vessel_radius", "melanin_slope", *dict(self.chromophores))
        held = {k: v for k, v in numbers.items() if v is not None}
        for key in held:
            if key not in (*allowed, *_SCATTERING, "thickness", "roughness"):
                raise InputError(f"layer '{name}' has no number '{key}'; allowed: {', '.join((*allowed, *_SCATTERING))}")
        if "blood" not in held and ("saturation" in held or "vessel_radius" in held):
            raise InputError(f"layer '{name}': saturation or vessel_radius without blood; give the volume fraction of blood")
        if "blood" in held:
            held.setdefault("saturation", _DEFAULTS["saturation"])
        if "melanin" in held:
            held.setdefault("melanin_slope", _DEFAULTS["melanin_slope"])
        held.setdefault("rayleigh", 0.0)
        held.setdefault("roughness", 0.0)
        if g is not None:
            held["g"] = g
        self.index = None
        if np.ndim(n) == 0:
            held["n"] = n
        else:
            self.index = _index_table(n, name)
        self.numbers = {key: as_number(held[key], f"layer '{name}': {key}") for key in held}
        for key, value in self.numbers.items():
            where = f"layer '{name}': {key}"
            if key in FRACTIONS:
                check_range(value, where, 0.0, high=1.0 + 1e-12)
            elif key == "g":
                check_range(value, where, -1.0, high=1.0)
            elif key == "n":
                check_range(value, where, 0.0, strict=True)
            elif key != "b":
                check_range(value, where, 0.0)

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of its numbers."""
        return tuple(self.numbers)

    @property
    def written_fields(self) -> tuple[str, ...]:
        return self.fields

    def number(self, field: str) -> Number:
        return self.numbers[field]

    @property
    def roughness(self) -> Number:
        return self.numbers["roughness"]

    def replace(self, **changes: Number) -> "_Tissue":
        """A copy with other numbers. Raises InputError for one that it does not have."""
        for key in changes:
            if key not in self.numbers:
                raise InputError(f"layer '{self.name}' has no number '{key}'; allowed: {', '.join(self.numbers)}")
        return self._again(**{**self.numbers, **changes})

    def _again(self, **numbers: Number) -> "_Tissue":
        n = numbers.pop("n", None) if self.index is None else self.index
        g = numbers.pop("g", None)
        return type(self)(self.name, n=n, g=g, reference=self.reference, chromophores=dict(self.chromophores), **numbers)  # pyright: ignore[reportArgumentType]

    def sigma_a(self, wavelength: Any) -> Number:
        """Absorption coefficient [1/mm] at a wavelength [nm]: the sum over what it holds."""
        total: Any = 0.0
        own = dict(self.chromophores)
        where = f"layer '{self.name}'"
        for key, amount in self.numbers.items():
            if key == "blood":
                s = self.numbers["saturation"]
                pure = s * spectrum("oxygenated").at(wavelength, f"{where}: blood")
                pure = pure + (1.0 - s) * spectrum("deoxygenated").at(wavelength, f"{where}: blood")
                radius = self.numbers.get("vessel_radius")
                total = total + amount * pure * (1.0 if radius is None else packaging(pure, radius))
            elif key == "melanin":
                total = total + amount * MELANOSOME * (wavelength / 500.0) ** (-self.numbers["melanin_slope"])
            elif key in own:
                total = total + amount * own[key].at(wavelength, f"{where}: {key}")
            elif key in UNITS and key != "saturation":
                total = total + amount * spectrum(key).at(wavelength, f"{where}: {key}")
        return total

    def sigma_s_prime(self, wavelength: Any) -> Number:
        """Reduced scattering coefficient [1/mm]: a (rayleigh (lambda/reference)^-4 + (1 - rayleigh)(lambda/reference)^-b), Jacques 2013 eq 2."""
        a, b, f = (self.numbers[key] for key in ("a", "b", "rayleigh"))
        ratio = wavelength / self.reference
        return a * (f * ratio**-4.0 + (1.0 - f) * ratio ** (-b))

    def n_at(self, wavelength: Any) -> Number:
        """Refractive index."""
        if self.index is None:
            return self.numbers["n"]
        return interpolated(wavelength, *self.index, f"layer '{self.name}': n")

    def at(self, wavelength: Any) -> Layer | HalfSpace:
        """The plain layer at one wavelength [nm]. Raises InputError outside a table."""
        if not isinstance(wavelength, jax.Array) and not (np.isfinite(wavelength) and wavelength > 0):
            raise InputError(f"layer '{self.name}': wavelength {wavelength!r}; allowed is a number of nm above 0")
        optics = {
            "sigma_a": self.sigma_a(wavelength),
            "sigma_s_prime": self.sigma_s_prime(wavelength),
            "g": self.numbers.get("g"),
            "n": self.n_at(wavelength),
            "roughness": self.numbers["roughness"],
        }
        if self.endless:
            return HalfSpace(self.name, **optics)
        return Layer(self.name, thickness=self.numbers["thickness"], **optics)

    def __repr__(self) -> str:
        shown = {k: v for k, v in self.numbers.items() if isinstance(v, Tracer) or k not in _HIDDEN or float(v) != 0.0}
        parts = [f"{k}={v!r}" if isinstance(v, Tracer) else f"{k}={float(v):.6g}" for k, v in shown.items()]
        return f"{type(self).__name__}({self.name!r}, {', '.join(parts)})"


def _index_table(n: Any, name: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    try:
        known, values = np.asarray(n[0], dtype=float), np.asarray(n[1], dtype=float)
    except (TypeError, ValueError, IndexError):
        raise InputError(f"layer '{name}': n = {n!r}; allowed is a number or (wavelengths in nm, indices)") from None
    if known.shape != values.shape or known.ndim != 1 or known.size < 2 or np.any(np.diff(known) <= 0) or not np.all(values > 0):
        raise InputError(f"layer '{name}': n; allowed are increasing wavelengths in nm and as many indices above 0")
    return tuple(known.tolist()), tuple(values.tolist())


class TissueLayer(_Tissue):
    """A layer of tissue: what it holds instead of coefficients, so that it has optics at every wavelength.

    Arguments
    ---------
    name : as for `Layer`. thickness : [mm].
    blood : volume fraction of whole blood (150 g/L haemoglobin). saturation : share of its haemoglobin that carries oxygen (default 0.7).
    vessel_radius : mean radius of its vessels [mm]; left out, blood is spread evenly (see `packaging`).
    melanin : volume fraction of melanosomes, each 51.9 (lambda/500 nm)^-melanin_slope /mm (default slope 3).
    water, fat : volume fractions. bilirubin : [umol/L]. baseline : share of bloodless skin's absorption.
    chromophores : substances of one's own, ``{"ink": lf.chromophore(...)}``; their amounts are further keywords, ``ink=0.1``.
    a, b, rayleigh, reference : sigma_s' = a (rayleigh (lambda/reference)^-4 + (1 - rayleigh) (lambda/reference)^-b) [1/mm], reference [nm].
    g : mean cosine, where a solver needs it. n : refractive index, or (wavelengths in nm, indices). roughness : as for `Layer`.

    Raises InputError for numbers out of range or unknown. Spectra of blood, water, fat and bilirubin need the extra ``tissue``.

    >>> import layerfit as lf
    >>> epidermis = lf.TissueLayer("epidermis", melanin=0.02, a=4.0, b=1.2, g=0.8, n=1.4, thickness=0.1)
    >>> round(epidermis.at(600).sigma_a, 4)
    0.6007
    """

    endless: ClassVar[bool] = False

    def __init__(
        self,
        name: str,
        *,
        thickness: Any,
        a: Any,
        b: Any,
        n: Any,
        g: Any = None,
        reference: float = 500.0,
        chromophores: Mapping[str, Spectrum] | None = None,
        **numbers: Any,
    ):
        held = {**numbers, "a": a, "b": b, "thickness": thickness}
        super().__init__(name, n=n, g=g, reference=reference, chromophores=chromophores, numbers=held)

    @property
    def thickness(self) -> Number:
        return self.numbers["thickness"]


class TissueHalfSpace(_Tissue):
    """Tissue without a lower end; arguments as for `TissueLayer`, without a thickness.

    >>> import layerfit as lf
    >>> dermis = lf.TissueHalfSpace("dermis", blood=0.02, saturation=0.6, water=0.65, a=4.0, b=1.2, n=1.4)
    >>> dermis.at(1000).sigma_s_prime.__round__(4)
    1.7411
    """

    endless: ClassVar[bool] = True

    def __init__(
        self,
        name: str,
        *,
        a: Any,
        b: Any,
        n: Any,
        g: Any = None,
        reference: float = 500.0,
        chromophores: Mapping[str, Spectrum] | None = None,
        **numbers: Any,
    ):
        super().__init__(name, n=n, g=g, reference=reference, chromophores=chromophores, numbers={**numbers, "a": a, "b": b})
