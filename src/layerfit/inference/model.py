"""The forward model of a problem as a function of its free numbers: what is compiled."""

from collections.abc import Mapping, Sequence
from itertools import islice
from typing import ClassVar

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
from ..wavelengths import Group, columns_at, over_wavelengths
from .parameters import MODEL_ERROR, NUISANCE, Coordinates, FreeParameter
from .priors import Priors
from .scatter import Scatter
from .sizes import Size
from .ties import Tie


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

    def __init__(self, stack: Stack, parameters: Sequence[FreeParameter], ties: Sequence[Tie], *, surroundings: bool = True):
        """surroundings : whether ``scene.`` numbers are those of this stack."""
        self.names = tuple(p.name if surroundings or not p.name.startswith("scene.") else "" for p in parameters)
        self.ties = tuple(tie for tie in ties if tie.name in stack.names and (surroundings or not tie.name.startswith("scene.")))
        self.fixed_names = stack.written_names
        self.fixed = np.array([float(stack.get(name)) for name in self.fixed_names])
        self.template = stack.set(dict.fromkeys(self.fixed_names, 0.5))  # its numbers are never used
        moving = {*self.names, *(tie.name for tie in self.ties)}
        faces = [(f"{layer.name}.roughness", layer.roughness) for layer in stack.layers]
        if not stack.half_space:
            faces.append(("scene.roughness_below", stack.roughness_below))
        self.rough_faces = tuple(name in moving or float(value) > 0 for name, value in faces)

    def stack(self, x: Float[AnyArray, "p"]) -> Stack:
        """The stack at free numbers x."""
        stack = self.template.set(dict(zip(self.fixed_names, self.fixed, strict=True)))
        stack = stack.set({name: x[i] for i, name in enumerate(self.names) if name in stack.names})
        return stack.set({tie.name: tie.value(stack) for tie in self.ties})

    def columns(self, x: Float[AnyArray, "p"]) -> Columns:
        """Its columns."""
        return to_columns(self.stack(x), rough_faces=self.rough_faces)

    def columns_at(self, x: Float[AnyArray, "p"], wavelength: Float[AnyArray, "w"]) -> Columns:
        """Its columns at many wavelengths, which are the first axis of each."""
        return columns_at(self.stack(x), wavelength, self.rough_faces)


class Sample(eqx.Module):
    """One stack, what predicts its measurements, and for each of these its free radius."""

    scene: Scene
    forward: Forward
    sizes: tuple[Size, ...]

    @property
    def count(self) -> int:
        """Number of measurements."""
        return len(self.sizes)

    def predict(self, x: Float[Array, "p"], shifts: Sequence[Float[Array, ""] | None]) -> list[Array]:
        """Values of each measurement, its calibration but offset and radius left out."""
        spread = [shift for shift, size in zip(shifts, self.sizes, strict=True) for _ in range(size.count)]
        values = iter(self.forward(self.scene.columns(x), spread))
        return [size.at(x, list(islice(values, size.count))) for size in self.sizes]


class SpectralSample(eqx.Module):
    """One stack of tissue and what predicts its spectra: for each group of the same wavelengths a forward model."""

    scene: Scene
    groups: tuple[Group, ...]
    forwards: tuple[Forward, ...]
    count: int = eqx.field(static=True)

    def predict(self, x: Float[Array, "p"], shifts: Sequence[Float[Array, ""] | None]) -> list[Array]:
        """Values of each spectrum, its calibration left out."""
        found: dict[int, Array] = {}
        for group, forward in zip(self.groups, self.forwards, strict=True):
            values = over_wavelengths(forward, self.scene.columns_at(x, group.wavelength), x.size)
            found |= dict(zip(group.members, values, strict=True))
        return [found[i] for i in range(self.count)]


class Model(eqx.Module):
    """Predictions and residuals at unbounded coordinates u.

    samples : the one asked for, then references; their measurements follow one another.
    """

    cheap: ClassVar[bool] = False  # whether many predictions side by side are worth it whatever the solver
    samples: tuple[Sample | SpectralSample, ...]
    coordinates: Coordinates
    scatter: tuple[Scatter, ...]
    priors: Priors
    nuisance: tuple[tuple[int | None, int | None, int | None], ...] = eqx.field(static=True)  # index of amplitude, offset, background
    error_scale: int | None = eqx.field(static=True)  # index of the scale of the model error
    priors_join: bool = eqx.field(static=True)  # whether priors are further residuals

    def __init__(
        self,
        samples: Sequence[Sample | SpectralSample],
        parameters: Sequence[FreeParameter],
        datasets: Sequence[Dataset],
        scatter: Sequence[Scatter],
        *,
        same: Mapping[str, str],
        priors_join: bool = True,
    ):
        """same : calibration numbers that are those of other measurements."""
        self.samples, self.coordinates = tuple(samples), Coordinates(parameters)
        self.scatter = tuple(scatter)
        low, high = np.array([(p.low, p.high) for p in parameters]).T
        index = {p.name: i for i, p in enumerate(parameters)}
        self.priors = Priors([p.prior for p in parameters], tuple(index), low, high)
        self.priors_join = priors_join
        index |= {name: index[source] for name, source in same.items()}
        self.error_scale = index.get(MODEL_ERROR)
        self.nuisance = tuple(tuple(index.get(f"{d.name}.{n}") for n in NUISANCE) for d in datasets)  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def scene(self) -> Scene:
        """Of the sample asked for."""
        return self.samples[0].scene

    @property
    def values(self) -> tuple[Float[AnyArray, "n"], ...]:
        """Measured values of all datasets."""
        return tuple(scatter.values for scatter in self.scatter)

    @property
    def sd(self) -> tuple[Float[AnyArray, "n"], ...]:
        """Their standard deviations, the model's error left out."""
        return tuple(scatter.sd for scatter in self.scatter)

    @property
    def rows(self) -> int:
        """Number of residuals: values, and priors that join them."""
        return sum(values.size for values in self.values) + (len(self.priors.informative) if self.priors_join else 0)

    def predict(self, x: Float[Array, "p"]) -> tuple[Float[Array, "n"], ...]:
        """Predicted values of all datasets at physical numbers x, calibration included."""
        shifts = [None if offset is None else x[offset] for _, offset, _ in self.nuisance]
        predicted: list[Array] = []
        for sample in self.samples:
            first = len(predicted)
            predicted += sample.predict(x, shifts[first : first + sample.count])
        return tuple(
            (1.0 if amplitude is None else x[amplitude]) * values + (0.0 if background is None else x[background])
            for values, (amplitude, _, background) in zip(predicted, self.nuisance, strict=True)
        )

    def residuals(self, u: Float[Array, "p"], logarithmic: Float[Array, ""]) -> Float[Array, "rows"]:
        """(prediction - value)/sd, or that whitened where errors are correlated; then (number - centre)/sd of each normal prior.

        Where logarithmic is 1 and prediction and value are positive, value times their log ratio stands in place of the difference. Both agree to
        first order near the data. Far from them the logarithm keeps a single value from ruling all others, which is what carries a fit over from a
        poor start.
        """
        parts = []
        x = self.coordinates.physical(u)
        for predicted, scatter in zip(self.predict(x), self.scatter, strict=True):
            values = scatter.values
            positive = (predicted > 0) & (values > 0)
            ratio = jnp.where(positive, predicted, 1.0) / jnp.where(positive, values, 1.0)
            parts.append(scatter.weighted(jnp.where((logarithmic > 0) & positive, jnp.log(ratio) * values, predicted - values)))
        if self.priors_join:
            parts.append(self.priors.residuals(x))
        return jnp.concatenate(parts)

    def scale(self, x: Float[Array, "p"]) -> Float[Array, ""] | float:
        """Of the model error."""
        return 1.0 if self.error_scale is None else x[self.error_scale]

    def misfit(self, x: Float[Array, "p"]) -> Float[Array, ""]:
        """Chi-square of the data, or the deviance that stands for it."""
        pairs = zip(self.predict(x), self.scatter, strict=True)
        return sum((scatter.misfit(predicted, self.scale(x)) for predicted, scatter in pairs), jnp.array(0.0))

    def log_likelihood(self, x: Float[Array, "p"], *, estimates_noise: bool) -> Float[Array, ""]:
        """Logarithm of the probability of the data. estimates_noise : integrated over one relative noise whose logarithm is uniform."""
        if estimates_noise:
            return -0.5 * sum(values.size for values in self.values) * jnp.log(self.misfit(x))
        pairs = zip(self.predict(x), self.scatter, strict=True)
        return sum((scatter.log_density(predicted, self.scale(x)) for predicted, scatter in pairs), jnp.array(0.0))
