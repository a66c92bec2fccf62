"""A compiled function serves where it is called by itself and within programs and transformations."""

import jax
import jax.numpy as jnp
import pytest

from layerfit import compilation
from layerfit.compilation import compiled

square = compiled(lambda x: x**2)

CALLS = {
    "alone": lambda: square(3.0),
    "by name": lambda: compiled(lambda *, x: x**2)(x=3.0),
    "in a program": lambda: jax.jit(square)(3.0),
    "of a constant in a program": lambda: jax.jit(lambda y: y * square(3.0))(1.0),
    "its derivative": lambda: 1.5 * jax.grad(square)(3.0),
    "its derivative in a program": lambda: 1.5 * jax.jit(jax.grad(square))(3.0),
    "beside a derivative": lambda: jax.grad(lambda y: y * square(3.0))(1.0),
    "over a batch": lambda: jax.vmap(square)(jnp.array([3.0]))[0],
    "in a loop": lambda: jax.lax.scan(lambda total, _: (total + square(3.0), None), 0.0, length=1)[0],
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_it_is_the_function(call):
    assert float(call()) == 9.0


def test_it_is_compiled_quickly(monkeypatch):
    """By itself with the options, an unknown one among them here; in a program, which takes none of its own, without."""
    monkeypatch.setitem(compilation._OLDER["compiler_options"], "no_such_option", True)
    cube = compiled(lambda x: x**3)
    assert float(jax.jit(cube)(2.0)) == 8.0
    with pytest.raises(jax.errors.JaxRuntimeError, match="no_such_option"):
        cube(2.0)
