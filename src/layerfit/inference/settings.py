"""What decides a posterior, as text by name: two runs may go on with one another if all of it is equal."""

import dataclasses
import hashlib
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from .problem import Problem

_LEFT_OUT = ("model", "choice")  # follow from the others
_WITHOUT_INFLUENCE = ("init",)  # where a fit begins


def problem_settings(problem: Problem) -> dict[str, str]:
    """Stack, data, free numbers and all else that a problem states.

    >>> import layerfit as lf
    >>> skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.01, sigma_s_prime=1, n=1.4)])
    >>> data = lf.Dataset(lf.TotalReflectance(), [0.5], noise=lf.Noise(relative=0.02))
    >>> stated = problem_settings(lf.Problem(skin, data, free={"skin.sigma_a": (1e-3, 1)}))
    >>> stated["stack skin sigma_a"], stated["parameters skin.sigma_a high"]
    ('0.01', '1.0')
    """
    found: dict[str, str] = {}
    for field in dataclasses.fields(problem):
        if field.name not in _LEFT_OUT:
            _describe(getattr(problem, field.name), field.name, found)
    return found


def solver_settings(problem: Problem) -> dict[str, str]:
    """The solver that runs, which for one that chooses depends on the fit."""
    found: dict[str, str] = {}
    _describe(problem.chosen, "solver used", found)
    return found


def _describe(value: Any, name: str, found: dict[str, str]) -> None:
    if isinstance(value, np.ndarray | jax.Array):
        array = np.asarray(value)
        shown = f"{array.item()!r}" if array.ndim == 0 else f"{array.size} numbers"
        found[name] = shown if array.ndim == 0 else f"{shown} with checksum {hashlib.sha256(array.tobytes()).hexdigest()[:12]}"
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):  # Equinox modules too
        found[name] = type(value).__name__
        for field in dataclasses.fields(value):
            if field.name not in _WITHOUT_INFLUENCE:
                _describe(getattr(value, field.name), f"{name} {field.name}".replace("stack layers ", "stack "), found)
    elif isinstance(value, Mapping):
        for key, item in value.items():
            _describe(item, f"{name} {key}", found)
    elif isinstance(value, list | tuple):
        found[name] = f"{len(value)} of them"
        for i, item in enumerate(value):
            inner = f"{name.removesuffix(' layers')} {getattr(item, 'name', i)}"
            _describe(item, inner, found)
    elif callable(value):
        found[name] = getattr(value, "__qualname__", type(value).__name__)
    else:
        found[name] = repr(value)
