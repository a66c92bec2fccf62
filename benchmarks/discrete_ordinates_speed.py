"""Time and error of one layer in discrete ordinates: python benchmarks/discrete_ordinates_speed.py (on an idle machine).

Slab albedo 0.9, tau 2, g 0.75 (R 0.09739464, T 0.66095770), fluxes; alone and in a batch of 64; compile and run time apart.
"""

import time
from functools import partial

import jax
import numpy as np

import layerfit as lf
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain

EXACT = np.array([0.09739464, 0.66095770])


def stack(albedo: float = 0.9) -> lf.Stack:
    return lf.Stack([lf.Layer("slab", sigma_a=2.0 * (1.0 - albedo), sigma_s=2.0 * albedo, g=0.75, n=1.0, thickness=1.0)])


def median(call, repeats: int = 30) -> float:
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def main() -> None:
    print("streams, compile [s], one [ms], each of 64 [ms], error")
    for streams in (8, 16, 32, 64):
        columns = to_columns(stack())
        geometries = [lf.TotalReflectance(), lf.TotalTransmittance()]
        forward = lf.DiscreteOrdinates(streams=streams).forward(Domain(stack(), columns, columns), geometries, [(0.0, 0.0)] * 2)
        one = jax.jit(lambda c, forward=forward: forward(c))
        start = time.perf_counter()
        values = jax.block_until_ready(one(columns))
        compiled = time.perf_counter() - start
        batch = jax.tree.map(lambda *x: jax.numpy.stack(x), *[to_columns(stack(a)) for a in np.linspace(0.5, 1.0, 64)])
        many = jax.jit(jax.vmap(lambda c, forward=forward: forward(c)))
        jax.block_until_ready(many(batch))
        error = np.max(np.abs(np.concatenate([np.asarray(v) for v in values]) - EXACT))
        alone, together = 1e3 * median(partial(one, columns)), 1e3 / 64 * median(partial(many, batch))
        print(f"{streams}, {compiled:.2f}, {alone:.3f}, {together:.4f}, {error:.1e}", flush=True)


if __name__ == "__main__":
    main()
