"""What people get wrong in a scene file, a data file or on the command line.

Each is one InputError in Python, and one line and exit code 2 from the command, with nothing written.
"""

import os

import pytest
from click.testing import CliRunner

import layerfit as lf
from layerfit.cli import main
from layerfit.scene_file import read_scene

SCENE = """
[scene]
n_above = 1.0

[[layer]]
name = "skin"
sigma_a = 0.02
sigma_s_prime = 2.0
n = 1.4
thickness = 1.5

[[layer]]
name = "fat"
sigma_a = 0.005
sigma_s_prime = 1.2
n = 1.44

[[measurement]]
name = "probe"
kind = "radial_reflectance"
file = "profile.csv"

[fit]
solver = "layered-diffusion"

[fit.free]
"skin.sigma_a" = [0.001, 1]
"fat.sigma_s_prime" = [0.1, 10]
"""
DATA = "r [mm], value [1/mm^2], sd [1/mm^2]\n1, 0.03, 0.001\n2, 0.01, 0.001\n4, 0.002, 0.0001\n"
SKIN, FAT, PROBE = "[[layer]] 1 ('skin')", "[[layer]] 2 ('fat')", "[[measurement]] 1 ('probe')"
INLINE = 'kind = "total_reflectance"\nvalue = 0.5\nsd = 0.01'
FROM_FILE = 'kind = "radial_reflectance"\nfile = "profile.csv"'

# what is replaced by what, in the scene; what the message must say
SCENES = {
    "unknown key": ("sigma_a = 0.02", "mu_a = 0.02", [SKIN, "unknown key 'mu_a'", "allowed: name, sigma_a, sigma_s, sigma_s_prime"]),
    "misspelt key": ("sigma_a = 0.02", "sigma_a = 0.02\nthicknes = 1", [SKIN, "unknown key 'thicknes'", "did you mean thickness?"]),
    "unknown table": ("[scene]", "[sample]", ["unknown key 'sample'", "allowed: scene, layer, measurement, fit"]),
    "unknown key of the scene": ("n_above = 1.0", "n_over = 1.0", ["[scene]", "unknown key 'n_over'", "did you mean n_above?"]),
    "unknown key of a source": (
        'file = "profile.csv"',
        'file = "profile.csv"\nsource = {kind = "disk", diameter = 1}',
        ["source", "'diameter'", "kind, radius"],
    ),
    "unknown key of the fit": ('solver = "layered-diffusion"', "steps = 5", ["[fit]", "unknown key 'steps'"]),
    "missing key": ("sigma_a = 0.02\n", "", [SKIN, "sigma_a is missing"]),
    "missing layers": (SCENE[SCENE.index("[[layer]]") : SCENE.index("[[measurement]]")], "", ["there is no [[layer]]", "allowed is one or more"]),
    "missing measurement": (SCENE[SCENE.index("[[measurement]]") : SCENE.index("[fit]")], "", ["there is no [[measurement]]"]),
    "one layer, written as a table": ("[[layer]]", "[layer]", ["line"]),
    "layers as a number": (SCENE[SCENE.index("[scene]") : SCENE.index("[[measurement]]")], "layer = 3\n", ["'layer' is not written as [[layer]]"]),
    "no scattering": ("sigma_s_prime = 2.0\n", "", ["layer 'skin'", "neither of sigma_s and sigma_s_prime"]),
    "sigma_s without g": ("sigma_s_prime = 2.0", "sigma_s = 20", ["layer 'skin'", "sigma_s given without g"]),
    "sigma_s and sigma_s_prime": ("sigma_s_prime = 2.0", "sigma_s_prime = 2.0\nsigma_s = 20\ng = 0.9", ["layer 'skin'", "both of"]),
    "negative coefficient": ("sigma_a = 0.02", "sigma_a = -0.02", [SKIN, "sigma_a = -0.02", "allowed is at least 0"]),
    "NaN coefficient": ("sigma_a = 0.02", "sigma_a = nan", [SKIN, "sigma_a = nan", "allowed is a finite number"]),
    "infinite coefficient": ("sigma_s_prime = 2.0", "sigma_s_prime = inf", [SKIN, "sigma_s_prime = inf", "a finite number"]),
    "text for a coefficient": ("sigma_a = 0.02", 'sigma_a = "0.02"', [SKIN, "sigma_a = '0.02'", "allowed is a number"]),
    "decimal comma": ("sigma_a = 0.02", "sigma_a = 0,02", ["not TOML", "line 7", ": sigma_a = 0,02; numbers are written with a point"]),
    "g of 1": ("n = 1.4\n", "n = 1.4\ng = 1.0\n", [SKIN, "g = 1", "allowed is below 1"]),
    "index 0": ("n = 1.4\n", "n = 0\n", [SKIN, "n = 0", "allowed is above 0"]),
    "index missing": ("n = 1.4\n", "", [SKIN, "n is missing"]),
    "half space not last": ("thickness = 1.5\n", "", ["[[layer]] 1 ('skin')", "no thickness", "not the last layer"]),
    "thickness 0": ("thickness = 1.5", "thickness = 0", [SKIN, "thickness = 0", "allowed is above 0"]),
    "thickness infinite": ("thickness = 1.5", "thickness = inf", [SKIN, "thickness = inf", "a half space, the last layer, has none"]),
    "thickness negative": ("thickness = 1.5", "thickness = -1", [SKIN, "thickness = -1", "allowed is above 0"]),
    "roughness negative": ("thickness = 1.5", "thickness = 1.5\nroughness = -0.1", [SKIN, "roughness = -0.1", "at least 0"]),
    "two layers of one name": ('name = "fat"', 'name = "skin"', ["layer name 'skin' is used 2 times"]),
    "layer name with a dot": ('name = "fat"', 'name = "fat.1"', ["layer name 'fat.1'", "without dots"]),
    "layer name empty": ('name = "fat"', 'name = ""', ["[[layer]] 2", "name = ''", "not empty"]),
    "key there twice": ("sigma_a = 0.02", "sigma_a = 0.02\nsigma_a = 0.03", ["not TOML"]),
    "broken TOML": ("[fit.free]", "[fit.free", ["not TOML", "line"]),
    "unknown kind": ("radial_reflectance", "reflectance", [PROBE, "kind = 'reflectance'", "allowed: radial_reflectance"]),
    "kind missing": ('kind = "radial_reflectance"\n', "", [PROBE, "kind is missing"]),
    "data file missing": ("profile.csv", "nothing.csv", [PROBE, "nothing.csv: no such file"]),
    "null in a name": ("profile.csv", r"a\u0000b", [PROBE, "cannot be read (embedded null byte)"]),
    "data file is a folder": ("profile.csv", ".", [PROBE, "this is a folder"]),
    "no place": ('file = "profile.csv"\n', "", [PROBE, "nothing says where it was measured", "file, x, or x_min with x_max"]),
    "file and places": ('file = "profile.csv"', 'file = "profile.csv"\nx = [1, 2]', [PROBE, "file and x says where", "allowed is one of"]),
    "places not increasing": ('file = "profile.csv"', "x = [1, 2, 2]", [PROBE, "r is not increasing: number 3 is 2 after 2"]),
    "NaN place": ('file = "profile.csv"', "x = [1, nan]", [PROBE, "number 2 of x = nan", "a finite number"]),
    "text place": ('file = "profile.csv"', 'x = [1, "two"]', [PROBE, "number 2 of x = 'two'", "a number"]),
    "ring without its end": ('file = "profile.csv"', "x_min = [1, 2]", [PROBE, "x_min says where"]),
    "places without values": ('file = "profile.csv"', "x = [1, 2]", ["measurement 'probe' has no values"]),
    "values beside places": ('file = "profile.csv"', "x = [1, 2]\nvalue = 0.1", [PROBE, "key 'value' has no meaning for kind 'radial_reflectance'"]),
    "specular of a profile": ('file = "profile.csv"', 'file = "profile.csv"\nspecular = "included"', [PROBE, "key 'specular' has no meaning"]),
    "specular unknown": (FROM_FILE, INLINE + '\nspecular = "yes"', [PROBE, "specular = 'yes'", "'included' or 'excluded'"]),
    "incidence impossible": (FROM_FILE, INLINE + "\nincidence = 95", [PROBE, "incidence = 95", "allowed"]),
    "sd of a total 0": (FROM_FILE, INLINE.replace("0.01", "0"), [PROBE, "sd = 0", "allowed is above 0"]),
    "sd without a value": (FROM_FILE, 'kind = "total_reflectance"\nsd = 0.1', [PROBE, "sd without a value"]),
    "source unknown": (
        'file = "profile.csv"',
        'file = "profile.csv"\nsource = {kind = "laser"}',
        [PROBE, "source kind = 'laser'", "allowed: pencil, disk"],
    ),
    "disk without radius": ('file = "profile.csv"', 'file = "profile.csv"\nsource = {kind = "disk"}', [PROBE, "'disk' needs a radius"]),
    "pencil with radius": ('file = "profile.csv"', 'file = "profile.csv"\nsource = {kind = "pencil", radius = 1}', [PROBE, "'pencil' has no radius"]),
    "detector negative": ('file = "profile.csv"', 'file = "profile.csv"\ndetector = {radius = -1}', [PROBE, "radius = -1", "at least 0"]),
    "noise negative": ('file = "profile.csv"', 'file = "profile.csv"\nnoise = {relative = -1}', [PROBE, "relative = -1", "at least 0"]),
    "noise a number": ('file = "profile.csv"', 'file = "profile.csv"\nnoise = 0.02', [PROBE, "noise = 0.02", "allowed is a table"]),
    "noise of nothing": ('file = "profile.csv"', 'file = "profile.csv"\nnoise = {}', [PROBE, "relative and absolute are both 0"]),
    "measurement name with a slash": ('name = "probe"', 'name = "a/b"', ["[[measurement]] 1", "without dots and slashes"]),
    "measurement named like a layer": ('name = "probe"', 'name = "skin"', ["measurement name 'skin' is also the name of a layer"]),
    "two measurements of one name": ("[fit]", f'[[measurement]]\nname = "probe"\n{FROM_FILE}\n[fit]', ["measurement name 'probe' is used 2 times"]),
    "unknown solver": ("layered-diffusion", "layered_difusion", ["[fit]", "solver 'layered_difusion' does not exist", "allowed: auto, dipole"]),
    "clear layer": ("sigma_s_prime = 2.0", "sigma_s_prime = 0", ["layer 'skin' is clear"]),
    "no free parameter": (SCENE[SCENE.index("[fit.free]") :], "", ["no free parameter was given"]),
    "free parameter that does not exist": ("fat.sigma_s_prime", "fat.thickness", ["free 'fat.thickness' does not exist", "allowed: skin.sigma_a"]),
    "free parameter without a layer": ('"fat.sigma_s_prime"', '"sigma_s_prime"', ["free 'sigma_s_prime' does not exist"]),
    "bounds that do not hold the start": ("[0.001, 1]", "[0.1, 1]", ["free 'skin.sigma_a'", "the start 0.02 lies outside its bounds 0.1 to 1"]),
    "bounds the wrong way round": ("[0.001, 1]", "[1, 0.001]", ["free 'skin.sigma_a'", "min = 1 is not below max = 0.001"]),
    "one bound": ("[0.001, 1]", "[0.001]", ["free 'skin.sigma_a'", "allowed is [min, max]"]),
    "a number for bounds": ("[0.001, 1]", "0.02", ["free 'skin.sigma_a' = 0.02", "allowed is [min, max]"]),
    "NaN bound": ("[0.001, 1]", "[nan, 1]", ["free 'skin.sigma_a'", "min = nan"]),
    "infinite bound": ("[0.001, 1]", "[0.001, inf]", ["free 'skin.sigma_a'", "max = inf"]),
    "text bound": ("[0.001, 1]", '["0.001", 1]', ["free 'skin.sigma_a'", "min = '0.001'"]),
    "negative bound": ("[0.001, 1]", "[-0.001, 1]", ["free 'skin.sigma_a'", "sigma_a can only be 0 to inf"]),
    "unknown key of a free parameter": ("[0.001, 1]", "{min = 0.001, max = 1, start = 0.1}", ["free 'skin.sigma_a'", "unknown key 'start'"]),
    "unknown scale": ("[0.001, 1]", '{min = 0.001, max = 1, scale = "lin"}', ["free 'skin.sigma_a'", "scale = 'lin'", '"linear", "log"']),
    "log scale down to 0": ("[0.001, 1]", '{min = 0, max = 1, scale = "log"}', ["free 'skin.sigma_a'", "scale log needs a min above 0"]),
    "sigma_s without g set free": ('"fat.sigma_s_prime"', '"fat.sigma_s"', ["free 'fat.sigma_s' does not exist"]),
    "one number free twice": (
        '"fat.sigma_s_prime" = [0.1, 10]',
        '"fat.sigma_s_prime" = [0.1, 10]\n"fat.sigma_s" = [1, 100]',
        ["free 'fat.sigma_s' does not exist"],
    ),
    "more parameters than data": (
        '"skin.sigma_a" = [0.001, 1]',
        '"skin.sigma_a" = [0.001, 1]\n"fat.sigma_a" = [0, 1]\n"skin.thickness" = [1, 2]',
        ["4 free parameters and 3 measured values"],
    ),
    "tie to nothing": ("[fit.free]", '[fit.ties]\n"fat.n" = "skin.m"\n[fit.free]', ["ties 'fat.n'", "'skin.m' is no number of the scene"]),
    "tie as a number": ("[fit.free]", '[fit.ties]\n"fat.n" = 3\n[fit.free]', ["ties 'fat.n' = 3", "allowed is the name of a number"]),
    "tie of half a pair": ("[fit.free]", '[fit.ties]\n"fat.n" = ["skin.n"]\n[fit.free]', ["ties 'fat.n'", "allowed is"]),
    "tie with a negative factor": ("[fit.free]", '[fit.ties]\n"fat.n" = ["skin.n", -1]\n[fit.free]', ["ties 'fat.n'", "factor = -1"]),
    "tied and free": ("[fit.free]", '[fit.ties]\n"skin.sigma_a" = "fat.sigma_a"\n[fit.free]', ["ties 'skin.sigma_a'", "it is free as well"]),
    "tied to itself": ("[fit.free]", '[fit.ties]\n"fat.n" = "fat.n"\n[fit.free]', ["ties 'fat.n'", "which is tied itself"]),
    "starts 0": ('solver = "layered-diffusion"', "starts = 0", ["[fit]", "starts = 0", "at least 1"]),
    "starts a fraction": ('solver = "layered-diffusion"', "starts = 2.5", ["[fit]", "starts = 2.5", "a whole number"]),
}
# data files, for the scene as it stands
FILES = {
    "empty file": ("", ["profile.csv: the file is empty"]),
    "unit missing": (DATA.replace("r [mm]", "r"), ["profile.csv, line 1", "header 'r' has no unit"]),
    "unit wrong": (DATA.replace("r [mm]", "r [1/mm]"), ["profile.csv, column 'r'", "unit '1/mm' does not fit"]),
    "r not increasing": (DATA.replace("\n2,", "\n5,"), ["profile.csv, line 4", "r is not increasing: number 3 is 4 after 5"]),
    "r and value exchanged": (DATA.replace("1, 0.03", "0.03, 1").replace("2, 0.01", "0.01, 2"), ["profile.csv, line 3", "r is not increasing"]),
    "text in a number column": (DATA.replace("0.01,", "saturated,"), ["profile.csv, line 3, column 'value'", "'saturated' is not a number"]),
    "sd zero": (DATA.replace("0.0001", "0"), ["profile.csv, line 4", "sd 3 is 0", "allowed is a number above 0"]),
    "frequencies for distances": (DATA.replace("r [mm]", "fx [1/mm]"), [PROBE, "columns fx, value, sd do not fit radial_reflectance"]),
    "no values": ("r [mm]\n1\n2\n", ["measurement 'probe' has no values", "column 'value'"]),
    "not a text": (b"PK\x03\x04\xff\xfe\x00", ["profile.csv: not a text in UTF-8"]),
}


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "profile.csv").write_text(DATA)
    return tmp_path


def files(folder):
    return {path.relative_to(folder): path.read_bytes() if path.is_file() else None for path in sorted(folder.rglob("*"))}


def refused(folder, parts, arguments=("fit", "scene.toml", "--out", "result")):
    """The command says so in one line with exit code 2 and writes nothing."""
    before = files(folder)
    arguments = [str(folder / a) if a in ("scene.toml", "result") else a for a in arguments]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2, (result.output, result.exception)
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) == 1 and lines[0].startswith("layerfit: "), result.stderr
    for part in parts:
        assert part in lines[0], lines[0]
    assert files(folder) == before, "something was written"


def raises(folder, parts):
    """Reading and stating the problem in Python says the same."""
    with pytest.raises(lf.InputError) as caught:
        read_scene(folder / "scene.toml").problem()
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"{folder / 'scene.toml'}: "), str(caught.value)
    for part in parts:
        assert part in str(caught.value)


@pytest.mark.parametrize("name", SCENES)
def test_scene(folder, name):
    old, new, parts = SCENES[name]
    assert old in SCENE
    (folder / "scene.toml").write_text(SCENE.replace(old, new, 1))
    raises(folder, parts)
    refused(folder, parts)


@pytest.mark.parametrize("name", FILES)
def test_data_file(folder, name):
    content, parts = FILES[name]
    (folder / "profile.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    raises(folder, parts)
    refused(folder, parts)


def test_the_scene_itself_is_right(folder):
    """What all cases above are made from."""
    problem = read_scene(folder / "scene.toml").problem()
    assert problem.names == ("skin.sigma_a", "fat.sigma_s_prime")


def test_sd_and_no_sd_together(folder):
    (folder / "other.csv").write_text("r [mm], value [1/mm^2]\n1, 0.03\n")
    text = SCENE.replace("[fit]", '[[measurement]]\nname = "other"\nkind = "radial_reflectance"\nfile = "other.csv"\n[fit]')
    (folder / "scene.toml").write_text(text)
    raises(folder, ["measurement 'other' has no sd and another one has"])
    refused(folder, ["measurement 'other' has no sd and another one has"])


def test_offset_of_a_total(folder):
    """Only distances have one."""
    (folder / "scene.toml").write_text(SCENE.replace(FROM_FILE, INLINE).replace("skin.sigma_a", "probe.offset"))
    raises(folder, ["free 'probe.offset' does not exist", "probe.amplitude, probe.background"])
    refused(folder, ["free 'probe.offset' does not exist"])


def test_offset_beyond_the_first_distance(folder):
    (folder / "scene.toml").write_text(SCENE.replace('"skin.sigma_a" = [0.001, 1]', '"probe.offset" = [-1, 1]'))
    raises(folder, ["'probe.offset': its bound -1 mm is not allowed"])


@pytest.mark.parametrize("command", ["fit", "predict"])
@pytest.mark.parametrize(("scene", "part"), [("nothing.toml", "no such file"), (".", "this is a folder"), ("profile.csv", "not TOML")])
def test_wrong_scene(folder, command, scene, part):
    out = "result" if command == "fit" else str(folder / "out.json")
    path = str(folder / scene)
    refused(folder, [path, part], (command, path, "--out", out))
    with pytest.raises(lf.InputError, match=part):
        read_scene(path)


def test_scene_that_is_no_text(folder):
    (folder / "scene.toml").write_bytes("µ".encode("utf-16"))
    raises(folder, ["not a text in UTF-8"])
    refused(folder, ["not a text in UTF-8"])


def test_scene_of_a_windows_editor(folder):
    """A byte order mark and Windows newlines are no mistake."""
    (folder / "scene.toml").write_bytes(("\ufeff" + SCENE).replace("\n", "\r\n").encode())
    assert read_scene(folder / "scene.toml").problem().names == ("skin.sigma_a", "fat.sigma_s_prime")


def test_names_without_quotes(folder):
    """TOML reads skin.sigma_a without quotes as tables; it means the same."""
    (folder / "scene.toml").write_text(SCENE.replace('"skin.sigma_a"', "skin.sigma_a").replace('"fat.sigma_s_prime"', "fat.sigma_s_prime"))
    problem = read_scene(folder / "scene.toml").problem()
    assert problem.names == ("skin.sigma_a", "fat.sigma_s_prime")
    assert [(p.low, p.high) for p in problem.parameters] == [(0.001, 1.0), (0.1, 10.0)]


def unwritable(folder):
    """Folders that not even root can write into."""
    (folder / "a file").write_text("")
    yield folder / "a file" / "result", "Not a directory"
    yield folder / "a file", "exists"
    if os.path.isdir("/proc/self"):
        yield "/proc/self/result", "No such file"


def test_unwritable_folder(folder):
    for path, _ in unwritable(folder):
        refused(folder, [f"{path}: cannot write into this folder", "give another"], ("fit", "scene.toml", "--out", str(path)))
        refused(folder, [str(path), "cannot write into this folder"], ("example", "two-layer", "--out", str(path)))


COMMANDS = {
    "unwritable file": (("predict", "scene.toml", "--out", "/proc/self/out.json"), ["/proc/self: cannot write into this folder"]),
    "folder that is not there": (("predict", "scene.toml", "--out", "{}/none/out.json"), ["none/out.json: the folder", "does not exist"]),
    "folder for a file": (("predict", "scene.toml", "--out", "{}"), ["this is a folder"]),
    "folder for the CSV": (("predict", "scene.toml", "--out", "{}/p.json", "--csv", "{}"), ["this is a folder"]),
    "result over the scene": (("predict", "scene.toml", "--out", "{}/scene.toml"), ["scene.toml: this would overwrite what was read"]),
    "result over the data": (
        ("predict", "scene.toml", "--out", "{}/p.json", "--csv", "{}/../{name}/profile.csv"),
        ["this would overwrite what was read"],
    ),
    "two results in one": (("predict", "scene.toml", "--out", "{}/p", "--csv", "{}/p"), ["this would overwrite"]),
    "noise without CSV": (("predict", "scene.toml", "--out", "{}/p.json", "--noise", "0.1"), ["--noise without --csv"]),
    "unknown solver": (
        ("predict", "scene.toml", "--out", "{}/p.json", "--solver", "magic"),
        ["solver 'magic' does not exist", "allowed: auto, dipole"],
    ),
    "unknown solver of a fit": (("fit", "scene.toml", "--out", "result", "--solver", "magic"), ["solver 'magic' does not exist"]),
    "photons without Monte Carlo": (("predict", "scene.toml", "--out", "{}/p.json", "--photons", "100"), ["--photons"]),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_command(folder, name):
    arguments, parts = COMMANDS[name]
    refused(folder, parts, tuple(a.format(folder, name=folder.name) for a in arguments))


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("fit",), "Missing argument"),
        (("fit", "scene.toml"), "Missing option '--out'"),
        (("fit", "scene.toml", "--out", "result", "--starts", "0"), "'--starts'"),
        (("predict", "scene.toml", "--out", "p.json", "--noise", "-1"), "'--noise'"),
        (("predict", "scene.toml", "--out", "p.json", "--noise", "2%"), "'2%' is not a valid float"),
        (("predict", "scene.toml", "--out", "p.json", "--seed", "x"), "'--seed'"),
        (("example", "three-layer"), "'three-layer' is not one of 'two-layer'"),
        (("fits", "scene.toml"), "No such command 'fits'"),
        (("fit", "scene.toml", "--output", "result"), "No such option"),
    ],
)
def test_usage(folder, arguments, part):
    """What click itself finds: exit code 2, and the last line says what."""
    before = files(folder)
    result = CliRunner().invoke(main, [*arguments])
    assert result.exit_code == 2
    assert part in result.stderr.splitlines()[-1]
    assert files(folder) == before
