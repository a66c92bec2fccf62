"""Light inside the sample: fluence at a depth, power absorbed in each layer. By layered diffusion here; see `ordinate_interior`."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ..errors import InputError
from ..measurement.geometry import Incidence, RadialReflectance
from ..optics.hankel import Span, quadrature
from ..scene.columns import to_columns
from ..scene.layer import Layer
from ..scene.stack import Stack
from ..solver import Domain
from .diffusion_layer import decay_rate
from .diffusion_pieces import Numbers, Scalars, first_boundary, first_medium
from .discrete_ordinates import DiscreteOrdinates
from .images import Images
from .layered_diffusion import LayeredDiffusion
from .ordinate_interior import check_no_distance, ordinate_absorbed, ordinate_fluence
from .response import Beamed, between, compose, compose_all, excess_reflection, reflection


def fluence(
    stack: Stack, depth: Any, *, r: Any = None, incidence: Incidence = "normal", solver: LayeredDiffusion | DiscreteOrdinates | None = None
) -> Float[Array, "depths"] | Float[Array, "depths r"]:
    """Fluence per unit incident power.

    depth : [mm], 0 or more, inside the sample. r : distances from a pencil beam [mm], above 0; the fluence is then in [1/mm^2]. Without r it is
    integrated over each plane [1], which is also the fluence under wide, even light of irradiance 1. incidence : "normal", an angle in the medium
    above [degrees] or "diffuse". solver : by default LayeredDiffusion, which gives that of the diffuse light, at normal incidence;
    DiscreteOrdinates gives that of all light, the unscattered beam included, without r.

    Raises InputError for a depth outside the sample, and for what the solver cannot do.

    >>> import layerfit as lf
    >>> lf.fluence(lf.Stack([lf.HalfSpace("skin", sigma_a=0.01, sigma_s_prime=1, n=1.4)]), [0, 5]).round(3)
    Array([3.519, 2.689], dtype=float64)
    """
    solver = LayeredDiffusion() if solver is None else solver
    depths = np.atleast_1d(np.asarray(depth, dtype=float))
    bottom = sum(float(layer.thickness) for layer in stack.layers if isinstance(layer, Layer))
    if not np.all(np.isfinite(depths)) or depths.min() < 0 or (not stack.half_space and depths.max() > bottom):
        raise InputError(f"fluence: depth = {depths.tolist()}; allowed is 0 to {'any depth' if stack.half_space else f'{bottom:g}'} mm")
    if isinstance(solver, DiscreteOrdinates):
        check_no_distance(r)
        return ordinate_fluence(solver, stack, _locate(stack, depths), incidence)
    _check_normal(incidence)
    columns = to_columns(stack)
    numbers = solver.numbers(columns)
    index = columns.n**2
    if r is None:
        where, inside = (np.array(part) for part in zip(*_locate(stack, depths), strict=True))
        found = jnp.zeros(depths.shape)
        for i in np.unique(where).tolist():
            here = where == i
            phi = jax.vmap(lambda z, i=i: spectral_fluence(solver, numbers, i, z, jnp.zeros(())))(jnp.asarray(inside[here]))
            found = found.at[here].set(index[i] * phi)
        return found
    geometry = RadialReflectance(r)
    imaged = solver.images(columns, geometry) is not None
    k_low = solver.span(Domain(stack, columns, columns)).k_low
    profiles = []
    for (i, z), z_total in zip(_locate(stack, depths), depths, strict=True):
        without = imaged and i == 0
        rule = quadrature(geometry.kernel(), Span(k_low, 38.0 / _nearest(stack, numbers, float(z_total)), True))
        weights, k = jnp.asarray(rule.weights), jnp.asarray(rule.k)
        profile = weights @ spectral_fluence(solver, numbers, i, z, k, without_images=without)
        profiles.append(index[i] * (profile + fluence_images(numbers, z).profile(geometry) if without else profile))
    return jnp.stack(profiles)


def absorbed(stack: Stack, *, incidence: Incidence = "normal", solver: LayeredDiffusion | DiscreteOrdinates | None = None) -> dict[str, float]:
    """Power absorbed in each layer per unit incident power, by layer name: sigma_a times the fluence, and what of the beam is absorbed unscattered.

    Computed without integrals: what the layer's sources emit and does not leave it. With R and T, specular included, all of it makes 1 where
    energy is conserved: by DiscreteOrdinates, and by LayeredDiffusion (the default) with boundary="partial_current" - with its other boundaries the
    exitance differs from the flux by some percent. Shares of the incident power [1].

    incidence : as in `fluence`. Raises InputError for stacks the solver cannot do, and for other light than normal with LayeredDiffusion.

    >>> import layerfit as lf
    >>> skin = lf.Layer("top", sigma_a=0.3, sigma_s_prime=5, n=1.4, thickness=0.5) | lf.HalfSpace("deep", sigma_a=0.02, sigma_s_prime=2, n=1.4)
    >>> {name: round(power, 4) for name, power in lf.absorbed(skin).items()}
    {'top': 0.4575, 'deep': 0.1285}
    """
    solver = LayeredDiffusion() if solver is None else solver
    if isinstance(solver, DiscreteOrdinates):
        return ordinate_absorbed(solver, stack, incidence)
    _check_normal(incidence)
    columns = to_columns(stack)
    numbers = solver.numbers(columns)
    unscattered = columns.sigma_a / columns.sigma_t_prime
    powers = {}
    for i, layer in enumerate(stack.layers):
        down, up = _currents(solver, numbers, i, 0.0, jnp.zeros(()))
        if i < len(numbers.thickness):
            down_out, up_in = _currents(solver, numbers, i, numbers.thickness[i], jnp.zeros(()))
        else:
            down_out = up_in = down.zero()
        beam = down.beam - up.beam - down_out.beam + up_in.beam  # what the beam loses here
        points = down.beam * numbers.down[0][i] + up_in.beam * numbers.up[0][i]
        net = down.source - up.source - down_out.source + up_in.source
        powers[layer.name] = float(net + points + beam * (numbers.fed[i] / numbers.extinction[i] + unscattered[i]))
    return powers


def _check_normal(incidence: Incidence) -> None:
    if incidence not in ("normal", 0, 0.0):
        raise InputError(f'incidence = {incidence!r} with solver layered-diffusion; allowed is "normal" (solver discrete-ordinates takes others)')


def _nearest(stack: Stack, numbers: Numbers, depth: float) -> float:
    """Distance from a depth to the nearest plane where the fluence bends: faces and the point source. The spectrum decays over it."""
    tops = np.cumsum([0.0, *(float(d) for d in numbers.thickness)])
    source = [t + float(z) for t, z, s in zip(tops, numbers.down[1], numbers.down[0], strict=False) if float(s) > 0]
    planes = np.concatenate([tops, source, [1.0 / max(float(e) for e in numbers.extinction)]])
    gaps = np.abs(planes - depth)
    gaps[-1] = planes[-1]
    return float(np.min(gaps[gaps > 1e-9 * planes.max()]))


def _locate(stack: Stack, depths: np.ndarray) -> list[tuple[int, float]]:
    """Layer and depth within it."""
    tops = np.cumsum([0.0] + [float(layer.thickness) for layer in stack.layers if isinstance(layer, Layer)])
    tops = tops[: len(stack.layers)]
    found = np.clip(np.searchsorted(tops, depths, side="right") - 1, 0, len(tops) - 1)
    return [(int(i), float(z - tops[i])) for i, z in zip(found, depths, strict=True)]


def _cut(numbers: Numbers, i: int, z: Any) -> Numbers:
    """The same stack with layer i cut in two at depth z below its upper face."""
    extinction = numbers.extinction[i]
    finite = i < len(numbers.thickness)
    below = numbers.thickness[i] - z if finite else None

    def twice(values: Scalars) -> Scalars:
        return (*values[: i + 1], *values[i:])

    def at(values: Scalars, upper: Any, lower: Any) -> Scalars:
        return (*values[:i], upper, lower, *values[i + 1 :])

    strength, depth = numbers.down[0][i], numbers.down[1][i]
    in_upper = depth <= z
    down = (
        at(numbers.down[0], jnp.where(in_upper, strength, 0.0), jnp.where(in_upper, 0.0, strength * jnp.exp(extinction * z))),
        at(numbers.down[1], jnp.where(in_upper, depth, 0.0), jnp.where(in_upper, 0.0, depth - z)),
    )
    up = (twice(numbers.up[0]), twice(numbers.up[1]))  # a half space has none
    if below is not None:
        strength, depth = numbers.up[0][i], numbers.up[1][i]
        in_lower = depth <= below
        up = (
            at(numbers.up[0], jnp.where(in_lower, 0.0, strength * jnp.exp(extinction * below)), jnp.where(in_lower, strength, 0.0)),
            at(numbers.up[1], jnp.where(in_lower, 0.0, depth - below), jnp.where(in_lower, depth, 0.0)),
        )
    upper = jnp.asarray(z, dtype=float)
    return replace(
        numbers,
        N=twice(numbers.N),
        decay2=twice(numbers.decay2),
        thickness=at(numbers.thickness, upper, below) if below is not None else (*numbers.thickness, upper),
        extinction=twice(numbers.extinction),
        fed=twice(numbers.fed),
        down=down,
        up=up,
        inner_beam=(*numbers.inner_beam[:i], jnp.zeros(()), *numbers.inner_beam[i:]),
    )


def _parts(solver: LayeredDiffusion, numbers: Numbers, i: int, z: Any, k: Float[Array, "*k"]):
    """Pieces above and below depth z of layer i."""
    pieces = solver.pieces(_cut(numbers, i, z), k)
    split = 2 * (i + 1)  # face, layer, interface, layer, ...: the new interface belongs to the lower part
    return pieces[:split], pieces[split:]


def _currents(solver: LayeredDiffusion, numbers: Numbers, i: int, z: Any, k: Float[Array, "*k"]) -> tuple[Beamed, Beamed]:
    """Light going down and up at depth z of layer i, for a beam of power 1 from above."""
    above, below = _parts(solver, numbers, i, z, k)
    lower = reflection(below)
    down = between(compose_all(above), lower)
    return down, lower @ down


def spectral_fluence(
    solver: LayeredDiffusion, numbers: Numbers, i: int, z: Any, k: Float[Array, "*k"], *, without_images: bool = False
) -> Float[Array, "*k"]:
    """Fluence over n^2 at depth z of layer i, at spatial frequency k; without that of a half space of the first medium if asked (i = 0)."""
    if not without_images:
        down, up = _currents(solver, numbers, i, z, k)
        return 2.0 * (down.source + up.source)
    above, below = _parts(solver, numbers, 0, z, k)
    upper, reference = compose_all(above), first_medium(numbers, k)
    if len(below) == 2:  # interface and half space: the first medium goes on for ever
        return jnp.zeros_like(k)
    rest = compose(*below[:2])
    excess = excess_reflection(rest, reflection(below[2:]), reference)
    lower, without = reflection(below), rest.R_above + rest.T_up @ reference @ between(rest, reference)
    # what the true lower part sends up beyond the reference, and what of it the upper part returns
    more_up = lower.bounce(upper.R_below) @ excess @ between(upper, without)
    more = more_up + upper.R_below @ more_up
    textbook = compose_all(_parts(solver, first_boundary(numbers), 0, z, k)[0])
    down, down_textbook = between(upper, without), between(textbook, without)
    change = (down + without @ down) - (down_textbook + without @ down_textbook)
    return 2.0 * (more.source + change.source)


def fluence_images(numbers: Numbers, z: float) -> Images:
    """Fluence over n^2 at depth z in a half space of the first medium (extrapolated boundary, point source)."""
    strength, depth = numbers.down[0][0] * (1.0 - numbers.edge_beam[0]), numbers.down[1][0]
    image = depth + z + 4.0 * numbers.edge_A[0] * first_boundary(numbers).edge_D[0]
    fluence = 0.5 * strength / numbers.N[0] * jnp.array([1.0, -1.0])
    return Images(jnp.stack([jnp.abs(depth - z), image]), jnp.zeros(2), fluence, decay_rate(numbers.decay2[0]))
