"""A chain in a file: killed at any moment it can be read, and goes on as if nothing had happened."""

import os
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest

import layerfit as lf
from layerfit.inference.chain import FILE, chain_in_file, chain_in_memory, read_chain, read_settings
from layerfit.inference.ensemble import STATE_SIZE, run_ensemble

WALKERS, P, STEPS = 32, 3, 1500
SETTINGS = {"data": "40 numbers", "seed": "7"}
CHILD = f"""
import sys
from pathlib import Path
import emcee
sys.path.insert(0, {os.path.dirname(__file__)!r})
from test_chain import steps
print("ready", flush=True)
for count in steps(Path(sys.argv[1])):
    print(count, flush=True)
"""


def density(x):
    return -0.5 * np.sum(((x - [1.0, 2.0, 3.0]) * [1.0, 3.0, 9.0]) ** 2, axis=1)


def walk(chain):
    begin = np.random.default_rng(1).standard_normal((WALKERS, P))
    for _ in run_ensemble(density, begin, chain, 7):
        yield chain.count
        if chain.count >= STEPS:
            return


def steps(path):
    return walk(chain_in_file(path, SETTINGS, STEPS, WALKERS, P, STATE_SIZE))


@pytest.fixture(scope="module")
def undisturbed():
    chain = chain_in_memory(STEPS, WALKERS, P, STATE_SIZE)
    for _ in walk(chain):
        pass
    return chain


def kill_often(path, undisturbed, kills, seed):
    """Run it, kill it after a random number of steps and a moment, and so on; then to the end. How far it had come at each kill."""
    rng = np.random.default_rng(seed)
    counts = []
    for _ in range(kills):
        with subprocess.Popen([sys.executable, "-c", CHILD, str(path)], stdout=subprocess.PIPE, text=True) as child:
            assert child.stdout is not None
            assert child.stdout.readline() == "ready\n"
            said = [int(child.stdout.readline() or STEPS) for _ in range(rng.integers(0, 1.5 * STEPS / kills))]
            time.sleep(float(rng.uniform(0.0, 0.004)))
            child.send_signal(signal.SIGKILL)
            said += [int(line) for line in child.stdout.read().split("\n")[:-1]]
        if not path.exists():  # it was killed before the file was there
            continue
        chain = read_chain(path)
        counts.append(chain.count)
        assert chain.count >= max(said, default=0), "no step is lost that was done"
        assert chain.count <= max(said, default=0) + 2
        assert np.array_equal(chain.x, undisturbed.x[: chain.count])
        assert read_settings(path) == SETTINGS
        with h5py.File(path) as file:
            assert file["x"].shape == (STEPS, WALKERS, P)
    for _ in steps(path):
        pass
    return counts


@pytest.mark.parametrize(("kills", "seed"), [(3, 0), pytest.param(10, 1, marks=pytest.mark.long)])
def test_killed_and_resumed(tmp_path, undisturbed, kills, seed):
    """Not only the distribution: every step is the one that an undisturbed run takes."""
    counts = kill_often(tmp_path / FILE, undisturbed, kills, seed)
    assert counts == sorted(counts) and any(0 < count < STEPS for count in counts), counts
    chain = read_chain(tmp_path / FILE)
    assert np.array_equal(chain.x, undisturbed.x)
    assert np.array_equal(chain.log_density, undisturbed.log_density)


def test_a_step_half_written_does_not_count(tmp_path):
    """Whatever a step had written before the head, the chain is the one before it, its state too."""
    chain = chain_in_file(tmp_path / FILE, SETTINGS, 10, 4, 2, 16)
    for i in range(3):
        chain.append(np.full((1, 4, 2), i), np.full((1, 4), i), np.zeros((1, 4)), bytes([i] * 16))
    head = chain._arrays["head"].copy()
    chain.append(np.full((2, 4, 2), 9.0), np.full((2, 4), 9.0), np.zeros((2, 4)), bytes([9] * 16))
    chain._arrays["head"][:] = head
    found = read_chain(tmp_path / FILE)
    assert found.count == 3 and np.max(found.x) == 2.0 and found.state == bytes([2] * 16)


def test_more_room(tmp_path):
    """A chain that is to be longer keeps its steps and its state."""
    chain = chain_in_file(tmp_path / FILE, SETTINGS, 3, 4, 2, 16)
    for i in range(3):
        chain.append(np.full((1, 4, 2), i), np.full((1, 4), i), np.ones((1, 4)), bytes([i] * 16))
    chain.close()
    longer = chain_in_file(tmp_path / FILE, SETTINGS, 7, 4, 2, 16)
    assert (longer.count, longer.capacity, longer.state) == (3, 7, bytes([2] * 16))
    longer.append(np.full((1, 4, 2), 3.0), np.full((1, 4), 3), np.ones((1, 4)), bytes([3] * 16))
    assert np.array_equal(longer.x[:, 0, 0], [0, 1, 2, 3])


def test_other_settings_are_named(tmp_path):
    chain_in_file(tmp_path / FILE, SETTINGS, 3, 4, 2, 16).close()
    with pytest.raises(lf.InputError, match=r"chain.h5.*made with seed = 7, now it is 8"):
        chain_in_file(tmp_path / FILE, SETTINGS | {"seed": "8"}, 3, 4, 2, 16)


def test_no_chain_is_named(tmp_path):
    (tmp_path / FILE).write_text("nothing")
    with pytest.raises(lf.InputError, match=r"chain.h5: not a chain"):
        chain_in_file(tmp_path / FILE, SETTINGS, 3, 4, 2, 16)


def test_two_writers_are_refused(tmp_path):
    chain = chain_in_file(tmp_path / FILE, SETTINGS, 3, 4, 2, 16)
    with pytest.raises(lf.InputError, match="another program is writing it"):
        chain_in_file(tmp_path / FILE, SETTINGS, 3, 4, 2, 16)
    chain.close()
    chain_in_file(tmp_path / FILE, SETTINGS, 3, 4, 2, 16).close()
