"""Moments where aberrations show by their squares, against images by direct sums."""

from dataclasses import replace

import numpy as np
import pytest
from own_images import drift, pupil_places, star_image

from jitterkit.batch import steps
from jitterkit.estimators import estimate_score
from jitterkit.forward import Parameters
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.likelihood import Data
from jitterkit.locate import locate_star
from jitterkit.loci import Mvn
from jitterkit.optics import Anchor, AnchoredOptics, obstructed_circle
from jitterkit.refit import FitOptions, Priors, Status, fit_best_locus, fit_frame
from jitterkit.refit.squares import with_free_squares
from jitterkit.scene import Star

LIGHT = 2e5


@pytest.fixture(scope="module")
def symmetric(telescope):
    """Focus and astigmatism of the common pupil, which is its own mirror image."""
    pupil = obstructed_circle(0.125, 0.04, samples=64, noll=(4, 5, 6))
    return replace(telescope, pupil_from=lambda: pupil).system()


def image(focus, blur=((0, 0, 1.0),)):
    """A star of a focus [nm], or of less light than none for a focus whose square is negative."""
    x, y = pupil_places()
    shape = np.sqrt(3) * (2 * (x**2 + y**2) - 1)

    def with_focus(nm):
        return star_image(0.6, -1.1, LIGHT, blur, opd=nm * shape)

    if focus >= 0:
        return with_focus(focus) + 2.0
    still = with_focus(0.0)
    return still - (with_focus(-focus) + with_focus(focus) - 2 * still) / 2 + 2.0


def fitted(pixels, optics, options=None, state=(4.0, -3.0, 3.0)):
    start = Parameters(Star(0.62, -1.08, 0.98 * LIGHT), Mvn.near(np.full(3, 1e-3)), state)
    return fit_frame(Data(pixels, 9.0), optics, start, options=options)


def off(result):
    estimated = isinstance(result, KernelEstimate)
    moments, covariance = (result.moments, result.covariance) if estimated else result.moments()
    return moments / np.sqrt(np.diag(covariance))


def freed(result, pixels, optics, options=None):
    return with_free_squares(result, Data(pixels, 9.0), optics, options or FitOptions())


def test_noise_that_asks_for_a_negative_square_is_not_taken_from_the_jitter(symmetric):
    pixels = image(-6.0)
    plain = fitted(pixels, symmetric, state=np.zeros(3))
    result = freed(plain, pixels, symmetric)
    assert np.all(off(plain)[[0, 2]] < -1.0)
    assert np.all(np.abs(off(result)) < 0.1)
    assert np.all(np.diag(result.moments()[1]) > np.diag(plain.moments()[1]))
    assert np.all(np.linalg.eigvalsh(result.covariance) > 0)
    assert result.image is plain.image


def test_an_estimate_does_not_take_it_from_the_jitter_either(symmetric):
    data = Data(image(-6.0), 9.0)
    fit = fitted(data.electrons, symmetric, state=np.zeros(3)).parameters
    low, right = (
        estimate_score(data, fit, symmetric.otf(fit.aberrations), optics=optics)
        for optics in (None, symmetric)
    )
    assert np.all(off(low)[[0, 2]] < -1.0)
    assert np.all(np.abs(off(right)) < 0.1)
    assert np.all(np.diag(right.covariance) > np.diag(low.covariance))


@pytest.mark.parametrize("shape", [None, pytest.param(-1.2, marks=pytest.mark.slow)])
def test_an_estimate_of_a_drift_is_right_with_free_squares(shape, symmetric):
    """Of a blur whose shape is fitted with its moments, or known."""
    light, truth = 1e6, 0.9**2 / 12 * np.array([0.75, np.sqrt(3) / 4, 0.25])
    data = Data(star_image(0.6, -1.1, light, drift(0.9, 30)) + 2.0, 9.0)
    start = Parameters(Star(0.62, -1.08, light), Mvn.of(0.1), (4.0, -3.0, 3.0))
    fit = fit_frame(data, symmetric, start).parameters
    otf = symmetric.otf(fit.aberrations)
    found = estimate_score(data, fit, otf, shape=shape, optics=symmetric)
    assert np.all(np.abs(found.moments - truth) < 0.3 * np.sqrt(np.diag(found.covariance)))
    assert found.moments == pytest.approx(np.asarray(found.locus.moments()))


@pytest.mark.parametrize("focus", [0.0, 6.0, 60.0])
@pytest.mark.parametrize("held", [False, True])
def test_moments_are_right_whether_a_focus_is_seen_or_not(focus, held, symmetric):
    """Also where a fit that begins without aberrations cannot free them."""
    pixels = image(focus)
    plain = fitted(pixels, symmetric, state=np.zeros(3) if held and focus < 10 else (focus + 4.0, -3.0, 3.0))
    result = freed(plain, pixels, symmetric)
    assert result.status is Status.OK
    assert np.all(np.abs(off(result)) < 0.15)


def test_a_focus_that_is_real_is_no_jitter_by_optics_about_it(symmetric):
    """Those of the later frames of a run: a step from no focus at all would start too far off."""
    x, y = pupil_places()
    light, state = 1e4, np.array([28.0, 0.0, 0.0])
    opd = 28.0 * np.sqrt(3) * (2 * (x**2 + y**2) - 1)
    pixels = star_image(0.6, -1.1, light, ((0, 0, 1.0),), opd=opd) + 2.0
    optics = AnchoredOptics.about(symmetric, Anchor.at(symmetric, state), light)
    start = Parameters(Star(0.6, -1.1, light), Mvn.near(np.full(3, 1e-3)), state)
    plain = fit_frame(Data(pixels, 9.0), optics, start)
    result = freed(plain, pixels, optics)
    assert result is not plain
    assert np.all(np.abs(off(result)) < 0.005)


def test_noise_that_asks_for_a_negative_square_is_not_taken_from_the_kurtosis(symmetric):
    """Of a drift, which was taken for a vibration too often."""
    light, blur = 1e6, drift(0.9, 30)
    x, y = pupil_places()
    opd = 5.0 * np.sqrt(3) * (2 * (x**2 + y**2) - 1)
    flat, ahead, behind = (star_image(0.6, -1.1, light, blur, opd=k * opd) for k in (0, 1, -1))
    pixels = flat - (ahead + behind - 2 * flat) / 2 + 2.0
    start = Parameters(Star(0.62, -1.08, light), Mvn.of(0.1), (1.0, 0.0, 0.0))
    result = fit_best_locus(Data(pixels, 9.0), symmetric, start, np.array([0.02, 0.0, 0.02]))
    shown = result.straight
    assert abs(shown.kurtosis + 1.2) < 0.1 * shown.error


def test_errors_of_a_blur_that_is_possible_are_not_replaced_by_smaller_ones(symmetric):
    pixels = image(0.0)
    plain = fitted(pixels, symmetric, state=np.zeros(3))
    assert freed(plain, pixels, symmetric) is not plain
    careful = replace(plain, covariance=100 * plain.covariance)
    assert freed(careful, pixels, symmetric) is careful


@pytest.mark.parametrize(
    ("focus", "uneven"), [(0.0, 0.0), (15.0, 0.0), (40.0, 0.0), (0.0, 1e-3), (40.0, 1e-3)]
)
def test_a_search_finds_a_focus_that_a_flat_wavefront_does_not_show(focus, uneven, symmetric):
    """Also where one sample of the pupil makes it not quite its own mirror image."""
    pixels, pupil = image(focus), symmetric.pupil
    light = np.array(pupil.transmission)
    light[20, 40] *= 1 - uneven
    symmetric = replace(symmetric, pupil=replace(pupil, transmission=light))
    start = locate_star(Data(pixels, 9.0), symmetric)
    assert start is not None
    result = freed(fit_frame(Data(pixels, 9.0), symmetric, start.parameters), pixels, symmetric)
    assert result.status is Status.OK
    assert "aberrations_held" not in result.flags
    assert np.all(np.abs(off(result)) < 0.15)
    # the sign cannot be known, and what is smaller than 4 nm shows as none
    assert abs(abs(float(result.parameters.aberrations[0])) - focus) < 4.0


@pytest.mark.parametrize("focus", [-30.0, 30.0])
def test_a_prior_tells_the_sign_that_no_image_shows(focus, symmetric):
    data = Data(image(30.0), 9.0)
    found = locate_star(data, symmetric)
    kernel = KernelEstimate(np.asarray(found.parameters.locus.moments()), found.covariance, "score")
    start = steps.SceneEstimate(data, found.parameters, kernel, symmetric, found.otf)
    result = steps.fit(start, Priors({"noll4": (focus, 5.0)}), locus="mvn")
    assert result.status is Status.OK
    assert float(result.parameters.aberrations[0]) == pytest.approx(focus, abs=2.0)
    assert "prior_contradicted" not in result.flags


def test_a_search_leaves_what_it_is_to_hold_as_it_is(symmetric):
    start = locate_star(Data(image(15.0), 9.0), symmetric, ("noll4", "noll5", "noll6"))
    assert start is not None
    assert not np.any(np.asarray(start.parameters.aberrations))


def test_what_is_known_or_held_or_seen_by_itself_stays(symmetric, optics):
    pixels = image(0.0)
    for telescope, options, state in (
        (symmetric, FitOptions(priors=Priors.alike(("noll4", "noll5", "noll6"), 1.0)), (4.0, -3.0, 3.0)),
        (symmetric, FitOptions(hold=("noll4", "noll5", "noll6")), np.zeros(3)),
        (optics, FitOptions(), np.zeros(2)),
    ):
        plain = fitted(pixels, telescope, options, state)
        assert freed(plain, pixels, telescope, options) is plain


def test_errors_of_a_blur_of_unknown_shape_stay_with_free_squares(symmetric):
    """The normal's values go with a mean kurtosis, which a step back to the maximum would undo."""
    light, blur = 3e4, drift(0.6, 30)
    pixels = star_image(0.6, -1.1, light, blur) + 2.0
    start = Parameters(Star(0.62, -1.08, light), Mvn.of(0.1), (4.0, -3.0, 3.0))
    plain = fit_best_locus(Data(pixels, 9.0), symmetric, start, np.array([0.02, 0.0, 0.02]))
    (change, variance), place = plain.off_maximum, plain.names.index("mvn_xx")
    result = freed(plain, pixels, symmetric)
    normal = freed(replace(plain, off_maximum=None), pixels, symmetric)
    assert result.moments()[0][0] == pytest.approx(normal.moments()[0][0] + change[place], rel=1e-6)
    assert result.covariance[place, place] == pytest.approx(
        normal.covariance[place, place] + variance[place, place], rel=1e-6
    )
    truth = 0.6**2 / 12 * np.cos(np.radians(30)) ** 2
    assert abs(result.moments()[0][0] - truth) < 0.6 * np.sqrt(result.covariance[place, place])


@pytest.mark.parametrize(("noll", "even"), [((4,), [0]), ((4, 5, 6), [0, 1, 2]), ((7, 8), []), ((), [])])
def test_modes_that_may_show_by_their_squares_are_those_that_are_their_own_mirror_image(
    noll, even, telescope
):
    pupil = obstructed_circle(0.125, 0.04, samples=64, noll=noll)
    assert replace(telescope, pupil_from=lambda: pupil).system().even_modes == even


@pytest.mark.slow
def test_the_mean_of_still_frames_shows_no_jitter(symmetric):
    expected, rng = image(0.0), np.random.default_rng(32)
    before, after = [], []
    for _ in range(60):
        pixels = rng.poisson(expected) + rng.normal(0, 3, expected.shape)
        plain = fitted(pixels, symmetric)
        before.append(off(plain))
        after.append(off(freed(plain, pixels, symmetric)))
    assert np.all(np.mean(before, axis=0)[[0, 2]] < -0.3)
    assert np.all(np.abs(np.mean(after, axis=0)) < 3.5 / np.sqrt(60))
    assert np.all(np.abs(np.std(after, axis=0, ddof=1) - 1) < 3.5 / np.sqrt(120))
