"""The report: complete, alone, and safe."""

import dataclasses
from html.parser import HTMLParser

import pytest

import layerfit as lf
from layerfit.report.html import fit_fragment, fit_report, svg
from layerfit.report.plots import plot_fit

VOID = {"meta", "br", "img", "hr", "input", "link", "path", "rect", "use", "stop"}


class Page(HTMLParser):
    """Tags, attributes and text of a page; fails where tags do not match."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.attributes, self.text, self.open = [], [], [], []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, name, value or "") for name, value in attrs]

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open and self.open.pop() == tag, tag

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def page(small_fit):
    return fit_report(small_fit, svg(plot_fit(small_fit)), title="A title & more")


def alone(page):
    """Nothing is loaded from anywhere, nothing is executed."""
    assert not {"script", "link", "iframe", "object", "embed", "img", "base", "form"} & set(page.tags)
    for tag, name, value in page.attributes:
        assert not name.startswith("on"), (tag, name)
        if name in ("src", "href", "xlink:href", "data", "srcset", "poster", "action", "background"):
            assert value.startswith(("#", "data:")), (tag, name, value)
        for part in value.split("url(")[1:]:
            assert part.lstrip("'\" ").startswith("#"), (tag, name, value)
    style = " ".join(page.text)
    assert "@import" not in style and "url(http" not in style


def test_alone(page):
    alone(Page(page))


def test_complete(page, small_fit):
    text = " ".join(" ".join(Page(page).text).split())
    for part in (
        "A title & more",
        "converged",
        "skin.sigma_a",
        "skin.sigma_s_prime",
        "probe.background",
        "1/mm²",
        "at its bound",
        "Data and fit",
        "The sample",
        "penetration depth",
        "Correlations",
        "layered-diffusion (source mixed, boundary averaged, diffusion asymptotic, subtract True)",
        "radial_reflectance, 9 values",
        "starts",
        repr(small_fit.stack),
        repr(small_fit.problem.stack),
        f"jax {__import__('jax').__version__}",
        "Farrell",
        *small_fit.warnings,
    ):
        assert " ".join(part.split()) in text, part
    assert page.count("<svg") == 2 and page.lstrip().startswith("<!DOCTYPE html>")


def test_correlations_can_be_read(page, small_fit):
    """The numbers of the matrix, white on dark colours."""
    assert page.count("+1.00") >= 3
    for row in small_fit.correlation:
        for c in row:
            assert f">{c:+.2f}</td>" in page
            if abs(c) > 0.6:
                assert "color: white" in page


HOSTILE = "<script>alert('1')</script><img src=x onerror=alert(2)>--><b>\"&{{ 7*7 }}"


@pytest.fixture(scope="module")
def hostile_fit():
    stack = lf.Stack([lf.HalfSpace(HOSTILE.replace(".", ""), sigma_a=0.02, sigma_s_prime=1.5, n=1.4)])
    geometry = lf.SpatialFrequency([0, 0.1, 0.2])
    name = "<script>alert(1)<img src=x onerror=alert(2)>--><b>$x_{"
    data = lf.Dataset(geometry, lf.predict(stack, geometry, solver=lf.LayeredDiffusion())[0].values, noise=lf.Noise(0.01), name=name)
    return lf.fit(lf.Problem(stack, data, free={f"{HOSTILE}.sigma_a": (1e-3, 1), f"{name}.amplitude": (0.9, 1.1)}), starts=1)


def test_hostile_names(hostile_fit):
    for text in (fit_report(hostile_fit, svg(plot_fit(hostile_fit)), title=HOSTILE), fit_fragment(hostile_fit)):
        page = Page(text)
        alone(page)
        assert "b" not in [t for t in page.tags if t == "b"][1:], "one <b> is ours"
        assert HOSTILE in "".join(page.text), "the name is shown as it is written"


def test_fragment(small_fit):
    """What a notebook shows: the tables, the warnings, the drawing, the solver."""
    text = small_fit._repr_html_()
    assert text == fit_fragment(small_fit)
    page = Page(text)
    alone(page)
    said = " ".join(page.text)
    for part in ("converged", "skin.sigma_a", "at its bound", "layered-diffusion (source mixed", *small_fit.warnings):
        assert part in said
    assert "html" not in page.tags and "svg" in page.tags


def test_estimated_noise_is_said(small_fit):
    other = dataclasses.replace(small_fit, noise=0.0123)
    assert "relative noise 0.012, estimated from the fit" in " ".join(fit_fragment(other).split())
    assert "estimated from the fit" not in fit_fragment(small_fit)
