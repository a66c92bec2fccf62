"""The command line: one thin command for each capability. Heavy modules are imported inside the commands, so that --help stays quick."""

import atexit
import gc
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

_EXAMPLES = ("two-layer", "slab-totals", "spatial-frequency")


class _Commands(click.Group):
    """Turns what goes wrong into one line and an exit code: 2 for wrong input, 1 for everything else."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except KeyboardInterrupt:
            _fail("interrupted", 130)
        except Exception as error:
            from .errors import InputError

            if isinstance(error, InputError):
                _fail(str(error), 2)
            if os.environ.get("LAYERFIT_DEBUG"):
                raise
            _fail(f"internal error, please report it ({type(error).__name__}: {error}); LAYERFIT_DEBUG=1 shows where", 1)


def _fail(message: str, code: int) -> None:
    click.echo(f"layerfit: {' '.join(message.split())}", err=True)
    sys.exit(code)


def _keep_compilations() -> None:
    """Let JAX keep what it compiles in the user's cache folder, so that the next run starts fast. Settings of the user come first."""
    import platformdirs

    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(platformdirs.user_cache_dir("layerfit")) / "jax"))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 80})
@click.version_option(package_name="layerfit")
def main() -> None:
    """Optical properties of layered, turbid samples from light measurements.

    A scene file (TOML) says what the sample is, what was measured and what is
    unknown. Start with: layerfit example two-layer
    """


@main.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option("--solver", metavar="NAME", help="Solver, instead of the one in the file.")
@click.option("--photons", type=click.IntRange(1), metavar="N", help="Photons for each illumination (solver monte-carlo) [default: 1,000,000].")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, metavar="S", help="Seed of random numbers.")
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="FILE.json", help="Where to write the prediction.")
@click.option("--csv", "csv_file", type=click.Path(path_type=Path), metavar="FILE.csv", help="Write it as a data file as well.")
@click.option("--noise", type=click.FloatRange(0, min_open=True), metavar="X", help="Relative noise for --csv: simulated data.")
def predict(scene: Path, solver: str | None, photons: int | None, seed: int, out: Path, csv_file: Path | None, noise: float | None) -> None:
    """Predict what the measurements of SCENE would give."""
    _keep_compilations()
    from .errors import InputError

    if noise is not None and csv_file is None:
        raise InputError("--noise without --csv: noise is only added to simulated data; give --csv FILE.csv")
    from .files import writable_file, write
    from .montecarlo_solver import with_run_settings
    from .predict import predict as run
    from .report.archive import prediction_dict
    from .scene_file import read_scene

    description = read_scene(scene)
    chosen = with_run_settings(description.solver(solver), photons=photons, seed=seed, progress=sys.stderr.isatty())
    names = [m.name for m in description.measurements]
    csv_files = [] if csv_file is None else _simulated_paths(csv_file, names)
    for i, path in enumerate(targets := [out, *csv_files]):
        writable_file(path, keep=[*description.files, *targets[:i]])
    predictions = run(description.stack, [m.geometry for m in description.measurements], solver=chosen)
    result = prediction_dict(predictions[0].solver.name, list(zip(names, predictions, strict=True)))
    write(out, _json(result))
    click.echo(f"prediction: {out}")
    for path in _write_simulated(csv_files, predictions, noise, seed):
        click.echo(f"data: {path}")
    for note in result["notes"]:
        click.echo(f"note: {note}", err=True)


def _simulated_paths(csv_file: Path, names: list[str]) -> list[Path]:
    """One data file a measurement."""
    return [csv_file] if len(names) == 1 else [csv_file.with_name(f"{csv_file.stem}_{name}{csv_file.suffix}") for name in names]


def _write_simulated(paths: list[Path], predictions: list[Any], noise: float | None, seed: int) -> list[Path]:
    """Predictions as data files, with noise drawn if asked for."""
    import numpy as np

    from .files import write
    from .report.archive import data_csv

    random = np.random.default_rng(seed)
    for path, prediction in zip(paths, predictions, strict=False):
        values, sd = prediction.values, None
        if noise is not None:
            sd = noise * np.abs(values)
            values = values + sd * random.standard_normal(values.size)
        write(path, data_csv(prediction.geometry, values, sd))
    return paths


@main.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Folder for fit.json, report.html and figures.")
@click.option("--solver", metavar="NAME", help="Solver, instead of the one in the file.")
@click.option("--starts", type=click.IntRange(1), metavar="N", help="Largest number of starts, instead of the file's (8).")
def fit(scene: Path, out: Path, solver: str | None, starts: int | None) -> None:
    """Fit the free numbers of SCENE to its data."""
    _keep_compilations()
    from .scene_file import read_scene

    description = read_scene(scene)
    problem = description.problem(solver)
    from .files import writable_folder
    from .inference.fit import fit as run
    from .inference.result import Outcome

    writable_folder(out)
    with _progress("fitting") as advance:
        result = run(problem, starts=starts or description.starts, seed=description.seed, on_start=advance)
    from .report.archive import save_fit

    paths = save_fit(result, out, title=f"layerfit: {scene.name}")
    click.echo(result.summary())
    click.echo(f"report: {paths['report.html']}")
    if result.outcome is not Outcome.CONVERGED:
        sys.exit(1)


@main.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Folder for chain, posterior.nc, report.html.")
@click.option("--solver", metavar="NAME", help="Solver, instead of the one in the file.")
@click.option("--sampler", default="emcee", show_default=True, metavar="NAME", help="emcee, nuts, or surrogate (for slow solvers).")
@click.option("--walkers", type=int, metavar="N", help="Walkers [default: 32; nuts: 4 chains].")
@click.option("--steps", type=int, metavar="N", help="Largest number of steps [default: 20,000; nuts: 2,000].")
@click.option("--seed", type=int, default=0, show_default=True, metavar="S", help="Seed of random numbers.")
def sample(scene: Path, out: Path, solver: str | None, sampler: str, walkers: int | None, steps: int | None, seed: int) -> None:
    """Draw from the posterior of SCENE's free numbers.

    Fits first. A run that was interrupted goes on where it ended when the same
    command is given again; a finished one ends at once.
    """
    _keep_compilations()
    from .files import writable_folder
    from .scene_file import read_scene

    description = read_scene(scene)
    problem = description.problem(solver)
    from .inference.chain import FILE, check_settings
    from .inference.fit import fit as run_fit
    from .inference.judgement import SamplingOutcome
    from .inference.sampling import check_request, run_settings
    from .inference.sampling import sample as run

    walkers, steps = check_request(problem, sampler, walkers, steps, seed)
    settings = run_settings(problem, sampler, walkers, seed)
    check_settings(writable_folder(out) / FILE, settings)
    from .report.posterior_archive import finished, save_posterior

    said = finished(out, settings, steps)
    if said is None:
        from .report.archive import save_fit

        with _progress("fitting") as advance:
            fit = run_fit(problem, starts=description.starts, seed=description.seed, on_start=advance)
        save_fit(fit, out, title=f"layerfit: {scene.name}")
        with _progress("sampling", "step") as advance:
            posterior = run(problem, fit, sampler=sampler, walkers=walkers, steps=steps, seed=seed, folder=out, on_step=advance)
        save_posterior(posterior, out, title=f"layerfit: {scene.name}")
        said = posterior.outcome.value, posterior.summary()
    click.echo(said[1])
    click.echo(f"report: {out / 'report.html'}")
    if said[0] != SamplingOutcome.CONVERGED.value:
        sys.exit(1)


class _progress:
    """A progress bar on a terminal, nothing elsewhere."""

    def __init__(self, what: str, unit: str = "start"):
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[note]}"), TimeElapsedColumn()
        console = Console(stderr=True)
        self.bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self.task = self.bar.add_task(what, total=None, note="compiling")
        self.unit = unit

    def __enter__(self) -> Callable[[int, int], None]:
        self.bar.start()
        return lambda done, total: self.bar.update(self.task, completed=done, total=total, note=f"{self.unit} {done} of at most {total}")

    def __exit__(self, *_: object) -> None:
        self.bar.stop()


@main.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option("--solver", metavar="NAME", help="Solver to judge, instead of the one in the file.")
@click.option("--photons", type=click.IntRange(1), metavar="N", help="Photons for each illumination [default: 1,000,000].")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, metavar="S", help="Seed of random numbers.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Folder for table and figure (default: NAME-validation beside SCENE).")
def validate(scene: Path, solver: str | None, photons: int | None, seed: int, out: Path | None) -> None:
    """Hold the solver of SCENE against the Monte Carlo.

    Ends with 1 where they differ by more than the solver's stated error.
    """
    _keep_compilations()
    from .files import writable_folder
    from .montecarlo_solver import PHOTONS, MonteCarlo
    from .scene_file import read_scene
    from .validation import Verdict, check
    from .validation import validate as run

    description = read_scene(scene)
    chosen, geometries = description.solver(solver), [m.geometry for m in description.measurements]
    photons = PHOTONS if photons is None else photons
    MonteCarlo(photons, seed)  # refused before a folder is made
    check(description.stack, geometries, chosen)
    folder = writable_folder(scene.parent / f"{scene.stem}-validation" if out is None else out)
    result = run(
        description.stack,
        geometries,
        solver=chosen,
        photons=photons,
        seed=seed,
        names=[m.name for m in description.measurements],
        progress=sys.stderr.isatty(),
    )
    paths = result.save(folder)
    click.echo(result.summary())
    click.echo(f"figure: {paths['validation.svg']}")
    if result.verdict in (Verdict.DISAGREE, Verdict.OVERSTATED):
        sys.exit(1)


@main.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option("--tolerance", type=click.FloatRange(0, min_open=True), metavar="X", help="Relative error that auto may leave [default: 0.01].")
@click.option("--photons", type=click.IntRange(1), metavar="N", help="Take a Monte Carlo of so many photons as reference.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, metavar="S", help="Seed of random numbers.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Folder for table and figure (default: NAME-comparison beside SCENE).")
def compare(scene: Path, tolerance: float | None, photons: int | None, seed: int, out: Path | None) -> None:
    """Run every solver on SCENE: time, error, and which one auto takes."""
    _keep_compilations()
    from .comparison import compare as run
    from .files import writable_folder
    from .scene_file import read_scene

    description = read_scene(scene)
    folder = writable_folder(scene.parent / f"{scene.stem}-comparison" if out is None else out)
    geometries = [m.geometry for m in description.measurements]
    result = run(description.stack, geometries, tolerance=tolerance, photons=photons, seed=seed, progress=sys.stderr.isatty())
    paths = result.save(folder)
    click.echo(result.summary())
    click.echo(f"figure: {paths['comparison.svg']}")


@main.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option("--solver", metavar="NAME", help="Solver, instead of the one in the file.")
@click.option("--choose", type=click.IntRange(1), default=6, show_default=True, metavar="K", help="How many of the best values to name.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Folder for table and figure (default: NAME-identify beside SCENE).")
def identify(scene: Path, solver: str | None, choose: int, out: Path | None) -> None:
    """Say what the measurements of SCENE could tell.

    Needs no data: x and noise of each measurement, and what is free.
    """
    _keep_compilations()
    from .files import writable_folder
    from .scene_file import read_scene

    description = read_scene(scene)
    result = description.identify(solver, choose)
    paths = result.save(writable_folder(scene.parent / f"{scene.stem}-identify" if out is None else out))
    click.echo(result.summary())
    click.echo(f"figure: {paths['identify.svg']}")


@main.command("map")
@click.argument("scene", type=click.Path(path_type=Path))
@click.option("--data", type=click.Path(path_type=Path), required=True, metavar="CUBE", help="Zarr store or netCDF file with named dimensions.")
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="MAPS.zarr", help="Zarr store for the maps.")
@click.option("--solver", metavar="NAME", help="Solver, instead of the one in the file.")
@click.option("--starts", type=click.IntRange(1), default=5, show_default=True, metavar="N", help="Starts of each pixel.")
@click.option("--block", type=click.IntRange(1), default=4096, show_default=True, metavar="N", help="Pixels fitted at a time.")
@click.option("--saturated", type=float, metavar="X", help="Values from X on are no measurements.")
@click.option("--scheduler", metavar="ADDRESS", help="Scheduler of dask, whose workers fit.")
def map_command(
    scene: Path, data: Path, out: Path, solver: str | None, starts: int, block: int, saturated: float | None, scheduler: str | None
) -> None:
    """Fit SCENE to every pixel of a cube.

    The measurements of SCENE are those of one pixel; values of their own they
    need none. A run that was interrupted goes on where it ended when the same
    command is given again.
    """
    _keep_compilations()
    from .mapping import run_map
    from .scene_file import read_scene

    description = read_scene(scene)
    with _progress("fitting", "tile") as advance:
        options = {"solver": solver, "starts": starts, "block": block, "saturated": saturated, "scheduler": scheduler}
        maps, problem = run_map(description, data, out, on_tiles=advance, **options)
    from .report.map_table import map_text, save_pictures

    click.echo(map_text(maps, problem))
    click.echo(f"maps: {out}")
    for path in save_pictures(maps, out):
        click.echo(f"figure: {path}")


@main.command()
@click.argument("name", type=click.Choice(_EXAMPLES))
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Folder to make (default: the example's name).")
def example(name: str, out: Path | None) -> None:
    """Write a ready scene with data into a folder."""
    from importlib.resources import files

    from .errors import InputError
    from .files import writable_folder, write

    folder = writable_folder(out or Path(name))
    sources = sorted(files("layerfit").joinpath("examples", name).iterdir(), key=lambda f: f.name)
    for path, source in [(folder / source.name, source) for source in sources]:
        if path.exists() and path.read_bytes() != source.read_bytes():
            raise InputError(f"{path} exists and is another file; allowed is --out with a new folder")
    for source in sources:
        write(folder / source.name, source.read_bytes())
    click.echo(f"scene: {folder / 'scene.toml'}")
    click.echo(f"next: layerfit fit {folder / 'scene.toml'} --out {folder / 'result'}")


def _json(content: dict[str, Any]) -> str:
    import json

    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def run() -> None:
    """The program. Imports and tracing make millions of objects that live to its end: searching them for garbage takes an eighth of a short run."""
    gc.set_threshold(100_000)
    atexit.register(gc.freeze)
    main()


if __name__ == "__main__":
    run()
