"""Maps: a fit for every pixel of a camera's picture. Speed and its parts, against `lf.fit`, against the truth, with workers, and after accidents.

python benchmarks/maps.py [speed|alone|phantom|ordinates|skin|workers|large|accidents ...]   (all if left out; half an hour)

Writes benchmarks/results/maps.json, of which other parts stay as they are, and docs/maps.png.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from phantom import FREE, FX, NOISE, SATURATED, STACK, cube, problem, truth
from record import record

import layerfit as lf

HERE = Path(__file__).parent
LIMITS = (0.0, SATURATED)
WAVELENGTHS = tuple(np.linspace(520.0, 800.0, 8))


def speed() -> dict:
    """256 x 256 pixels, 5 frequencies, 3 numbers, one process, two cores."""
    from layerfit.inference import many

    stated = problem()
    image = cube(truth(256), stated).isel(wavelength=0)
    began = time.perf_counter()
    lf.fit_map(stated, image.isel(y=slice(0, 16)), limits=LIMITS)
    first = time.perf_counter() - began
    began = time.perf_counter()
    lf.fit_map(stated, image.isel(y=slice(0, 16)), limits=LIMITS)
    compiled = first - (time.perf_counter() - began)
    parts = {"covariance_s": 0.0}
    whole = many._assemble

    def timed(*arguments):
        start = time.perf_counter()
        result = whole(*arguments)
        parts["covariance_s"] += time.perf_counter() - start
        return result

    many._assemble = timed
    began = time.perf_counter()
    maps = lf.fit_map(stated, image, limits=LIMITS)
    seconds = time.perf_counter() - began
    covariance = parts["covariance_s"] / len(os.sched_getaffinity(0))  # tiles run side by side, one a core
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        lf.fit_map(stated, image, limits=LIMITS, store=Path(folder) / "maps.zarr")
        stored = time.perf_counter() - began
    many._assemble = whole
    return {
        "what": "speed",
        "pixels": int(maps.outcome.size),
        "converged": int((maps.outcome == 0).sum()),
        "pixels_per_second": maps.outcome.size / seconds,
        "all_s": seconds + compiled,
        "compile_s": compiled,
        "solve_s": seconds - covariance,
        "covariance_s": covariance,
        "store_s": stored - seconds,
    }


def alone() -> dict:
    """The same pixels one by one through `lf.fit`."""
    stated = problem()
    image = cube(truth(64), stated).isel(wavelength=0)
    maps = lf.fit_map(stated, image, limits=LIMITS)
    picked = np.flatnonzero(np.asarray(maps.outcome).ravel() == 0)[::8]
    values = image.values.reshape(-1, len(FX))
    x = np.stack([maps[name].values.ravel() for name in stated.names], axis=1)
    chi2 = maps.chi2.values.ravel()
    gaps, apart, errors = [], [], []
    for i in picked:
        data = lf.Dataset(lf.SpatialFrequency(fx=FX), values[i], noise=lf.Noise(NOISE))
        one = lf.fit(lf.Problem(STACK, data, free=FREE, solver=lf.LayeredDiffusion()))
        gaps.append(chi2[i] - one.chi2)
        apart.append(np.max(np.abs(x[i] / one.x - 1)))
        stderr = np.array([np.nan if e.stderr is None else e.stderr for e in one.parameters.values()])
        errors.append(np.nanmax(np.abs(x[i] - one.x) / stderr))
    gaps, apart, errors = np.array(gaps), np.array(apart), np.array(errors)
    same = np.abs(gaps) <= 1e-6
    return {
        "what": "alone",
        "pixels": len(picked),
        "worse_by_1e-6": int(np.sum(gaps > 1e-6)),
        "better_by_1e-6": int(np.sum(gaps < -1e-6)),
        "worst_gap": float(np.max(gaps)),
        "largest_relative_difference": float(np.max(apart[same])),
        "differ_by_more_than_1e-6": int(np.sum(apart[same] > 1e-6)),
        "largest_difference_in_standard_errors": float(np.nanmax(errors[same])),
    }


def phantom() -> list[dict]:
    """Truth against map over all good pixels, 64 x 64 at 8 wavelengths; and whether the spoilt ones are named."""
    stated, known = problem(), truth(96, WAVELENGTHS)
    image = cube(known, stated, seed=1)
    maps = lf.fit_map(stated, image, limits=LIMITS, correlations=True)
    figure = lf.plot_map(maps, at={"wavelength": 3})
    figure.savefig(HERE.parent / "docs" / "maps.png", dpi=100)
    dead, saturated = np.all(image.values == 0, axis=-1), image.values[..., 0] >= SATURATED
    outcome = np.asarray(maps.outcome)
    rows = [
        {
            "what": "spoilt pixels",
            "pixels": outcome.size,
            "dead": int(dead.sum()),
            "dead_named": int(np.sum(outcome[dead] == 5)),
            "saturated": int(saturated.sum()),
            "saturated_named": int(np.sum(outcome[saturated & ~dead] == 6)),
            "others_left_out": int(np.sum(outcome[~dead & ~saturated] > 2)),
            "converged": int(np.sum(outcome == 0)),
        }
    ]
    for name in stated.names:
        error, sd = (maps[name] - known[name]).values, maps[f"{name}.stderr"].values
        good = (outcome == 0) & np.isfinite(sd)
        clear = good & (maps[f"{name}.determined"].values == 1)
        rows.append(
            {
                "what": f"coverage of {name}",
                "good": int(good.sum()),
                "at_bound": int(np.sum(maps[f"{name}.at_bound"].values == 1)),
                "within_1_sd": float(np.mean(np.abs(error[good]) <= sd[good])),
                "within_2_sd": float(np.mean(np.abs(error[good]) <= 2 * sd[good])),
                "median_error_in_sd": float(np.median(error[good] / sd[good])),
                "relative_bias_of_median": float(np.median(error[good] / known[name].values[good])),
                "determined": int(clear.sum()),
                "determined_within_1_sd": float(np.mean(np.abs(error[clear]) <= sd[clear])),
            }
        )
    return rows


def _client(workers: int):
    import distributed

    return distributed.Client(n_workers=workers, threads_per_worker=1, memory_limit="2GiB", dashboard_address=None)


def workers() -> list[dict]:
    """Two workers of dask against one, with what they have compiled."""
    stated = problem()
    image = cube(truth(192), stated).isel(wavelength=0)
    rows = []
    for count in (1, 2):
        with _client(count) as client:
            lf.fit_map(stated, image.isel(y=slice(0, 64)), limits=LIMITS, block=1024)  # every worker meets every shape
            began = time.perf_counter()
            maps = lf.fit_map(stated, image, limits=LIMITS, block=1024)
            seconds = time.perf_counter() - began
            memory = max(client.run(_memory).values())
        rows.append({"what": "workers", "workers": count, "seconds": seconds, "pixels_per_second": maps.outcome.size / seconds, "memory_mib": memory})
    rows.append({"what": "workers", "two_against_one": rows[0]["seconds"] / rows[1]["seconds"]})
    return rows


def _memory() -> float:
    """Largest memory of this process so far [MiB]."""
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def large() -> dict:
    """2048 x 2048 pixels that are made as they are asked for, 1 % of them fitted, by two workers, into a store."""
    import dask.array as da
    import xarray as xr

    stated = problem()
    small = cube(truth(64), stated).isel(wavelength=0)
    whole = da.tile(da.from_array(small.values, chunks=(64, 64, 5)), (32, 32, 1))
    image = xr.DataArray(whole, dims=("y", "x", "fx"), coords={"fx": small.fx})
    chosen = xr.DataArray(np.random.default_rng(0).random((2048, 2048)) < 0.01, dims=("y", "x"))
    with tempfile.TemporaryDirectory() as folder, _client(2) as client:
        began = time.perf_counter()
        maps = lf.fit_map(stated, image, mask=chosen, limits=LIMITS, store=Path(folder) / "maps.zarr")
        seconds = time.perf_counter() - began
        fitted = int((maps.outcome == 0).sum())
        memory = max(client.run(_memory).values())
    return {"what": "2048 x 2048", "seconds": seconds, "fitted": fitted, "worker_memory_mib": memory, "own_memory_mib": _memory()}


def ordinates() -> dict:
    """The picture of 256 x 256 pixels by discrete ordinates, through polynomials; and what these change,
    on 12 pixels fitted without from where the map ended."""
    stated = problem(lf.DiscreteOrdinates())
    began = time.perf_counter()
    quick = lf.emulate(stated)
    made = time.perf_counter() - began
    image = cube(truth(256), quick).isel(wavelength=0)
    began = time.perf_counter()
    maps = lf.fit_map(quick, image, limits=LIMITS)
    seconds = time.perf_counter() - began
    picked = np.flatnonzero(np.asarray(maps.outcome).ravel() == 0)[:: maps.outcome.size // 12]
    apart = []
    for i in picked:
        data = lf.Dataset(lf.SpatialFrequency(fx=FX), image.values.reshape(-1, len(FX))[i], noise=lf.Noise(NOISE))
        free = {n: {"min": b[0], "max": b[1], "init": float(maps[n].values.ravel()[i])} for n, b in FREE.items()}
        one = lf.fit(lf.Problem(STACK, data, free=free, solver=lf.DiscreteOrdinates()), starts=1)
        apart.append([abs(float(maps[n].values.ravel()[i]) - e.value) / (e.stderr or np.nan) for n, e in one.parameters.items()])
    return {
        "what": "ordinates",
        "emulator_s": made,
        "emulator_error": quick.model.error,
        "predictions": int(np.prod(quick.model.coefficients[0].shape[:-1])),
        "map_s": seconds,
        "all_minutes": (made + seconds) / 60,
        "converged": int((maps.outcome == 0).sum()),
        "fitted_without": len(apart),
        "largest_change_in_standard_errors": float(np.nanmax(apart)),
        "median_change_in_standard_errors": float(np.nanmedian(apart)),
    }


def skin() -> dict:
    """300 measured spectra of skin as a picture of 100 people x 3 repeats: discrete ordinates at 46 wavelengths, errors of 1.2 %, independent."""
    import nist_skin as nist
    import xarray as xr

    wavelength, values = nist.spectra(nist.ROOT.parent / "shared" / "data" / "nist-skin")
    coarse = np.flatnonzero((wavelength >= 450) & (wavelength <= 1000))[:: nist.STEP]
    image = xr.DataArray(
        values[..., coarse], dims=("person", "repeat", "wavelength"), coords={"wavelength": ("wavelength", wavelength[coarse], {"units": "nm"})}
    )
    data = lf.Dataset(lf.Spectrum(wavelength[coarse], nist.GEOMETRY), values[0, 0, coarse], noise=lf.Noise(relative=nist.RELATIVE))
    stated = lf.Problem(nist.SKIN, data, free=nist.FREE, ties=nist.TIES, solver=lf.DiscreteOrdinates(streams=nist.STREAMS))
    began = time.perf_counter()
    maps = lf.fit_map(stated, image, starts=2)
    seconds = time.perf_counter() - began
    return {
        "what": "300 spectra of skin",
        "seconds": seconds,
        "converged": int((maps.outcome == 0).sum()),
        "median_reduced_chi2": float(np.median(maps.chi2) / maps.attrs["degrees_of_freedom"]),
        "median_melanin": float(np.median(maps["epidermis.melanin"])),
        "median_blood": float(np.median(maps["dermis.blood"])),
    }


CLIENT = """
import sys
sys.path.insert(0, {here!r})
from phantom import cube, problem, truth, SATURATED
import layerfit as lf
if __name__ == "__main__":
    stated = problem()
    image = cube(truth(96), stated).isel(wavelength=0)
    workers = int(sys.argv[2])
    if workers:
        import distributed
        client = distributed.Client(n_workers=workers, threads_per_worker=1, dashboard_address=None)
        print("pids", *client.run(__import__("os").getpid).values(), flush=True)
    def said(done, total):
        print("tiles", done, total, flush=True)
    lf.fit_map(stated, image, limits=(0.0, SATURATED), block=512, store=sys.argv[1], on_tiles=said)
    print("end", flush=True)
"""


def accidents() -> list[dict]:
    """SIGKILL of a worker, of the client, and a full disk: what is then in the store, against an undisturbed run."""
    stated = problem()
    image = cube(truth(96), stated).isel(wavelength=0)
    calm = lf.fit_map(stated, image, limits=LIMITS, block=512)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "client.py"
        script.write_text(CLIENT.format(here=str(HERE)))

        def run(store, count, until=None, victim=None):
            """Starts a client and kills somebody after some tiles; returns numbers of tiles said to be done and to do, and whether it ended well."""
            process = subprocess.Popen(
                [sys.executable, str(script), str(store), str(count)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
            )
            pids, done, total, killed = [], 0, 0, False
            for line in process.stdout:
                words = line.split()
                if words[0] == "pids":
                    pids = [int(w) for w in words[1:]]
                if words[0] == "tiles":
                    done, total = int(words[1]), int(words[2])
                    if until is not None and done >= until and not killed:
                        killed = True
                        os.kill(pids[0] if victim == "worker" else process.pid, signal.SIGKILL)
            return done, total, process.wait()

        def same(store):
            found = lf.open_map(store).compute()
            return bool(np.array_equal(found.outcome, calm.outcome)) and all(
                bool(np.allclose(found[name], calm[name], rtol=1e-6, atol=0, equal_nan=True)) for name in stated.names
            )

        store = Path(folder) / "worker.zarr"
        done, total, code = run(store, 2, until=3, victim="worker")
        rows.append({"what": "SIGKILL of a worker", "tiles_done": done, "tiles": total, "exit": code, "same_as_calm": same(store)})
        store = Path(folder) / "client.zarr"
        for until in (2, 5, 9):
            run(store, 0, until=until, victim="client")
            lf.open_map(store).compute()  # readable
        done, total, code = run(store, 0)
        rows.append({"what": "three SIGKILLs of the client", "tiles_left": total, "exit": code, "same_as_calm": same(store)})
    rows.append(_full_disk(stated, image, calm))
    return rows


def _full_disk(stated, image, calm) -> dict:
    """On a file system of half a MiB, where one can be made; then the store is moved to a larger one and the run goes on."""
    mount = Path(tempfile.mkdtemp())
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(mount)], capture_output=True).returncode:
        return {"what": "full disk", "said": "no file system could be mounted here"}
    try:
        try:
            lf.fit_map(stated, image, limits=LIMITS, block=512, store=mount / "maps.zarr")
            said = "no error"
        except lf.InputError as error:
            said = str(error)
        there = lf.open_map(mount / "maps.zarr").compute()
        kept = int((there.outcome >= 0).sum())
        subprocess.run(["mount", "-o", "remount,size=64m", str(mount)], check=True)
        done = lf.fit_map(stated, image, limits=LIMITS, block=512, store=mount / "maps.zarr").compute()
        whole = all(bool(np.allclose(done[name], calm[name], rtol=1e-6, atol=0, equal_nan=True)) for name in stated.names)
    finally:
        subprocess.run(["umount", str(mount)])
        shutil.rmtree(mount, ignore_errors=True)
    return {"what": "full disk", "said": said.replace(str(mount), "..."), "pixels_kept": kept, "same_as_calm": whole}


def main():
    parts = {f.__name__: f for f in (speed, alone, phantom, ordinates, skin, workers, large, accidents)}
    chosen = sys.argv[1:] or list(parts)
    known = HERE / "results" / "maps.json"
    rows = json.loads(known.read_text()) if known.exists() else []
    for name in chosen:
        found = parts[name]()
        new = [{"part": name} | row for row in (found if isinstance(found, list) else [found])]
        print(*new, sep="\n", flush=True)
        rows = [row for row in rows if row["part"] != name] + new
        record("maps", sorted(rows, key=lambda row: list(parts).index(row["part"])))


if __name__ == "__main__":
    main()
