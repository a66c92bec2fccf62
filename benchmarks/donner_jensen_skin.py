"""Skin of Donner and Jensen 2005, table 3: total R and T of each layer and of the stack, discrete ordinates against Monte Carlo, and its colours.

python benchmarks/donner_jensen_skin.py [PHOTONS]   (4e6 if left out; ten minutes)

Diffuse light, red, green and blue; smooth faces, and a rough surface for the figure. Each layer alone lies between air, as in figure 8; the bloody
dermis has no lower end. Writes docs/donner-jensen-skin.md, docs/donner-jensen-skin.png and benchmarks/results/donner_jensen_skin.json.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from record import record

import layerfit as lf

DOCS = Path(__file__).parent.parent / "docs"
BANDS = ("R", "G", "B")
# sigma_a and sigma_s [1/mm] for R, G, B; n; g; thickness [mm]
TABLE = {
    "epidermis": ((2.1, 2.1, 5.0), (48.0, 60.0, 65.0), 1.4, 0.0, 0.03),
    "upper dermis": ((0.16, 0.19, 0.30), (32.0, 40.0, 46.0), 1.34, 0.25, 0.05),
    "bloody dermis": ((0.085, 1.0, 25.0), (4.5, 4.7, 4.8), 1.4, 0.8, None),
}
ROUGHNESS = (0.0, 0.3, 0.6)
COMBINED = "combination"
SOLVER = lf.DiscreteOrdinates(streams=32)


def layer(name: str, band: int, roughness: float = 0.0):
    sigma_a, sigma_s, n, g, thickness = TABLE[name]
    optics = {"sigma_a": sigma_a[band], "sigma_s": sigma_s[band], "n": n, "g": g, "roughness": roughness}
    return lf.HalfSpace(name, **optics) if thickness is None else lf.Layer(name, thickness=thickness, **optics)


def sample(name: str, band: int, roughness: float = 0.0) -> lf.Stack:
    """One layer alone or all of them; only the surface is rough."""
    if name != COMBINED:
        return lf.Stack([layer(name, band, roughness)])
    return lf.Stack([layer(part, band, roughness if i == 0 else 0.0) for i, part in enumerate(TABLE)])


def geometries(stack: lf.Stack, specular: str) -> list:
    both = [lf.TotalReflectance(incidence="diffuse", specular=specular)]
    return both if stack.half_space else [*both, lf.TotalTransmittance(incidence="diffuse")]


def totals(stack: lf.Stack, specular: str = "included", solver=SOLVER) -> list[float]:
    return [float(p.values[0]) for p in lf.predict(stack, geometries(stack, specular), solver=solver)]


def main():
    photons = int(float(sys.argv[1])) if len(sys.argv) > 1 else 4_000_000
    rows = []
    for name in (*TABLE, COMBINED):
        for band, letter in enumerate(BANDS):
            stack = sample(name, band)
            ours = totals(stack, "excluded")
            walked = lf.predict(stack, geometries(stack, "excluded"), solver=lf.MonteCarlo(photons=photons, seed=8))
            for what, value, truth in zip("RT", ours, walked, strict=False):
                mean, se = float(truth.values[0]), float(truth.estimated_error[0])
                rows.append({"layer": name, "band": letter, "what": what, "ordinates": value, "walked": mean, "se": se})
                print(name, letter, what, f"{value:.5f} {mean:.5f} {100 * (value / mean - 1):+.3f} % {(value - mean) / se:+.1f} se", flush=True)
    colours = {}
    for name in (*TABLE, COMBINED):
        strip = np.array([[totals(sample(name, band, s))[0] for band in range(3)] for s in ROUGHNESS])
        colours[f"{name}, R"] = lf.colour_of_rgb(strip)
        if name not in (COMBINED, "bloody dermis"):
            colours[f"{name}, T"] = lf.colour_of_rgb([[totals(sample(name, band, s))[1] for band in range(3)] for s in ROUGHNESS])
    record("donner_jensen_skin", rows)
    picture(colours)
    (DOCS / "donner-jensen-skin.md").write_text(page(rows, photons))


def picture(colours) -> None:
    figure: Figure = lf.swatches(colours)
    axes = figure.axes[0]
    axes.set_title("D65, 2 degrees", fontsize="small", loc="right")
    places = (np.arange(len(ROUGHNESS)) + 0.5) / len(ROUGHNESS)
    axes.set_xticks(places, [f"surface roughness {s:g}" if s else "smooth surface" for s in ROUGHNESS], fontsize="small")
    figure.savefig(DOCS / "donner-jensen-skin.png", dpi=110)


def page(rows, photons: int) -> str:
    worst = max(rows, key=lambda row: abs(row["ordinates"] / row["walked"] - 1))
    scores = [abs(row["ordinates"] - row["walked"]) / row["se"] for row in rows]
    text = [
        "# Skin of Donner and Jensen",
        "",
        "Three layers of skin (C. Donner and H. W. Jensen 2005, table 3), each alone between air and all together, in diffuse light: total "
        "reflectance and "
        f"transmittance by discrete ordinates (32 streams) and by the Monte Carlo ({photons:.0e} photons a sample). Specular reflection left out. "
        "Made by `python benchmarks/donner_jensen_skin.py`.",
        "",
        f"Largest difference: {100 * abs(worst['ordinates'] / worst['walked'] - 1):.2f} % ({worst['layer']}, {worst['band']}, {worst['what']}); "
        f"{sum(s <= 3 for s in scores)} of {len(scores)} values lie within 3 standard errors.",
        "",
        "| sample | | R: ordinates | Monte Carlo | G: ordinates | Monte Carlo | B: ordinates | Monte Carlo |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in (*TABLE, COMBINED):
        for what in "RT":
            found = [row for row in rows if (row["layer"], row["what"]) == (name, what)]
            if found:
                cells = [f"{row['ordinates']:.5f} | {row['walked']:.5f} ± {row['se']:.5f}" for row in found]
                text.append(f"| {name} | {what} | " + " | ".join(cells) + " |")
    text += [
        "",
        "![strips of colour](donner-jensen-skin.png)",
        "",
        "As the strips of their figure 8: reflected (R) and transmitted (T) light of each layer and of the combination, the three bands taken as "
        "linear sRGB, "
        "specular reflection included. From left to right the surface gets rougher (RMS slope).",
    ]
    return "\n".join(text) + "\n"


if __name__ == "__main__":
    main()
