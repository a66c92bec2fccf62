"""The forward model of a problem as a function of its free numbers: what is compiled."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..arrays import AnyArray
from ..measurement.dataset import Dataset
from ..scene.columns import Columns, to_columns
from ..scene.stack import Stack
from ..solver import Forward
from .parameters import NUISANCE, Coordinates, FreeParameter, Tie


class Scene(eqx.Module):
    """A stack with free and tied numbers, as a function of the free ones.

    All numbers of the stack are arrays, so that problems which differ in values alone share one compilation.
    """

    template: Stack
    fixed: Float[AnyArray, "numbers"]
    fixed_names: tuple[str, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)  # of the free numbers, nuisance ones included
    ties: tuple[Tie, ...] = eqx.field(static=True)
    rough_faces: tuple[bool, ...] = eqx.field(static=True)

    def __init__(self, stack: Stack, parameters: Sequence[FreeParameter], ties: Sequence[Tie]):
        self.names = tuple(p.name for p in parameters)
        self.ties = tuple(ties)
        self.fixed_names = stack.written_names
        self.fixed = np.array([float(stack.get(name)) for name in self.fixed_names])
        self.template = stack.set(dict.fromkeys(self.fixed_names, 0.5))  # its numbers are never used
        moving = {*self.names, *(tie.name for tie in ties)}
        faces = [(f"{layer.name}.roughness", layer.roughness) for layer in stack.layers]
        if not stack.half_space:
            faces.append(("scene.roughness_below", stack.roughness_below))
        self.rough_faces = tuple(name in moving or float(value) > 0 for name, value in faces)

    def stack(self, x: Float[AnyArray, "p"]) -> Stack:
        """The stack at free numbers x."""
        stack = self.template.set(dict(zip(self.fixed_names, self.fixed, strict=True)))
        stack = stack.set({name: x[i] for i, name in enumerate(self.names) if name in stack.names})
        return stack.set({tie.name: tie.factor * stack.get(tie.source) for tie in self.ties})

    def columns(self, x: Float[AnyArray, "p"]) -> Columns:
        """Its columns."""
        return to_columns(self.stack(x), rough_faces=self.rough_faces)


class Model(eqx.Module):
    """Predictions and residuals at unbounded coordinates u."""

    scene: Scene
    coordinates: Coordinates
    forward: Forward
    values: tuple[Float[AnyArray, "n"], ...]
    sd: tuple[Float[AnyArray, "n"], ...]
    nuisance: tuple[tuple[int | None, int | None, int | None], ...] = eqx.field(static=True)  # index of amplitude, offset, background

    def __init__(self, scene: Scene, parameters: Sequence[FreeParameter], forward: Forward, datasets: Sequence[Dataset], sd: Sequence[np.ndarray]):
        self.scene, self.coordinates, self.forward = scene, Coordinates(parameters), forward
        self.values = tuple(d.values for d in datasets)
        self.sd = tuple(sd)
        index = {name: i for i, name in enumerate(scene.names)}
        self.nuisance = tuple(tuple(index.get(f"{d.name}.{n}") for n in NUISANCE) for d in datasets)  # pyright: ignore[reportAttributeAccessIssue]

    def predict(self, x: Float[Array, "p"]) -> tuple[Float[Array, "n"], ...]:
        """Predicted values of all datasets at physical numbers x, calibration included."""
        shifts = [None if offset is None else x[offset] for _, offset, _ in self.nuisance]
        predicted = self.forward(self.scene.columns(x), shifts)
        return tuple(
            (1.0 if amplitude is None else x[amplitude]) * values + (0.0 if background is None else x[background])
            for values, (amplitude, _, background) in zip(predicted, self.nuisance, strict=True)
        )

    def residuals(self, u: Float[Array, "p"], logarithmic: Float[Array, ""]) -> Float[Array, "n"]:
        """(prediction - value)/sd; where logarithmic is 1 and both are positive, their log ratio over the relative sd.

        Both agree to first order near the data. Far from them the logarithm keeps a single value from ruling all others, which is what carries a
        fit over from a poor start.
        """
        parts = []
        for predicted, values, sd in zip(self.predict(self.coordinates.physical(u)), self.values, self.sd, strict=True):
            linear = (predicted - values) / sd
            positive = (predicted > 0) & (values > 0)
            ratio = jnp.where(positive, predicted, 1.0) / jnp.where(positive, values, 1.0)
            parts.append(jnp.where((logarithmic > 0) & positive, jnp.log(ratio) * values / sd, linear))
        return jnp.concatenate(parts)
