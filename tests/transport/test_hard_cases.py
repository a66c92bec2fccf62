"""Inputs at which other codes break, row by row (docs/hard-cases.md): the right answer or one clear error."""

from pathlib import Path

import cases
import numpy as np
import pytest
from ordinates_layer import response, totals
from ordinates_scenes import R_ALL, R_DIFFUSE, T_DIFFUSE, R, T, layered, predicted, slab

import layerfit as lf
from layerfit.errors import InputError

ALL = [R_ALL, T, R_DIFFUSE, T_DIFFUSE]
OBLIQUE = [lf.TotalReflectance(incidence=60.0), lf.TotalTransmittance(incidence=60.0)]
ROWS, LONG = {}, set()


def row(name: str, *, long: bool = False):
    def add(function):
        ROWS[name] = function
        if long:
            LONG.add(name)
        return function

    return add


def values(stack: lf.Stack, geometries=ALL, streams: int = 32) -> np.ndarray:
    return np.array([value[0] for value in predicted(stack, geometries, streams)])


def medium(sigma_a: float, sigma_s: float, g: float = 0.0, n: float = 1.0, thickness: float = 1.0, **around) -> lf.Stack:
    return lf.Stack([lf.Layer("slab", sigma_a=sigma_a, sigma_s=sigma_s, g=g, n=n, thickness=thickness)], **around)


def balance(found: np.ndarray) -> float:
    return float(np.abs([found[0] + found[1] - 1.0, found[2] + found[3] - 1.0]).max())


def refused(said: str, **numbers):
    with pytest.raises(InputError, match=said) as caught:
        medium(**{"sigma_a": 0.1, "sigma_s": 1.0, **numbers})
    assert "\n" not in str(caught.value)


@row("albedo 1")
def _():
    found = values(medium(0.0, 1.0))
    assert abs(found[0] - 0.341329) <= 1e-6
    assert balance(found) <= 1e-12


@row("albedo within 1e-9 of 1")
def _():
    exact = values(medium(0.0, 1.0))
    for lost, bound in ((1e-9, 3e-9), (1e-12, 5e-12), (1e-14, 5e-14), (1e-16, 5e-14)):
        assert np.abs(values(medium(lost, 1.0)) - exact).max() <= bound
    # and the loss itself is right: absorption grows in proportion to 1 - albedo
    first, second = (1.0 - values(medium(lost, 1.0 - lost))[:2].sum() for lost in (1e-9, 1e-6))
    assert abs(second / first - 1e3) <= 0.1


@row("tau 0")
def _():
    with pytest.raises(InputError, match="thickness 0"):
        values(medium(0.1, 1.0, thickness=0.0))
    nothing = lf.Layer("nothing", sigma_a=0.1, sigma_s=1.0, g=0.0, n=1.0, thickness=0.0)
    there = lf.Layer("slab", sigma_a=0.1, sigma_s=1.0, g=0.0, n=1.0, thickness=1.0)
    # a layer has an optical thickness of 1e-12 at least (1e-10 where indices differ), so that light trapped between faces has a slope
    assert np.abs(values(lf.Stack([nothing, there])) - values(lf.Stack([there]))).max() <= 1e-12


@row("tau infinite")
def _():
    refused("thickness = inf.*HalfSpace", thickness=np.inf)


@row("tau nan")
def _():
    refused("thickness = nan: allowed is a finite number", thickness=np.nan)


@row("g 1")
def _():
    refused("g = 1.0: allowed is a finite number at least -1 and below 1", g=1.0)


@row("albedo above 1")
def _():
    refused("sigma_a = -1e-07: allowed is a finite number at least 0", sigma_a=-1e-7)


@row("thin forward-scattering layer at 60 degrees", long=True)
def _():
    found = predicted(medium(0.001, 0.009, 0.9), OBLIQUE)  # default streams
    assert abs(found[0][0] - 0.000958242055) <= 1e-7
    assert abs(found[1][0] - 0.997032475) <= 1e-7


@row("g 0.98", long=True)
def _():
    found = predicted(medium(0.1, 9.9, 0.98), [R, T])  # default streams
    assert abs(found[0][0] - 0.04155674) <= 2e-7
    assert abs(found[1][0] - 0.845186134) <= 2e-7


@row("index steps between layers", long=True)
def _():
    case = cases.load("skin3_dj_R")
    found = predicted(case.stack, [R], 32)[0][0]
    truth = case.totals["R_diffuse"]
    assert abs(found - truth["value"]) <= max(3.0 * truth["se"], 1e-3 * truth["value"])


def _around_the_beam(streams: int | None) -> np.ndarray:
    mu = np.array([0.501, 0.5001, 0.5, 0.49999, 0.499])
    angle = np.degrees(np.arccos(mu))
    angle[2] = 60.0
    return predicted(slab(1.0, 0.9, 0.9), [lf.AngularTransmittance(angle, incidence=60.0, azimuth=90.0)], streams)[0]


@row("line of sight along the beam")
def _():
    found = _around_the_beam(32)
    assert np.abs(found - 0.0333).max() <= 2e-4
    assert np.abs(np.diff(found) / np.array([-0.0009, -0.0001, -0.00001, -0.00099]) + 0.0320).max() <= 4e-4  # one slope throughout


@row("line of sight along the beam, default streams", long=True)
def _():
    assert abs(_around_the_beam(None)[2] - 3.329628277e-02) <= 1e-6


@row("beam at an ordinate")
def _():
    nodes = 0.5 * (np.polynomial.legendre.leggauss(8)[0] + 1.0)
    for node in (*nodes[[0, 3, 7]], 0.7627662049581645):
        found = []
        for mu in (node * (1.0 - 1e-5), node, node * (1.0 + 1e-5)):
            (back, through), root = response(np.array([0.9, 0.9, 1.0, 1.0, mu]), 0, 8, 1, 16)
            found.append([totals(back, root)[0], totals(through, root)[0]])
        below, at, above = np.array(found)
        assert np.all(np.isfinite(at))
        assert np.abs(at - 0.5 * (below + above)).max() <= 1e-8


@row("normal incidence with 256 streams", long=True)
def _():
    found, few = predicted(medium(0.1, 0.9, 0.5), [R, T], 256), predicted(medium(0.1, 0.9, 0.5), [R, T], 32)
    assert np.abs(np.array(found) - np.array(few)).max() <= 1e-6


@row("conservative, tau 1e7")
def _():
    found = values(medium(0.0, 1e7))
    assert balance(found) <= 1e-9
    assert abs(found[3] * 0.75 * (1e7 + 2.0 * 0.7104460896) - 1.0) <= 1e-8  # Milne's problem


@row("direction along the surface")
def _():
    with pytest.raises(InputError, match="degrees from 0 to below 90"):
        lf.AngularReflectance([0.0, 90.0])
    with pytest.raises(InputError, match="degrees from 0 to below 90"):
        lf.TotalReflectance(incidence=90.0)


@row("fewer moments than streams")
def _():
    """Rayleigh, disotest 2b: three moments, 16 streams."""
    beam = float(np.degrees(np.arccos(0.080442)))
    found = predicted(medium(0.0, 0.2), [lf.TotalReflectance(incidence=beam)], 16, phase={"slab": (1.0, 0.0, 0.1)})[0][0]
    assert abs(found * np.pi * 0.080442 - 0.125561) <= 1e-6


@row("nothing on stderr", long=True)
def _(capfd):
    lf.predict(slab(1.0, 0.9, 0.9), lf.AngularReflectance([0.0, 30.0]), solver=lf.DiscreteOrdinates(streams=16))
    said = capfd.readouterr()
    assert said.err == "" and said.out == ""


@row("more and more directions, matched", long=True)
def _():
    for tau, g in ((10.0, 0.5), (1000.0, 0.5)):
        few = values(medium(0.0, tau, g), streams=32)
        for streams in (16, 24, 48, 64):
            found = values(medium(0.0, tau, g), streams=streams)
            assert balance(found) <= 1e-9
            assert np.abs(found - few).max() <= 1e-6 if streams >= 24 else 1e-5


@row("more and more directions, n 1.4", long=True)
def _():
    few = values(slab(1.0, 0.9, 0.5, 1.4), streams=32)
    for streams in (48, 64):
        assert balance(values(slab(1000.0, 1.0, 0.5, 1.4), streams=streams)) <= 1e-9
        assert np.abs(values(slab(1.0, 0.9, 0.5, 1.4), streams=streams) - few).max() <= 1e-6


@row("n 1.4 with few directions")
def _():
    """16 directions a hemisphere, against the H functions."""
    stack = lf.Stack([lf.HalfSpace("deep", sigma_a=0.1, sigma_s=0.9, g=0.0, n=1.4)])
    assert abs(values(stack, [R], 32)[0] - 0.2505959) <= 1e-6


@row("oblique incidence")
def _():
    """tau 1 of no scattering over a conservative slab at 60 degrees."""
    found = values(layered("1/0/0;10/1/0.5"), OBLIQUE, 16)
    assert abs(found[0] - 0.023324745) <= 1e-6
    assert abs(found[1] - 0.02441396067) <= 1e-6


@row("n below 1")
def _():
    """Only ratios of indices matter; nothing is lost."""
    found = values(medium(0.1, 1.0, 0.5, 0.9), streams=16)
    assert np.abs(found - values(medium(0.1, 1.0, 0.5, 1.0, n_above=1.0 / 0.9, n_below=1.0 / 0.9), streams=16)).max() <= 1e-13
    assert balance(values(medium(0.0, 1.0, 0.5, 0.9), streams=16)) <= 1e-13


@row("half space of albedo 1")
def _():
    for n in (1.0, 1.4):
        found = values(lf.Stack([lf.HalfSpace("deep", sigma_a=0.0, sigma_s=1.0, g=0.0, n=n)]), [R_ALL, R_DIFFUSE], 16)
        assert np.abs(found - 1.0).max() <= 1e-13


@row("light from above, not from below")
def _():
    upright, turned = values(layered("1/0/0;10/1/0.5"), ALL, 16), values(layered("10/1/0.5;1/0/0"), ALL, 16)
    assert abs(upright[0] - 0.060940996) <= 1e-6
    assert abs(upright[2] - 0.037140523) <= 1e-6
    assert turned[0] >= 0.4  # the scatterer on top
    assert abs(turned[3] - upright[3]) <= 1e-14  # reciprocity of diffuse light


@row("different media above and below")
def _():
    upright = values(medium(0.1, 1.0, 0.5, 1.4, n_above=1.33, n_below=1.5), streams=16)
    turned = values(medium(0.1, 1.0, 0.5, 1.4, n_above=1.5, n_below=1.33), streams=16)
    assert abs(upright[3] * 1.33**2 - turned[3] * 1.5**2) <= 1e-13  # reciprocity: n^2 times what diffuse light passes on
    assert balance(values(medium(0.0, 1.0, 0.5, 1.4, n_above=1.33, n_below=1.5), streams=16)) <= 1e-13


def _round_trip(n: float, albedo: float, tau: float) -> lf.Fit:
    truth = slab(tau, albedo, 0.0, n)
    data = [lf.Dataset(g, v, 1e-3 * v, name=f"m{i}") for i, (g, v) in enumerate(zip([R_ALL, T], predicted(truth, [R_ALL, T], 8), strict=True))]
    free = {
        "slab.sigma_a": {"min": 1e-6, "max": 100.0, "init": 0.1, "scale": "log"},
        "slab.sigma_s": {"min": 1e-3, "max": 1e3, "init": 1.0, "scale": "log"},
    }
    start = truth.set({"slab.sigma_a": 0.1, "slab.sigma_s": 1.0})
    return lf.fit(lf.Problem(start, data, free=free, solver=lf.DiscreteOrdinates(streams=8)))


@row("albedo and tau from R and T", long=True)
def _():
    """All 40 of them within 2 % of 1 - albedo and of tau."""
    for n in (1.0, 1.4):
        for albedo in (0.5, 0.9, 0.99, 0.999, 0.9999):
            for tau in (0.1, 1.0, 10.0, 100.0):
                stack = _round_trip(n, albedo, tau).stack
                sigma_a, sigma_s = stack.get("slab.sigma_a"), stack.get("slab.sigma_s")
                assert abs(sigma_a / (sigma_a + sigma_s) / (1.0 - albedo) - 1.0) <= 0.02, (n, albedo, tau)
                assert abs((sigma_a + sigma_s) / tau - 1.0) <= 0.02, (n, albedo, tau)


@row("R + T = 1.2")
def _():
    """The nearest scene, without absorption, and a warning that it does not describe the data."""
    data = [lf.Dataset(geometry, [0.6], [0.006], name=f"m{i}") for i, geometry in enumerate((R_ALL, T))]
    free = {"slab.sigma_a": (0.0, 100.0), "slab.sigma_s": (1e-3, 1e3)}
    fit = lf.fit(lf.Problem(slab(1.0, 0.5, 0.0), data, free=free, solver=lf.DiscreteOrdinates(streams=8)))
    assert fit.parameters["slab.sigma_a"].at_bound
    assert any("lower bound" in warning for warning in fit.warnings)
    assert any("does not describe the data" in warning for warning in fit.warnings)
    assert not any("cannot be judged" in warning for warning in fit.warnings)


@row("where MCML is biased", long=True)
def _():
    """n 1.4, 5 mm of sigma_s 4.975, g 0.8, sigma_a 0.005: adding-doubling, to its uncertainty."""
    found = predicted(medium(0.005, 4.975, 0.8, 1.4, 5.0), [R, T])  # default streams
    assert abs(found[0][0] - 0.59249) <= 1.5e-5
    assert abs(found[1][0] - 0.28446) <= 1.5e-5


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.long) if name in LONG else name for name in ROWS])
def test_row(name, request):
    """One row of the table."""
    function = ROWS[name]
    if function.__code__.co_argcount:
        function(request.getfixturevalue("capfd"))
    else:
        function()


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.long)
        for name in ("thin_slab_01mfp", "two_thin_low_over_thick_high", "head_scalp_skull_csf_brain", "absorbing_top", "si_n14_g08_a0667")
    ],
)
def test_where_diffusion_breaks(name):
    """Thin layers, low-scattering gaps, strong absorbers: totals within 3 standard errors of the Monte Carlo case, 0.1 % at least."""
    case = cases.load(name)
    both = [R] if case.stack.half_space else [R, T]
    for value, key in zip(predicted(case.stack, both, 32), ("R_diffuse", "T_total"), strict=False):
        truth = case.totals[key]
        assert abs(value[0] - truth["value"]) <= max(3.0 * truth["se"], 1e-3 * truth["value"]), key


def test_every_row_is_documented():
    """docs/hard-cases.md names each test and no other."""
    text = (Path(__file__).parents[2] / "docs" / "hard-cases.md").read_text()
    missing = [name for name in ROWS if f"`test_row[{name}]`" not in text]
    assert missing == []
    assert all(part.split("]")[0] in ROWS for part in text.split("`test_row[")[1:])
