"""Two-layer R(r) at 64 radii, its Jacobian in 5 parameters, and Donner & Jensen's method done plainly in NumPy: time beside error, one core.

    python benchmarks/two_layer_speed.py

The plain program: 1000 dipole pairs for the four profiles of the upper layer (R and T, from above and below), a dipole for the half space, a
1024 x 1024 grid, FFT, Kubelka-Munk in frequency (eqs 21 and 22), inverse FFT. Both methods are compared with R(r) in arbitrary precision
(tests/reference/hankel.json, "multipole two layers").
"""

import os

os.sched_setaffinity(0, {0})

import json
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from record import record

import layerfit as lf
from layerfit.optics.fresnel import diffuse_moments, mismatch
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain

STORED = json.loads((Path(__file__).parent.parent / "tests" / "reference" / "hankel.json").read_text())
RADII = np.geomspace(0.1, 20.0, 64)
STACK = lf.Layer("top", sigma_a=0.02, sigma_s_prime=1.5, n=1.4, thickness=2.0) | lf.HalfSpace("deep", sigma_a=0.01, sigma_s_prime=1.0, n=1.4)
NAMES = ("top.sigma_a", "top.sigma_s_prime", "top.thickness", "deep.sigma_a", "deep.sigma_s_prime")
PASSES = 8


def dipoles(r, sigma_a, sigma_s_prime, d, zb0, zb1, pairs):
    """R(r) and T(r) of a slab by image pairs (DJ05 eqs 11 to 16)."""
    l = 1 / (sigma_a + sigma_s_prime)
    sigma_tr, alpha = np.sqrt(3 * sigma_a / l), sigma_s_prime * l
    i = np.arange(-pairs, pairs + 1)
    period = 2 * (d + zb0 + zb1)
    R, T = np.zeros_like(r), np.zeros_like(r)
    for z, sign in ((i * period + l, 1.0), (i * period - l - 2 * zb0, -1.0)):
        for total, depth, side in ((R, z, 1.0), (T, d - z, 1.0)):
            for start in range(0, r.size, 64):  # blocks that stay in the cache
                part = slice(start, start + 64)
                distance = np.sqrt(r[part, None] ** 2 + depth**2)
                green = depth * (1 + sigma_tr * distance) * np.exp(-sigma_tr * distance) / distance**3
                total[part] += side * sign * alpha / (4 * np.pi) * green.sum(axis=1)
    return R, T


def plain(A, pixel=0.06, size=1024, pairs=1000, radii=256):
    """R(r) on a row of the grid, and its radii."""
    axis = (np.arange(size) - size // 2) * pixel
    grid = np.hypot(axis[:, None], axis[None, :])
    table = np.concatenate([[0.0], np.geomspace(0.5 * pixel, grid.max(), radii - 1)])
    l1, l2 = 1 / 1.52, 1 / 1.01
    zb0, zb1 = 2 * A * l1 / 3, 2 * l1 / 3
    profiles = [*dipoles(table, 0.02, 1.5, 2.0, zb0, zb1, pairs), *dipoles(table, 0.02, 1.5, 2.0, zb1, zb0, pairs)]
    half = 0.0
    for z, sign in ((l2, 1.0), (-l2 - 4 * l2 / 3, -1.0)):
        distance = np.sqrt(table**2 + z**2)
        tr = np.sqrt(3 * 0.01 / l2)
        half = half + sign * l2 / (4 * np.pi) * z * (1 + tr * distance) * np.exp(-tr * distance) / distance**3
    spectra = [np.fft.rfft2(np.fft.ifftshift(np.interp(grid, table, p))) * pixel**2 for p in (*profiles, half)]
    R1, T1, R1_below, T1_up, R2 = spectra
    image = np.fft.fftshift(np.fft.irfft2(R1 + T1_up * R2 * T1 / (1 - R1_below * R2), s=grid.shape)) / pixel**2
    return axis[size // 2 :], image[size // 2, size // 2 :]


def compiled(function, x):
    """Function compiled for x, and the seconds it took."""
    start = time.perf_counter()
    done = jax.jit(function).lower(x).compile(compiler_options={"xla_cpu_use_fusion_emitters": False})
    return done, time.perf_counter() - start


def median_ms(call, repeat):
    call()
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times))


def forward(solver, radii):
    """R(r) as a function of the five numbers, for stacks within a factor of two."""
    geometry = lf.RadialReflectance(r=radii)
    x = np.array([STACK.get(name) for name in NAMES])
    ends = [to_columns(STACK.set(dict(zip(NAMES, x * f, strict=True)))) for f in (0.5, 2.0)]
    model = solver.forward(Domain(STACK, *ends), [geometry], [(0.0, 0.0)])
    return lambda x: model(to_columns(STACK.set({name: x[i] for i, name in enumerate(NAMES)})))[0], jnp.asarray(x)


def main():
    stored_r = np.array([float(r) for r in STORED["r_mm"]])
    expected = np.array([float(v) for k, v in STORED.items() if k.startswith("multipole two") for v in v])
    visible = (stored_r >= 0.3) & (stored_r <= 15)
    entering = 1 - (0.4 / 2.4) ** 2
    A = float(mismatch(*diffuse_moments(jnp.asarray(1.4))))
    rows = []
    slow = min(median_ms(lambda: plain(A), 3) for _ in range(4))
    axis, row = plain(A)
    error = np.max(np.abs(np.interp(stored_r[visible], axis, row) / expected[visible] - 1))
    rows.append({"what": "plain NumPy, 1000 pairs, 1024 x 1024 FFT", "ms": slow, "compile_s": 0.0, "largest_error": error})
    print("| what | time [ms] | compile [s] | largest relative error, 0.3 to 15 mm | times faster |\n|---|---|---|---|---|")
    print(f"| {rows[0]['what']} | {slow:.0f} | | {error:.1e} | 1 |")
    calls = []
    for solver in (lf.Multipole(), lf.LayeredDiffusion()):
        function, x = forward(solver, RADII)
        value, seconds = compiled(function, x)
        jacobian, jacobian_seconds = compiled(jax.jacfwd(function), x)
        error = None
        if solver.name == "multipole":
            same = lf.predict(STACK, lf.RadialReflectance(r=stored_r), solver=solver)[0].values / entering
            error = float(np.max(np.abs(same / expected - 1)[visible]))
        for what, call, compile_s in (("R(r)", value, seconds), ("Jacobian, 5 parameters", jacobian, jacobian_seconds)):
            calls.append((f"{solver.name}: {what}", lambda call=call, x=x: call(x).block_until_ready(), compile_s, error))
    # in turn: a shared machine changes its pace by half within seconds; the least of the medians is what the code takes
    medians = np.array([[median_ms(call, 300) for _, call, _, _ in calls] for _ in range(PASSES)])
    for (what, _, compile_s, error), ms, most in zip(calls, medians.min(axis=0).tolist(), medians.max(axis=0).tolist(), strict=True):
        rows.append({"what": what, "ms": ms, "ms_slowest_pass": most, "compile_s": compile_s, "largest_error": error})
        shown = "see docs/diffusion-errors.md" if error is None else f"{error:.1e}"
        print(f"| {what} | {ms:.3f} (to {most:.3f}) | {compile_s:.1f} | {shown} | {slow / ms:.0f} |")
    record("two_layer_speed", rows)


if __name__ == "__main__":
    main()
