"""The picture of a stack in a notebook."""

import itertools
from xml.etree import ElementTree

import pytest

import layerfit as lf

SVG = "{http://www.w3.org/2000/svg}"


def layer(name, thickness, **changes):
    return lf.Layer(name, **{"sigma_a": 0.01, "sigma_s_prime": 1.0, "n": 1.4, "thickness": thickness, **changes})


DEEP = lf.HalfSpace("deep", sigma_a=0.02, sigma_s_prime=2, n=1.37)


def drawn(stack):
    return ElementTree.fromstring(stack._repr_html_())


def boxes(stack):
    """Top and height of each layer's rectangle."""
    return [(float(r.get("y")), float(r.get("height"))) for r in drawn(stack).iter(f"{SVG}rect") if r.get("stroke")]


def texts(stack):
    return ["".join(t.itertext()) for t in drawn(stack).iter(f"{SVG}text")]


def test_to_scale():
    """Heights are as the thicknesses, layers touch, top first."""
    (y1, h1), (y2, h2), (y3, h3), (y4, _) = boxes(layer("a", 1.0) | layer("b", 3.0) | layer("c", 0.1) | DEEP)
    assert abs(h2 / h1 - 3.0) <= 0.01 and abs(h3 / h1 - 0.1) <= 0.002
    assert abs(y1 + h1 - y2) <= 0.11 and abs(y2 + h2 - y3) <= 0.11 and abs(y3 + h3 - y4) <= 0.11


def test_thin_layer_is_visible():
    (_, thin), (_, thick) = boxes(lf.Stack([layer("a", 1e-6), layer("b", 5.0)]))
    assert thin >= 3.0 and thick > 100.0


def test_what_is_written():
    found = " ".join(texts(lf.Stack([layer("a", 0.25, roughness=0.2), layer("b", 2.0)], n_above=1.33, n_below=1.5, roughness_below=0.15)))
    for text in ("above: n = 1.33", "below: n = 1.5, rough 0.15", "a 0.25 mm", "b 2 mm", "σa 0.01, σs′ 1 /mm, n 1.4, rough 0.2"):
        assert text in found
    assert "half space" in " ".join(texts(layer("a", 1) | DEEP)) and "below" not in " ".join(texts(layer("a", 1) | DEEP))


def test_darker_with_absorption():
    def shade(stack):
        return next(r.get("fill") for r in drawn(stack).iter(f"{SVG}rect"))

    def brightness(sigma_a):
        return sum(int(c) for c in shade(lf.Stack([layer("a", 1, sigma_a=sigma_a)]))[4:-1].split(","))

    assert brightness(0.0) > brightness(0.01) > brightness(1.0) > brightness(100.0)


@pytest.mark.parametrize(
    "stack",
    [
        lf.Stack([DEEP]),
        lf.Stack([layer("a", 0.0), layer("b", 0.0)]),
        lf.Stack([layer("vacuum", 1.0, sigma_a=0.0, sigma_s_prime=0.0)]),
        lf.Stack([layer(f"layer {i}", 0.001 if i % 2 else 1.0) for i in range(12)]),
        layer("hair", 1e-5) | DEEP,
    ],
    ids=["half space", "no thickness", "vacuum", "many layers", "thin over deep"],
)
def test_nothing_is_cut_off_or_on_top_of_another(stack):
    svg = drawn(stack)
    height, width = float(svg.get("height")), float(svg.get("width"))
    positions = []
    for text in svg.iter(f"{SVG}text"):
        x, y = float(text.get("x")), float(text.get("y"))
        assert 0 <= x <= width and 10 <= y <= height - 2, "".join(text.itertext())
        positions.append((x, y))
    assert len(set(positions)) == len(positions)
    labels = sorted(y for x, y in positions if x > 0)
    assert all(b - a >= 12.0 for a, b in itertools.pairwise(labels))
    for y, h in boxes(stack):
        assert y + h <= height


def test_long_name_stays_inside():
    """A long name makes the picture wider instead of running out of it: letters of 12 pixels are 6.5 wide on average."""
    svg = drawn(layer("a rather long name, as in the stratum corneum of the volar forearm", 1) | DEEP)
    for text in svg.iter(f"{SVG}text"):
        assert float(text.get("x")) + 6.5 * len("".join(text.itertext())) <= float(svg.get("width"))


def test_hostile_name_is_escaped():
    name = "<script>alert('&\"')</script>"
    text = (layer(name, 1) | DEEP)._repr_html_()
    assert "<script" not in text
    assert any(name in t for t in texts(layer(name, 1) | DEEP))
