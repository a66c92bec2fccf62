"""Layers, half spaces and stacks as values: what they hold, refuse, and how they read."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import layerfit as lf

SKIN = lf.Layer("skin", sigma_a=0.3, sigma_s=25.0, g=0.8, n=1.4, thickness=0.1, roughness=0.2)
FAT = lf.Layer("fat", sigma_a=0.005, sigma_s_prime=1.2, n=1.44, thickness=4)
DEEP = lf.HalfSpace("deep", sigma_a=0.02, sigma_s_prime=2.0, g=0.9, n=1.37)


def evaluated(text):
    return eval(text, {name: getattr(lf, name) for name in ("Layer", "HalfSpace", "Stack")})


@pytest.mark.parametrize(
    ("layer", "sigma_s", "sigma_s_prime"),
    [(SKIN, 25.0, 5.0), (FAT, None, 1.2), (DEEP, 20.0, 2.0)],
    ids=["written with sigma_s", "without g", "written with sigma_s_prime"],
)
def test_both_ways_to_write_scattering(layer, sigma_s, sigma_s_prime):
    assert layer.sigma_s is None if sigma_s is None else abs(layer.sigma_s - sigma_s) <= 1e-13
    assert abs(layer.sigma_s_prime - sigma_s_prime) <= 1e-14
    assert abs(layer.transport_mfp * (layer.sigma_a + sigma_s_prime) - 1) <= 1e-14


def test_replace_keeps_how_it_was_written():
    """sigma_s_prime of a layer written with sigma_s is set at fixed g, and the other way round."""
    changed = SKIN.replace(sigma_s_prime=10.0)
    assert not changed.reduced and abs(changed.sigma_s - 50.0) <= 1e-12 and changed.g == 0.8
    changed = DEEP.replace(sigma_s=5.0)
    assert changed.reduced and abs(changed.sigma_s_prime - 0.5) <= 1e-14 and changed.g == 0.9
    changed = SKIN.replace(g=0.5)
    assert changed.sigma_s == 25.0 and abs(changed.sigma_s_prime - 12.5) <= 1e-13
    assert DEEP.replace(g=0.5).sigma_s_prime == 2.0
    changed = SKIN.replace(g=0.5, sigma_s_prime=10.0)
    assert abs(changed.sigma_s - 20.0) <= 1e-13, "the new g holds"
    assert SKIN.sigma_s == 25.0 and SKIN.g == 0.8, "the layer itself stays"


def test_replace_others():
    changed = SKIN.replace(thickness=2, n=1.5, roughness=0, sigma_a=0)
    assert (changed.thickness, changed.n, changed.roughness, changed.sigma_a) == (2.0, 1.5, 0.0, 0.0)
    assert type(changed) is lf.Layer and type(DEEP.replace(n=1.5)) is lf.HalfSpace


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: DEEP.replace(thickness=1.0), "layer 'deep' has no number 'thickness'; allowed: sigma_a, sigma_s, sigma_s_prime, g, n, roughness"),
        (lambda: SKIN.replace(mu_a=1.0), "layer 'skin' has no number 'mu_a'"),
        (lambda: SKIN.replace(sigma_s=1.0, sigma_s_prime=1.0), "both set"),
        (lambda: FAT.replace(sigma_s=10.0), "g is unknown"),
        (lambda: lf.Layer("a", sigma_a=0.1, n=1.4, thickness=1), "neither of sigma_s and sigma_s_prime"),
        (lambda: lf.Layer("a", sigma_a=0.1, sigma_s=1, sigma_s_prime=1, g=0, n=1.4, thickness=1), "both of sigma_s and sigma_s_prime"),
        (lambda: lf.Layer("a", sigma_a=0.1, sigma_s=1, n=1.4, thickness=1), "sigma_s given without g"),
        (lambda: SKIN.replace(sigma_a=-0.1), "layer 'skin': sigma_a = -0.1: allowed is a finite number at least 0"),
        (lambda: SKIN.replace(sigma_a=np.nan), "layer 'skin': sigma_a = nan"),
        (lambda: SKIN.replace(sigma_s=np.inf), "layer 'skin': sigma_s = inf"),
        (lambda: FAT.replace(sigma_s_prime=-1), "layer 'fat': sigma_s_prime = -1.0"),
        (lambda: SKIN.replace(g=1.0), "layer 'skin': g = 1.0: allowed is a finite number at least -1 and below 1"),
        (lambda: SKIN.replace(g=-1.1), "layer 'skin': g = -1.1"),
        (lambda: SKIN.replace(n=0.0), "layer 'skin': n = 0.0: allowed is a finite number above 0"),
        (lambda: SKIN.replace(thickness=-1), "thickness = -1.0"),
        (lambda: SKIN.replace(thickness=np.inf), "a half space is written HalfSpace"),
        (lambda: SKIN.replace(roughness=-0.1), "roughness = -0.1"),
        (lambda: SKIN.replace(sigma_a="0.3"), "layer 'skin': sigma_a: '0.3' was given; allowed is a number"),
        (lambda: SKIN.replace(sigma_a=True), "True was given"),
        (lambda: SKIN.replace(sigma_a=[0.1, 0.2]), "was given; allowed is a number"),
        (lambda: SKIN.replace(sigma_a=jnp.ones(2)), "an array of shape (2,) was given"),
        (lambda: SKIN.replace(sigma_a=1j), "allowed is a number"),
        (lambda: lf.HalfSpace("a.b", sigma_a=0, sigma_s_prime=1, n=1), "layer name 'a.b'"),
        (lambda: lf.HalfSpace("", sigma_a=0, sigma_s_prime=1, n=1), "layer name ''"),
        (lambda: lf.HalfSpace("scene", sigma_a=0, sigma_s_prime=1, n=1), "other than 'scene'"),
        (lambda: lf.HalfSpace("a\nb", sigma_a=0, sigma_s_prime=1, n=1), "layer name 'a\\nb'"),
        (lambda: DEEP | SKIN, "half space 'deep' is not the last layer"),
        (lambda: SKIN | DEEP | FAT, "half space 'deep' (layer 2 of 3) is not the last layer"),
        (lambda: SKIN | SKIN, "layer name 'skin' is used 2 times"),
        (lambda: lf.Stack([]), "a stack without layers"),
        (lambda: lf.Stack([SKIN], n_above=0), "n_above = 0.0"),
        (lambda: lf.Stack([SKIN], n_below=np.nan), "n_below = nan"),
        (lambda: lf.Stack([SKIN], roughness_below=-1), "roughness_below = -1.0"),
        (lambda: (SKIN | DEEP).get("skin.mu_a"), "'skin.mu_a' is no number of this scene; allowed: skin.sigma_a, skin.sigma_s"),
        (lambda: (SKIN | DEEP).set({"deep.thickness": 1.0}), "'deep.thickness' is no number of this scene"),
        (lambda: (SKIN | FAT).get("fat.sigma_s"), "'fat.sigma_s' is no number"),
        (lambda: (SKIN | DEEP).set({"skin.sigma_a": -1.0}), "layer 'skin': sigma_a = -1.0"),
    ],
)
def test_refused(make, message):
    with pytest.raises(lf.InputError) as caught:
        make()
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_stack_of_something_else():
    with pytest.raises(TypeError):
        (SKIN | DEEP) | "fat"


def test_composing():
    stack = SKIN | FAT | DEEP
    assert [layer.name for layer in stack.layers] == ["skin", "fat", "deep"]
    assert stack.half_space and not (SKIN | FAT).half_space
    wet = lf.Stack([SKIN], n_above=1.33, n_below=1.5, roughness_below=0.1) | DEEP
    assert (wet.n_above, wet.n_below, wet.roughness_below) == (1.33, 1.5, 0.1), "the surroundings stay"
    assert (SKIN | DEEP) == (SKIN | DEEP) and (SKIN | DEEP.replace(n=1.3)) != (SKIN | DEEP)


def test_names():
    assert (FAT | DEEP).names == (
        *("fat.sigma_a", "fat.sigma_s_prime", "fat.n", "fat.thickness", "fat.roughness"),
        *("deep.sigma_a", "deep.sigma_s", "deep.sigma_s_prime", "deep.g", "deep.n", "deep.roughness"),
        *("scene.n_above", "scene.n_below", "scene.roughness_below"),
    )


def test_every_number_can_be_set_and_read():
    stack = SKIN | FAT | DEEP
    for i, name in enumerate(stack.names):
        value = 0.31 + 0.01 * i
        changed = stack.set({name: value})
        assert abs(changed.get(name) - value) <= 1e-14, name
        same = [other for other in stack.names if other.rsplit(".", 1)[0] != name.rsplit(".", 1)[0]]
        assert all(changed.get(other) == stack.get(other) for other in same), name


def test_setting_all_written_numbers_makes_any_stack():
    stack = SKIN | FAT | DEEP
    other = stack.set(dict.fromkeys(stack.written_names, 0.5))
    assert other != stack
    assert other.set({name: stack.get(name) for name in stack.written_names}) == stack


def test_frozen():
    for thing, field in ((SKIN, "sigma_a"), (DEEP, "n"), (SKIN | DEEP, "n_above")):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(thing, field, 1.0)


def test_pytrees():
    """A stack passes through jit and grad: the derivative of a conversion is the textbook one."""
    stack = SKIN | DEEP
    leaves, structure = jax.tree.flatten(stack)
    assert jax.tree.unflatten(structure, leaves) == stack
    slope = jax.jit(jax.grad(lambda x: stack.set({"skin.sigma_s_prime": x}).get("skin.sigma_s")))(5.0)
    assert abs(float(slope) - 5.0) <= 1e-12
    slope = jax.grad(lambda g: stack.set({"skin.g": g}).get("skin.sigma_s_prime"))(0.8)
    assert abs(float(slope) + 25.0) <= 1e-12


@pytest.mark.parametrize(
    "thing",
    [
        SKIN,
        FAT,
        DEEP,
        SKIN | FAT | DEEP,
        lf.Stack([SKIN]),
        lf.Stack([DEEP], n_above=1.33),
        lf.Stack([SKIN, FAT], n_below=1.5, roughness_below=0.123456789012345),
        lf.HalfSpace('it\'s "odd" \\ <b>µ', sigma_a=1 / 3, sigma_s_prime=2e-7, g=-0.5, n=1.1),
    ],
)
def test_repr_reads_back(thing):
    assert evaluated(repr(thing)) == thing
    assert "\n" not in repr(thing)


def test_repr_of_jax_numbers_reads_back():
    assert evaluated(repr(SKIN.replace(sigma_a=jnp.asarray(0.25)))) == SKIN.replace(sigma_a=0.25)
