"""Pictures of how good each solver is where: errors of R(r) against Monte Carlo, case by case and by distance, from the pages that hold them.

    python benchmarks/error_maps.py

Reads docs/diffusion-errors.md and docs/transport-profiles.md, writes docs/error-maps.png.
"""

import re
from pathlib import Path

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

DOCS = Path(__file__).parent.parent / "docs"
DIFFUSION = {"multipole": "multipole", "layered-diffusion (default)": "layered diffusion"}
Rows = dict[str, list[float]]


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().split("|")[1:-1]]


def numbers(texts: list[str]) -> list[float]:
    """The number that each begins with; NaN where there is none."""
    found = [re.match(r"[-+]?[\d.]+", text) for text in texts]
    return [float(match[0]) if match else np.nan for match in found]


def diffusion() -> tuple[list[str], dict[str, Rows]]:
    """Bands of distance, and for each variant and case its errors [%]."""
    bands: list[str] = []
    found: dict[str, Rows] = {name: {} for name in DIFFUSION}
    for part in (DOCS / "diffusion-errors.md").read_text().split("\n## ")[1:]:
        case = part.split("\n", 1)[0].split(" (")[0]
        rows = [cells(line) for line in part.splitlines() if line.startswith("|")]
        if not rows or rows[0][0] != "variant" or rows[0][-1] != "T":
            continue
        bands = rows[0][1:-2]
        for row in rows:
            if row[0] in found and len(row) == len(rows[0]):
                found[row[0]][case] = numbers(row[1:-2])
    return bands, found


def ordinates() -> tuple[list[str], Rows]:
    """The same of R(r) by discrete ordinates."""
    rows = [cells(line) for line in (DOCS / "transport-profiles.md").read_text().splitlines() if line.startswith("|")]
    return rows[0][1:6], {row[0].removesuffix(" R"): numbers(row[1:6]) for row in rows if row[0].endswith(" R") and len(row) == len(rows[0])}


def main() -> None:
    bands, found = diffusion()
    usual = found["layered-diffusion (default)"]
    cases = sorted(usual, key=lambda case: np.nanmedian(np.abs(usual[case])))
    panels = [(title, bands, found[name]) for name, title in DIFFUSION.items()] + [("discrete ordinates", *ordinates())]
    figure = Figure(figsize=(13.0, 0.3 * len(cases) + 1.5), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, width_ratios=[len(b) for _, b, _ in panels])
    for ax, (title, names, rows) in zip(axes, panels, strict=True):
        values = np.array([rows.get(case, [np.nan] * len(names)) for case in cases])
        image = ax.imshow(np.clip(np.abs(values), 0.1, 100), norm=LogNorm(0.1, 100), cmap="RdYlGn_r", aspect="auto")
        for (i, j), value in np.ndenumerate(values):
            if np.isfinite(value):
                ax.text(j, i, f"{value:+.0f}" if abs(value) >= 10 else f"{value:+.1f}", ha="center", va="center", fontsize=7)
        short = [re.sub(r"( to inf| and more)$", " on", name).replace(" to ", "-") for name in names]
        ax.set_xticks(range(len(names)), short, fontsize=7)
        ax.set_title(f"{title}: error of R(r) [%]", fontsize="medium")
        ax.set_xlabel("distance r [transport mean free paths]", fontsize="small")
    axes[0].set_yticks(range(len(cases)), cases, fontsize=8)
    figure.colorbar(image, ax=axes, label="size of the error [%]", shrink=0.8)
    figure.savefig(DOCS / "error-maps.png", dpi=90)


if __name__ == "__main__":
    main()
