"""What a scene file may hold, and in one line what is wrong with one that holds something else."""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from .errors import InputError, closest


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class SurroundingsTable(_Table):
    n_above: float = Field(1.0, gt=0)
    n_below: float = Field(1.0, gt=0)
    roughness_below: float = Field(0.0, ge=0)


class LayerTable(_Table):
    name: str | None = Field(None, min_length=1)
    sigma_a: float = Field(ge=0)
    sigma_s: float | None = Field(None, ge=0)
    sigma_s_prime: float | None = Field(None, ge=0)
    g: float | None = Field(None, ge=-1, lt=1)
    n: float = Field(gt=0)
    thickness: float | None = Field(None, gt=0)
    roughness: float = Field(0.0, ge=0)


class SourceTable(_Table):
    kind: str
    radius: float | None = Field(None, gt=0)


class DetectorTable(_Table):
    radius: float = Field(0.0, ge=0)
    na: float = Field(1.0, gt=0)


class NoiseTable(_Table):
    relative: float = Field(0.0, ge=0)
    absolute: float = Field(0.0, ge=0)


class MeasurementTable(_Table):
    name: str | None = Field(None, min_length=1)
    kind: str
    file: str | None = None
    x: list[float] | None = None
    x_min: list[float] | None = None
    x_max: list[float] | None = None
    value: float | None = None
    sd: float | None = Field(None, gt=0)
    specular: Literal["included", "excluded"] | None = None
    incidence: str | float | None = None
    azimuth: float | None = None
    source: SourceTable | None = None
    detector: DetectorTable | None = None
    noise: NoiseTable | None = None
    exposure: float | None = Field(None, gt=0)
    likelihood: str | dict[str, Any] | None = None


class FitTable(_Table):
    solver: str = "auto"
    free: dict[str, Any] = Field(default_factory=dict)
    ties: dict[str, Any] = Field(default_factory=dict)
    likelihood: str | dict[str, Any] | None = None
    model_error: Literal["off", "on", "free"] = "off"
    starts: int = Field(8, ge=1)
    seed: int = Field(0, ge=0)


class SceneTable(_Table):
    scene: SurroundingsTable = SurroundingsTable()  # pyright: ignore[reportCallIssue]
    layer: list[LayerTable] = Field(min_length=1)
    measurement: list[MeasurementTable] = Field(default_factory=list)
    fit: FitTable = FitTable()  # pyright: ignore[reportCallIssue]


def checked(content: dict[str, Any]) -> SceneTable:
    """The tables of a scene file. Raises InputError naming the key, what was given and what is allowed."""
    try:
        return SceneTable.model_validate(content)
    except ValidationError as error:
        raise InputError(_message(error, content)) from None


_ALLOWED = {
    "greater_than": "above {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "below {lt:g}",
    "float_type": "a number",
    "int_type": "a whole number",
    "finite_number": "a finite number",
    "string_type": "a text",
    "string_too_short": "a text that is not empty",
    "list_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
    "literal_error": "{expected}",
}


def _message(error: ValidationError, content: dict[str, Any]) -> str:
    """The thing wrong that matters first, in one line."""
    found = error.errors(include_url=False)
    first = next((e for e in found if e["type"] == "extra_forbidden"), found[0])  # a misspelt key is why another one is missing
    path = list(first["loc"])
    if first["type"] == "missing":
        return f"{_where(path[:-1], content)}: {path[-1]} is missing" if len(path) > 1 else f"there is no [[{path[-1]}]]; allowed is one or more"
    if first["type"] == "extra_forbidden":
        model: Any = SceneTable
        for step in path[:-1]:
            model = model if isinstance(step, int) else _submodel(model, step)
        known = list(model.model_fields)
        return f"{_where(path[:-1], content)}: unknown key '{path[-1]}'; allowed: {', '.join(known)}{closest(str(path[-1]), known)}"
    if first["type"] == "too_short":
        return f"[[{path[0]}]] is empty; allowed is one or more"
    keys = [p for p in path if p not in ("str", "float")]  # branches of a union are no keys
    allowed = _ALLOWED.get(first["type"], first["msg"]).format(**first.get("ctx", {}))
    if keys[-1] == "thickness":
        allowed += " (a half space, the last layer, has none)"
    key = keys[-1]
    if isinstance(key, int):  # an element of a list
        keys.pop()
        key = f"number {key + 1} of {keys[-1]}"
    if keys == ["layer"] or keys == ["measurement"]:
        return f"top level: '{keys[0]}' is not written as [[{keys[0]}]]; allowed is one such table for each {keys[0]}"
    return f"{_where(keys[:-1], content)}: {key} = {first['input']!r}; allowed is {allowed}"


def _submodel(model: Any, field: str) -> Any:
    annotation = model.model_fields[field].annotation
    while not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
        annotation = next(a for a in annotation.__args__ if a is not type(None))
    return annotation


def _where(path: list[Any], content: dict[str, Any]) -> str:
    """[[layer]] 2 ('dermis'), [scene], [fit] ..."""
    if not path:
        return "top level"
    if len(path) > 1 and isinstance(path[1], int):
        name = content[path[0]][path[1]].get("name") if isinstance(content[path[0]][path[1]], dict) else None
        rest = "".join(f", {p}" for p in path[2:])
        return f"[[{path[0]}]] {path[1] + 1}{f' ({name!r})' if name else ''}{rest}"
    return f"[{'.'.join(map(str, path))}]"
