"""What a person states: a stack, data, what is free, and a solver."""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..measurement.dataset import Dataset
from ..measurement.geometry import Radial
from ..scene.stack import Stack
from ..solver import Choice, Domain, Solver
from ..transport.auto import Auto
from .model import Model, Scene
from .parameters import FreeParameter, Tie, free_parameters, parse_ties

RELATIVE_NOISE = 1.0  # placeholder where the noise is estimated from the fit


def _resolution(data: Sequence[Dataset]) -> tuple[np.ndarray, ...] | None:
    """Relative sd of all values, one array a dataset; None where the data have none."""
    shares = tuple(d.sd / np.maximum(np.abs(d.values), 1e-300) for d in data if d.sd is not None)
    return shares or None


class Problem(eqx.Module):
    """A fit to be done.

    Arguments
    ---------
    stack : the guess; numbers that are not free keep its values.
    data : a Dataset or several, fitted together.
    free : ``{"layer.number": (min, max)}``, or with a table ``{"min":, "max":, "init":, "scale": "log" | "linear"}``. Any number of the stack
        (``stack.names``), and of each dataset ``name.amplitude`` (factor on the prediction), ``name.offset`` (added to r) and ``name.background``
        (added to the prediction).
    ties : ``{"layer.number": "other.number"}`` or ``(other, factor)``: numbers that follow others.
    solver : how the data are predicted. choice : the one of a solver that chooses, where it is known already.

    Raises InputError where something does not fit together, before anything runs.

    >>> import layerfit as lf
    >>> skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.01, sigma_s_prime=1, n=1.4)])
    >>> data = lf.Dataset(lf.RadialReflectance(r=[1, 2, 4, 8]), [0.0215, 0.00929, 0.00231, 0.000347], noise=lf.Noise(relative=0.02))
    >>> lf.Problem(skin, data, free={"skin.sigma_a": (1e-3, 1), "skin.sigma_s_prime": (0.1, 10)}).names
    ('skin.sigma_a', 'skin.sigma_s_prime')
    """

    stack: Stack
    data: tuple[Dataset, ...]
    parameters: tuple[FreeParameter, ...]
    ties: tuple[Tie, ...]
    solver: Solver
    choice: Choice
    model: Model

    def __init__(
        self,
        stack: Stack,
        data: Dataset | Sequence[Dataset],
        *,
        free: Mapping[str, Any],
        ties: Mapping[str, Any] | None = None,
        solver: Solver | None = None,
        choice: Choice | None = None,
    ):
        self.stack = stack if isinstance(stack, Stack) else Stack((stack,))
        self.data = (data,) if isinstance(data, Dataset) else tuple(data)
        self._check_names()
        self.parameters = free_parameters(self.stack, self.data, free)
        self.ties = parse_ties(self.stack, self.parameters, ties or {})
        count = sum(d.geometry.size for d in self.data)
        if len(self.parameters) > count:
            raise InputError(f"{len(self.parameters)} free parameters and {count} measured values; allowed are at most as many parameters as values")
        self.solver = Auto() if solver is None else solver
        geometries = [d.geometry for d in self.data]
        start = self.stack.set({p.name: p.init for p in self.parameters if p.name in self.stack.names})
        for geometry in geometries:
            self.solver.check(start, geometry)
        self.choice = self.solver.choose(start, geometries, _resolution(self.data)) if choice is None else choice
        scene = Scene(self.stack, self.parameters, self.ties)
        forward = self.chosen.forward(self._domain(scene), geometries, [self._shift(d) for d in self.data])
        if not forward.differentiable:
            raise InputError(f"solver {self.chosen.name} has no derivatives; allowed for a fit are the other solvers")
        sd = [RELATIVE_NOISE * d.values if d.sd is None else d.sd for d in self.data]
        self.model = Model(scene, self.parameters, forward, self.data, sd)

    def again(self, stack: Stack, x: np.ndarray) -> "Problem | None":
        """The same problem from where a fit ended, with a better solver where the chosen one is not good enough there; None where it is.

        stack : the fitted one. x : the fitted numbers in physical units, in the order of ``parameters``.
        """
        better = self.solver.choose_again(self.choice, stack, [d.geometry for d in self.data], _resolution(self.data))
        if better is None:
            return None
        free = {}
        for p, value in zip(self.parameters, x, strict=True):
            free[p.name] = {"min": p.low, "max": p.high, "init": float(np.clip(value, p.low, p.high)), "scale": p.scale}
        ties = {tie.name: (tie.source, tie.factor) for tie in self.ties}
        return Problem(self.stack, self.data, free=free, ties=ties, solver=self.solver, choice=better)

    @property
    def chosen(self) -> Solver:
        """The solver that runs."""
        return self.choice.solver

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free numbers, in the order of all vectors and matrices."""
        return tuple(p.name for p in self.parameters)

    @property
    def estimates_noise(self) -> bool:
        """Whether some data have no sd, so that one relative noise is estimated from the fit."""
        return any(d.sd is None for d in self.data)

    def _check_names(self) -> None:
        if not self.data:
            raise InputError("a problem without data was given; allowed is one dataset or more")
        names = [d.name for d in self.data]
        layers = [layer.name for layer in self.stack.layers]
        for name in names:
            if names.count(name) > 1 or name in layers:
                raise InputError(
                    f"measurement name '{name}' is also the name of {'a layer' if name in layers else 'another measurement'}; give each its own"
                )
        lacking = [d.name for d in self.data if d.sd is None]
        if lacking and len(lacking) < len(self.data):
            raise InputError(
                f"measurement '{lacking[0]}' has no sd and another one has; with several measurements allowed is sd or noise for all, or for none"
            )

    def _shift(self, dataset: Dataset) -> tuple[float, float]:
        bounds = next(((p.low, p.high) for p in self.parameters if p.name == f"{dataset.name}.offset"), (0.0, 0.0))
        if isinstance(dataset.geometry, Radial) and bounds != (0.0, 0.0):
            for bound in bounds:
                try:
                    dataset.geometry.shifted(bound)
                except InputError as error:
                    raise InputError(f"'{dataset.name}.offset': its bound {bound:g} mm is not allowed: {error}") from None
        return bounds

    def _domain(self, scene: Scene) -> Domain:
        """Smallest and largest value of each column within the bounds."""
        low = np.array([p.low for p in self.parameters])
        high = np.array([p.high for p in self.parameters])
        # sigma_s' = sigma_s (1 - g) falls with g, everything else rises with its number
        falling = np.array([p.name.endswith(".g") for p in self.parameters])
        corners = [scene.columns(x) for x in (low, high, np.where(falling, high, low), np.where(falling, low, high))]

        smallest = jax.tree.map(lambda *c: jnp.asarray(np.min(c, axis=0)), *corners)
        largest = jax.tree.map(lambda *c: jnp.asarray(np.max(c, axis=0)), *corners)
        return Domain(self.stack, smallest, largest)
