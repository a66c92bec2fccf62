"""Scenes and predictions that the tests of discrete ordinates share."""

import csv
from functools import partial
from pathlib import Path

import equinox as eqx
import jax
import numpy as np

import layerfit as lf
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain

REFERENCE = Path(__file__).parent.parent / "reference"
R, T = lf.TotalReflectance(), lf.TotalTransmittance()
R_ALL = lf.TotalReflectance(specular="included")
R_DIFFUSE, T_DIFFUSE = lf.TotalReflectance(specular="included", incidence="diffuse"), lf.TotalTransmittance(incidence="diffuse")


def table(name: str) -> list[dict[str, str]]:
    lines = [line for line in (REFERENCE / "plane_parallel" / name).read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def predicted(stack: lf.Stack, geometries, streams: int | None = None, **settings) -> list[np.ndarray]:
    """Values alone: no second rule for the error."""
    solver = lf.DiscreteOrdinates(streams=streams, **settings)
    for geometry in geometries:
        solver.check(stack, geometry)
    columns = to_columns(stack)
    forward = solver.forward(Domain(stack, columns, columns), geometries, [(0.0, 0.0)] * len(geometries))
    arrays, rest = eqx.partition((forward, columns), eqx.is_array)
    leaves, structure = jax.tree.flatten(rest)
    return [np.asarray(value) for value in _run(arrays, (tuple(leaves), structure))]


@partial(jax.jit, static_argnums=1, compiler_options={"xla_cpu_use_fusion_emitters": False})  # compiles in less time
def _run(arrays, rest):
    forward, columns = eqx.combine(arrays, jax.tree.unflatten(rest[1], rest[0]))
    return forward(columns)


def slab(tau: float, albedo: float, g: float, n: float = 1.0, roughness: float = 0.0, **around) -> lf.Stack:
    layer = lf.Layer("slab", sigma_a=(1.0 - albedo) * tau, sigma_s=albedo * tau, g=g, n=n, thickness=1.0, roughness=roughness)
    return lf.Stack([layer], roughness_below=roughness, **around)


def layered(text: str) -> lf.Stack:
    """tau/albedo/g; tau/albedo/g ... from the top."""
    layers = []
    for i, part in enumerate(text.split(";")):
        tau, albedo, g = (float(number) for number in part.split("/"))
        layers.append(lf.Layer(f"layer{i}", sigma_a=(1.0 - albedo) * tau, sigma_s=albedo * tau, g=g, n=1.0, thickness=1.0))
    return lf.Stack(layers)
