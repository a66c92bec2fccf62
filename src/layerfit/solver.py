"""The interface every solver fulfils, and the solvers by name.

A solver is a value that is passed. It says what it cannot do (`check`), what is to be kept in mind (`notes`), and turns a family of stacks
and a list of geometries into a `Forward`, in which everything that does not depend on the numbers of the stack is already done.
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import fields
from importlib import import_module
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import numpy as np
from jax import Array
from jaxtyping import Float

from .compilation import compiled
from .errors import InputError
from .measurement.geometry import Geometry
from .scene.columns import Columns
from .scene.stack import Stack


class Domain(eqx.Module):
    """The stacks a forward model must serve: one, or all within the bounds of a fit.

    low, high : for each column the smallest and the largest value.
    """

    stack: Stack
    low: Columns
    high: Columns

    @property
    def fixed_optics(self) -> bool:
        """Whether refractive indices and roughness are the same in all stacks."""
        return all(np.array_equal(getattr(self.low, name), getattr(self.high, name)) for name in ("n", "n_above", "n_below", "roughness"))


class Evaluation(NamedTuple):
    """What a forward model gives for one stack: values and absolute errors (None: unknown), one array a geometry, and what is to be said of them."""

    values: tuple[np.ndarray, ...]
    errors: tuple[np.ndarray | None, ...]
    notes: tuple[str, ...] = ()


def relative_errors(errors: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Absolute errors as shares of values of the same shape [1]; one that is no number counts as infinite."""
    return np.nan_to_num(np.abs(errors) / np.maximum(np.abs(values), 1e-300), nan=np.inf, posinf=np.inf)


_compiled = compiled(lambda forward, columns: forward(columns))


class Forward(eqx.Module):
    """A forward model for fixed geometries: a function of the columns alone."""

    differentiable: ClassVar[bool] = True

    @abstractmethod
    def __call__(self, columns: Columns, shifts: Sequence[Float[Array, ""] | None] | None = None) -> tuple[Array, ...]:
        """Predicted values, one array a geometry. shifts: for each geometry an offset of its distances [mm], or None."""

    def error(self, columns: Columns) -> tuple[np.ndarray | None, ...] | None:
        """Estimated absolute error of each value, the method's included, one array a geometry; None where it is unknown."""
        return None

    def run(self, columns: Columns) -> tuple[Array, ...]:
        """The values, compiled."""
        return _compiled(self, columns)

    def evaluate(self, columns: Columns) -> Evaluation:
        """Values and errors together, for a solver that gets both from one run."""
        values = tuple(np.asarray(v) for v in self.run(columns))
        return Evaluation(values, self.error(columns) or (None,) * len(values))


Resolution = Sequence[np.ndarray]


class Choice(NamedTuple):
    """The solver that will run, and why. rung : 0 for the cheapest of those a solver chooses from."""

    solver: "Solver"
    notes: tuple[str, ...]
    rung: int = 0


class Solver(eqx.Module):
    """How a measurement is predicted from a stack."""

    name: ClassVar[str]
    references: ClassVar[tuple[str, ...]] = ()

    @property
    def settings(self) -> dict[str, Any]:
        """Its settings by name, those at their default included."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def label(self) -> str:
        """Its name, and what is set otherwise than by itself."""
        settings = ", ".join(f"{value} {name}" for name, value in self.settings.items() if type(value) in (int, float))
        return f"{self.name} ({settings})" if settings else self.name

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in self.settings.items())})"

    def choose(self, stack: Stack, geometries: Sequence[Geometry], resolution: Resolution | None = None, domain: Domain | None = None) -> "Choice":
        """The solver that will run; only a solver that chooses returns another than itself.

        resolution : relative sd of the data, one array a geometry; None where there are no data or none is known. domain : all stacks that it must
        serve, where they are known.
        """
        return Choice(self, ())

    def choose_again(self, before: "Choice", stack: Stack, geometries: Sequence[Geometry], resolution: Resolution | None = None) -> "Choice | None":
        """A better choice where an earlier one no longer holds for a stack, None where it does."""
        return None

    @abstractmethod
    def check(self, stack: Stack, geometry: Geometry) -> None:
        """Raise InputError for a scene or geometry outside what the solver can do."""

    def refusal(self, stack: Stack, geometries: Sequence[Geometry]) -> str | None:
        """Why the solver cannot do a scene with these geometries, None where it can."""
        try:
            for geometry in geometries:
                self.check(stack, geometry)
        except InputError as error:
            return str(error)
        return None

    def notes(self, stack: Stack, geometry: Geometry) -> tuple[str, ...]:
        """Sentences a user should read beside the result."""
        return ()

    @abstractmethod
    def forward(self, domain: Domain, geometries: Sequence[Geometry], shifts: Sequence[tuple[float, float]]) -> Forward:
        """A forward model for all stacks of the domain. shifts: range of the offset of each geometry's distances [mm]."""


_SOLVERS = {
    "auto": "layerfit.transport.auto:Auto",
    "dipole": "layerfit.transport.multipole:Dipole",
    "multipole": "layerfit.transport.multipole:Multipole",
    "layered-diffusion": "layerfit.transport.layered_diffusion:LayeredDiffusion",
    "discrete-ordinates": "layerfit.transport.discrete_ordinates:DiscreteOrdinates",
    "monte-carlo": "layerfit.montecarlo_solver:MonteCarlo",
}


def solver_by_name(name: str, **settings: Any) -> Solver:
    """A solver from its name in a scene file. Raises InputError for a name that does not exist."""
    if name not in _SOLVERS:
        raise InputError(f"solver '{name}' does not exist; allowed: {', '.join(_SOLVERS)}")
    module, cls = _SOLVERS[name].split(":")
    return getattr(import_module(module), cls)(**settings)
