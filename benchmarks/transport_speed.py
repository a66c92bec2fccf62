"""R(r) of two layers by discrete ordinates at the default fineness: compilation, value and Jacobian, beside plain diffusion and its error.

    python benchmarks/transport_speed.py        # two minutes

64 distances from half a transport mean free path to 20 mm, 6 parameters (both absorptions and scatterings, g of the top, thickness). Least of the
medians of three passes of 7 calls, on one core, compiled as fits are; compilation is tracing and compiling. The error is that against the finest
rung of Auto; diffusion stands beside.
"""

import os
import sys
import time

if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {sorted(os.sched_getaffinity(0))[0]})

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from record import record

import layerfit as lf
from layerfit.compilation import QUICK
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain

SKIN = lf.Layer("top", sigma_a=0.02, sigma_s_prime=2.0, g=0.8, n=1.4, thickness=1.5) | lf.HalfSpace(
    "deep", sigma_a=0.005, sigma_s_prime=1.2, g=0.8, n=1.4
)
GEOMETRY = lf.RadialReflectance(r=np.geomspace(0.25, 20.0, 64))


def timed(function, x):
    start = time.perf_counter()
    jax.block_until_ready(function(x))
    first, passes = time.perf_counter() - start, []
    for _ in range(3):
        times = []
        for _ in range(7):
            start = time.perf_counter()
            jax.block_until_ready(function(x))
            times.append(time.perf_counter() - start)
        passes.append(float(np.median(times)))
    return first, min(passes)


def main():
    columns = to_columns(SKIN)
    finest = lf.predict(SKIN, GEOMETRY, solver=lf.Auto.ladder()[-1])[0].values
    rows = []
    for solver in (lf.LayeredDiffusion(), lf.Auto.ladder()[1], lf.DiscreteOrdinates()):
        forward = solver.forward(Domain(SKIN, columns, columns), [GEOMETRY], [(0.0, 0.0)])

        def values(x, forward=forward):
            g = jnp.stack([x[4], columns.g[1]])
            where = lambda c: (c.sigma_a, c.sigma_s_prime, c.g, c.thickness)  # noqa: E731
            return forward(eqx.tree_at(where, columns, (x[:2], x[2:4], g, x[5:])))[0]

        x = jnp.concatenate([columns.sigma_a, columns.sigma_s_prime, columns.g[:1], columns.thickness])
        compile_value, value = timed(jax.jit(values, **QUICK), x)
        compile_jacobian, jacobian = timed(jax.jit(jax.jacfwd(values), **QUICK), x)
        error = np.abs(np.asarray(values(x)) / finest - 1.0)
        row = {
            "solver": solver.label,
            "compile_value_s": compile_value,
            "value_ms": 1e3 * value,
            "compile_jacobian_s": compile_jacobian,
            "jacobian_ms": 1e3 * jacobian,
            "median_error": float(np.median(error)),
            "largest_error": float(np.max(error)),
        }
        rows.append(row)
        print(", ".join(f"{name} {v if isinstance(v, str) else format(v, '.3g')}" for name, v in row.items()), flush=True)
    record("transport_speed", rows)


if __name__ == "__main__":
    sys.exit(main())
