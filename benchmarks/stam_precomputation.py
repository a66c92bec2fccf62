"""Stam's precomputation: all R_k and T_k of one layer, rough on both sides: python benchmarks/stam_precomputation.py (on an idle machine).

24 azimuthal orders, 48 streams; compile and run time apart, with the largest error against 64 streams beside them: of diffuse reflectance and
transmittance, and of the BRDF and BTDF of the first 24 orders, carried over from ordinate to ordinate by Lagrange interpolation. Quietest of the
passes and the slowest; "faces" is what the two rough interfaces take of it (they are kept where no optical index or roughness changes).
"""

import time

import jax
import numpy as np
from record import record

import layerfit as lf
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain
from layerfit.transport.reciprocal_matrices import ReciprocalMatrices, assemble, optics, plan

ORDERS, STREAMS, REFERENCE, PASSES = 24, 48, 64, 10


def stack(roughness: float) -> lf.Stack:
    layer = lf.Layer("skin", sigma_a=0.1, sigma_s=2.0, g=0.6, n=1.4, thickness=1.0, roughness=roughness)
    return lf.Stack([layer], roughness_below=roughness)


def timed(call) -> tuple[object, float]:
    start = time.perf_counter()
    result = jax.block_until_ready(call())
    return result, time.perf_counter() - start


def carried(kernel, mu: np.ndarray, to: np.ndarray) -> np.ndarray:
    """Kernels at other cosines, both within one panel, by the polynomial through all; odd orders over their sines, which are no polynomial."""

    def rows() -> np.ndarray:
        matrix = np.ones((len(to), len(mu)))
        for j in range(len(mu)):
            for k in range(len(mu)):
                if k != j:
                    matrix[:, j] *= (to - mu[k]) / (mu[j] - mu[k])
        return matrix

    between = rows()
    odd = (np.arange(len(kernel)) % 2)[:, None]
    sine, there = (np.where(odd, np.sqrt(1.0 - c**2), 1.0) for c in (mu, to))
    smooth = np.asarray(kernel) / (sine[:, :, None] * sine[:, None, :])
    return between @ smooth @ between.T * there[:, :, None] * there[:, None, :]


def matrices(sample: lf.Stack, streams: int) -> tuple[ReciprocalMatrices, dict[str, float]]:
    columns = to_columns(sample)
    shape = plan(Domain(sample, columns, columns), lf.DiscreteOrdinates(streams=streams), ORDERS)
    (grid, faces), first = timed(lambda: optics(shape, columns))
    m, second = timed(lambda: assemble(shape, columns, grid, faces))
    faces_s, whole_s = [], []
    for _ in range(PASSES):
        kept, a = timed(lambda: optics(shape, columns))
        _, b = timed(lambda kept=kept: assemble(shape, columns, *kept))
        faces_s.append(a)
        whole_s.append(a + b)
    return m, {"first_s": first + second, "run_s": min(whole_s), "slowest_s": max(whole_s), "faces_s": min(faces_s)}


def main() -> None:
    rows = []
    for roughness in (0.1, 0.3, 0.6):
        fine, _ = matrices(stack(roughness), REFERENCE)
        m, times = matrices(stack(roughness), STREAMS)
        mu, to = np.asarray(m.mu_above), np.asarray(fine.mu_above)
        inner = (to >= mu.min()) & (to <= mu.max())
        error = {
            "diffuse": max(abs(float(m.diffuse(getattr(m, f)()) - fine.diffuse(getattr(fine, f)()))) for f in ("reflectance", "transmittance")),
            **{
                name: float(np.max(np.abs(carried(getattr(m, name), mu, to[inner]) - np.asarray(getattr(fine, name))[:, inner][:, :, inner])))
                for name in ("R_above", "T_down")
            },
        }
        largest = {name: float(np.max(np.abs(getattr(fine, name)))) for name in ("R_above", "T_down")}
        row = {"roughness": roughness, "orders": ORDERS, "streams": STREAMS, **times, "error": error, "largest": largest}
        print(row, flush=True)
        rows.append(row)
    record("stam_precomputation", rows)


if __name__ == "__main__":
    main()
