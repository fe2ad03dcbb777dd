"""The optics about an anchor, against the optics computed anew."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from jitterkit.optics import (
    Anchor,
    AnchoredOptics,
    Grid,
    OpticalSystem,
    Pupil,
    SelfAnchoringOptics,
    expand,
    lines,
)
from jitterkit.optics.colours import Colours

STATE = np.array([3.0, -2.0, 0.0, 5.0, 1.0, -4.0, 2.0])
CHANGE = np.array([1.0, -0.5, 0.3, 0.2, 0.7, 0.1, -1.0])


@pytest.fixture(scope="module")
def system(toliman):
    return OpticalSystem(toliman, lines(540.0, 620.0), Grid((48, 48), 0.375, 8))


@pytest.fixture(scope="module")
def anchor(system):
    return Anchor.at(system, STATE)


def largest(array) -> float:
    return float(np.abs(np.asarray(array)).max())


def test_at_its_state_an_anchor_is_the_expansion_itself(system, anchor):
    here, exact = anchor.otf(STATE), system.otf(STATE)
    assert largest(here.value - exact.value) < 1e-15
    assert largest(here.jacobian - exact.jacobian) < 1e-15
    assert here.names == exact.names


@pytest.mark.parametrize(("part", "order"), [("value", 3), ("jacobian", 2)])
def test_away_from_it_value_and_derivatives_err_in_the_third_and_second_order(system, anchor, part, order):
    def error(size):
        exact = expand(system.pupil, system.spectrum, system.grid, STATE + size * CHANGE)
        return largest(getattr(anchor.otf(STATE + size * CHANGE), part) - getattr(exact, part))

    # Halving the step divides the error by 2^order, up to the next order: 2 pi 2.5/540 of 2 nm
    # in the extremes of seven modes.
    assert error(2.0) / error(1.0) == pytest.approx(2**order, rel=0.03)
    assert error(2.0) > 1e-12


def test_of_segments_that_share_no_light_the_second_derivatives_are_those_of_finite_differences():
    """Pistons of two halves, which have no product, and a mode of the transmission."""
    x = np.linspace(-1, 1, 32) * np.ones((32, 1))
    halves = np.stack([x > 0, x <= 0]).astype(float)
    pupil = Pupil((np.hypot(x, x.T) < 1).astype(float), 0.125, basis=halves, shading=x[None])
    system = OpticalSystem(pupil, lines(540.0, 620.0), Grid((16, 16), 0.375, 8))
    state, steps = np.array([3.0, 0.0, 0.0]), np.diag([1.0, 1.0, 0.01])
    anchor = Anchor.at(system, state)
    for change in steps[[0, 1, 2, 0, 0, 1]] + steps[[0, 1, 2, 1, 2, 2]]:
        before, here, after = (system.otf(state + k * change).value for k in (-1, 0, 1))
        real, imaginary = np.einsum("i,ijcyx,j->cyx", change, np.asarray(anchor.second.curvature), change)
        # both are of the size of (2 pi 2/540)², and differences err by that over 12 of it
        assert largest(before - 2 * here + after - (real + 1j * imaginary)) < (2 * np.pi * 2 / 540) ** 4 / 12


def test_second_derivatives_on_a_smaller_grid_are_those_of_the_whole_one_cut(system, anchor):
    """Colours and a shift of the wavelength included."""
    known = Colours((0.5, -0.5), 0.3, wavelength_err=5e-4)
    coloured = replace(system, colours=known, grid=replace(system.grid, pad=16))
    cut = Anchor.at(coloured, STATE).within(system.grid)
    small = Anchor.at(coloured, STATE, system.grid)
    assert cut.second.curvature.shape[:2] == (len(STATE), len(STATE) + 1)
    for part in ("curvature", "chromatic"):
        there, here = getattr(cut.second, part), getattr(small.second, part)
        assert largest(there - here) < 1e-4 * largest(there)  # steps of differences are shares of a grid
    assert small.within(system.grid).second is small.second  # 60 MB of TOLIMAN, which are not copied


def test_diffused_charge_is_in_the_anchor(system):
    blurred = replace(system, diffusion=0.1)
    here, exact = Anchor.at(blurred, STATE).otf(STATE + 0.1 * CHANGE), blurred.otf(STATE + 0.1 * CHANGE)
    assert largest(here.value - exact.value) < 1e-9 < largest(exact.value - system.otf(STATE).value)


@pytest.mark.parametrize(("size", "own"), [(1.0, True), (7.0, False), (60.0, False)])
def test_beyond_its_reach_the_optics_are_computed_again(system, anchor, size, own):
    """At 1e7 photons the reach is 1.9 nm; 7 nm is near enough for the derivatives, 60 nm for nothing."""
    optics, state = AnchoredOptics.about(system, anchor, 1e7), STATE + size * CHANGE / np.linalg.norm(CHANGE)
    here, exact = optics.otf(state), system.otf(state)
    assert (largest(here.value - exact.value) > 1e-13) is own
    slopes = largest(here.jacobian - exact.jacobian) / largest(exact.jacobian)
    assert (slopes < 1e-13) is (size == 60.0)
    assert (
        slopes < 0.02
    )  # second order, of a phase of 0.08 rad rms, and half as much again of the steepest mode
    assert optics.near(state, here).value == pytest.approx(here.value)


@pytest.mark.parametrize("sigmas", [0.05, 1.0])
def test_what_the_second_order_leaves_out_is_less_than_it_says(system, anchor, sigmas):
    """Chi-squared of all photons, in a few directions."""
    optics, rng = AnchoredOptics.about(system, anchor, 4e7), np.random.default_rng(1)
    for change in rng.normal(size=(4, 7)):
        change *= (sigmas / optics.left_out(STATE + change)) ** (1 / 3) * 0.999
        assert optics.reaches(STATE + change) is (sigmas == 0.05)
        psf = np.asarray(system.otf(STATE + change).psf())
        error = np.asarray(anchor.otf(STATE + change).psf()) - psf
        assert 0.1 * sigmas < np.sqrt(4e7 * np.sum(error**2 / psf)) < sigmas


def test_optics_that_are_asked_for_states_close_to_each_other_are_expanded_a_few_times(system, monkeypatch):
    """As exact as those that are expanded each time."""
    expanded = []
    monkeypatch.setattr(
        "jitterkit.optics.system.expand", lambda *a, **k: expanded.append(k["derivatives"]) or expand(*a, **k)
    )
    rng, photons = np.random.default_rng(3), 1e5
    own = SelfAnchoringOptics(replace(system), photons)
    for _ in range(30):
        state = STATE + rng.normal(0.0, 0.6, 7)
        before, here = len(expanded), own.otf(state)
        made, exact = len(expanded) - before, system.otf(state)
        assert largest(here.jacobian - exact.jacobian) < 0.005 * largest(exact.jacobian)
        # the error of an image of so many photons, in sigmas of the whole
        assert largest(here.value - exact.value) * np.sqrt(photons) < 0.05
        assert made <= 1
    assert sum(expanded) - 30 <= 10  # 30 are those that it is compared with
    far = own.otf(STATE + 60.0)
    np.testing.assert_array_equal(far.value, system.otf(STATE + 60.0).value)
    assert own.phase(CHANGE) == system.phase(CHANGE)


def test_optics_of_one_frame_differ_from_the_system_by_nothing_until_they_pay(system):
    own = SelfAnchoringOptics(replace(system), 1e5)
    np.testing.assert_array_equal(own.otf(STATE).value, system.otf(STATE).value)
    np.testing.assert_array_equal(own.otf(STATE, derivatives=False).value, system.otf(STATE).value)
    near = own.near(STATE + CHANGE, system.otf(STATE))
    np.testing.assert_array_equal(near.slopes, system.otf(STATE).slopes)
    assert own.system.nominal is own.nominal


def test_optics_with_a_wavefront_of_b_make_no_anchor_for_values(system, monkeypatch):
    """Its difference counts as a distance: an anchor was made by each call."""
    wide = replace(system, of_b=(system.pupil.names[1],))
    own = SelfAnchoringOptics(wide, 1e5)
    made = []
    monkeypatch.setattr(
        "jitterkit.optics.anchored.Anchor.at", lambda *a, at=Anchor.at: made.append(1) or at(*a)
    )
    for step in np.linspace(0.0, 0.5, 12):
        own.otf(np.append(STATE + step, 60.0))
        own.second_order(np.append(STATE + step, 60.0))
    assert len(made) == 1


def test_states_far_apart_in_turn_do_not_make_anchors_without_end(system, monkeypatch):
    own, made = SelfAnchoringOptics(replace(system), 1e5), []
    monkeypatch.setattr(
        "jitterkit.optics.anchored.Anchor.at", lambda *a, at=Anchor.at: made.append(1) or at(*a)
    )
    for step in np.linspace(0.0, 0.3, 12):
        for place in (0.0, 40.0, 80.0):
            own.otf(STATE + place + step)
    assert len(made) <= 3
    assert len(pickle.dumps(own)) < 2 * len(pickle.dumps(own.system))
    again = pickle.loads(pickle.dumps(own))
    assert largest(again.otf(STATE).value - own.otf(STATE).value) * np.sqrt(1e5) < 0.05


def test_asking_for_one_state_again_makes_no_anchor(system, monkeypatch):
    """Nor do states of other lengths: without what may follow the modes."""
    monkeypatch.setattr("jitterkit.optics.anchored.Anchor.at", None)
    wide = replace(system, plate_scale_sigma=1e-3)
    own = SelfAnchoringOptics(wide, 1e5)
    for state in 6 * [STATE, np.append(STATE, 0.0)]:
        np.testing.assert_array_equal(own.otf(state).value, wide.otf(state).value)
