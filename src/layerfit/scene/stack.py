"""A stack of layers between two media."""

from typing import Any

import equinox as eqx

from ..errors import InputError
from .layer import HalfSpace, Layer, Number, Part, as_number, check_range

AnyLayer = Any  # Layer, HalfSpace, TissueLayer or TissueHalfSpace; solvers see the first two alone

SCENE_FIELDS = ("n_above", "n_below", "roughness_below")


class Stack(eqx.Module):
    """Layers from top to bottom, between a medium above and a medium below.

    Usually written ``layer | layer | half_space``; this constructor also sets the surroundings.

    Arguments
    ---------
    layers : Layers, top first; the last may be a HalfSpace.
    n_above, n_below : refractive index of the media above and below. n_below is without meaning under a half space.
    roughness_below : RMS slope of the lowest face (see `Layer` for the others).

    Raises InputError for no layer, a half space that is not last, two layers of one name, or numbers out of range.

    >>> import layerfit as lf
    >>> skin = lf.Layer("top", sigma_a=0.3, sigma_s_prime=5, n=1.4, thickness=0.1) | lf.HalfSpace("deep", sigma_a=0.02, sigma_s_prime=2, n=1.4)
    >>> skin.get("deep.sigma_a")
    0.02
    >>> skin.set({"deep.sigma_a": 0.03}).layers[1].sigma_a
    0.03
    """

    layers: tuple[AnyLayer, ...]
    n_above: Number
    n_below: Number
    roughness_below: Number

    def __init__(
        self,
        layers: "tuple[AnyLayer, ...] | list[AnyLayer]",
        *,
        n_above: Number = 1.0,
        n_below: Number = 1.0,
        roughness_below: Number = 0.0,
    ):
        self.layers = tuple(layers)
        self.n_above = as_number(n_above, "n_above")
        self.n_below = as_number(n_below, "n_below")
        self.roughness_below = as_number(roughness_below, "roughness_below")
        if not self.layers:
            raise InputError("a stack without layers was given; allowed is one layer or more")
        names = [layer.name for layer in self.layers]
        for i, layer in enumerate(self.layers[:-1]):
            if layer.endless:
                raise InputError(f"half space '{layer.name}' (layer {i + 1} of {len(names)}) is not the last layer")
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"layer name '{name}' is used {names.count(name)} times; each layer needs its own")
        check_range(self.n_above, "n_above", 0.0, strict=True)
        check_range(self.n_below, "n_below", 0.0, strict=True)
        check_range(self.roughness_below, "roughness_below", 0.0)

    @property
    def half_space(self) -> bool:
        """Whether the last layer has no lower end."""
        return self.layers[-1].endless

    @property
    def spectral(self) -> bool:
        """Whether a layer's optics depend on the wavelength."""
        return any(not isinstance(layer, Layer | HalfSpace) for layer in self.layers)

    def at(self, wavelength: Any) -> "Stack":
        """The stack of plain layers at one wavelength [nm]. Raises InputError for wavelengths outside a layer's tables."""
        layers = [layer if isinstance(layer, Layer | HalfSpace) else layer.at(wavelength) for layer in self.layers]
        return Stack(layers, **self._surroundings())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all numbers that can be read, set or fitted."""
        layers = [f"{layer.name}.{field}" for layer in self.layers for field in layer.fields]
        return (*layers, *(f"scene.{field}" for field in SCENE_FIELDS))

    @property
    def written_names(self) -> tuple[str, ...]:
        """The names the stack was written with: sigma_s or sigma_s_prime, not both. Setting them all makes any stack of this structure."""
        layers = [f"{layer.name}.{field}" for layer in self.layers for field in layer.written_fields]
        return (*layers, *(f"scene.{field}" for field in SCENE_FIELDS))

    def __or__(self, other: AnyLayer) -> "Stack":
        if not isinstance(other, Part):
            return NotImplemented
        return Stack((*self.layers, other), **self._surroundings())

    def _surroundings(self) -> dict[str, Number]:
        return {field: getattr(self, field) for field in SCENE_FIELDS}

    def _find(self, name: str, allowed: tuple[str, ...]) -> tuple[int | None, str]:
        if name not in allowed:
            raise InputError(f"'{name}' is no number of this scene; allowed: {', '.join(allowed)}")
        owner, field = name.rsplit(".", 1)
        index = next((i for i, layer in enumerate(self.layers) if layer.name == owner), None)
        return index, field

    def get(self, name: str) -> Number:
        """The number called ``layer.field`` or ``scene.field``; InputError where there is none."""
        index, field = self._find(name, self.names)
        return getattr(self, field) if index is None else self.layers[index].number(field)

    def set(self, values: dict[str, Any]) -> "Stack":
        """A new stack with some numbers replaced; this one stays as it is. InputError for a name that does not exist."""
        changes: dict[int | None, dict[str, Any]] = {}
        allowed = self.names
        for name, value in values.items():
            index, field = self._find(name, allowed)
            changes.setdefault(index, {})[field] = value
        layers = [layer.replace(**changes[i]) if i in changes else layer for i, layer in enumerate(self.layers)]
        return Stack(layers, **{**self._surroundings(), **changes.get(None, {})})  # pyright: ignore[reportArgumentType]

    def __repr__(self) -> str:
        chain = " | ".join(map(repr, self.layers))
        around = [f"{k}={float(v)!r}" for k, v in self._surroundings().items() if float(v) != (0.0 if "rough" in k else 1.0)]
        if len(self.layers) > 1 and not around:
            return chain
        return f"Stack({list(self.layers)!r}{''.join(', ' + a for a in around)})"

    def _repr_html_(self) -> str:
        from .drawing import stack_svg

        return stack_svg(self)
