"""Speed of the Monte Carlo beside its error: ``python benchmarks/montecarlo_speed.py [--repeats 5]``.

Scenes and bars: MCML 1.2.2, unmodified, -O2, one thread: 19.7 s a million photons for two-layer skin (epidermis 0.03 mm over a half space
of dermis, Donner and Jensen 2005, table 3, red), 278 s for skin over fat. Which dermis that was is not said; both of the table are timed,
and the slower one (upper dermis) is held against the bar. Compilation, loading of the cached engine and running are timed apart. The error
is that of R a million photons, with the threshold of absorption as it is by default and at 1e-4 as in MCML, where it costs more time.
Stores tests/reference/montecarlo/speed.json.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from montecarlo_cases import RESULTS, ROOT, fail_on, provenance

import layerfit.montecarlo as mc

SCENES = {
    "skin (upper dermis)": (
        mc.Medium([1.4, 1.34], [2.1, 0.16], [48.0, 32.0], [0.0, 0.25], [0.03, math.inf]),
        200_000,
        19.7,
    ),
    "skin (bloody dermis)": (
        mc.Medium([1.4, 1.4], [2.1, 0.085], [48.0, 4.5], [0.0, 0.8], [0.03, math.inf]),
        200_000,
        19.7,
    ),
    "skin over fat": (mc.Medium([1.4, 1.44], [0.02, 0.005], [20.0, 12.0], 0.9, [1.5, math.inf]), 40_000, 278.0),
}
TALLIES = mc.Tallies(rings=np.linspace(0.0, 10.0, 101), theta=np.linspace(0.0, 90.0, 31))

START = """
import time
begin = time.perf_counter()
import layerfit.montecarlo as mc
imported = time.perf_counter()
result = mc.simulate(mc.Medium([1.4], [0.1], [1.0], 0.5, [1.0]), photons=100, threads=1)
print(imported - begin, result.compile_seconds)
"""


def start(cache: str) -> tuple[float, float]:
    """Seconds for the import, and for compiling or loading, in a new process."""
    environment = os.environ | {"NUMBA_CACHE_DIR": cache, "PYTHONPATH": str(ROOT / "src")}
    out = subprocess.run([sys.executable, "-c", START], env=environment, capture_output=True, text=True, check=True).stdout
    first, second = out.split()
    return float(first), float(second)


def timed(medium: mc.Medium, photons: int, repeats: int, **settings: Any) -> tuple[list[float], mc.Result]:
    """Wall seconds of each of some runs, and the last result."""
    seconds, result = [], None
    for seed in range(repeats):
        begin = time.perf_counter()
        result = mc.simulate(medium, None, TALLIES, photons=photons, seed=seed, **settings)
        seconds.append(time.perf_counter() - begin)
    assert result is not None
    return seconds, result


def scene(medium: mc.Medium, photons: int, published: float, repeats: int) -> dict[str, Any]:
    """Times of one scene: one thread, two threads, and with MCML's way of weighting."""
    timed(medium, 1000, 1, threads=1)
    # in turn, so that a change of the machine's pace meets both alike
    pairs = [(timed(medium, photons, 1, threads=1)[0][0], timed(medium, photons, 1, threads=2)[0][0]) for _ in range(repeats)]
    one, two = (np.array(column) for column in zip(*pairs, strict=True))
    _, result = timed(medium, photons, 1, threads=1)
    slow, weighted = timed(medium, photons, repeats, threads=1, analogue_below=1e-4)
    per_million = 1e6 / photons
    scale = math.sqrt(photons / 1e6)
    return {
        "photons": photons,
        "seconds_per_million": float(np.median(one)) * per_million,
        "least": float(one.min()) * per_million,
        "most": float(one.max()) * per_million,
        "photons_per_second": photons / float(np.median(one)),
        "published_photons_per_second": 1e6 / published,
        "times_published": published / (float(np.median(one)) * per_million),
        "two_threads": float(np.median(one / two)),
        "R_error_per_million": float(result.standard_error("R")) * scale,
        "analogue_below_1e-4": {
            "seconds_per_million": float(np.median(slow)) * per_million,
            "times_published": published / (float(np.median(slow)) * per_million),
            "R_error_per_million": float(weighted.standard_error("R")) * scale,
        },
    }


def main() -> None:
    """Time, store, print, and fail below the published speed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--out", type=Path, default=RESULTS / "speed.json")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as cache:
        imported, compiled = start(cache)
        _, loaded = start(cache)
    table: dict[str, Any] = {"start": {"import_seconds": imported, "compile_seconds": compiled, "load_seconds": loaded}}
    print(json.dumps(table["start"]))
    for name, (medium, photons, published) in SCENES.items():
        table[name] = scene(medium, photons, published, options.repeats)
        print(name, json.dumps(table[name]), flush=True)
    header = provenance("python benchmarks/montecarlo_speed.py", 0, 0) | {
        "processor": platform.processor() or platform.machine(),
        "processors": os.cpu_count(),
    }
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps({"header": header, "results": table}, indent=1) + "\n")
    slow = [name for name in SCENES if table[name]["times_published"] < 1.0]
    fail_on(None if not slow else f"slower than published MCML: {', '.join(slow)}")
    print("two threads against one:", [round(table[name]["two_threads"], 2) for name in SCENES], "(asked 1.8)")


if __name__ == "__main__":
    main()
