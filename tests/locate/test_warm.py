"""The start of a frame by a reference frame, against the truth and against a search from nothing."""

from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest

from jitterkit.estimators import estimate_score
from jitterkit.estimators.score import estimate_from_normal
from jitterkit.forward import expected_image
from jitterkit.instruments import load_instrument
from jitterkit.likelihood import MISFIT, Data
from jitterkit.locate import ReferenceFrame, locate_binary
from jitterkit.loci import Linear, Mvn, Shm
from jitterkit.optics import Anchor, flat_band, obstructed_circle
from jitterkit.scene import Binary
from jitterkit.simulate import simulate_frame

FLUX = 1e7


@pytest.fixture(scope="module")
def telescope():
    """One of its own: a large frame, of which a cut-out is enough, and a detector that nothing fills."""
    pupil = obstructed_circle(0.09, 0.03, noll=(7, 8), samples=160)
    small = load_instrument("smallsat")
    deep = replace(small.detector, full_well=1e7, bits=22)
    band = flat_band(530.0, 640.0, 3)
    return replace(small, pupil_from=pupil, spectrum=band, detector=deep, colours=None)


@pytest.fixture(scope="module")
def shown(telescope):
    """One frame of many, and what fits it."""
    frame = draw(telescope, Mvn.of(0.15, 0.1, 20.0), seed=1)
    return locate_binary(Data.of(frame), telescope.system()).parameters


@pytest.fixture(scope="module")
def reference(telescope, shown):
    return made(shown, telescope.system())


def made(shown, system, **options):
    return ReferenceFrame.of(shown, system, Anchor.at(system, np.round(shown.aberrations)), **options)


def draw(telescope, locus, *, seed, aberrations=(5.0, -8.0), **changes):
    """Calibrated as a command would."""
    values = {"separation": 10.0, "theta": 30.0, "x": 1.0, "y": -2.0, "flux": FLUX, "contrast": 3.37}
    rng = np.random.default_rng(seed)
    raw = simulate_frame(telescope, Binary(**values | changes), locus, aberrations=aberrations, rng=rng).raw
    return telescope.detector.calibrate(raw)


def estimated(reference, frame):
    """Blur and everything else of a frame; None where the reference frame does not show them."""
    data = frame if isinstance(frame, Data) else Data.of(frame)
    if (start := reference.locate(data)) is None:
        return None
    estimate, parameters = estimate_from_normal(start.parameters, start.otf, start.data, ())
    return (estimate, start.in_frame(parameters)) if start.misfit(parameters)[0] < MISFIT else None


def searched(telescope, frame, **system):
    """The same from nothing."""
    start = locate_binary(Data.of(frame), telescope.system(**system))
    return estimate_score(Data.of(frame), start.parameters, start.otf)


@pytest.mark.slow
def test_moments_and_places_are_those_of_the_truth(telescope, reference):
    rng, pulls = np.random.default_rng(2), []
    for seed in range(24):
        major, minor, angle = rng.uniform(0.0, 0.25), rng.uniform(0.0, 0.1), rng.uniform(0, 180)
        locus, (x, y) = Mvn.of(major, minor, angle), rng.uniform(-3, 3, 2)
        wander = np.array([5.0, -8.0]) + rng.normal(0, 0.5, 2)
        frame = draw(telescope, locus, seed=100 + seed, x=x, y=y, aberrations=wander)
        estimate, parameters = estimated(reference, frame)
        off = estimate.moments - np.asarray(locus.moments())
        pulls.append(off @ np.linalg.solve(estimate.covariance, off))
        # a photon's place scatters by 0.5 arcsec: 1e7 of them give 2e-4 along each axis
        np.testing.assert_allclose((parameters.scene.x, parameters.scene.y), (x, y), atol=1.5e-3)
    # chi-squared of 72 degrees of freedom; errors that hold a doubt about the shape make it smaller
    assert 30 < sum(pulls) < 72 + 4 * 12


@pytest.mark.parametrize("major", [0.0, 0.05, 0.2])
def test_it_agrees_with_the_estimate_from_nothing(telescope, reference, major):
    frame = draw(telescope, Mvn.of(major, major / 2, 70.0), seed=5)
    quick, _ = estimated(reference, frame)
    whole = searched(telescope, frame)
    # pixels that are left out may grow errors by 1 %: then the two differ by sqrt(1.01² - 1) = 0.14 of one
    np.testing.assert_allclose(quick.errors, whole.errors, rtol=0.04)
    np.testing.assert_array_less(np.abs(quick.moments - whole.moments), 0.5 * whole.errors)
    assert (quick.locus is None) == (whole.locus is None)


@pytest.mark.slow
def test_a_drift_has_its_length_and_its_shape(telescope, reference):
    locus = Linear.of(0.9, 35.0)
    estimate, _ = estimated(reference, draw(telescope, locus, seed=7))
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
def test_a_streak_as_large_as_the_image_is_registered_too(telescope, flux, locus):
    first = draw(telescope, Mvn.of(0.15, 0.1, 20.0), seed=1, flux=flux)
    system = telescope.system()
    reference = made(locate_binary(Data.of(first), system).parameters, system)
    frame = draw(telescope, locus, seed=11, flux=flux)
    (quick, _), whole = estimated(reference, frame), searched(telescope, frame)
    np.testing.assert_allclose(quick.errors, whole.errors, rtol=0.04)
    np.testing.assert_array_less(np.abs(quick.moments - whole.moments), 0.5 * whole.errors)
    assert quick.shape == pytest.approx(whole.shape, abs=0.5 * whole.shape_err)


def test_a_pair_far_from_the_first_is_found_there_unless_the_frame_ends(telescope, reference):
    locus = Mvn.of(0.1, 0.05, 0.0)
    estimate, parameters = estimated(reference, draw(telescope, locus, seed=8, x=7.0, y=-7.0))
    np.testing.assert_allclose((parameters.scene.x, parameters.scene.y), (7.0, -7.0), atol=2e-3)
    assert np.all(np.abs(estimate.moments - np.asarray(locus.moments())) < 5 * estimate.errors)
    assert estimated(reference, draw(telescope, locus, seed=8, x=14.0, y=-15.0)) is None


@pytest.mark.parametrize("locus", [Mvn.of(0.0), Mvn.of(0.2, 0.02, 75.0)], ids=["still", "blurred"])
def test_a_wavefront_that_moved_costs_the_moments_a_twentieth_of_an_error(telescope, shown, reference, locus):
    """Noise-free images of the optics computed anew, beyond where the anchor reaches."""
    frame, system = draw(telescope, locus, seed=11), telescope.system()
    optics = replace(reference.optics, photons=FLUX)

    def told(size, direction):
        state = np.asarray(shown.aberrations[:2]) + size * np.asarray(direction)
        truth = eqx.tree_at(lambda p: p.aberrations, shown, state).with_locus(locus)
        image = np.asarray(expected_image(truth, system.otf(state)))
        clean = replace(frame, electrons=image, mask=np.zeros(frame.shape, bool))
        return estimated(reference, clean)[0], optics.left_out(state)

    def off(estimate):
        return (estimate.moments - np.asarray(locus.moments())) / estimate.errors

    here, _ = told(0.0, (1.0, 0.0))
    for direction in ((1.0, 0.0), (0.0, -1.0), (0.6, 0.8)):
        _, sigmas = told(1.0, direction)
        end = (0.05 / sigmas) ** (1 / 3)  # where the anchor leaves out a twentieth of a sigma of the image
        for share in (0.9, 3.0):
            there, _ = told(share * end, direction)
            np.testing.assert_allclose(off(there), off(here), atol=0.05)
            np.testing.assert_allclose(there.errors, here.errors, rtol=0.06)


@pytest.mark.parametrize("major", [0.0, 0.1])
@pytest.mark.slow
def test_a_blurred_first_frame_lends_no_shape_to_sharp_ones(telescope, major):
    blurred, system = draw(telescope, Mvn.of(0.5, 0.4, 20.0), seed=20), telescope.system()
    reference = made(locate_binary(Data.of(blurred), system).parameters, system)
    accepted = 0
    for seed in range(6):
        frame = draw(telescope, Mvn.of(major, 0.6 * major, 70.0), seed=30 + seed)
        if (told := estimated(reference, frame)) is None:
            continue
        accepted += 1
        whole = searched(telescope, frame)
        assert (told[0].locus is None) == (whole.locus is None)
        np.testing.assert_allclose(told[0].errors, whole.errors, rtol=0.05)
    assert accepted >= 4


def test_what_is_asked_for_must_not_be_held(telescope, shown):
    for name in ("x", "separation", "shaped_xx", "mvn_xy"):
        assert made(shown, telescope.system(), hold=("background", name)) is None


def test_masked_and_full_pixels_are_left_out(telescope, reference):
    locus = Mvn.of(0.1, 0.05, 0.0)
    frame = draw(telescope, locus, seed=9)
    brightest = np.unravel_index(np.argmax(frame.electrons), frame.shape)
    hot = np.random.default_rng(3).random(frame.shape) < 0.01
    hot[brightest] = True
    spoilt = replace(frame, electrons=np.where(hot, 1e7, frame.electrons), mask=frame.mask | hot)
    low = replace(frame, ceiling=np.full(frame.shape, 0.8 * frame.electrons[brightest]))
    for one in (spoilt, replace(low, full=low.electrons >= low.ceiling, mask=low.electrons >= low.ceiling)):
        estimate, _ = estimated(reference, one)
        assert np.all(np.abs(estimate.moments - np.asarray(locus.moments())) < 4.5 * estimate.errors)
        censored, _ = estimated(reference, Data.of(one, censored=True))
        np.testing.assert_array_equal(censored.moments, estimate.moments)


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
def test_a_frame_of_something_else_is_distinguished_or_reported_right(telescope, reference, changes):
    told = estimated(reference, draw(telescope, Mvn.of(0.1, 0.1, 0.0), seed=10, **changes))
    if told is not None:
        _believed(told, Mvn.of(0.1, 0.1, 0.0), changes)


@pytest.mark.parametrize(
    "changes",
    [{"contrast": 1.5}, {"contrast": 6.0}, {"separation": 10.5}, {"theta": 33.0}, {"flux": 2 * FLUX}],
    ids=str,
)
def test_what_differs_and_is_believed_is_right(telescope, reference, changes):
    locus = Mvn.of(0.2, 0.05, 110.0)
    _believed(estimated(reference, draw(telescope, locus, seed=40, **changes)), locus, changes)


def _believed(told, locus, changes):
    estimate, parameters = told
    off = estimate.moments - np.asarray(locus.moments())
    assert off @ np.linalg.solve(estimate.covariance, off) < 16.3  # once in a thousand, of three degrees
    # a photon's place scatters by 0.5 arcsec: at contrast 6 the fainter star's 1.4e6 give 4.2e-4, both 4.6e-4
    assert abs(parameters.scene.separation - changes.get("separation", 10.0)) < 2e-3


@pytest.mark.parametrize(
    "system",
    [
        None,  # the common telescope, whose programs other tests compile
        pytest.param({"plate_scale": 0.75}, marks=pytest.mark.slow),
        pytest.param({"plate_scale": 0.75, "shape": (74, 74)}, marks=pytest.mark.slow),  # 405 fine samples
    ],
    ids=["small", "undersampled", "odd"],
)
def test_a_frame_of_which_no_part_is_enough_is_used_as_it_is(telescope, common_telescope, system):
    common = replace(common_telescope, detector=telescope.detector)
    other = replace(telescope, **system) if system else common
    optics, locus = other.system(), Mvn.of(0.2, 0.1, 60.0)
    first = draw(other, Mvn.of(0.15, 0.1, 20.0), seed=1)
    reference = made(locate_binary(Data.of(first), optics).parameters, optics)
    assert reference.optics.system is optics or reference.optics.system.grid.shape < optics.grid.shape
    frame = draw(other, locus, seed=5, x=0.3, y=-0.8)
    (quick, parameters), whole = estimated(reference, frame), searched(other, frame)
    np.testing.assert_allclose(quick.errors, whole.errors, rtol=0.04)
    np.testing.assert_array_less(np.abs(quick.moments - whole.moments), 0.5 * whole.errors)
    np.testing.assert_allclose((parameters.scene.x, parameters.scene.y), (0.3, -0.8), atol=2e-3)


def test_a_reference_pair_near_the_edge_is_cut_out_whole_or_not_at_all(telescope):
    """A pair off the centre of its cut-out would have light of its own come back within the rim."""
    frame, system = draw(telescope, Mvn.of(0.15, 0.1, 20.0), seed=1, x=14.5, y=-14.0), telescope.system()
    reference = made(locate_binary(Data.of(frame), system).parameters, system)
    assert reference.rim == (0, 0)
    assert reference.image.shape == system.grid.shape


def test_rows_that_are_exposed_one_after_the_other_are_not_cut_out(telescope, shown):
    rolling = eqx.tree_at(lambda p: p.shutter, shown, object(), is_leaf=lambda part: part is None)
    assert made(rolling, telescope.system()) is None
