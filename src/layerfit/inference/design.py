"""Which values tell most: greedy D-optimal design."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..measurement.geometry import Geometry
from .parameters import FreeParameter
from .uncertainty import natural_scales


class Step(eqx.Module):
    """One value chosen.

    measurement, place : whose it is, and where ("r 2.5"; "" for a total). index : its number in the measurement, from 0. bits : information
    gained, the logarithm to base 2 of how much the volume of the uncertainty shrinks. sd, relative : what is left after it, in physical units
    and as in `Knowledge` (p,).
    """

    measurement: str = eqx.field(static=True)
    place: str = eqx.field(static=True)
    index: int = eqx.field(static=True)
    bits: float = eqx.field(static=True)
    sd: np.ndarray
    relative: np.ndarray


def greedy(
    information: Float[np.ndarray, "p p"],
    rows: Float[np.ndarray, "n p"],
    where: Sequence[tuple[str, int]],
    geometries: Mapping[str, Geometry],
    parameters: Sequence[FreeParameter],
    x: Float[np.ndarray, "p"],
    count: int,
) -> tuple[Step, ...]:
    """Values in the order of what they tell, each once: the next is the one with the largest det of the information.

    information : what is known before, not singular. rows : weighted slopes of each value. Both in natural scales. where : measurement and number of
    each value. With j one of rows and C the inverse information, a value multiplies det by 1 + j^T C j.
    """
    left = list(range(len(rows)))
    scale = natural_scales(parameters, x)
    steps = []
    for _ in range(min(count, len(left))):
        known = np.linalg.inv(information)
        gains = np.einsum("np,pq,nq->n", rows[left], known, rows[left])
        best = left.pop(int(np.argmax(gains)))
        information = information + np.outer(rows[best], rows[best])
        relative = np.sqrt(np.diag(np.linalg.inv(information)))
        name, index = where[best]
        bits = 0.5 * float(np.log2(1.0 + np.max(gains)))
        steps.append(Step(name, geometries[name].place(index), index, bits, relative * scale, relative))
    return tuple(steps)
