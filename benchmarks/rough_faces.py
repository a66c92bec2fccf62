"""Rough faces in discrete ordinates against the Monte Carlo: totals, and lobes of light through thin layers laid over each other.

python benchmarks/rough_faces.py [PHOTONS]   (2e6 if left out; half an hour, most of it the figure)

The ordinates follow light that meets one facet and hand back what a second one catches by a reciprocal term of rank one; the Monte Carlo walks from
facet to facet. What they differ by is what that model costs. Stores benchmarks/results/rough_faces.json and the figure beside it.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from record import record

import layerfit as lf

ROUGHNESS = (0.0, 0.1, 0.3, 0.6)
ANGLES = np.arange(2.0, 84.0, 4.0)


def skin(roughness: float) -> lf.Stack:
    """Donner and Jensen 2005, table 3, red, over a half space; its lower interfaces smooth."""
    upper = lf.Layer("epidermis", sigma_a=2.1, sigma_s=48.0, g=0.0, n=1.4, thickness=0.03, roughness=roughness)
    middle = lf.Layer("upper dermis", sigma_a=0.16, sigma_s=32.0, g=0.25, n=1.34, thickness=0.05, roughness=roughness)
    return upper | middle | lf.HalfSpace("dermis", sigma_a=0.085, sigma_s=4.5, g=0.8, n=1.4)


def slab(roughness: float, n: float, sigma_s: float = 5.0, thickness: float = 1.0) -> lf.Stack:
    layer = lf.Layer("slab", sigma_a=0.05, sigma_s=sigma_s, g=0.5, n=n, thickness=thickness, roughness=roughness)
    return lf.Stack([layer], roughness_below=roughness)


SCENES = {"skin, table 3": skin, "slab n 1.33": lambda s: slab(s, 1.33), "slab n 1.5": lambda s: slab(s, 1.5)}


def geometry(light, what: str):
    if what == "T":
        return lf.TotalTransmittance(incidence=light)
    return lf.TotalReflectance(specular="excluded" if what == "R" else "included", incidence=light)


def totals(photons: int) -> list[dict]:
    rows = []
    print("| scene | roughness | light | what | ordinates | Monte Carlo | deviation | standard errors |\n|---|---|---|---|---|---|---|---|")
    for name, make in SCENES.items():
        for roughness in ROUGHNESS:
            stack = make(roughness)
            kinds = ("R with specular", "R") if stack.half_space else ("R with specular", "R", "T")
            asked = [(light, what) for light in ("normal", 45.0, "diffuse") for what in kinds]
            geometries = [geometry(light, what) for light, what in asked]
            ours = lf.predict(stack, geometries, solver=lf.DiscreteOrdinates())
            walked = lf.predict(stack, geometries, solver=lf.MonteCarlo(photons=photons, seed=1))
            for (light, what), a, b in zip(asked, ours, walked, strict=True):
                value, truth, se = float(a.values[0]), float(b.values[0]), float(b.estimated_error[0])
                rows.append({"scene": name, "roughness": roughness, "light": light, "what": what, "ordinates": value, "walked": truth, "se": se})
                deviation, z = 100 * (value / truth - 1), (value - truth) / se
                print(f"| {name} | {roughness} | {light} | {what} | {value:.5f} | {truth:.5f} | {deviation:+.2f} % | {z:+.1f} |", flush=True)
    return rows


def lobes(photons: int) -> None:
    """Light at 40 degrees on a thin, hardly scattering plate: what its faces send where, in the plane of incidence and 90 degrees out of it."""
    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    axes = figure.subplots(2, 3, sharex=True)
    for column, roughness in enumerate((0.1, 0.3, 0.6)):
        stack = slab(roughness, 1.5, sigma_s=0.5, thickness=0.5)
        kinds, azimuths = (lf.AngularTransmittance, lf.AngularReflectance), (0.0, 90.0, 180.0)
        asked = [(row, azimuth) for row in (0, 1) for azimuth in azimuths]
        geometries = [kinds[row](ANGLES, incidence=40.0, azimuth=azimuth) for row, azimuth in asked]
        ours = lf.predict(stack, geometries, solver=lf.DiscreteOrdinates())
        walked = lf.predict(stack, geometries, solver=lf.MonteCarlo(photons=photons, seed=2))
        for (row, azimuth), a, b in zip(asked, ours, walked, strict=True):
            color = f"C{azimuths.index(azimuth)}"
            axes[row, column].plot(ANGLES, a.values, color=color, label=f"azimuth {azimuth:g}°")
            axes[row, column].errorbar(ANGLES, b.values, b.estimated_error, fmt=".", color=color, ms=4)
        for row, what in enumerate(("through", "back from deeper faces")):
            axes[row, column].set_title(f"{what}, roughness {roughness}")
            axes[row, column].grid(alpha=0.3)
    for panel in axes[-1]:
        panel.set_xlabel("angle in the outer medium [°]")
    for panel in axes[:, 0]:
        panel.set_ylabel("radiance [1/sr]")
    axes[0, 0].legend(frameon=False, title="lines: ordinates, points: Monte Carlo")
    figure.savefig(Path(__file__).parent / "results" / "rough_faces.svg")


def main() -> None:
    photons = int(float(sys.argv[1])) if len(sys.argv) > 1 else 2_000_000
    rows = totals(photons)
    record("rough_faces", rows)
    smooth = [abs(r["ordinates"] - r["walked"]) / r["se"] for r in rows if r["roughness"] == 0.0]
    rough = [(abs(r["ordinates"] / r["walked"] - 1.0), r) for r in rows if r["roughness"] > 0.0]
    worst = max(rough, key=lambda pair: pair[0])
    print(f"\nroughness 0: largest {max(smooth):.1f} standard errors of {len(smooth)}")
    print(f"rough: largest {100 * worst[0]:.2f} % of {len(rough)}: {worst[1]}")
    lobes(photons)


if __name__ == "__main__":
    main()
