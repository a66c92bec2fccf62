"""Wall time of commands and imports, each in a fresh process, the compilation cache empty at first.

python benchmarks/command_time.py
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from record import record


def seconds(command, **environment):
    began = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True, env=os.environ | environment)
    return time.perf_counter() - began


def python(code):
    return [sys.executable, "-c", code]


def main():
    layerfit = [sys.executable, "-m", "layerfit.cli"]
    rows = {}
    with tempfile.TemporaryDirectory() as folder:
        cache = {"XDG_CACHE_HOME": str(Path(folder) / "cache")}
        scene = Path(folder) / "two-layer"
        seconds([*layerfit, "example", "two-layer", "--out", str(scene)])
        run = [*layerfit, "fit", str(scene / "scene.toml"), "--out", str(scene / "result")]
        python_import = "import jax", "import jax, equinox, optimistix", "import layerfit"
        for code in python_import:
            rows[code] = min(seconds(python(code)) for _ in range(3))
        rows["layerfit --help"] = min(seconds([*layerfit, "--help"]) for _ in range(3))
        rows["layerfit fit, first"] = seconds(run, **cache)
        rows["layerfit fit, again"] = min(seconds(run, **cache) for _ in range(3))
    print("| what | seconds |\n|---|---|")
    for what, value in rows.items():
        print(f"| {what} | {value:.2f} |")
    record("command_time", rows)


if __name__ == "__main__":
    main()
