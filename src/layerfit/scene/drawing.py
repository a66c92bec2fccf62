"""A stack drawn to scale, as SVG text."""

from html import escape
from itertools import pairwise

from .layer import Layer
from .stack import Stack

_WIDTH, _HEIGHT, _LABEL = 150, 240, 330
_SHOWN = 600.0  # nm
_LETTER = 7.5  # width that a bold letter of 12 pixels rarely exceeds on average


def stack_svg(stack: Stack) -> str:
    """The stack as an SVG: layers to scale (a thin one at least 3 pixels), darker with absorption, the beam from above; tissue at 600 nm."""
    stack = stack.at(_SHOWN) if stack.spectral else stack
    finite = [float(layer.thickness) for layer in stack.layers if isinstance(layer, Layer)]
    total = sum(finite) * (1.4 if stack.half_space else 1.0) or 1.0
    heights = [max(3.0, float(layer.thickness) / total * _HEIGHT) if isinstance(layer, Layer) else 0.28 * _HEIGHT for layer in stack.layers]
    if stack.half_space and not finite:
        heights = [float(_HEIGHT)]
    top = 34.0
    edges = [top]
    for height in heights:
        edges.append(edges[-1] + height)
    labels = _spread([(a + b) / 2 for a, b in pairwise(edges)], 30.0, top + 6)
    bottom = max(edges[-1] + 26, labels[-1] + 26)
    longest = max(len(layer.name) for layer in stack.layers) + len(" half space")
    width = _WIDTH + max(_LABEL, 24 + _LETTER * longest)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{bottom:.0f}" role="img" aria-label="layers drawn to scale" '
        'font-family="sans-serif" font-size="12">',
        '<defs><linearGradient id="deep" x1="0" y1="0" x2="0" y2="1"><stop offset="0.5" stop-color="white" stop-opacity="0"/>'
        '<stop offset="1" stop-color="white"/></linearGradient></defs>',
        f'<text x="{_WIDTH + 16}" y="{top - 14}" fill="#555">above: n = {float(stack.n_above):g}</text>',
        f'<path d="M{_WIDTH / 2} 4 V{top - 3} m-4 -7 l4 7 l4 -7" stroke="#c33" stroke-width="1.6" fill="none"/>',
    ]
    for layer, y0, y1, label in zip(stack.layers, edges[:-1], edges[1:], labels, strict=True):
        absorbing = float(layer.sigma_a) / (float(layer.sigma_a) + float(layer.sigma_s_prime) or 1.0)
        shade = int(235 - 170 * absorbing**0.35)
        color = f"rgb({min(shade + 18, 250)},{int(shade * 0.86)},{int(shade * 0.72)})"
        parts.append(f'<rect x="0" y="{y0:.1f}" width="{_WIDTH}" height="{y1 - y0:.1f}" fill="{color}" stroke="#444" stroke-width="0.8"/>')
        if not isinstance(layer, Layer):
            parts.append(f'<rect x="-1" y="{y0 + 1:.1f}" width="{_WIDTH + 2}" height="{y1 - y0 + 1:.1f}" fill="url(#deep)"/>')
        thickness = f"{float(layer.thickness):.3g} mm" if isinstance(layer, Layer) else "half space"
        numbers = f"σa {float(layer.sigma_a):.3g}, σs′ {float(layer.sigma_s_prime):.3g} /mm, n {float(layer.n):.4g}"
        if float(layer.roughness) > 0:
            numbers += f", rough {float(layer.roughness):.3g}"
        parts.append(f'<path d="M{_WIDTH} {(y0 + y1) / 2:.1f} L{_WIDTH + 12} {label:.1f}" stroke="#999" fill="none"/>')
        parts.append(f'<text x="{_WIDTH + 16}" y="{label:.1f}"><tspan font-weight="bold">{escape(layer.name)}</tspan> {thickness}</text>')
        parts.append(f'<text x="{_WIDTH + 16}" y="{label + 14:.1f}" fill="#555">{numbers}</text>')
    if not stack.half_space:
        rough = f", rough {float(stack.roughness_below):.3g}" if float(stack.roughness_below) > 0 else ""
        parts.append(f'<text x="0" y="{edges[-1] + 18:.1f}" fill="#555">below: n = {float(stack.n_below):g}{rough}</text>')
    return "".join([*parts, "</svg>"])


def _spread(wanted: list[float], gap: float, first: float) -> list[float]:
    """Label positions near the wanted ones, at least a gap apart."""
    placed: list[float] = []
    for y in wanted:
        placed.append(max(y, placed[-1] + gap if placed else first))
    return placed
