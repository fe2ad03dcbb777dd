"""The quick score estimate against the truth, and against the one that finds everything from nothing."""

from dataclasses import replace

import equinox as eqx
import jax
import numpy as np
import pytest

from jitterkit.estimators import compare, estimate_score
from jitterkit.estimators.repeat import Repeat
from jitterkit.forward import expected_image
from jitterkit.instruments import load_instrument
from jitterkit.likelihood import Data
from jitterkit.locate import locate_binary
from jitterkit.loci import Linear, Mvn, Shm
from jitterkit.optics import obstructed_circle
from jitterkit.scene import Binary
from jitterkit.simulate import simulate_frame

FLUX = 1e7


@pytest.fixture(scope="module")
def telescope():
    """One of its own: a large frame, of which a cut-out is enough, and a detector that nothing fills."""
    pupil = obstructed_circle(0.09, 0.03, noll=(7, 8), samples=160)
    small = load_instrument("smallsat")
    deep = replace(small.detector, full_well=1e7, bits=22)
    return replace(small, pupil_from=pupil, detector=deep)


@pytest.fixture(scope="module")
def shown(telescope):
    """One frame of many, and what fits it."""
    frame = draw(telescope, Mvn.of(0.15, 0.1, 20.0), seed=1)
    return locate_binary(Data.of(frame), telescope.system()).parameters


@pytest.fixture(scope="module")
def repeat(telescope, shown):
    return Repeat.of(shown, telescope.system())


def draw(telescope, locus, *, seed, aberrations=(5.0, -8.0), **changes):
    """Calibrated as a command would."""
    values = {"separation": 10.0, "theta": 30.0, "x": 1.0, "y": -2.0, "flux": FLUX, "contrast": 3.37}
    rng = np.random.default_rng(seed)
    raw = simulate_frame(telescope, Binary(**values | changes), locus, aberrations=aberrations, rng=rng).raw
    return telescope.detector.calibrate(raw)


@pytest.mark.slow
def test_moments_and_places_are_those_of_the_truth(telescope, repeat):
    rng, pulls = np.random.default_rng(2), []
    for seed in range(24):
        major, minor, angle = rng.uniform(0.0, 0.25), rng.uniform(0.0, 0.1), rng.uniform(0, 180)
        locus, (x, y) = Mvn.of(major, minor, angle), rng.uniform(-3, 3, 2)
        wander = np.array([5.0, -8.0]) + rng.normal(0, 0.5, 2)
        frame = draw(telescope, locus, seed=100 + seed, x=x, y=y, aberrations=wander)
        estimate, parameters, _ = repeat.estimate(Data.of(frame))
        off = estimate.moments - np.asarray(locus.moments())
        pulls.append(off @ np.linalg.solve(estimate.covariance, off))
        # a photon's place scatters by 0.5 arcsec: 1e7 of them give 2e-4 along each axis
        np.testing.assert_allclose((parameters.scene.x, parameters.scene.y), (x, y), atol=1.5e-3)
    # chi-squared of 72 degrees of freedom; errors that hold a doubt about the shape make it smaller
    assert 30 < sum(pulls) < 72 + 4 * 12


@pytest.mark.parametrize("major", [0.0, 0.05, 0.2])
def test_it_agrees_with_the_estimate_from_nothing(telescope, repeat, major):
    frame = draw(telescope, Mvn.of(major, major / 2, 70.0), seed=5)
    quick, *_ = repeat.estimate(Data.of(frame))
    start = locate_binary(Data.of(frame), telescope.system())
    whole = estimate_score(Data.of(frame), start.parameters, start.otf)
    # pixels that are left out may grow errors by 1 %: then the two differ by sqrt(1.01² - 1) = 0.14 of one
    np.testing.assert_allclose(quick.errors, whole.errors, rtol=0.04)
    np.testing.assert_array_less(np.abs(quick.moments - whole.moments), 0.5 * whole.errors)
    assert (quick.locus is None) == (whole.locus is None)


@pytest.mark.slow
def test_a_drift_has_its_length_and_its_shape(telescope, repeat):
    locus = Linear.of(0.9, 35.0)
    estimate, *_ = repeat.estimate(Data.of(draw(telescope, locus, seed=7)))
    off = estimate.moments - np.asarray(locus.moments())
    assert off @ np.linalg.solve(estimate.covariance, off) < 16.3  # once in a thousand, of three degrees
    assert estimate.shape == pytest.approx(-1.2, abs=4 * estimate.shape_err)  # of a uniform density
    assert estimate.shape_err < 0.3


@pytest.mark.parametrize("flux", [pytest.param(3e5, marks=pytest.mark.slow), FLUX])
@pytest.mark.parametrize(
    "locus",
    [Linear.of(1.5, 35.0), pytest.param(Linear.of(2.1, 80.0), marks=pytest.mark.slow), Shm.of(1.2, 35.0)],
)
@pytest.mark.slow
def test_a_streak_as_large_as_the_image_repeats_too(telescope, flux, locus):
    shown = locate_binary(
        Data.of(draw(telescope, Mvn.of(0.15, 0.1, 20.0), seed=1, flux=flux)), telescope.system()
    )
    repeat = Repeat.of(shown.parameters, telescope.system())
    frame = Data.of(draw(telescope, locus, seed=11, flux=flux))
    quick, *_ = repeat.estimate(frame)
    start = locate_binary(frame, telescope.system())
    whole = estimate_score(frame, start.parameters, start.otf)
    np.testing.assert_allclose(quick.errors, whole.errors, rtol=0.04)
    np.testing.assert_array_less(np.abs(quick.moments - whole.moments), 0.5 * whole.errors)
    assert quick.shape == pytest.approx(whole.shape, abs=0.5 * whole.shape_err)


def test_a_pair_far_from_the_first_is_found_there_unless_the_frame_ends(telescope, repeat):
    locus = Mvn.of(0.1, 0.05, 0.0)
    estimate, parameters, _ = repeat.estimate(Data.of(draw(telescope, locus, seed=8, x=9.0, y=-11.0)))
    np.testing.assert_allclose((parameters.scene.x, parameters.scene.y), (9.0, -11.0), atol=2e-3)
    assert np.all(np.abs(estimate.moments - np.asarray(locus.moments())) < 5 * estimate.errors)
    assert repeat.estimate(Data.of(draw(telescope, locus, seed=8, x=14.0, y=-15.0))) is None


@pytest.mark.parametrize("locus", [Mvn.of(0.0), Mvn.of(0.2, 0.02, 75.0)], ids=["still", "blurred"])
def test_a_wavefront_that_moved_costs_the_moments_a_twentieth_of_an_error_or_there_is_no_estimate(
    telescope, shown, repeat, locus
):
    """Noise-free images of the optics computed anew, out to where the anchor no longer reaches."""
    frame, system = draw(telescope, locus, seed=11), telescope.system()
    optics = replace(repeat.optics, photons=FLUX)

    def told(size, direction):
        state = np.asarray(shown.aberrations) + size * np.asarray(direction)
        truth = eqx.tree_at(lambda p: p.aberrations, shown, state).with_locus(locus)
        image = np.asarray(expected_image(truth, system.otf(state)))
        clean = replace(frame, electrons=image, mask=np.zeros(frame.shape, bool))
        return repeat.estimate(Data.of(clean)), optics.left_out(state)

    def off(estimate):
        return (estimate.moments - np.asarray(locus.moments())) / estimate.errors

    here, _ = told(0.0, (1.0, 0.0))
    for direction in ((1.0, 0.0), (0.0, -1.0), (0.6, 0.8)):
        _, sigmas = told(1.0, direction)
        end = (0.5 / sigmas) ** (1 / 3)  # where it leaves out half a sigma of the whole image
        for share, near in ((0.45, True), (0.97, False)):
            there, _ = told(share * end, direction)
            assert there.near is near
            np.testing.assert_allclose(off(there.estimate), off(here.estimate), atol=0.05)
            np.testing.assert_allclose(there.estimate.errors, here.estimate.errors, rtol=0.06)
        assert told(1.05 * end, direction)[0] is None


@pytest.mark.parametrize("major", [0.0, 0.1])
@pytest.mark.slow
def test_a_blurred_first_frame_lends_no_shape_to_sharp_ones(telescope, major):
    blurred = draw(telescope, Mvn.of(0.5, 0.4, 20.0), seed=20)
    start = locate_binary(Data.of(blurred), telescope.system())
    repeat, locus = Repeat.of(start.parameters, telescope.system()), Mvn.of(major, 0.6 * major, 70.0)
    accepted = 0
    for seed in range(6):
        data = Data.of(draw(telescope, locus, seed=30 + seed))
        if (told := repeat.estimate(data)) is None:
            continue
        accepted += 1
        start = locate_binary(data, telescope.system())
        whole = estimate_score(data, start.parameters, start.otf)
        assert (told.estimate.locus is None) == (whole.locus is None)
        np.testing.assert_allclose(told.estimate.errors, whole.errors, rtol=0.05)
    assert accepted >= 4


def test_what_is_asked_for_must_not_be_held(telescope, shown):
    for name in ("x", "separation", "shaped_xx", "mvn_xy"):
        assert Repeat.of(shown, telescope.system(), hold=("background", name)) is None


@pytest.mark.slow
def test_a_frame_with_a_ceiling_and_one_without_go_through_one_program(telescope, repeat):
    frame = draw(telescope, Mvn.of(0.15, 0.1, 20.0), seed=9)
    free = Data.of(frame)
    data = Data(free.electrons, free.read_variance, free.used, ceiling=np.full(frame.shape, 1e6))
    assert free.ceiling is None
    alone, _ = repeat.compare([free, free])
    programs = compare._each._cache_size()
    full = np.zeros(frame.shape, bool)
    counted = Data(free.electrons, free.read_variance, free.used, ceiling=data.ceiling, full=full)
    ends = [*repeat.compare([data]), *repeat.compare([data, free]), *repeat.compare([free, data, counted])]
    assert compare._each._cache_size() == programs
    for end in ends:
        for one, other in zip(jax.tree.leaves(alone), jax.tree.leaves(end), strict=True):
            np.testing.assert_array_equal(one, other)


def test_masked_and_full_pixels_are_left_out(telescope, repeat):
    locus = Mvn.of(0.1, 0.05, 0.0)
    frame = draw(telescope, locus, seed=9)
    brightest = np.unravel_index(np.argmax(frame.electrons), frame.shape)
    hot = np.random.default_rng(3).random(frame.shape) < 0.01
    hot[brightest] = True
    spoilt = replace(frame, electrons=np.where(hot, 1e7, frame.electrons), mask=frame.mask | hot)
    low = replace(frame, ceiling=np.full(frame.shape, 0.8 * frame.electrons[brightest]))
    for one in (spoilt, replace(low, full=low.electrons >= low.ceiling, mask=low.electrons >= low.ceiling)):
        estimate, *_ = repeat.estimate(Data.of(one))
        assert np.all(np.abs(estimate.moments - np.asarray(locus.moments())) < 4.5 * estimate.errors)
        censored, *_ = repeat.estimate(Data.of(one, censored=True))
        np.testing.assert_array_equal(censored.moments, estimate.moments)


@pytest.mark.slow
def test_frames_compared_together_tell_what_each_tells_alone(telescope, repeat):
    frames = [draw(telescope, Mvn.of(0.02 * n, 0.01 * n, 8.0 * n), seed=60 + n, x=n - 9.0) for n in range(19)]
    data = [Data.of(frame) for frame in frames]  # more than are compared at a time
    brightest = np.unravel_index(np.argmax(frames[4].electrons), frames[4].shape)
    low = np.full(frames[4].shape, 0.8 * frames[4].electrons[brightest])
    data[4] = Data.of(replace(frames[4], ceiling=low, mask=frames[4].electrons >= low))
    data[7] = Data(np.zeros((64, 64)))
    data[11] = Data.of(draw(telescope, Mvn.of(0.1), seed=10, separation=13.0))
    ends = repeat.compare(data)
    assert ends[7] is None
    for n, end in enumerate(ends):
        alone, told = repeat.estimate(data[n]), None if end is None else repeat.told(end)
        assert (told is None) == (alone is None) == (n in (7, 11))
        if told is not None:
            np.testing.assert_allclose(told.estimate.moments, alone.estimate.moments, rtol=1e-5, atol=1e-8)
            np.testing.assert_allclose(told.estimate.covariance, alone.estimate.covariance, rtol=1e-4)


@pytest.mark.parametrize(
    "changes",
    [
        {"separation": 13.0},
        {"theta": 40.0},
        {"contrast": 1.02},
        {"aberrations": (5.0, 60.0)},
        {"flux": 1.0},
        {"flux": 4 * FLUX},
    ],
    ids=str,
)
def test_what_repeats_nothing_is_told_apart(telescope, repeat, changes):
    assert repeat.estimate(Data.of(draw(telescope, Mvn.of(0.1, 0.1, 0.0), seed=10, **changes))) is None


@pytest.mark.parametrize(
    "changes",
    [{"contrast": 1.5}, {"contrast": 6.0}, {"separation": 10.5}, {"theta": 33.0}, {"flux": 2 * FLUX}],
    ids=str,
)
def test_what_differs_and_is_believed_is_right(telescope, repeat, changes):
    locus = Mvn.of(0.2, 0.05, 110.0)
    estimate, parameters, _ = repeat.estimate(Data.of(draw(telescope, locus, seed=40, **changes)))
    off = estimate.moments - np.asarray(locus.moments())
    assert off @ np.linalg.solve(estimate.covariance, off) < 16.3  # once in a thousand, of three degrees
    # a photon's place scatters by 0.5 arcsec: at contrast 6 the fainter star's 1.4e6 give 4.2e-4, both 4.6e-4
    assert abs(parameters.scene.separation - changes.get("separation", 10.0)) < 2e-3


def test_small_and_undersampled_frames_are_left_to_others(telescope, shown):
    assert Repeat.of(shown, telescope.system(shape=(64, 64))) is None
    assert Repeat.of(shown, telescope.system(plate_scale=0.75)) is None
