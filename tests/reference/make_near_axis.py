"""Stored T(r) near the axis behind slabs, by the project's Monte Carlo: ``python tests/reference/make_near_axis.py`` (a few minutes).

Rings are narrow, where a few directions of a solver would be seen as cones of light.
"""

from pathlib import Path

import numpy as np
from ring_rows import ring_rows

import layerfit as lf

PHOTONS = 20_000_000
SLABS = {
    "forward_01": lf.Stack([lf.Layer("a", sigma_a=0.05, sigma_s=50.0, g=0.98, n=1.4, thickness=0.1)]),
    "forward_05": lf.Stack([lf.Layer("a", sigma_a=0.02, sigma_s=10.0, g=0.9, n=1.4, thickness=0.5)]),
    "forward_1": lf.Stack([lf.Layer("a", sigma_a=0.01, sigma_s=10.0, g=0.9, n=1.4, thickness=1.0)]),
    "glass_3": lf.Stack([lf.Layer("a", sigma_a=0.02, sigma_s=5.0, g=0.8, n=1.33, thickness=3.0)], n_below=1.5),
    "two_thin": lf.Stack(
        [
            lf.Layer("a", sigma_a=0.05, sigma_s=10.0, g=0.9, n=1.33, thickness=0.1),
            lf.Layer("b", sigma_a=0.2, sigma_s=10.0, g=0.8, n=1.5, thickness=0.1),
        ]
    ),
}
EDGES = np.geomspace(0.1, 0.5, 9)  # in transport mean free paths of the first layer


def main() -> None:
    lines = [
        f"# T(r) [1/mm^2] of rings [mm] behind the slabs of make_near_axis.py, Monte Carlo of {PHOTONS} photons, standard error",
        "slab,r_min,r_max,T,se",
    ]
    for name, stack in SLABS.items():
        edges = EDGES / float(stack.layers[0].sigma_a + stack.layers[0].sigma_s_prime)
        geometry = lf.RadialTransmittance(r_min=edges[:-1], r_max=edges[1:])
        found = lf.predict(stack, geometry, solver=lf.MonteCarlo(photons=PHOTONS, seed=3))[0]
        lines += ring_rows(name, edges, found)
    (Path(__file__).parent / "near_axis.csv").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
