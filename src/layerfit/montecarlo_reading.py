"""How each measurement is read off a Monte Carlo run: its light, its tallies, and what becomes of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from . import montecarlo as mc
from .errors import InputError
from .measurement.geometry import Angular, Geometry, Radial, SpatialFrequency, Total, TotalReflectance
from .measurement.source import Disk, Gaussian, Pencil
from .montecarlo_angles import azimuth_bins, polar_bins

POINT_RADIUS = 0.1  # of the larger fibre that stands for a point, relative to the distance (or to the diameter of a source, if larger)


@dataclass(frozen=True)
class Reading:
    """One measurement in the terms of the Monte Carlo.

    light : where the light comes from. tally : name of the tally read. rings, k, fibres : what it needs to be counted at, one of them at most.
    na : aperture of rings. theta, phi : edges of bins of direction [deg]. weights, shape (values, places) : the values are weights @ tally.
    specular : the first-surface reflection is added.
    one : what one photon of full weight adds to each value, times the number of photons.
    """

    light: Any
    tally: str
    one: np.ndarray
    rings: tuple[tuple[float, float], ...] = ()
    k: tuple[float, ...] = ()
    fibres: tuple[mc.CollectingFibre, ...] = ()
    na: float | None = None
    theta: tuple[float, ...] = ()
    phi: tuple[float, ...] = ()
    weights: np.ndarray | None = field(default=None, compare=False)
    specular: bool = False

    @property
    def shares_aperture(self) -> bool:
        """Whether it is counted with the one aperture that a run has for its rings and frequencies."""
        return bool(self.rings or self.k)

    def samples(self, result: mc.Result) -> np.ndarray:
        """The values in each batch, shape (batches, values)."""
        found = result.estimate(self.tally).samples
        assert found is not None
        found = found.reshape(result.batches, -1)
        for wanted, counted in ((self.rings, result.tallies.rings), (self.k, result.tallies.k), (self.fibres, result.tallies.fibres)):
            if wanted:
                found = found[:, [counted.index(place) for place in wanted]]  # pyright: ignore[reportArgumentType]
        if self.theta:
            found = self._without_beam(found, result)
        if self.specular:
            reflected = result.estimate("R_specular").samples
            assert reflected is not None
            found = found + reflected[:, None]
        return found if self.weights is None else found @ self.weights.T

    def _without_beam(self, found: np.ndarray, result: mc.Result) -> np.ndarray:
        """Radiances without the light that was never scattered, where it leaves as a beam: all faces smooth, and one direction of incidence."""
        above, below = result.layout.index_outside
        if not isinstance(self.light, mc.Pencil) or any(result.medium.roughness):
            return found
        s = (1.0 - self.light.cosine**2) * (1.0 if self.tally.startswith("R") else (above / below) ** 2)
        edges = np.sin(np.radians(self.theta)) ** 2
        place = int(np.searchsorted(edges, s, side="right")) - 1
        if place >= edges.size - 1:
            return found  # reflected as a whole at the lowest face
        beam = result.estimate(f"{self.tally[0]}_unscattered").samples
        assert beam is not None
        first = place * (len(self.phi) - 1)  # the beam travels in azimuth 0
        beam = beam / ((edges[place + 1] - edges[place]) * np.radians(self.phi[1] - self.phi[0]))
        rest = found[:, first] - beam
        found = found.copy()
        found[:, first] = np.where(np.abs(rest) > 1e-12 * beam, rest, 0.0)  # nothing but the beam is exactly nothing
        return found

    def estimate(self, result: mc.Result) -> mc.Estimate:
        """Means with standard errors. Where nothing was counted the error is what one photon would have added: none seen is not none there."""
        samples = self.samples(result)
        error = samples.std(axis=0, ddof=1) / np.sqrt(result.batches)
        quantum = self.one / result.photons
        impossible = self.tally.startswith("T") and result.medium.half_space
        if not impossible:
            error = np.where(np.any(samples != 0.0, axis=0), error, quantum)
        return mc.Estimate(samples.mean(axis=0), error, result.batches - 1, samples, None if impossible or self.k else quantum)


def reading(geometry: Geometry, lobe: float = np.inf) -> Reading:
    """How a measurement is read. lobe : see `montecarlo_angles.lobe_width`. Raises InputError for one that the Monte Carlo does not simulate."""
    side = "R" if geometry.side == "above" else "T"
    if isinstance(geometry, Radial):
        return _radial(geometry, side)
    if isinstance(geometry, SpatialFrequency):
        return Reading(mc.Pencil(), "R_k", np.ones(geometry.size), k=tuple(geometry.k.tolist()))
    if isinstance(geometry, Total):
        specular = isinstance(geometry, TotalReflectance) and geometry.specular == "included"
        return Reading(_incident(geometry.incidence), side, np.ones(1), specular=specular)
    if isinstance(geometry, Angular):
        return _angular(geometry, side, lobe)
    raise InputError(f"solver monte-carlo does not predict {geometry.kind}")


def _incident(incidence: float | str) -> Any:
    if incidence == "diffuse":
        return mc.Lambertian()
    return mc.Pencil() if incidence == "normal" else mc.Pencil(float(np.cos(np.radians(float(incidence)))))


def _angular(geometry: Angular, side: str, lobe: float) -> Reading:
    light = _incident(geometry.incidence)
    edges, weights = polar_bins(geometry.angle, lobe)
    phi, share = np.array([0.0, 180.0]), np.ones(1)
    if geometry.azimuth is not None and not light.symmetric:
        phi, share = azimuth_bins(geometry.azimuth, lobe / max(float(np.max(np.sin(np.radians(geometry.angle)))), 1e-3))
    # straight up or down there is no azimuth: all of it is counted
    shares = np.where(geometry.angle[:, None] == 0.0, np.diff(phi) / 180.0, share)
    together = (weights[:, :, None] * shares[:, None, :]).reshape(weights.shape[0], -1)
    solid = np.outer(np.diff(edges), np.radians(np.diff(phi))).ravel()
    one = np.max(np.abs(together) / solid, axis=1)
    theta = np.degrees(np.arcsin(np.sqrt(edges)))
    return Reading(light, f"{side}_angle", one, theta=tuple(theta.tolist()), phi=tuple(phi.tolist()), weights=together)


def _radial(geometry: Radial, side: str) -> Reading:
    source = geometry.source
    if isinstance(source, Pencil):
        light, width = mc.Pencil(), 0.0
    elif isinstance(source, Disk):
        light, width = mc.Disk(source.radius), source.radius
    elif isinstance(source, Gaussian):
        light, width = mc.Gaussian(source.radius), source.radius
    else:
        raise InputError(f"solver monte-carlo does not simulate source kind '{source.name}'; allowed: pencil, disk, gaussian")
    na = geometry.detector.na if geometry.detector.na < 1.0 else None
    if geometry.r is None:
        assert geometry.r_min is not None and geometry.r_max is not None
        rings = tuple(zip(geometry.r_min.tolist(), geometry.r_max.tolist(), strict=True))
        area = np.pi * (geometry.r_max**2 - geometry.r_min**2)
        return Reading(light, f"{side}_rings", 1.0 / area, rings=rings, na=na)
    radius = geometry.detector.radius
    if radius > 0.0:
        return Reading(light, f"{side}_fibres", _one(geometry.r, radius), fibres=tuple(_fibre(r, radius, na) for r in geometry.r))
    return _points(light, f"{side}_fibres", geometry.r, np.maximum(geometry.r, 2.0 * width), na)


def _points(light: Any, tally: str, r: np.ndarray, scale: np.ndarray, na: float | None) -> Reading:
    """Values at points, from two concentric fibres.

    The mean over a disk of radius a is R + a^2/8 L R + a^4/192 L^2 R + ..., L the Laplacian. Twice the mean over a/sqrt 2 less that over a
    keeps R, drops the second term and leaves -a^4/384 L^2 R: with a = r/10 a relative 2e-4 where R falls as exp(-5 r) at r = 1, below any
    error that counting reaches there.
    """
    wide = POINT_RADIUS * scale
    narrow = wide / np.sqrt(2.0)
    pairs = list(zip(r, wide, narrow, strict=True))
    fibres = tuple(_fibre(at, a, na) for at, a, _ in pairs) + tuple(_fibre(at, b, na) for at, _, b in pairs)
    one = np.eye(r.size)
    return Reading(light, tally, _one(r, wide), fibres=fibres, weights=np.concatenate((-one, 2.0 * one), axis=1))


def _fibre(r: float, radius: float, na: float | None) -> mc.CollectingFibre:
    return mc.CollectingFibre(float(r), float(radius), na=1e6 if na is None else na)  # no direction is beyond the large aperture


def _one(r: np.ndarray, radius: np.ndarray | float) -> np.ndarray:
    """What a photon adds to a fibre's value at most: the share of its circle that the fibre covers, over the fibre's area."""
    share = np.arcsin(np.minimum(radius / np.maximum(r, radius), 1.0)) / np.pi
    return np.where(r > radius, share, 1.0) / (np.pi * np.asarray(radius) ** 2)


@dataclass(frozen=True)
class Run:
    """One simulation that serves some measurements: their positions in the list, and what must be counted."""

    light: Any
    tallies: mc.Tallies
    members: tuple[int, ...]


def runs(readings: Sequence[Reading]) -> list[Run]:
    """As few simulations as the measurements allow: one for each light, aperture of rings and set of directions."""
    groups: list[list[int]] = []
    for i, one in enumerate(readings):
        group = next((g for g in groups if not any(_conflict(readings[j], one) for j in g)), None)
        if group is None:
            groups.append([i])
        else:
            group.append(i)
    return [_run([readings[i] for i in group], tuple(group)) for group in groups]


def _conflict(a: Reading, b: Reading) -> bool:
    """Whether two measurements cannot be counted in one run. Fibres have their own aperture, and totals none."""
    apertures = a.shares_aperture and b.shares_aperture and a.na != b.na
    directions = bool(a.theta and b.theta) and (a.theta, a.phi) != (b.theta, b.phi)
    return a.light != b.light or apertures or directions


def _run(together: list[Reading], members: tuple[int, ...]) -> Run:
    rings, k, fibres = (list(dict.fromkeys(place for one in together for place in getattr(one, name))) for name in ("rings", "k", "fibres"))
    na = next((one.na for one in together if one.shares_aperture), None)
    theta, phi = next(((one.theta, one.phi) for one in together if one.theta), (None, None))
    return Run(together[0].light, mc.Tallies(rings=rings or None, k=k or None, fibres=fibres, na=na, theta=theta, phi=phi), members)
