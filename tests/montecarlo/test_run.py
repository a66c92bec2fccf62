"""Runs: the same numbers whatever the threads or the pieces, stores, stops, interruption, and what is imported."""

import ast
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import layerfit.montecarlo as mc
from layerfit.montecarlo import store

PACKAGE = Path(mc.__file__).parent
MEDIUM = mc.Medium(
    [1.4, 1.34, 1.5],
    [0.1, 0.0, 0.3],
    [5.0, 0.0, 10.0],
    [0.8, 0.0, 0.3],
    [0.2, 0.1, 1.0],
    roughness=[0.2, 0.0, 0.1, 0.3],
)
TALLIES = mc.Tallies(
    rings=[0.0, 0.2, 1.0], k=[0.0, 1.0], theta=[0, 45, 90], phi=[0, 90, 180], fibres=[mc.CollectingFibre(0.3, 0.1, 0.5)],
    na=0.9, derivatives=True,
)  # fmt: skip
LIGHT = mc.Fibre(0.1, 0.4)


def run(photons: float = 20_000, seed: int = 1, threads: int = 1, **settings) -> mc.Result:
    return mc.simulate(MEDIUM, LIGHT, TALLIES, photons=photons, seed=seed, threads=threads, **settings)


def test_threads_do_not_change_a_bit():
    one, two, three = (run(threads=threads) for threads in (1, 2, 3))
    assert np.array_equal(one.sums, two.sums)
    assert np.array_equal(one.sums, three.sums)
    assert one.batches == 100
    assert one.photons == 20_000
    other = run(seed=2)
    assert not np.array_equal(one.sums, other.sums)
    # batches differ from each other, so that their scatter is an error
    assert len({batch.tobytes() for batch in one.sums}) == 100


def test_pieces_do_not_change_a_bit(tmp_path: Path):
    whole = run(40_000, photons_per_batch=200)
    path = tmp_path / "run.npz"
    first = run(20_000, photons_per_batch=200, store=path)
    second = run(40_000, threads=2, store=path)
    assert np.array_equal(first.sums, whole.sums[:100])
    assert np.array_equal(second.sums, whole.sums)
    for name in whole.names:
        assert np.array_equal(second.value(name), whole.value(name))
        assert np.array_equal(second.standard_error(name), whole.standard_error(name))
    # asking again for as much or less returns what is there
    assert np.array_equal(run(10_000, store=path).sums, whole.sums)
    assert [p.name for p in tmp_path.iterdir()] == ["run.npz"]


def test_default_batches_can_be_continued(tmp_path: Path):
    path = tmp_path / "run.npz"
    clear = mc.Medium([1.5], [0.1], [0.0], None, [1.0])
    mc.simulate(clear, photons=1e6, threads=1, store=path)
    assert np.array_equal(mc.simulate(clear, photons=1.2e6, threads=1, store=path).sums, mc.simulate(clear, photons=1.2e6, threads=2).sums)


def test_a_stored_run_is_read_back_exactly(tmp_path: Path):
    path = tmp_path / "run.npz"
    phase = mc.TabulatedPhase([-1.0, 0.1, 1.0], [0.1, 0.2, 0.7])
    for number, source in enumerate((mc.Pencil(0.7), mc.Disk(0.1), mc.Gaussian(0.3, 0.9), LIGHT, mc.Lambertian(0.1, (0.0, 30.0)))):
        medium = mc.Medium([1.4, 1.3], [0.1, 0.2], [1.0, 1 / 3], phase=[phase, 0.5], thickness=[0.1, np.inf], n_above=1.33)
        written = mc.simulate(medium, source, TALLIES, photons=1000, seed=number, threads=1, store=path)
        read = mc.load(path)
        assert (read.medium, read.source, read.tallies) == (medium, source, TALLIES)
        assert np.array_equal(read.sums, written.sums)
        assert read.seed == number
        assert np.array_equal(read.value("R_rings"), written.value("R_rings"))
        path.unlink()


def test_a_store_of_another_run_is_refused(tmp_path: Path):
    path = tmp_path / "run.npz"
    run(1000, store=path)
    before = path.read_bytes()
    other = mc.Medium([1.4], [0.1], [5.0], 0.8, [0.2])
    with pytest.raises(ValueError, match=r"^store: .*another scene.*medium\.sigma_s"):
        mc.simulate(other, LIGHT, TALLIES, photons=1000, seed=1, store=path)
    with pytest.raises(ValueError, match=r"^store: .*source\.na"):
        mc.simulate(MEDIUM, mc.Fibre(0.1, 0.5), TALLIES, photons=1000, seed=1, store=path)
    with pytest.raises(ValueError, match=r"^store: .*tallies\.derivatives"):
        mc.simulate(MEDIUM, LIGHT, mc.Tallies(), photons=1000, seed=1, store=path)
    with pytest.raises(ValueError, match=r"^store: .*seed 1.*seed 2"):
        run(1000, seed=2, store=path)
    with pytest.raises(ValueError, match=r"^store: .*analogue_below"):
        run(1000, analogue_below=0.5, store=path)
    assert path.read_bytes() == before
    header, _ = store.read(path)
    assert header["seed"] == 1
    assert header["photons"] == 1000
    assert "version" in header
    assert len(header["scene_hash"]) == 64
    path.write_bytes(before[: len(before) // 2])
    with pytest.raises(ValueError, match=r"^store: .*allowed a file that simulate wrote"):
        run(1000, store=path)
    path.write_bytes(b"")
    with pytest.raises(ValueError, match=r"^store: .*allowed a file that simulate wrote"):
        mc.load(path)


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "run.npz"
    run(1000, store=path)
    before = path.read_bytes()

    def broken(*_: object, **__: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(np, "savez", broken)
    with pytest.raises(OSError, match="disk full"):
        run(2000, store=path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["run.npz"]


def test_stops_at_a_relative_error():
    one, two = (run(1e6, threads=threads, photons_per_batch=500, relative_error={"R": 0.02}) for threads in (1, 2))
    assert one.outcome == "relative error reached"
    assert float(one.estimate("R").relative_error) <= 0.02
    assert 20 <= one.batches < 1000
    assert np.array_equal(one.sums, two.sums)
    assert run(2000, relative_error={"R": 1e-6}).outcome == "done"


def test_stops_at_the_time_limit():
    start = time.perf_counter()
    result = run(1e9, photons_per_batch=1000, max_seconds=1.0)
    assert result.outcome == "time limit"
    assert 0.9 <= time.perf_counter() - start <= 10.0
    assert np.array_equal(result.sums[:5], run(5000, photons_per_batch=1000).sums)


SCRIPT = """
import math, signal, sys
import layerfit.montecarlo as mc
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs begin with it ignored
medium = mc.Medium([1.4], [0.01], [10.0], 0.8, [math.inf])
mc.simulate(medium, photons=200, threads=1)  # compiled
print("started", flush=True)
result = mc.simulate(medium, photons=1e9, photons_per_batch=1000, threads=2, seed=5, store=sys.argv[1])
print(result.outcome, result.batches, flush=True)
"""


def test_interruption_keeps_whole_batches(tmp_path: Path):
    path = tmp_path / "run.npz"
    with subprocess.Popen([sys.executable, "-c", SCRIPT, path], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "started\n"
            time.sleep(2.0)
            os.kill(process.pid, signal.SIGINT)
            outcome, count = process.communicate(timeout=60)[0].split()
        finally:
            process.kill()
    assert outcome == "interrupted"
    assert process.returncode == 0
    kept = mc.load(path)
    assert kept.batches == int(count) >= 2
    again = mc.simulate(kept.medium, photons=2000, photons_per_batch=1000, seed=5, threads=1)
    assert np.array_equal(kept.sums[:2], again.sums)


def test_progress_bar_is_shown(capsys: pytest.CaptureFixture[str]):
    run(2000, progress=True)
    shown = capsys.readouterr()
    assert "100/100" in shown.err
    assert shown.out == ""


def test_results_cannot_be_changed():
    result = run(1000)
    with pytest.raises(ValueError, match="read-only"):
        result.sums[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        result.value("R_rings")[0] = 1.0
    with pytest.raises(AttributeError):
        result.seed = 2  # pyright: ignore[reportAttributeAccessIssue]
    assert "1000 photons in 100 batches, seed 1: done" in str(result)


def test_importing_starts_nothing_heavy():
    code = "import sys, layerfit.montecarlo; print([m for m in ('numba', 'jax', 'matplotlib', 'scipy', 'rich') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"


def test_nothing_is_shared_with_the_accused():
    allowed = {"numpy", "numba", "scipy", "rich"} | set(sys.stdlib_module_names)
    for path in PACKAGE.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                assert all(alias.name.split(".")[0] in allowed for alias in node.names), path
            elif isinstance(node, ast.ImportFrom):
                # a single dot stays in this package
                assert node.level == 1 or (node.level == 0 and str(node.module).split(".")[0] in allowed), path


def test_the_digest_covers_all_compiled_files():
    from layerfit.montecarlo import engine

    compiled = {path.stem for path in PACKAGE.glob("*.py") if "@compiled" in path.read_text()}
    assert compiled <= set(engine._FILES)


def test_descriptions_are_plain_json():
    scene = store.describe(MEDIUM, LIGHT, TALLIES)
    assert json.loads(json.dumps(scene)) == scene
    assert store.scene_hash(scene) != store.scene_hash(store.describe(MEDIUM, mc.Fibre(0.1, 0.41), TALLIES))
