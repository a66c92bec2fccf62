"""A layer and a half space: the nouns a person writes."""

import math
from typing import TYPE_CHECKING, Any, ClassVar

import equinox as eqx
import jax
from jax.core import Tracer

from ..errors import InputError

if TYPE_CHECKING:
    from .stack import Stack

Number = Any  # a Python float, or a scalar array (traced ones included)

LAYER_FIELDS = ("sigma_a", "sigma_s", "sigma_s_prime", "g", "n", "thickness", "roughness")


def as_number(value: Any, where: str) -> Number:
    """A float for anything that holds one; arrays of JAX stay as they are, so that a stack can be differentiated."""
    if isinstance(value, jax.Array):
        if value.shape != ():
            raise InputError(f"{where}: an array of shape {value.shape} was given; allowed is one number")
        return value
    if isinstance(value, bool | str):
        raise InputError(f"{where}: {value!r} was given; allowed is a number")
    try:
        return float(value)
    except (TypeError, ValueError):
        raise InputError(f"{where}: {value!r} was given; allowed is a number") from None


def check_range(value: Number, where: str, low: float, *, strict: bool = False, high: float = math.inf) -> None:
    """Raise InputError where a known (not traced) number is not finite or outside [low, high), or (low, high) with strict."""
    if isinstance(value, Tracer):
        return
    number = float(value)
    ok = math.isfinite(number) and (number > low if strict else number >= low) and number < high
    if not ok:
        allowed = f"{'above' if strict else 'at least'} {low:g}" + (f" and below {high:g}" if high < math.inf else "")
        raise InputError(f"{where} = {number!r}: allowed is a finite number {allowed}")


class Part(eqx.Module):
    """One layer of a stack, of whatever kind."""

    endless: ClassVar[bool] = False

    def _take_name(self, name: str) -> None:
        if not isinstance(name, str) or not name or name != name.strip() or not name.isprintable() or "." in name or name == "scene":
            raise InputError(f"layer name {name!r}: allowed is a non-empty text without dots, other than 'scene'")
        self.name = name

    def __or__(self, other: "Part") -> "Stack":
        from .stack import Stack  # a stack is made of layers: the import must wait until both exist

        if self.endless:
            raise InputError(f"half space '{self.name}' is not the last layer: nothing can lie under a half space")
        return Stack((self,)) | other  # pyright: ignore[reportArgumentType]


class _Medium(Part):
    """What a layer and a half space share: how light is absorbed, scattered and refracted."""

    name: str = eqx.field(static=True)
    sigma_a: Number
    scattering: Number
    g: Number | None
    n: Number
    roughness: Number
    reduced: bool = eqx.field(static=True)

    def __init__(
        self,
        name: str,
        *,
        sigma_a: Number,
        sigma_s: Number | None = None,
        sigma_s_prime: Number | None = None,
        g: Number | None = None,
        n: Number,
        roughness: Number = 0.0,
    ):
        self._take_name(name)
        if (sigma_s is None) == (sigma_s_prime is None):
            given = "neither" if sigma_s is None else "both"
            raise InputError(f"layer '{name}': {given} of sigma_s and sigma_s_prime given; allowed is one of them")
        if sigma_s is not None and g is None:
            raise InputError(f"layer '{name}': sigma_s given without g; allowed is sigma_s with g, or sigma_s_prime")
        self.sigma_a = as_number(sigma_a, f"layer '{name}': sigma_a")
        self.reduced = sigma_s is None
        self.scattering = as_number(sigma_s_prime if sigma_s is None else sigma_s, f"layer '{name}': {self._scattering_name}")
        self.g = None if g is None else as_number(g, f"layer '{name}': g")
        self.n = as_number(n, f"layer '{name}': n")
        self.roughness = as_number(roughness, f"layer '{name}': roughness")
        check_range(self.sigma_a, f"layer '{name}': sigma_a", 0.0)
        check_range(self.scattering, f"layer '{name}': {self._scattering_name}", 0.0)
        check_range(self.n, f"layer '{name}': n", 0.0, strict=True)
        check_range(self.roughness, f"layer '{name}': roughness", 0.0)
        if self.g is not None:
            check_range(self.g, f"layer '{name}': g", -1.0, high=1.0)

    @property
    def _scattering_name(self) -> str:
        return "sigma_s_prime" if self.reduced else "sigma_s"

    @property
    def sigma_s(self) -> Number | None:
        """Scattering coefficient [1/mm]; None where the layer was written with sigma_s_prime and no g."""
        if not self.reduced:
            return self.scattering
        return None if self.g is None else self.scattering / (1.0 - self.g)

    @property
    def sigma_s_prime(self) -> Number:
        """Reduced scattering coefficient sigma_s (1 - g) [1/mm]."""
        return self.scattering if self.g is None or self.reduced else self.scattering * (1.0 - self.g)

    @property
    def transport_mfp(self) -> Number:
        """Transport mean free path 1/(sigma_a + sigma_s') [mm]."""
        return 1.0 / (self.sigma_a + self.sigma_s_prime)

    def _keywords(self) -> dict[str, Number | None]:
        return {
            "sigma_a": self.sigma_a,
            self._scattering_name: self.scattering,
            "g": self.g,
            "n": self.n,
            "roughness": self.roughness,
        }

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of its numbers."""
        return tuple(f for f in LAYER_FIELDS if (f != "thickness" or not self.endless) and getattr(self, f) is not None)

    def number(self, field: str) -> Number:
        """One of its numbers."""
        return getattr(self, field)

    @property
    def written_fields(self) -> tuple[str, ...]:
        """The numbers it was written with."""
        return tuple(key for key, value in self._keywords().items() if value is not None)

    def replace(self, **changes: Number) -> "_Medium":
        """A copy with other numbers.

        Setting sigma_s_prime of a layer written with sigma_s changes sigma_s at fixed g, and the other way round. Raises InputError for
        a number that the layer does not have.
        """
        keywords = self._keywords()
        for key in changes:
            if key not in (*keywords, "sigma_s", "sigma_s_prime"):
                allowed = ", ".join(k for k in LAYER_FIELDS if k in keywords or k in ("sigma_s", "sigma_s_prime"))
                raise InputError(f"layer '{self.name}' has no number '{key}'; allowed: {allowed}")
        scattering = {k: changes.pop(k) for k in ("sigma_s", "sigma_s_prime") if k in changes}
        keywords.update(changes)
        if len(scattering) > 1:
            raise InputError(f"layer '{self.name}': sigma_s and sigma_s_prime both set; they are one number given g")
        for key, value in scattering.items():
            if key != self._scattering_name:
                g = keywords["g"]
                if g is None:
                    raise InputError(f"layer '{self.name}': sigma_s cannot be set because g is unknown; give the layer a g")
                value = value / (1.0 - g) if key == "sigma_s_prime" else value * (1.0 - g)
            keywords[self._scattering_name] = value
        return type(self)(self.name, **keywords)  # pyright: ignore[reportArgumentType]

    def __repr__(self) -> str:
        hidden = {"g": None, "roughness": 0.0}
        parts = [f"{k}={_plain(v)}" for k, v in self._keywords().items() if not _same(v, hidden.get(k, ...))]
        return f"{type(self).__name__}({self.name!r}, {', '.join(parts)})"


def _same(value: Any, default: Any) -> bool:
    if value is None or default is None or default is ... or isinstance(value, Tracer):
        return value is default
    return float(value) == default


def _plain(value: Any) -> str:
    return repr(value) if isinstance(value, Tracer) else repr(float(value))


class Layer(_Medium):
    """A homogeneous layer of finite thickness.

    Arguments
    ---------
    name : text without dots; numbers of the layer are called ``name.sigma_a`` and so on.
    sigma_a : absorption coefficient [1/mm], at least 0.
    sigma_s : scattering coefficient [1/mm], with g; or
    sigma_s_prime : reduced scattering coefficient sigma_s (1 - g) [1/mm].
    g : mean cosine of the scattering angle, -1 <= g < 1. May be left out with sigma_s_prime; solvers that need it say so.
    n : refractive index.
    thickness : [mm], at least 0.
    roughness : RMS slope per axis of the upper face (sigma of Stam 2001, eq 17; the Beckmann alpha is sqrt 2 of it).

    Raises InputError where a number is missing, not finite or outside its range.

    >>> import layerfit as lf
    >>> lf.Layer("fat", sigma_a=0.005, sigma_s=12, g=0.9, n=1.44, thickness=4)
    Layer('fat', sigma_a=0.005, sigma_s=12.0, g=0.9, n=1.44, thickness=4.0)
    """

    thickness: Number

    def __init__(
        self,
        name: str,
        *,
        sigma_a: Number,
        sigma_s: Number | None = None,
        sigma_s_prime: Number | None = None,
        g: Number | None = None,
        n: Number,
        thickness: Number,
        roughness: Number = 0.0,
    ):
        super().__init__(name, sigma_a=sigma_a, sigma_s=sigma_s, sigma_s_prime=sigma_s_prime, g=g, n=n, roughness=roughness)
        self.thickness = as_number(thickness, f"layer '{name}': thickness")
        try:
            check_range(self.thickness, f"layer '{name}': thickness", 0.0)
        except InputError as error:
            raise InputError(f"{error} (a half space is written HalfSpace, or without a thickness in a file)") from None

    def _keywords(self) -> dict[str, Number | None]:
        keywords = super()._keywords()
        roughness = keywords.pop("roughness")
        return {**keywords, "thickness": self.thickness, "roughness": roughness}


class HalfSpace(_Medium):
    """A homogeneous medium without a lower end; the last layer of a stack.

    Arguments as for `Layer`, without a thickness. It is a type of its own because an infinite thickness has no derivative.

    >>> import layerfit as lf
    >>> lf.HalfSpace("dermis", sigma_a=0.02, sigma_s_prime=2, n=1.4)
    HalfSpace('dermis', sigma_a=0.02, sigma_s_prime=2.0, n=1.4)
    """

    endless: ClassVar[bool] = True

    def __init__(
        self,
        name: str,
        *,
        sigma_a: Number,
        sigma_s: Number | None = None,
        sigma_s_prime: Number | None = None,
        g: Number | None = None,
        n: Number,
        roughness: Number = 0.0,
    ):
        super().__init__(name, sigma_a=sigma_a, sigma_s=sigma_s, sigma_s_prime=sigma_s_prime, g=g, n=n, roughness=roughness)
