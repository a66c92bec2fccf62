"""One small fit for all tests of the report."""

import numpy as np
import pytest

import layerfit as lf


@pytest.fixture(scope="session")
def small_fit():
    """R(r) of a half space with one number at its bound, a background in 1/mm^2, and warnings."""
    r = np.linspace(1, 5, 9)
    stack = lf.Stack([lf.HalfSpace("skin", sigma_a=0.02, sigma_s_prime=1.5, n=1.4)])
    value = lf.predict(stack, lf.RadialReflectance(r=r))[0].values * (1 + 0.005 * (-1) ** np.arange(r.size))
    data = lf.Dataset(lf.RadialReflectance(r=r), value, noise=lf.Noise(0.01), name="probe")
    free = {"skin.sigma_a": (1e-3, 1), "skin.sigma_s_prime": {"min": 0.1, "max": 1.4, "init": 1}, "probe.background": (-1e-3, 1e-3)}
    return lf.fit(lf.Problem(stack, data, free=free), starts=1)
