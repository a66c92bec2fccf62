"""The pieces that layered diffusion composes, each as a `Response` of diffuse light and beam: layers, interfaces, half space, and the beam alone."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from .diffusion_layer import exponential_source_layer, half_space_emission, half_space_exponential, half_space_reflection, point_source_layer
from .response import Beamed, Response, Scalar, compose_all

Scalars = tuple[Float[Array, "*copies"], ...]  # one number, or a copy of it for each frequency


class Numbers(eqx.Module):
    """A stack as its spectrum sees it: scalars, one a layer, a face or an inner interface."""

    N: Scalars  # n^2 D [mm]
    decay2: Scalars  # sigma_a/D [1/mm^2]
    thickness: Scalars
    extinction: Scalars  # of the beam, per depth [1/mm]
    fed: Scalars  # beam to diffuse light along the way, per depth [1/mm]
    down: tuple[Scalars, Scalars]  # point sources of a beam from above: strength per unit of beam at the upper face, depth below it [mm]
    up: tuple[Scalars, Scalars]  # the same from below
    inner_beam: Scalars  # reflectances for the beam
    edge_beam: Scalars
    edge_A: Scalars
    edge_D: Scalars  # of the medium that the extrapolated boundary continues, see `beam.seen_from_above`
    edge_decay2: Scalars
    edge_n2: Scalars
    exit_fluence: Scalars
    exit_flux: Scalars
    half_space: bool = eqx.field(static=True)
    spread: bool = eqx.field(static=True)  # part of the source follows the beam
    pointed: bool = eqx.field(static=True)  # part of it is a point


def interface_piece(beam: Float[Array, "*k"]) -> Response[Beamed]:
    """Between two layers: the diffuse channels are continuous, the beam is partly reflected."""
    one, zero = jnp.ones_like(beam), jnp.zeros_like(beam)
    back, through = Beamed(zero, zero, beam), Beamed(one, zero, one - beam)
    return Response(back, back, through, through)


def beam_alone(numbers: Numbers) -> Response[Scalar]:
    """The beam alone, which knows no frequency: faces, attenuation, inner interfaces."""

    def mirror(reflectance: Float[Array, ""]) -> Response[Scalar]:
        back, through = Scalar(reflectance), Scalar(1.0 - reflectance)
        return Response(back, back, through, through)

    pieces = [mirror(numbers.edge_beam[0])]
    for i, extinction in enumerate(numbers.extinction):
        if i > 0:
            pieces.append(mirror(numbers.inner_beam[i - 1]))
        finite = i < len(numbers.thickness)
        passing = jnp.exp(-extinction * numbers.thickness[i]) if finite else jnp.zeros_like(extinction)
        none, through = Scalar(jnp.zeros_like(extinction)), Scalar(passing)
        pieces.append(Response(none, none, through, through))
    if not numbers.half_space:
        pieces.append(mirror(numbers.edge_beam[1]))
    return compose_all(pieces)


def layer_piece(numbers: Numbers, i: int, k: Float[Array, "*k"]) -> Response[Beamed]:
    one = jnp.ones_like(k)
    N, d, extinction = (one * x[i] for x in (numbers.N, numbers.thickness, numbers.extinction))
    q = k**2 + numbers.decay2[i]
    spread = exponential_source_layer(N, q, d, extinction, one * numbers.fed[i]) if numbers.spread else None
    if not numbers.pointed:
        assert spread is not None
        return spread
    down, up = ((one * strength[i], one * depth[i]) for strength, depth in (numbers.down, numbers.up))
    point = point_source_layer(N, q, d, jnp.exp(-extinction * d), down, up)
    if spread is None:
        return point

    def join(a: Beamed, b: Beamed) -> Beamed:
        return Beamed(a.diffuse, a.source + b.source, a.beam)

    return jax.tree.map(join, point, spread, is_leaf=lambda x: isinstance(x, Beamed))


def first_medium(numbers: Numbers, k: Float[Array, "*k"]) -> Beamed:
    """Reflection of a half space of the first layer's medium that no source lies in."""
    zero = jnp.zeros_like(k)
    return Beamed(half_space_reflection(numbers.N[0], k**2 + numbers.decay2[0]), zero, zero)


def first_boundary(numbers: Numbers) -> Numbers:
    """The same with the extrapolated boundary of the first medium, the one that has images."""
    return replace(
        numbers,
        edge_D=(numbers.N[0] / numbers.edge_n2[0], *numbers.edge_D[1:]),
        edge_decay2=(numbers.decay2[0], *numbers.edge_decay2[1:]),
    )


def half_space_piece(numbers: Numbers, i: int, k: Float[Array, "*k"]) -> Response[Beamed]:
    zero = jnp.zeros_like(k)
    N, q = numbers.N[i], k**2 + numbers.decay2[i]
    source = half_space_exponential(N, q, numbers.extinction[i], numbers.fed[i]) if numbers.spread else zero
    if numbers.pointed:
        strength, depth = numbers.down
        source = source + strength[i] * half_space_emission(N, q, depth[i])
    back, nothing = Beamed(half_space_reflection(N, q), source, zero), Beamed(zero, zero, zero)
    return Response(back, nothing, nothing, nothing)
