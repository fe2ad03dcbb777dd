"""Expansions that an optical system keeps for a thread."""

import pickle

import jax
import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.optics import Grid, OpticalSystem, expand, lines, obstructed_circle

PUPIL = obstructed_circle(0.1, 0.03, noll=(4, 7, 8), samples=64)


@pytest.fixture
def system():
    return OpticalSystem(PUPIL, lines(540.0, 620.0), Grid((24, 24), 0.375, 8))


def test_the_same_state_is_expanded_once(system):
    state = np.array([3.0, -2.0, 1.0])
    first = system.otf(state)
    state[0] = 4.0  # the caller's own array
    other = system.otf(state)
    assert system.otf([3.0, -2.0, 1.0]) is first
    assert system.otf(state) is other
    assert system.otf(state, derivatives=False) is not other
    assert np.array_equal(other.value, expand(PUPIL, system.spectrum, system.grid, state).value)


def test_what_was_kept_longest_ago_is_dropped(system):
    kept = [system.otf(np.full(3, float(k))) for k in range(3)]
    assert system.otf(np.full(3, 2.0)) is kept[2]
    assert system.otf(np.full(3, 1.0)) is kept[1]
    assert system.otf(np.full(3, 0.0)) is not kept[0]


def test_an_array_of_another_shape_is_refused_after_it_too(system):
    system.otf([1.0, 2.0, 3.0])
    with refused(ErrorCode.WRONG_SHAPE, "(1, 3)"):
        system.otf([[1.0, 2.0, 3.0]])


def test_nothing_is_kept_from_within_a_program(system):
    state = np.array([1.0, 2.0, 3.0])
    inside = jax.jit(lambda factor: factor * abs(system.otf(state).value[0, 1]))(1.0)
    assert float(abs(system.otf(state).value[0, 1])) == pytest.approx(float(inside), rel=1e-12)


def test_a_copy_in_another_process_begins_with_none(system):
    first = system.otf([1.0, 2.0, 3.0])
    copy = pickle.loads(pickle.dumps(system))
    assert copy.otf([1.0, 2.0, 3.0]) is not first
    assert np.array_equal(copy.otf([1.0, 2.0, 3.0]).value, first.value)
