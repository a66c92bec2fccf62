"""The scene file: a TOML description of the sample, the measurements and the fit."""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from .errors import InputError, closest
from .measurement.csv_file import Table, dataset_from_table, geometry_from_table, read_table, read_text
from .measurement.dataset import Dataset, Noise, check_measurement_name
from .measurement.geometry import GEOMETRIES, Angular, Geometry, Incident, Radial, SpatialFrequency, Total, TotalReflectance
from .measurement.planned import Planned
from .measurement.source import SOURCES, Detector, Source
from .scene.layer import HalfSpace, Layer
from .scene.stack import Stack
from .scene_tables import MeasurementTable, SceneTable, SourceTable, checked
from .solver import Solver, solver_by_name

if TYPE_CHECKING:
    from .inference.identify import Identification
    from .inference.problem import Problem


@dataclass(frozen=True)
class Measurement:
    """One [[measurement]]: where to predict, the data if there are any, and the file that both are from."""

    name: str
    geometry: Geometry
    dataset: Dataset | None
    file: Path | None
    likelihood: Any = None
    noise: Noise | None = None


@dataclass(frozen=True)
class SceneFile:
    """A scene file as objects."""

    path: Path
    stack: Stack
    measurements: tuple[Measurement, ...]
    solver_name: str
    free: Mapping[str, Any]
    ties: Mapping[str, Any]
    starts: int
    seed: int
    likelihood: Any = None
    model_error: Literal["off", "on", "free"] = "off"

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that were read."""
        return (self.path, *(m.file for m in self.measurements if m.file is not None))

    def solver(self, name: str | None = None) -> Solver:
        """The solver named on the command line, or in the file."""
        if name is not None:
            return solver_by_name(name)
        try:
            return solver_by_name(self.solver_name)
        except InputError as error:
            raise InputError(f"{self.path}: [fit]: {error}") from None

    def datasets(self) -> list[Dataset]:
        """All data. Raises InputError where a measurement has none."""
        lacking = next((m for m in self.measurements if m.dataset is None), None)
        if lacking is not None:
            raise InputError(
                f"{self.path}: measurement '{lacking.name}' has no values; a fit needs a file with a column 'value' (or value, for a total)"
            )
        return [m.dataset for m in self.measurements if m.dataset is not None]

    def planned(self) -> list[Dataset | Planned]:
        """All measurements, made or not, with their noise. Raises InputError where a measurement has none."""
        for m in self.measurements:
            if m.noise is None and (m.dataset is None or m.dataset.sd is None):
                raise InputError(
                    f"{self.path}: measurement '{m.name}' has no noise, on which all depends that it could tell; "
                    "give noise = {relative = 0.02} (or a column 'sd' beside the values)"
                )
        return [m.dataset if m.dataset is not None else Planned(m.geometry, m.noise or Noise(), m.name) for m in self.measurements]

    def identify(self, solver: str | None = None, choose: int = 6) -> "Identification":
        """What the measurements of the file could tell. Raises InputError where it does not fit together."""
        from .inference.identify import identify

        data, chosen = self.planned(), self.solver(solver)
        try:
            return identify(
                self.stack, data, free=_dotted(self.free), ties=_dotted(self.ties), likelihood=self._likelihoods(), solver=chosen, choose=choose
            )
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from None

    def problem(self, solver: str | None = None, data: list[Dataset] | None = None) -> "Problem":
        """The fit that the file describes, or of other data. Raises InputError where it does not fit together."""
        from .inference.problem import Problem  # slow to import, and a prediction needs none of it

        data, chosen = self.datasets() if data is None else data, self.solver(solver)
        try:
            return Problem(
                self.stack,
                data,
                free=_dotted(self.free),
                ties=_dotted(self.ties),
                likelihood=self._likelihoods(),
                model_error=self.model_error,
                solver=chosen,
            )
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from None

    def _likelihoods(self) -> dict[str, Any]:
        """Of each measurement for which one is stated, by itself or for all in [fit]."""
        given = {m.name: m.likelihood if m.likelihood is not None else self.likelihood for m in self.measurements}
        return {name: likelihood for name, likelihood in given.items() if likelihood is not None}


def read_scene(path: str | Path) -> SceneFile:
    """Read a scene file. Relative paths in it are relative to it.

    Raises InputError naming the file and the key of what is wrong, what was given and what is allowed.
    """
    path = Path(path)
    text = read_text(path)
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not TOML: {error}{_quoted(str(error), text)}") from None
    try:
        scene = checked(content)
        stack = _stack(scene)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if not scene.measurement:
        raise InputError(f"{path}: there is no [[measurement]]; allowed is one or more")
    measurements = tuple(_measurement(path, i, m) for i, m in enumerate(scene.measurement, 1))
    names = [m.name for m in measurements]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{path}: measurement name '{name}' is used {names.count(name)} times; each needs its own")
    fit = scene.fit
    return SceneFile(path, stack, measurements, fit.solver, fit.free, fit.ties, fit.starts, fit.seed, fit.likelihood, fit.model_error)


def _stack(scene: SceneTable) -> Stack:
    layers: list[Layer | HalfSpace] = []
    for i, table in enumerate(scene.layer, 1):
        values = table.model_dump(exclude={"name", "thickness"})
        name = table.name or f"layer{i}"
        if table.thickness is not None:
            layers.append(Layer(name, thickness=table.thickness, **values))
        elif i == len(scene.layer):
            layers.append(HalfSpace(name, **values))
        else:
            raise InputError(
                f"[[layer]] {i} ('{name}') has no thickness, which makes it a half space, but it is not the last layer; give it a thickness above 0"
            )
    return Stack(layers, **scene.scene.model_dump())


def _measurement(path: Path, number: int, table: MeasurementTable) -> Measurement:
    name = table.name or ("measurement" if number == 1 else f"measurement{number}")
    where = f"{path}: [[measurement]] {number} ('{name}')"
    try:
        check_measurement_name(name)
        return replace(_measurement_at(path, name, table), likelihood=table.likelihood)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _measurement_at(path: Path, name: str, table: MeasurementTable) -> Measurement:
    if table.kind not in GEOMETRIES:
        raise InputError(f"kind = '{table.kind}'; allowed: {', '.join(GEOMETRIES)}{closest(table.kind, GEOMETRIES)}")
    cls = GEOMETRIES[table.kind]
    _check_keys(table, cls)
    noise = Noise(table.noise.relative, table.noise.absolute) if table.noise else None
    source = _source(table.source) if table.source else None
    detector = Detector(table.detector.radius, table.detector.na) if table.detector else None
    options: dict[str, Any] = {}
    if issubclass(cls, Incident):
        options["incidence"] = table.incidence if table.incidence is not None else "normal"
    if issubclass(cls, Angular):
        options["azimuth"] = table.azimuth
    if cls is TotalReflectance:
        options["specular"] = table.specular or "excluded"
    if table.file is not None:
        data: Table = read_table(path.parent / table.file)
        geometry = geometry_from_table(data, table.kind, source=source, detector=detector, **options)
        dataset = dataset_from_table(data, geometry, noise=noise, exposure=table.exposure, name=name) if "value" in data.columns else None
        return Measurement(name, geometry, dataset, data.path, noise=noise)
    geometry = _inline(table, cls, source, detector, options)
    dataset = None
    if table.value is not None:
        sd = None if table.sd is None else [table.sd]
        dataset = Dataset(geometry, [table.value], sd, noise=noise if sd is None else None, exposure=table.exposure, name=name)
    return Measurement(name, geometry, dataset, None, noise=noise)


def _check_keys(table: MeasurementTable, cls: type[Geometry]) -> None:
    """Keys that this kind of measurement does not know."""
    given = {key for key, value in table.model_dump().items() if value is not None}
    known = {"name", "kind", "file", "noise", "exposure", "likelihood"}
    if issubclass(cls, Total):
        known |= {"value", "sd", "incidence"} | ({"specular"} if cls is TotalReflectance else set())
    elif issubclass(cls, Angular):
        known |= {"x", "incidence", "azimuth"}
    elif cls is SpatialFrequency:
        known |= {"x"}
    else:
        known |= {"x", "x_min", "x_max", "source", "detector"}
        if table.incidence in ("normal", 0, 0.0):
            known |= {"incidence"}
    for key in sorted(given - known):
        raise InputError(f"key '{key}' has no meaning for kind '{table.kind}'; allowed: {', '.join(sorted(known))}")
    places = given & {"file", "x", "x_min", "x_max"}
    if places not in ({"file"}, {"x"}, {"x_min", "x_max"}) and not (issubclass(cls, Total) and places <= {"file"}):
        raise InputError(f"{' and '.join(sorted(places)) or 'nothing'} says where it was measured; allowed is one of file, x, or x_min with x_max")
    if "file" in given and given & {"value", "sd"}:
        raise InputError("value or sd beside a file; allowed is one of them")
    if "sd" in given and "value" not in given:
        raise InputError("sd without a value")


def _inline(table: MeasurementTable, cls: type[Geometry], source: Source | None, detector: Detector | None, options: dict[str, Any]) -> Geometry:
    if issubclass(cls, Radial):
        if table.x is not None:
            return cls(table.x, source=source, detector=detector)
        return cls(r_min=table.x_min, r_max=table.x_max, source=source, detector=detector)
    if issubclass(cls, SpatialFrequency):
        return cls(table.x)
    return cls(table.x, **options) if issubclass(cls, Angular) else cls(**options)


def _source(table: SourceTable) -> Source:
    if table.kind not in SOURCES:
        raise InputError(f"source kind = '{table.kind}'; allowed: {', '.join(SOURCES)}{closest(table.kind, SOURCES)}")
    needs_radius = table.kind in ("disk", "gaussian")
    if needs_radius != (table.radius is not None):
        raise InputError(f"source kind '{table.kind}' {'needs a radius [mm]' if needs_radius else 'has no radius'}")
    cls: Any = SOURCES[table.kind]
    return cls(table.radius) if needs_radius else cls()


def _quoted(message: str, text: str) -> str:
    """The line that a message about TOML means, with what is wrong most often."""
    match = re.search(r"at line (\d+)", message)
    if not match:
        return ""
    line = text.splitlines()[int(match[1]) - 1].strip()
    return f": {line}" + ("; numbers are written with a point (1.5), not a comma" if re.search(r"=\s*\d+,\d+\s*(#.*)?$", line) else "")


def _dotted(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Names with a dot. TOML reads skin.sigma_a without quotes as a table within a table, which means the same."""
    flat: dict[str, Any] = {}
    for name, spec in tables.items():
        inner = isinstance(spec, Mapping) and "." not in name
        flat |= {f"{name}.{field}": value for field, value in spec.items()} if inner else {name: spec}
    return flat
