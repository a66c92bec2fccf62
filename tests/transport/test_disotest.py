"""Problems 1, 2, 3, 8 and 9 of DISORT's own test: fluxes to the digits printed, intensities to 1e-3, with DISORT's number of streams.

Printed values: tables of cdisort. Beams of DISORT have a flux across the beam; ours a power of 1: theirs is ours times the flux on the surface.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ordinates_scenes import R_DIFFUSE, T_DIFFUSE, layered, predicted, slab

import layerfit as lf
from layerfit.scene.columns import to_columns
from layerfit.solver import Domain
from layerfit.transport.ordinate_stack import lay_out, make_faces, make_grid, medium, pieces
from layerfit.transport.response import between, compose_all, reflection

PRINTED = 0.5e-5  # half of the sixth digit


def close(found, printed, relative: float, floor: float = 0.0) -> None:
    found, printed = np.asarray(found), np.asarray(printed)
    assert np.all(np.abs(found - printed) <= relative * np.abs(printed) + floor), (found, printed, found / np.maximum(printed, 1e-300) - 1.0)


def stored(shared, name: str) -> dict[str, np.ndarray]:
    """What DISORT 4 gives: fluxes, and intensities from straight down to straight up (cosines of Gauss nodes)."""
    folder = shared / "data" / "disort-results"
    if not folder.is_dir():
        pytest.skip("shared/data/disort-results is not beside the project")
    return dict(np.load(folder / f"{name}_test.npz"))


def seen(tau, albedo, g, cosines, streams, incidence="diffuse", azimuth=None, **settings):
    """Up at the top and down at the bottom: fluxes (the unscattered beam left out) and intensities, for a power of pi on the surface."""
    angle = np.degrees(np.arccos(cosines))
    where = {"incidence": incidence}
    looks = [lf.AngularReflectance(angle, **where, azimuth=azimuth), lf.AngularTransmittance(angle, **where, azimuth=azimuth)]
    totals = [lf.TotalReflectance(**where), lf.TotalTransmittance(**where)]
    up, down, R, T = predicted(slab(tau, albedo, g), looks + totals, streams, **settings)
    beam = 0.0 if incidence == "diffuse" else np.exp(-tau / (1.0 if incidence == "normal" else np.cos(np.radians(incidence))))
    return np.pi * R[0], np.pi * (T[0] - beam), np.pi * up, np.pi * down


GAUSS = 0.5 * (np.polynomial.legendre.leggauss(8)[0] + 1.0)  # cosines of the stored intensities
PROBLEM_1 = {
    "1a": (0.03125, 0.2, 0.0799451, 0.0794108, (0.117771, 0.0264170, 0.0134041), (0.115898, 0.0263324, 0.0133826)),
    "1b": (0.03125, 1.0, 0.422922, 0.420233, (0.622884, 0.139763, 0.0709192), (0.613458, 0.139337, 0.0708109)),
    "1c": (0.03125, 0.99, 0.0906556, 3.04897, (0.133177, 0.0299879, 0.0152233), (0.863946, 0.969363, 0.984447)),
    "1d": (32.0, 0.2, 0.259686, 0.0, (0.262972, 0.0906967, 0.0502853), (0.0, 0.0, 0.0)),
    "1e": (32.0, 1.0, 3.07390, 0.0676954, (1.93321, 1.02732, 0.797199), (0.0116385, 0.0187805, 0.0271316)),
    "1f": (32.0, 0.99, 2.49618, 0.00460048, (0.877510, 0.815136, 0.752715), (0.000779280, 0.00126492, 0.00186840)),
}
GRAZING_1, GRAZING_2 = (float(np.degrees(np.arccos(mu))) for mu in (0.1, 0.080442))


@pytest.mark.parametrize("name", PROBLEM_1)
def test_problem_1(name, shared):
    """Isotropic scattering; a beam at mu0 = 0.1 (a, b, d, e) or diffuse light (c, f). Cosines 0.1, 0.5, 1 as printed.

    a and d also at the 8 that are stored; the stored results of the others are of other scenes (albedo below 1, a beam beside the diffuse light).
    """
    tau, albedo, up, down, I_up, I_down = PROBLEM_1[name]
    incidence = "diffuse" if name in ("1c", "1f") else GRAZING_1
    cosines = np.sort(np.array([0.1, 0.5, 1.0, *GAUSS]))[::-1]
    found_up, found_down, looked_up, looked_down = seen(tau, albedo, 0.0, cosines, 16, incidence)
    close(found_up, up, PRINTED)
    close(found_down, down, PRINTED, 1e-9)
    printed = [list(cosines).index(mu) for mu in (0.1, 0.5, 1.0)]
    close(looked_up[printed], I_up, 1e-3)
    close(looked_down[printed], I_down, 1e-3, 1e-9)
    if name not in ("1a", "1d"):
        return
    result = stored(shared, name)
    gauss = [list(cosines).index(mu) for mu in GAUSS]
    close(found_up, result["flup"][0], 1e-6)
    close(found_down, result["rfldn"][1], 1e-5, 1e-8)
    close(looked_up[gauss], result["uu"][8:, 0, 0], 1e-3)
    close(looked_down[gauss], result["uu"][7::-1, 1, 0], 1e-3, 1e-8)


PROBLEM_2 = {
    "2a": (0.2, 0.5, 0.0535063, 0.0441791, (0.161796, 0.0211501, 0.00786713), (0.0257685, 0.0200778, 0.00771897)),
    "2b": (0.2, 1.0, 0.125561, 0.106123, (0.347678, 0.0487120, 0.0189387), (0.0677603, 0.0464061, 0.0186027)),
    "2c": (5.0, 0.5, 0.0624730, 0.000251683, (0.162566, 0.0245786, 0.0101498), (1.32472e-5, 3.97168e-5, 0.000170004)),
    "2d": (5.0, 1.0, 0.225915, 0.0268008, (0.364010, 0.0826993, 0.0492370), (0.00379276, 0.00769337, 0.0105950)),
}


@pytest.mark.parametrize("name", PROBLEM_2)
def test_problem_2(name):
    """Rayleigh's three moments, beam at mu0 = 0.080442 of flux pi, looked at in the plane of incidence."""
    tau, albedo, up, down, I_up, I_down = PROBLEM_2[name]
    cosines = [0.981986, 0.538263, 0.018014]
    found = seen(tau, albedo, 0.0, cosines, 16, GRAZING_2, azimuth=0.0, phase={"slab": (1.0, 0.0, 0.1)})
    found_up, found_down, looked_up, looked_down = (0.080442 * value for value in found)
    close(found_up, up, PRINTED)
    close(found_down, down, PRINTED, 1e-9)
    close(looked_up[::-1], I_up, 1e-3)
    close(looked_down[::-1], I_down, 1e-3)


PROBLEM_3 = {
    "3a": (1.0, 0.247374, 1.73849, (0.151159, 0.101103, 0.0395460), (0.213750, 0.266648, 3.05855)),
    "3b": (8.0, 1.59096, 1.54958, (0.379740, 0.519598, 0.493302), (0.236362, 0.422350, 0.669581)),
}


@pytest.mark.parametrize("name", PROBLEM_3)
def test_problem_3(name):
    """Henyey-Greenstein 0.75, albedo 1, normal beam of flux pi. DISORT takes the moments up to 32 for the whole phase function.

    Intensities agree to 5e-6, but along the beam, where DISORT also corrects light scattered twice: 7e-4. The phase function without its truncation
    is another one (1.1 % off for light sent straight back at tau 1, 0.2 % along the beam).
    """
    tau, up, down, I_up, I_down = PROBLEM_3[name]
    found = seen(tau, 1.0, 0.75, [1.0, 0.5, 0.1], 16, "normal", phase={"slab": [0.75**l for l in range(33)]})
    close(found[0], up, 1e-5)
    close(found[1], down, PRINTED)
    close(found[2][::-1], I_up, 1e-5)
    close(found[3][:0:-1], I_down[:2], 1e-5)
    close(found[3][0], I_down[2], 1e-3)


def inside(stack: lf.Stack, cosines, phase) -> np.ndarray:
    """Diffuse light of power 1 on a matched stack: (fluxes and intensities) x (down, up) above each layer and under the last. 8 streams."""
    columns = to_columns(stack)
    tables = tuple(phase for _ in stack.layers)
    layout = lay_out(Domain(stack, columns, columns), 8, 1, tables)

    @jax.jit
    def solved(columns):
        grid = make_grid(layout, columns, jnp.asarray(np.sqrt(1.0 - np.asarray(cosines) ** 2)), jnp.zeros(0))
        parts = pieces(layout, columns, medium(layout, columns), grid, make_faces(columns, grid, layout, 0), 0)
        return parts, grid.root[0]

    parts, root = solved(columns)
    views, rows = len(cosines), []
    for cut in range(0, len(parts), 2):
        under = reflection(parts[cut:])
        down = between(compose_all(parts[:cut]), under) if cut else under.one()
        for operator in (down, under @ down):
            K = np.asarray(operator.value[0]) / (np.pi * 2.0 * np.sum(root**2))
            flux = 2.0 * np.pi * root @ K[views:, views:] @ root
            rows.append([flux, *(K[:views, views:] @ root + np.diagonal(K[:views, :views]))])
    return np.array(rows).reshape(-1, 2, 1 + views)


PROBLEM_8 = {
    "8a": ("0.25/0.5/0;0.25/0.3/0", (1.0, 0.722235, 0.513132), (0.0929633, 0.0278952, 0.0)),
    "8b": ("0.25/0.8/0;0.25/0.95/0", (1.0, 0.795332, 0.650417), (0.225136, 0.126349, 0.0)),
    "8c": ("1/0.8/0;2/0.95/0", (1.0, 0.486157, 0.159984), (0.378578, 0.243397, 0.0)),
}
NODES = 0.5 * (np.polynomial.legendre.leggauss(4)[0] + 1.0)


def test_problem_8(shared):
    """Two isotropic layers under diffuse light: fluxes at the top, between and below, intensities at DISORT's ordinates."""
    for name, (text, down, up) in PROBLEM_8.items():
        found = inside(layered(text), NODES, None)
        close(found[:, 0, 0], down, PRINTED)
        close(found[:, 1, 0], up, PRINTED, 1e-12)
        R_up, T_down = predicted(layered(text), [R_DIFFUSE, T_DIFFUSE], 8)
        assert abs(R_up[0] - found[0, 1, 0]) <= 1e-13 and abs(T_down[0] - found[-1, 0, 0]) <= 1e-13
        result = stored(shared, name)
        depths = np.concatenate([[0.0], np.cumsum([float(part.split("/")[0]) for part in text.split(";")])])
        same = [level for level in range(3) if abs(result["tau_test_arr"][level] - depths[level]) <= 1e-6]
        assert len(same) >= (1 if name == "8c" else 3)  # the stored results of 8c are at other depths than the printed ones
        for level in same:
            close(found[level, 0, 1:], result["uu"][3::-1, level, 0], 1e-5)
            close(found[level, 1, 1:], result["uu"][4:, level, 0], 1e-5, 1e-9)


MOMENTS = (1.0, *(c / (2 * l + 3) for l, c in enumerate((2.00916, 1.56339, 0.67407, 0.22215, 0.04725, 0.00671, 0.00068, 0.00005))))
PROBLEM_9 = {
    "9a": (None, (1.0, 0.355151, 0.144265, 0.00671445, 6.16968e-7), (0.227973, 0.0875098, 0.0361819, 0.00219291, 0.0)),
    "9b": (MOMENTS, (1.0, 0.452357, 0.236473, 0.0276475, 7.41853e-5), (0.100079, 0.0452014, 0.0241941, 0.00416016, 0.0)),
}


@pytest.mark.parametrize("name", [pytest.param("9a", marks=pytest.mark.long), "9b"])
def test_problem_9(name, shared):
    """Six layers of optical thickness 1 to 6, cut where DISORT looks in: 1.05, 2.1, 6. 9b with tabulated moments."""
    phase, down, up = PROBLEM_9[name]
    albedo = [0.6 + 0.05 * l for l in range(1, 7)]
    cut = ((1.0, 0), (0.05, 1), (1.05, 1), (0.9, 1), (3.0, 2), (4.0, 3), (5.0, 4), (6.0, 5))
    found = inside(layered(";".join(f"{tau}/{albedo[l]}/0" for tau, l in cut)), [*NODES, 1.0], phase)[[0, 2, 3, 5, 8]]
    close(found[:, 0, 0], down, PRINTED)
    close(found[:, 1, 0], up, PRINTED, 1e-12)
    if name == "9a":
        close(found[:, 0, 5], (0.318310, 0.153507, 0.0706614, 0.00372784, 2.87656e-7), 1e-3)
        close(found[:, 1, 5], (0.0591345, 0.0231903, 0.00972307, 0.000594743, 0.0), 1e-3, 1e-12)
    result = stored(shared, name)
    for level in range(5):
        close(found[level, 0, 1:5], result["uu"][3::-1, level, 0], 1e-3)
        close(found[level, 1, 1:5], result["uu"][4:, level, 0], 1e-3, 1e-9)
