"""The blur of a field, end to end, on stars drawn by direct quadrature."""

import re
from dataclasses import replace

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.forward import Parameters
from jitterkit.frames import Frame
from jitterkit.likelihood import Data
from jitterkit.loci import Linear
from jitterkit.metric import Prior, invert_information
from jitterkit.optics import empirical_otf
from jitterkit.scene import Star
from jitterkit.scoring import fisher_scoring
from jitterkit.starfield import estimate_field, field_psf, roundest
from jitterkit.starfield.detect import find_stars
from jitterkit.starfield.joint import fit_joint
from jitterkit.starfield.moments import adaptive_moments


def apart(a, b):
    """Angle between two axes, degrees."""
    return abs((a - b + 90) % 180 - 90)


def number_after(words, text):
    return float(re.search(rf"{words} ([\d.]*\d)", text)[1])


@pytest.mark.parametrize(
    ("length", "angle", "seed"), [pytest.param(2.0, 162.0, 1, marks=pytest.mark.slow), (6.0, 75.0, 2)]
)
def test_with_a_sharp_reference_length_and_angle_are_right(field, trail, sharp, length, angle, seed):
    frame, _ = field(np.random.default_rng(seed), trail(length, angle), stars=100, side=500)
    estimate = estimate_field(frame, reference=sharp[0])
    assert estimate.length == pytest.approx(length, rel=0.05)
    assert apart(estimate.angle, angle) < 2
    # and within four of the errors that are stated, which are a hundred times smaller than that
    assert estimate.length == pytest.approx(length, abs=4 * estimate.length_err)
    assert apart(estimate.angle, angle) < 4 * estimate.angle_err
    assert estimate.length_err < 0.02
    assert not estimate.conditional
    assert estimate.pattern.kind == "smear"
    assert estimate.kernel.axes[0] == pytest.approx(length / np.sqrt(12), rel=0.02)
    chi2, dof = estimate.variation
    assert chi2 == pytest.approx(dof, abs=5 * np.sqrt(2 * dof))
    assert not estimate.remarks


def test_errors_of_length_and_angle_turn_over_with_the_frame(field, trail):
    rng = np.random.default_rng(8)
    few = {"stars": 20, "side": 290}
    reference, _ = field(rng, trail(0.0, 0.0), **few)
    frame, _ = field(rng, trail(6.0, 15.0), **few)
    over = [replace(one, electrons=one.electrons.T) for one in (frame, reference)]
    upright, turned = estimate_field(frame, reference=reference), estimate_field(over[0], reference=over[1])
    # both fits end within a twentieth of an error of one optimum, and there the errors differ by 1e-3
    assert apart(turned.angle, 90 - upright.angle) < 0.1 * upright.angle_err
    assert turned.length_err == pytest.approx(upright.length_err, rel=5e-3)
    assert turned.angle_err == pytest.approx(upright.angle_err, rel=5e-3)


def a_few(star, rng, flux, ux=0.0, uy=0.0):
    """Nine stars of one flux on a grid of 60 pixels, at phases of their own."""
    image = np.full((240, 240), 100.0)
    for x, y in np.stack(np.meshgrid([60, 120, 180], [60, 120, 180]), -1).reshape(-1, 2):
        image[y - 24 : y + 25, x - 24 : x + 25] += flux * star(*rng.uniform(-0.5, 0.5, 2), ux, uy)
    return Frame(rng.poisson(image).astype(float), 0.0)


@pytest.mark.parametrize(("sharp_flux", "flux"), [(2e4, 2e4), pytest.param(1e4, 1e5, marks=pytest.mark.slow)])
def test_the_noise_of_a_reference_is_not_taken_for_blur(star, sharp_flux, flux):
    u, off = np.array([3 * np.cos(np.radians(20)), 3 * np.sin(np.radians(20))]), []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        reference = a_few(star, rng, sharp_flux)
        kernel = estimate_field(a_few(star, rng, flux, *u), reference=reference).kernel
        truth = np.array([u[0] ** 2, u[0] * u[1], u[1] ** 2]) / 12
        off.append((np.asarray(kernel.moments) - truth) / np.sqrt(np.diag(kernel.covariance)))
    # the mean of four is good to half an error; more blur smooths the noise, by three errors
    assert np.all(np.abs(np.mean(off, axis=0)) < 1.5)


def test_stars_that_vibrate_are_not_drawn_along_a_uniform_line(star):
    """Moments were two percent too large, seven of their errors, and without a remark."""
    u, phases = (
        3.0 * np.array([np.cos(np.radians(20)), np.sin(np.radians(20))]),
        np.pi * (np.arange(24) + 0.5),
    )

    def vibrating(dx, dy, ux, uy):
        return np.mean([star(dx + ux * c, dy + uy * c) for c in np.cos(phases / 24) / 2], axis=0)

    rng = np.random.default_rng(0)
    reference = a_few(star, rng, 3e6)
    estimate = estimate_field(a_few(vibrating, rng, 1e6, *u), reference=reference)
    truth = np.array([u[0] ** 2, u[0] * u[1], u[1] ** 2]) / 8
    errors = np.sqrt(np.diag(estimate.kernel.covariance))
    assert np.all(np.abs(np.asarray(estimate.kernel.moments) - truth) < 3 * errors)
    assert errors[0] < 0.01 * truth[0]
    # of a uniform line of that variance
    assert estimate.length == pytest.approx(3.0 * np.sqrt(12 / 8), abs=4 * estimate.length_err)
    assert estimate.length_err < 0.01
    assert number_after("vibration of", " ".join(estimate.remarks)) == pytest.approx(3.0, abs=0.02)


@pytest.fixture(scope="module")
def alone(trailed):
    return estimate_field(trailed[0])


def test_without_a_reference_moments_and_axis_are_within_their_errors(alone, trailed, star):
    estimate = alone
    u = 4 * np.cos(np.radians(30)), 4 * np.sin(np.radians(30))
    phases = np.random.default_rng(4).uniform(-0.5, 0.5, (40, 2))
    images = np.array([star(*p, *u, half=16) for p in phases])
    stars = find_stars(trailed[0]).chosen(np.arange(40))
    exact = adaptive_moments(
        type(stars)(stars.x, stars.y, 1e6 * images, 1 + 0 * images, 1 + 0 * images, images > -1, (680, 680))
    ).moments.mean(0)
    errors = np.sqrt(np.diag(estimate.common_covariance))
    # four errors; half of one is left for the background under the wings
    np.testing.assert_array_less(np.abs(estimate.common - exact), 4.5 * errors)
    assert np.all(errors < 0.01)
    assert apart(estimate.angle, 30) < 4 * estimate.angle_err
    assert estimate.moments.shape == estimate.errors.shape == (len(estimate.x), 3)
    assert estimate.used.sum() > 0.95 * len(estimate.x)
    assert estimate.conditional
    assert len(estimate.remarks) == 1  # the condition
    assert estimate.length == pytest.approx(4, abs=4 * estimate.length_err)
    # the weight follows the star, so that moments overstate a line: 13 % at this length
    assert estimate.moment_length == pytest.approx(4.53, abs=0.05)


def test_the_plate_scale_only_changes_units(alone, trailed):
    pixels, scaled = alone, estimate_field(trailed[0], plate_scale=2.5)
    assert scaled.length == pytest.approx(2.5 * pixels.length)
    assert scaled.angle == pixels.angle
    np.testing.assert_allclose(scaled.moments, 6.25 * pixels.moments)
    np.testing.assert_allclose(scaled.kernel.moments, 6.25 * pixels.kernel.moments)
    np.testing.assert_allclose(scaled.kernel.covariance, 6.25**2 * pixels.kernel.covariance)
    assert scaled.kernel.locus.describe()["length"] == pytest.approx(scaled.length)


def test_turning_the_frame_turns_the_axis(alone, trailed):
    turned = Frame(np.rot90(trailed[0].electrons, -1).copy(), 25.0)  # rows grow upwards: by +90 degrees
    first, second = alone, estimate_field(turned)
    assert apart(second.angle, first.angle + 90) < 0.05
    assert second.length == pytest.approx(first.length, rel=2e-3)


def test_optics_are_not_taken_for_tracking(field, trail, rng):
    frame, _ = field(rng, lambda x, y: (x * 3 / 480, y * 3 / 480), stars=120)
    pattern = estimate_field(frame).pattern
    assert pattern.kind == "radial"
    assert f"{pattern.pattern_share:.0%}" in pattern.sentence
    assert f"{pattern.smear_share:.0%}" in pattern.sentence


@pytest.mark.slow
def test_a_change_of_seeing_is_reported_and_leaves_the_length(field, trail, sharp):
    frame, _ = field(np.random.default_rng(9), trail(4.0, 120.0), stars=120, fwhm=3.3)
    estimate = estimate_field(frame, reference=field_psf(sharp[0]))
    assert estimate.length == pytest.approx(4.0, rel=0.05)
    assert apart(estimate.angle, 120) < 2
    assert "wider" in estimate.remarks[0]
    # that of a normal of these widths; a Moffat star has wings
    assert number_after("by", estimate.remarks[0]) == pytest.approx(
        (3.3**2 - 3**2) / (8 * np.log(2)), rel=0.2
    )


def test_a_little_less_seeing_than_the_reference_s_is_in_the_error(field, trail, sharp):
    frame, _ = field(np.random.default_rng(10), trail(4.0, 120.0), stars=30, side=360, fwhm=2.9)
    estimate = estimate_field(frame, reference=sharp[0])
    assert "narrower" in estimate.remarks[0]
    assert number_after("by", estimate.remarks[0]) == pytest.approx(
        (3**2 - 2.9**2) / (8 * np.log(2)), rel=0.2
    )
    assert estimate.length == pytest.approx(4.0, abs=2 * estimate.length_err)
    assert estimate.length_err < 0.2


@pytest.mark.parametrize("half", [12, pytest.param(24, marks=pytest.mark.slow)])
def test_a_psf_may_have_stamps_of_another_size(field, trail, sharp, half):
    frame, _ = field(np.random.default_rng(12), trail(3.0, 60.0), stars=30, side=400)
    estimate = estimate_field(frame, reference=field_psf(sharp[0], half=half))
    # of the light beyond a stamp of 12 pixels the PSF knows nothing: 2 % of a Moffat star
    assert estimate.length == pytest.approx(3.0, rel=0.02)
    assert not estimate.remarks or half == 12


def test_a_vibration_against_a_reference_is_reported_not_to_be_a_line(field, trail, sharp):
    """Half the time at rest and half along a line, as no line alone is."""
    parts = [field(np.random.default_rng(5), trail(size, 30.0), stars=40, side=400)[0] for size in (0.0, 6.0)]
    frame = Frame(sum(part.electrons for part in parts), 50.0)
    estimate = estimate_field(frame, reference=sharp[0])
    assert number_after("chi²/dof", estimate.remarks[0]) > 1.5
    # its variance is that of a line of 6/sqrt(2); half the difference to the moments', of some 10 %, counts
    assert estimate.length_err > 0.1
    along = np.array([0.75, np.sqrt(0.75), 0.25])  # of the variance at 30 degrees
    error = np.sqrt(along @ estimate.kernel.covariance @ along)
    assert along @ estimate.kernel.moments == pytest.approx(36 / 12 / 2, abs=4 * error)
    assert error < 0.3 * 36 / 12 / 2


def test_fits_are_compared_over_the_stars_that_both_use(trailed, sharp):
    """A fit that leaves out the star that tells has the smaller deviance a pixel."""
    stars = find_stars(trailed[0]).chosen(np.arange(5))
    otf = empirical_otf(field_psf(sharp[0]).stamp, 1.0, stars.electrons.shape[1:], pad=16)
    line = fit_joint(stars, adaptive_moments(stars), otf, Linear.of(4.0, 30.0))
    assert np.isfinite(line.deviances[line.used]).all()
    picky = replace(
        line,
        used=np.arange(5) > 0,
        deviances=np.array([np.nan, *(1.01 * line.deviances[1:])]),
    )
    whole = replace(line, deviances=np.array([1e9, *line.deviances[1:]]))
    assert whole.fits_better(picky)
    assert not picky.fits_better(whole)


@pytest.mark.parametrize("stretch", [np.sqrt, lambda light: np.arcsinh(light / 300)])
@pytest.mark.slow
def test_pixels_that_were_stretched_are_not_measured(stretch, trailed, sharp):
    """A bright star is lowered more in its middle than a faint one, and so is wider."""
    frame, reference = (replace(one[0], electrons=1e3 * stretch(np.clip(one[0].electrons, 0, None)))
                        for one in (trailed, sharp))  # fmt: skip
    for given in (None, reference):
        assert "stretched" in estimate_field(frame, reference=given).kernel.undetermined
    assert not estimate_field(trailed[0]).kernel.undetermined


def test_a_shape_that_is_no_trail_is_refused(star, rng):
    cross = star(0.0, 0.0, 14.0, 0.0) + star(0.0, 0.0, 0.0, 14.0)
    image = np.full((200, 200), 200.0)
    for x, y in ((50, 50), (150, 60), (90, 150)):
        image[y - 24 : y + 25, x - 24 : x + 25] += 3e6 * cross
    with refused(ErrorCode.MODEL_MISMATCH, "Moffat", error=UndeterminedError) as caught:
        estimate_field(Frame(rng.poisson(image).astype(float), 0.0))
    assert number_after("chi²/dof", str(caught.value)) > 100


@pytest.mark.slow
def test_the_joint_fit_is_the_weighted_mean_of_single_ones(trailed, sharp):
    stars = find_stars(trailed[0]).chosen(np.arange(20, 28))
    moments = adaptive_moments(stars)
    psf = field_psf(sharp[0])
    otf = empirical_otf(psf.stamp, 1.0, stars.electrons.shape[1:], centre=(16, 16), pad=12)
    joint = fit_joint(stars, moments, otf, Linear.of(3.0, 20.0))
    total, weighted = np.zeros((2, 2)), np.zeros(2)
    for i in range(len(stars)):
        start = Parameters(Star(*moments.centre[i], moments.flux[i]), Linear.of(3.5, 25.0))
        data = Data(stars.electrons[i], stars.sky_variance[i], stars.used[i])
        end = fisher_scoring(start, otf, data, tuple(range(6)), Prior.none(6))
        weight = np.linalg.inv(invert_information(end.information)[0][3:5, 3:5])
        total, weighted = total + weight, weighted + weight @ np.asarray(end.parameters.locus.coords)
    mean, covariance = np.linalg.solve(total, weighted), np.linalg.inv(total)
    # single stars lean on their own information, taken at their own noisy answer: a third of an error
    np.testing.assert_array_less(
        np.abs(np.asarray(joint.locus.coords) - mean), 0.33 * np.sqrt(np.diag(covariance))
    )
    assert joint.dof == 14
    # the scatter of the stars may widen the errors, not narrow them
    assert np.trace(np.linalg.solve(covariance, joint.covariance)) > 1.9


def test_the_sharpest_frame_of_a_set_is_found(field, trail, trailed, sharp, rng):
    soft, _ = field(rng, trail(0.0, 0.0), stars=30, side=300, fwhm=4.5)
    empty = Frame(rng.normal(100, 10, (128, 128)), 0.0)
    assert roundest([trailed[0], empty, sharp[0], soft]) == 2
    with refused(ErrorCode.TOO_FEW_STARS, 1, error=UndeterminedError):
        roundest([empty])


def test_an_impossible_plate_scale_is_refused(trailed):
    with refused(ErrorCode.OUT_OF_RANGE, -1, error=ConfigurationError):
        estimate_field(trailed[0], plate_scale=-1.0)


def test_a_reference_on_other_pixels_is_refused(trailed, sharp):
    frame, reference = (
        Frame(f.electrons, 25.0, plate_scale=p) for f, p in ((trailed[0], 3.0), (sharp[0], 1.5))
    )
    with refused(ErrorCode.WRONG_INSTRUMENT, "reference has 1.5", "frame 3.0", error=ConfigurationError):
        estimate_field(frame, reference=reference)


@pytest.mark.slow
def test_a_flat_of_one_value_changes_nothing_but_the_unit(field, trail, sharp):
    """What is counted is what was collected: electrons, noise and errors scale together."""
    counted, _ = field(np.random.default_rng(9), trail(4, 30), stars=40, side=400)
    divided = Frame(counted.electrons / 0.25, counted.read_variance, response=0.25)
    plain, flat = (estimate_field(frame, reference=sharp[0]) for frame in (counted, divided))
    assert (flat.used.sum(), flat.length) == pytest.approx((plain.used.sum(), plain.length), rel=1e-6)
    assert flat.length_err == pytest.approx(plain.length_err, rel=1e-6)
    np.testing.assert_allclose(flat.errors, plain.errors, rtol=1e-6)
