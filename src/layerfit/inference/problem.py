"""What a person states: a stack, data, what is free, and a solver."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..arrays import AnyArray
from ..compilation import compiled
from ..errors import InputError, one_of
from ..measurement.dataset import Dataset
from ..measurement.geometry import Radial
from ..scene.columns import Columns
from ..scene.stack import Stack
from ..solver import Choice, Domain, Solver
from ..transport.auto import Auto
from ..wavelengths import check_kinds, groups, posed, some
from .likelihood import Likelihood, parse_likelihoods
from .model import Model, Sample, Scene, SpectralSample
from .model_error import error_covariances, stated_errors
from .parameters import MODEL_ERROR, FreeParameter, calibration_names, free_parameters, spread_points
from .priors import LogNormal
from .reference import Reference
from .scatter import NormalScatter
from .sizes import free_size
from .ties import Tie, parse_ties

RELATIVE_NOISE = 1.0  # placeholder where the noise is estimated from the fit
_LOOKED_AT = 200  # points between the bounds at which functions are evaluated
ModelError = Literal["off", "on", "free"]
_FREE_SCALE = {"min": 0.1, "max": 10.0, "init": 1.0, "prior": LogNormal(1.0, 2.0)}


def _resolution(data: Sequence[Dataset]) -> tuple[np.ndarray, ...] | None:
    """Relative sd of all values, one array a dataset; None where the data have none."""
    shares = tuple(d.sd / np.maximum(np.abs(d.values), 1e-300) for d in data if d.sd is not None)
    return shares or None


class Problem(eqx.Module):
    """A fit to be done.

    Arguments
    ---------
    stack : the guess; numbers that are not free keep its values.
    data : a Dataset or several, fitted together. reference : other samples measured with the same instrument, see `Reference`.
    free : ``{"layer.number": (min, max)}``, or with a table ``{"min":, "max":, "init":, "scale": "log" | "linear"}``. Any number of the stack
        (``stack.names``), and of each dataset ``name.amplitude`` (factor on the prediction), ``name.offset`` (added to r), ``name.background``
        (added to the prediction), ``name.source_radius`` (of a disk or Gaussian source) and ``name.detector_radius`` (of a fibre with a radius).
        A table may give a ``"prior"``: ``lf.Normal(1.0, 0.05)``, ``{"normal": [1.0, 0.05]}`` ... (default: uniform between the bounds).
    ties : ``{"layer.number": "other.number"}`` or ``(other, factor)``: numbers that follow others; or a function of the stack.
    likelihood : how the data scatter, one for all or ``{measurement: likelihood}``: lf.GaussianNoise() (default), lf.StudentT(nu),
        lf.Poisson() (default for counts), lf.CorrelatedNoise(relative, length).
    model_error : whether the error that the solver states of itself is part of the uncertainty: "off", "on", or "free" with its scale as the free
        number ``scene.model_error`` (by default log-normal about 1 with a factor of 2: data see only that of it which no other number absorbs).
    solver : how the data are predicted. choice : the one of a solver that chooses, where it is known already.

    Raises InputError where something does not fit together, before anything runs.

    >>> import layerfit as lf
    >>> skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.01, sigma_s_prime=1, n=1.4)])
    >>> data = lf.Dataset(lf.RadialReflectance(r=[1, 2, 4, 8]), [0.0215, 0.00929, 0.00231, 0.000347], noise=lf.Noise(relative=0.02))
    >>> lf.Problem(skin, data, free={"skin.sigma_a": (1e-3, 1), "skin.sigma_s_prime": (0.1, 10)}).names
    ('skin.sigma_a', 'skin.sigma_s_prime')
    """

    stack: Stack
    data: tuple[Dataset, ...]  # those of references last
    references: tuple[Reference, ...]
    parameters: tuple[FreeParameter, ...]
    ties: tuple[Tie, ...]
    likelihoods: tuple[Likelihood, ...]
    model_error: ModelError = eqx.field(static=True)
    solver: Solver
    choice: Choice
    model: Model

    def __init__(
        self,
        stack: Stack,
        data: Dataset | Sequence[Dataset],
        *,
        reference: Reference | Sequence[Reference] = (),
        free: Mapping[str, Any],
        ties: Mapping[str, Any] | None = None,
        likelihood: Any = None,
        model_error: ModelError = "off",
        solver: Solver | None = None,
        choice: Choice | None = None,
    ):
        self.stack = stack if isinstance(stack, Stack) else Stack((stack,))
        self.references = (reference,) if isinstance(reference, Reference) else tuple(reference)
        own = (data,) if isinstance(data, Dataset) else tuple(data)
        if not own:
            raise InputError("a problem without data was given; allowed is one dataset or more")
        self.data = (*own, *(d for r in self.references for d in r.data))
        self._check_names()
        one_of(model_error, ("off", "on", "free"), "model_error")
        self.model_error = model_error
        more = {**free, MODEL_ERROR: _FREE_SCALE} if self._adds_scale(free) else free
        self.parameters = free_parameters(self.stack, self.data, more, others=self._stacks[1:])
        self.likelihoods = parse_likelihoods(likelihood, self.data)
        self._check_likelihoods()
        self.ties = parse_ties(self._stacks, self.parameters, ties or {}, calibration=calibration_names(self.data))
        count, flat = sum(d.geometry.size for d in self.data), sum(not p.prior.square for p in self.parameters)
        if flat > count:
            raise InputError(f"{flat} free parameters and {count} measured values; allowed are at most as many parameters as values")
        self.solver = Auto() if solver is None else solver
        samples = []
        for number, (stack, data) in enumerate(zip(self._stacks, self._measurements, strict=True)):
            sample, made = self._sample(stack, data, choice if number == 0 else None, surroundings=number == 0)
            samples.append(sample)
            if number == 0:
                self.choice = made
        errors = self._errors(samples, np.array([p.init for p in self.parameters]), [d.values for d in self.data])
        scatter = [
            likelihood.scatter(d, RELATIVE_NOISE * d.values if d.sd is None else d.sd, error)
            for d, likelihood, error in zip(self.data, self.likelihoods, errors, strict=True)
        ]
        same = {tie.name: tie.source for tie in self.ties if tie.name in calibration_names(self.data)}
        self.model = Model(samples, self.parameters, self.data, scatter, same=same, priors_join=not self.estimates_noise)

    @property
    def _stacks(self) -> tuple[Stack, ...]:
        return (self.stack, *(r.stack for r in self.references))

    @property
    def _measurements(self) -> tuple[tuple[Dataset, ...], ...]:
        """Data of each sample."""
        own = len(self.data) - sum(len(r.data) for r in self.references)
        return (self.data[:own], *(r.data for r in self.references))

    def _sample(self, stack: Stack, data: Sequence[Dataset], choice: Choice | None, *, surroundings: bool) -> tuple[Sample | SpectralSample, Choice]:
        """The forward model of one stack, and the solver that runs it."""
        check_kinds(stack, [d.geometry for d in data])
        if stack.spectral and self.model_error != "off":
            raise InputError(f'model_error = {self.model_error!r} with spectra; allowed with them is "off"')
        scene = Scene(stack, self.parameters, self.ties, surroundings=surroundings)
        domain = None if stack.spectral else self._domain(scene, stack)
        start = stack.set({p.name: p.init for p in self.parameters if p.name in stack.names and p.name in scene.names})
        start = start.set({tie.name: float(tie.value(start)) for tie in scene.ties})
        geometries = [d.geometry for d in data]
        for geometry in geometries:
            for one in posed(start, geometry):
                self.solver.check(*one)
        if choice is None:
            choice = max((self.solver.choose(*one, _resolution(data), domain) for one in some(start, geometries)), key=lambda made: made.rung)
        if domain is None:
            parts = groups(geometries)
            forwards = []
            for group in parts:
                domain = self._domain(scene, start.at(float(group.wavelength[0])), group.wavelength)
                forwards.append(choice.solver.forward(domain, group.geometries, [(0.0, 0.0)] * len(group.geometries)))
            return SpectralSample(scene, parts, tuple(forwards), len(data)), choice
        laid = [(self._shift(d), *free_size(d, self.parameters)) for d in data]
        forward = choice.solver.forward(domain, [g for _, _, more in laid for g in more], [shift for shift, _, more in laid for _ in more])
        if not forward.differentiable:
            raise InputError(f"solver {choice.solver.name} has no derivatives; allowed for a fit are the other solvers")
        return Sample(scene, forward, tuple(size for _, size, _ in laid)), choice

    def again(self, stack: Stack, x: np.ndarray) -> "Problem | None":
        """The same problem from where a fit ended, with a better solver where the chosen one is not good enough there; None where it is.

        stack : the fitted one. x : the fitted numbers in physical units, in the order of ``parameters``.
        """
        data = self._measurements[0]
        asked = [self.solver.choose_again(self.choice, *one, _resolution(data)) for one in some(stack, [d.geometry for d in data])]
        better = max((made for made in asked if made is not None), key=lambda made: made.rung, default=None)
        if better is None:
            return None
        free = {}
        for p, value in zip(self.parameters, x, strict=True):
            free[p.name] = {"min": p.low, "max": p.high, "init": float(np.clip(value, p.low, p.high)), "scale": p.scale, "prior": p.prior}
        return Problem(
            self.stack,
            self._measurements[0],
            reference=self.references,
            free=free,
            ties={tie.name: tie.as_given() for tie in self.ties},
            likelihood=dict(zip((d.name for d in self.data), self.likelihoods, strict=True)),
            model_error=self.model_error,
            solver=self.solver,
            choice=better,
        )

    def with_errors_at(self, x: np.ndarray, predictions: Sequence[np.ndarray]) -> "Problem":
        """The same problem with the model's error as stated for free numbers x, as shares of the predictions there."""
        errors = self._errors(self.model.samples, x, predictions)
        scatter = tuple(
            NormalScatter(s.values, s.sd, s.covariance, error) if isinstance(s, NormalScatter) else s
            for s, error in zip(self.model.scatter, errors, strict=True)
        )
        return eqx.tree_at(lambda p: p.model.scatter, self, scatter)

    def _errors(self, samples: Sequence[Sample | SpectralSample], x: np.ndarray, sizes: Sequence[np.ndarray]) -> list[np.ndarray | None]:
        """Covariance of the model's error for each dataset. sizes : the values that stated errors are shares of."""
        found: list[np.ndarray | None] = []
        if self.model_error == "off":
            return [None] * len(self.data)
        for sample, data in zip(samples, self._measurements, strict=True):
            assert isinstance(sample, Sample)  # spectra have no model error
            columns = sample.scene.columns(x)
            firsts = np.cumsum([0, *(size.count for size in sample.sizes)])[:-1]  # of the geometries that stand for a dataset
            stated = stated_errors(sample.forward, columns)
            shares = [stated[i] for i in firsts]
            found += error_covariances([d.geometry for d in data], columns, shares, sizes[len(found) : len(found) + len(data)])
        if all(error is None for error in found):
            raise InputError(f'model_error = {self.model_error!r}: solver {self.chosen.name} states no error; allowed with it is "off"')
        return found

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

    @property
    def least_squares(self) -> bool:
        """Whether what is maximised is a sum of squares; if not, a maximum of the posterior density is looked for from its minimum."""
        squares = all(s.square for s in self.model.scatter) and self.model.error_scale is None and not self.model.priors.hierarchical
        return squares and not (self.estimates_noise and self.model.priors.informative)

    def _adds_scale(self, free: Mapping[str, Any]) -> bool:
        given = MODEL_ERROR in free
        if given and self.model_error != "free":
            raise InputError(f"free '{MODEL_ERROR}' with model_error = {self.model_error!r}; allowed with it is \"free\"")
        return self.model_error == "free" and not given

    def _check_likelihoods(self) -> None:
        for dataset, likelihood in zip(self.data, self.likelihoods, strict=True):
            if dataset.sd is None and (likelihood.needs_sd or self.model_error != "off"):
                what = f"likelihood {likelihood.kind}" if likelihood.needs_sd else f"model_error = {self.model_error!r}"
                raise InputError(f"measurement '{dataset.name}': {what} needs the noise of the data; give sd or noise")
            if self.model_error != "off" and not likelihood.takes_model_error:
                text = f"measurement '{dataset.name}': model_error = {self.model_error!r} with likelihood {likelihood.kind}"
                raise InputError(f"{text}; allowed with it are gaussian, correlated")

    def _check_names(self) -> None:
        names = [d.name for d in self.data]
        layers = [layer.name for stack in self._stacks for layer in stack.layers]
        twice = next((name for name in layers if layers.count(name) > 1), None)
        if twice is not None:
            raise InputError(f"layer '{twice}' is in the sample and in a reference; give each layer its own name")
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

    def _columns_at(self, scene: Scene, x: np.ndarray, wavelength: np.ndarray | None = None) -> Columns:
        """The columns at free numbers x. Raises InputError where a function gives what no stack can have."""
        try:
            return scene.columns(x) if wavelength is None else scene.columns_at(x, wavelength)
        except Exception as error:  # the function is the user's
            names = "', '".join(tie.name for tie in self.ties if tie.function is not None)
            if not names:
                raise
            where = ", ".join(f"{name} = {value:.3g}" for name, value in zip(self.names, x, strict=True))
            said = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
            raise InputError(f"ties '{names}': the function fails at {where}: {said}") from None

    def _domain(self, scene: Scene, stack: Stack, wavelength: np.ndarray | None = None) -> Domain:
        """Smallest and largest value of each column within the bounds. stack : a plain one. wavelength : those at which tissue is looked at."""
        low = np.array([p.low for p in self.parameters])
        high = np.array([p.high for p in self.parameters])
        # sigma_s' = sigma_s (1 - g) falls with g, everything else rises with its number
        falling = np.array([p.name.endswith(".g") for p in self.parameters])
        places = [low, high, np.where(falling, high, low), np.where(falling, low, high)]
        if any(tie.function is not None for tie in self.ties):  # whose extremes may be anywhere
            places += list(spread_points(self.parameters, _LOOKED_AT))
        if wavelength is None:
            corners = [self._columns_at(scene, x) for x in places]
            smallest, largest = (jax.tree.map(lambda *c, of=of: jnp.asarray(of(c, axis=0)), *corners) for of in (np.min, np.max))
        else:  # amounts and scattering act together: their extremes may be anywhere as well
            self._columns_at(scene, low, wavelength)
            smallest, largest = _extremes(scene, np.concatenate([places, spread_points(self.parameters, _LOOKED_AT)]), wavelength)
        return Domain(stack, smallest, largest)


@compiled
def _extremes(scene: Scene, x: Float[AnyArray, "m p"], wavelength: Float[AnyArray, "w"]) -> tuple[Columns, Columns]:
    """Smallest and largest value of each column at many numbers and wavelengths."""
    columns = jax.vmap(lambda one: scene.columns_at(one, wavelength))(jnp.asarray(x))
    return jax.tree.map(lambda c: jnp.min(c, axis=(0, 1)), columns), jax.tree.map(lambda c: jnp.max(c, axis=(0, 1)), columns)
