"""A sample that is measured together with the one asked for."""

from collections.abc import Sequence

import equinox as eqx

from ..errors import InputError
from ..measurement.dataset import Dataset
from ..scene.stack import Stack


class Reference(eqx.Module):
    """A phantom measured with the same instrument: it tells the calibration, as well as its own numbers are known.

    stack : its layers, whose names differ from those of the sample. data : one dataset or more, with names of their own.

    Its numbers are free or held like the sample's, their uncertainty given by priors; ties make the calibration of its measurements that of the
    sample's:

    >>> import layerfit as lf
    >>> probe = lf.RadialReflectance(r=[1, 2, 4, 8])
    >>> skin = lf.Stack([lf.HalfSpace("skin", sigma_a=0.01, sigma_s_prime=1, n=1.4)])
    >>> phantom = lf.Stack([lf.HalfSpace("phantom", sigma_a=0.01, sigma_s_prime=1, n=1.5)])
    >>> noise = lf.Noise(relative=0.02)
    >>> problem = lf.Problem(
    ...     skin,
    ...     lf.Dataset(probe, [0.0415, 0.0169, 0.0036, 0.0005], noise=noise, name="probe"),
    ...     reference=lf.Reference(phantom, lf.Dataset(probe, [0.0413, 0.0173, 0.0041, 0.0007], noise=noise, name="check")),
    ...     free={
    ...         "skin.sigma_a": (1e-3, 1),
    ...         "skin.sigma_s_prime": (0.1, 10),
    ...         "phantom.sigma_a": {"min": 5e-3, "max": 2e-2, "prior": lf.Normal(0.01, 3e-4)},
    ...         "phantom.sigma_s_prime": {"min": 0.5, "max": 2, "prior": lf.Normal(1.0, 0.03)},
    ...         "probe.amplitude": (0.2, 5),
    ...     },
    ...     ties={"check.amplitude": "probe.amplitude"},
    ... )
    >>> lf.fit(problem).parameters["probe.amplitude"].value > 1
    True
    """

    stack: Stack
    data: tuple[Dataset, ...]

    def __init__(self, stack: Stack, data: Dataset | Sequence[Dataset]):
        self.stack = stack if isinstance(stack, Stack) else Stack((stack,))
        self.data = (data,) if isinstance(data, Dataset) else tuple(data)
        if not self.data:
            raise InputError("a reference without data was given; allowed is one dataset or more")
