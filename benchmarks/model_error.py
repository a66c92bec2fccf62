"""How often 95 % intervals hold the truth when transport-made data are fitted by diffusion, without and with its stated error.

Writes docs/model-error.md:

    python benchmarks/model_error.py [--draws 10]

The data are ring averages of R(r) (and T(r) of slabs) beyond one transport mean free path of the first layer, 25 a profile, where their own standard
error is below 5 %; 1.5 % of normal noise is drawn and added, and the sd holds both. "Open" scenes are the Monte Carlo cases of tests/reference/cases:
size and correlation of the stated error were laid over these. "Fresh" scenes were not looked at for that: half spaces, slabs and two layers drawn at
random, computed by discrete ordinates (whose own error is below 1 %).

All coefficients and thicknesses of samples of one or two layers are free, of more layers the coefficients of the optically thickest finite one;
bounds a factor of 20 (absorption), 5 (scattering) and 4 (thickness) about the truth, fits start a factor of 1.6 away. An interval is the value and
1.96 standard errors; a number that ends at its bound has none, which the fit says, and is counted apart.
"""

import argparse
import os
import sys
import time
from pathlib import Path
from typing import NamedTuple

# most of the time is compilation; the quick code generator does
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false --xla_backend_optimization_level=0")

import numpy as np
from fits_of_monte_carlo import SPAN, thinned
from record import record

import layerfit as lf

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from cases import cases

NOISE = 0.015
MODES = ("off", "on")
THIN = 0.5  # mfp': diffusion refuses nothing, but there is no diffusion in a slab as thin as this
FRESH = 12


class Scene(NamedTuple):
    name: str
    kind: str
    stack: lf.Stack
    profiles: list  # (name, geometry, values, standard errors)


def written(stack):
    """The same stack written with sigma_s_prime, so that it can be free."""
    layers = []
    for x in stack.layers:
        numbers = {"sigma_a": x.sigma_a, "sigma_s_prime": x.sigma_s_prime, "g": x.g, "n": x.n}
        layers.append(lf.HalfSpace(x.name, **numbers) if isinstance(x, lf.HalfSpace) else lf.Layer(x.name, thickness=x.thickness, **numbers))
    return lf.Stack(layers, n_above=stack.n_above, n_below=stack.n_below)


def open_scenes():
    for case in cases():
        if len(case.stack.layers) == 1 and min(case.optical_thickness, default=np.inf) < THIN:
            continue
        kinds = [(lf.RadialReflectance, case.R, case.R_se, "R")]
        kinds += [] if case.stack.half_space else [(lf.RadialTransmittance, case.T, case.T_se, "T")]
        profiles = []
        for kind, values, se, name in kinds:
            low, high, value, sd = thinned(case, values, se)
            profiles.append((name, kind(r_min=low, r_max=high), value, np.sqrt(np.maximum(sd**2 - (0.02 * value) ** 2, 0.0))))
        yield Scene(case.name, "open", written(case.stack), profiles)


def fresh_scenes(seed=2024):
    random = np.random.default_rng(seed)

    def between(low, high):
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    solver = lf.DiscreteOrdinates()
    for i in range(FRESH):
        top = {"sigma_s_prime": between(0.5, 3.0), "g": float(random.uniform(0.0, 0.9)), "n": float(random.uniform(1.33, 1.5))}
        top["sigma_a"] = top["sigma_s_prime"] * between(0.002, 0.1)
        mfp = 1.0 / (top["sigma_a"] + top["sigma_s_prime"])
        if i % 3 == 0:
            stack = lf.Stack([lf.HalfSpace("layer1", **top)])
        elif i % 3 == 1:
            stack = lf.Stack([lf.Layer("layer1", thickness=between(2.0, 10.0) * mfp, **top)])
        else:
            deep = {"sigma_s_prime": top["sigma_s_prime"] * between(0.4, 2.5), "g": top["g"], "n": top["n"]}
            deep["sigma_a"] = deep["sigma_s_prime"] * between(0.002, 0.1)
            stack = lf.Layer("layer1", thickness=between(1.0, 5.0) * mfp, **top) | lf.HalfSpace("layer2", **deep)
        edges = mfp * np.geomspace(1.0, 15.0, 26)
        kinds = [("R", lf.RadialReflectance)] + ([] if stack.half_space else [("T", lf.RadialTransmittance)])
        profiles = []
        for name, kind in kinds:
            geometry = kind(r_min=edges[:-1], r_max=edges[1:])
            predicted = lf.predict(stack, geometry, solver=solver)[0].values
            profiles.append((name, geometry, predicted, 0.003 * predicted))
        yield Scene(f"fresh{i + 1}", "fresh", stack, profiles)


def free_numbers(stack):
    layers = stack.layers
    if len(layers) > 2:
        layers = [max((x for x in layers if isinstance(x, lf.Layer)), key=lambda x: float(x.thickness / x.transport_mfp))]
    fitted = SPAN if len(stack.layers) <= 2 else ("sigma_a", "sigma_s_prime")
    truth = {
        f"{x.name}.{n}": float(getattr(x, n)) for x in layers for n in SPAN if n in fitted and not (n == "thickness" and isinstance(x, lf.HalfSpace))
    }
    free = {}
    for i, (name, value) in enumerate(truth.items()):
        span = SPAN[name.rsplit(".", 1)[1]]
        free[name] = {"min": value / span, "max": value * span, "init": value * (1.6 if i % 2 else 0.6), "scale": "log"}
    return truth, free


def studied(scene, draws, modes):
    """One row a number and mode."""
    truth, free = free_numbers(scene.stack)
    rows = []
    for mode in modes:
        random = np.random.default_rng(7)
        held = {name: [] for name in truth}
        sizes = {name: [] for name in truth}
        began = time.perf_counter()
        for _ in range(draws):
            data = []
            for name, geometry, values, se in scene.profiles:
                noisy = values * (1.0 + NOISE * random.standard_normal(values.size))
                data.append(lf.Dataset(geometry, noisy, np.hypot(se, NOISE * values), name=name))
            result = lf.fit(lf.Problem(scene.stack, data, free=free, solver=lf.LayeredDiffusion(), model_error=mode), starts=2)
            for name, value in truth.items():
                estimate = result.parameters[name]
                if estimate.stderr is None:
                    held[name].append(None)
                else:
                    held[name].append(bool(abs(estimate.value - value) <= 1.96 * estimate.stderr))
                    sizes[name].append(estimate.stderr / value)
        for name in truth:
            stated = [one for one in held[name] if one is not None]
            rows.append(
                {
                    "scene": scene.name,
                    "kind": scene.kind,
                    "mode": mode,
                    "number": name,
                    "stated": len(stated),
                    "held": sum(stated),
                    "at_bound": draws - len(stated),
                    "stderr": float(np.median(sizes[name])) if sizes[name] else None,
                }
            )
        mine = [row for row in rows if row["mode"] == mode]
        held_, stated_ = sum(r["held"] for r in mine), sum(r["stated"] for r in mine)
        sd = " ".join(f"{r['number'].split('.')[0][-1]}{r['number'].split('.')[1][:7]}:{r['stderr'] or -1:.2f}" for r in mine)
        print(f"{scene.name:30} {mode:4} {held_}/{stated_} {time.perf_counter() - began:.0f} s  {sd}", flush=True)
    return rows


def share(rows):
    stated = sum(row["stated"] for row in rows)
    return f"{100 * sum(row['held'] for row in rows) / stated:.0f} %" if stated else "-"


def with_bounds(rows):
    whole = sum(row["stated"] + row["at_bound"] for row in rows)
    return f"{100 * sum(row['held'] for row in rows) / whole:.0f} %"


def median_sd(rows):
    sizes = [row["stderr"] for row in rows if row["stderr"] is not None]
    return f"{100 * float(np.median(sizes)):.2g} %" if sizes else "-"


def written_table(rows, draws, modes):
    lines = ["# The model's error as part of the uncertainty", "", " ".join(__doc__.split(", without and")[0].split()) + ".", ""]
    lines += [" ".join(part.split()) + "\n" for part in __doc__.split("\n\n")[2:]]
    lines += [f"Made by `python benchmarks/model_error.py --draws {draws} --modes {' '.join(modes)}`: {draws} draws of noise a scene.", ""]
    lines += ["| scenes | model error | intervals that hold the truth | numbers at a bound counted as misses | at a bound | median standard error |"]
    lines += ["|---|---|---|---|---|---|"]
    for kind in ("open", "fresh"):
        for mode in modes:
            part = [row for row in rows if row["kind"] == kind and row["mode"] == mode]
            if part:
                lines.append(f"| {kind} | {mode} | {share(part)} | {with_bounds(part)} | {sum(r['at_bound'] for r in part)} | {median_sd(part)} |")
    lines += ["", "## Scene by scene", "", "Intervals that hold the truth, and the median standard error.", ""]
    lines += ["| scene | numbers | " + " | ".join(modes) + " |", "|---" * (len(modes) + 2) + "|"]
    for name in dict.fromkeys(row["scene"] for row in rows):
        mine = [row for row in rows if row["scene"] == name]
        cells = []
        for mode in modes:
            part = [row for row in mine if row["mode"] == mode]
            bound = sum(row["at_bound"] for row in part)
            cells.append(f"{share(part)} ({median_sd(part)}{f'; {bound} at a bound' if bound else ''})")
        lines.append(f"| {name} | {len(mine) // len(modes)} | " + " | ".join(cells) + " |")
    return "\n".join(lines).rstrip() + "\n"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--only", default="")
    parser.add_argument("--modes", nargs="+", default=MODES, choices=["off", "on", "free"])
    arguments = parser.parse_args()
    rows = []
    for scene in sorted([*open_scenes(), *fresh_scenes()], key=lambda scene: len(scene.stack.layers) > 2):  # what compiles for minutes comes last
        if arguments.only in scene.name:
            rows += studied(scene, arguments.draws, arguments.modes)
            text = written_table(rows, arguments.draws, arguments.modes)
            if not arguments.only:
                record("model_error", rows)
                (ROOT / "docs" / "model-error.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
