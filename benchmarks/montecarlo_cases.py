"""Cases with known answers for the Monte Carlo, shared by its tests and its benchmarks.

Exact values: Chandrasekhar's H function (isotropic half spaces), the Ambartsumian system with an internal Fresnel reflection
(mismatched half spaces), and discrete ordinates with 128 streams (Henyey-Greenstein slabs), as printed in the collection of reference
numbers, sections 1 to 3; each is known to half its last printed digit or better, far below the errors here.
MCML profiles: cases/NAME.json, .csv and .angular.csv of the same collection, which is looked for beside the repository.
"""

from __future__ import annotations

import csv
import json
import math
import platform
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import layerfit.montecarlo as mc

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "tests" / "reference" / "montecarlo"
MCML = ROOT.parent / "shared" / "reference" / "cases"


@dataclass(frozen=True)
class Exact:
    """A scene whose totals are known; `expected` maps tally names to values."""

    name: str
    section: int
    medium: mc.Medium
    source: mc.Pencil | mc.Lambertian
    expected: dict[str, float]


def _half_space(albedo: float, value: float, n: float = 1.0, source: Any = None, tag: str = "normal") -> Exact:
    medium = mc.Medium([n], [1.0 - albedo], [albedo], [0.0], [math.inf])
    name = f"half space a={albedo:g} n={n:g} {tag}"
    return Exact(name, 1 if n == 1.0 else 2, medium, source or mc.Pencil(), {"R": value})


def _slab(g: float, albedo: float, tau: float, reflected: float, transmitted: float) -> Exact:
    medium = mc.Medium([1.0], [1.0 - albedo], [albedo], [g], [tau])
    return Exact(f"slab g={g:g} a={albedo:g} tau={tau:g}", 3, medium, mc.Pencil(), {"R": reflected, "T": transmitted})


_OBLIQUE, _DIFFUSE = mc.Pencil(0.5), mc.Lambertian()
EXACT = (
    _half_space(0.5, 0.115226),
    _half_space(0.9, 0.4149475),
    _half_space(0.99, 0.752721),
    _half_space(0.999, 0.912845),
    _half_space(0.9, 0.507939, source=_OBLIQUE, tag="mu0=0.5"),
    _half_space(0.99, 0.815140, source=_OBLIQUE, tag="mu0=0.5"),
    _half_space(0.9, 0.478024, source=_DIFFUSE, tag="diffuse"),
    _half_space(0.999, 0.929713, source=_DIFFUSE, tag="diffuse"),
    _half_space(0.9, 0.2747321, 1.33),
    _half_space(0.9, 0.2505959, 1.4),
    _half_space(0.9, 0.2199186, 1.5),
    _half_space(0.5, 0.0442459, 1.5),
    _half_space(0.99, 0.6035893, 1.4),
    _half_space(0.999, 0.8301157, 1.4),
    _half_space(0.999, 0.8014585, 1.5),
    _half_space(0.9999, 0.9240633, 1.4),
    _slab(0.0, 0.5, 1.0, 0.09911919, 0.446058390),
    _slab(0.0, 0.9, 10.0, 0.41493469, 5.61239453e-3),
    _slab(0.0, 0.99, 10.0, 0.74093232, 0.0847608708),
    _slab(0.0, 0.9999, 10.0, 0.85155162, 0.146084717),
    _slab(0.0, 0.9999, 100.0, 0.96963089, 0.0103508129),
    _slab(0.75, 0.9, 2.0, 0.09739464, 0.660957700),
    _slab(0.75, 0.99, 10.0, 0.47257088, 0.340012433),
    _slab(0.75, 0.9999, 10.0, 0.56784121, 0.429944882),
    _slab(0.9, 0.9, 2.0, 0.03221530, 0.759576341),
    _slab(0.9, 0.99, 10.0, 0.24762765, 0.589081511),
    _slab(0.9, 0.99, 100.0, 0.39953456, 3.58833887e-3),
    _slab(0.9, 0.9999, 100.0, 0.83683193, 0.139329448),
    _slab(0.98, 0.9, 1.0, 0.00303127, 0.899994794),
    _slab(0.98, 0.99, 10.0, 0.04155674, 0.845186134),
    _slab(0.98, 0.9999, 100.0, 0.49472423, 0.483677609),
)


@dataclass(frozen=True)
class Profile:
    """An MCML run: its scene, and its results as estimates with 20 batches."""

    name: str
    medium: mc.Medium
    tallies: mc.Tallies
    photons: int
    cpu_seconds: float
    totals: mc.Estimate
    rings: mc.Estimate
    angles: mc.Estimate


TOTALS = ("R", "T", "A")


def mcml_names() -> tuple[str, ...]:
    """Names of the MCML cases that are there; empty where the collection is not."""
    return tuple(sorted(path.stem for path in MCML.glob("*.json")))


def _column(rows: Sequence[dict[str, str]], *names: str) -> np.ndarray:
    return np.array([float(row[name]) for name in names for row in rows])


def _both(rows: Sequence[dict[str, str]], up: str, down: str, up_error: str, down_error: str, dof: int, quantum: np.ndarray) -> mc.Estimate:
    return mc.Estimate(_column(rows, up, down), _column(rows, up_error, down_error), dof, quantum=np.tile(quantum, 2))


def mcml(name: str) -> Profile:
    """Read one MCML case."""
    header = json.loads((MCML / f"{name}.json").read_text())
    layers = header["layers"]
    medium = mc.Medium(
        [layer["n"] for layer in layers],
        [layer["mua_per_mm"] for layer in layers],
        [layer["mus_per_mm"] for layer in layers],
        [layer["g"] for layer in layers],
        [math.inf if layer["thickness_mm"] == "semi-infinite" else layer["thickness_mm"] for layer in layers],
        n_above=header["n_above"],
        n_below=header["n_below"],
    )
    with open(MCML / f"{name}.csv") as file:
        rings = list(csv.DictReader(file))
    with open(MCML / f"{name}.angular.csv") as file:
        angles = list(csv.DictReader(file))
    edges = np.append(_column(rings, "r_lo_mm"), float(rings[-1]["r_hi_mm"]))
    theta = np.append(_column(angles, "theta_lo_deg"), float(angles[-1]["theta_hi_deg"]))
    totals = header["totals"]
    listed = [totals["R_diffuse"], totals["T_total"], *totals["A_layer"]]
    value = np.array([item["value"] for item in listed])
    # 20 batches may by chance scatter less than photons that each count 0 or 1 weights ever could
    floor = 0.7 * np.sqrt(value * (1.0 - value) / header["photons"]) * (np.arange(value.size) < 2)
    dof, photons = header["batches"] - 1, header["photons"]
    area = math.pi * np.diff(edges**2)
    sphere = math.pi * np.diff(np.sin(np.radians(theta)) ** 2)
    return Profile(
        name,
        medium,
        mc.Tallies(rings=edges, theta=theta),
        header["photons"],
        header["cpu_seconds"],
        mc.Estimate(value, np.maximum([item["se"] for item in listed], floor), dof, quantum=1.0 / photons),
        _both(rings, "R_per_mm2", "T_per_mm2", "R_se", "T_se", dof, 1.0 / (photons * area)),
        _both(
            angles,
            "R_radiance_per_sr",
            "T_radiance_per_sr",
            "R_radiance_se",
            "T_radiance_se",
            dof,
            1.0 / (photons * sphere),
        ),
    )


def families(result: mc.Result) -> dict[str, mc.Estimate]:
    """The same three families of a run of ours: totals, rings, angles."""
    groups = {"totals": TOTALS, "rings": ("R_rings", "T_rings"), "angles": ("R_angle", "T_angle")}
    return {group: mc.Estimate.join([result.estimate(name) for name in names]) for group, names in groups.items()}


def judge(result: mc.Result, profile: Profile, level: float) -> dict[str, mc.Comparison]:
    """Compare a run with an MCML case, family by family."""
    ours = families(result)
    return {name: mc.compare(ours[name], getattr(profile, name), level=level) for name in ours}


def provenance(command: str, seed: int, photons: int) -> dict[str, Any]:
    """Header of a stored result."""
    import numba

    from layerfit.montecarlo.engine import ENGINE
    from layerfit.montecarlo.store import version

    return {
        "command": command,
        "seed": seed,
        "photons": photons,
        "engine": ENGINE,
        "layerfit": version(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
    }


def collect(
    name: str,
    header: dict[str, Any],
    jobs: Sequence[tuple[str, Callable[[], dict[str, Any]]]],
    out: Path | None,
    fresh: bool,
) -> dict[str, Any]:
    """Run the jobs that the stored file of the same header does not hold yet; store after each; print each."""
    path = out or RESULTS / f"{name}.json"
    stored: dict[str, Any] = json.loads(path.read_text()) if path.exists() and not fresh else {}
    entries = stored.get("results", {}) if stored.get("header") == header else {}
    for label, job in jobs:
        if label not in entries:
            entries[label] = job()
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps({"header": header, "results": entries}, indent=1) + "\n")
        print(label, json.dumps(entries[label]), flush=True)
    return {"header": header, "results": entries}


def fail_on(message: str | None) -> None:
    """End a benchmark with exit code 1 and a line that says what failed."""
    if message:
        sys.exit(f"FAILED: {message}")
