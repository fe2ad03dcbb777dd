"""Displaced pixels and stars of a catalogue: against images made pixel by pixel, and astropy's sky."""

from dataclasses import replace

import numpy as np
import pytest
from astropy import units
from astropy.coordinates import SkyCoord
from astropy.wcs import WCS
from refusals import refused

from jitterkit.batch import FrameProcessor
from jitterkit.batch.steps import calibrate
from jitterkit.detectors import Detector
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.forward import Parameters, displacement_effect, expected_image
from jitterkit.frames import RawFrame
from jitterkit.instruments import read_instrument
from jitterkit.instruments.background_stars import BackgroundStars
from jitterkit.instruments.description import describe_instrument
from jitterkit.instruments.sky import Sky
from jitterkit.joint import Exposure, FrameFitter, refit_sequence
from jitterkit.known_light import KnownLight, without_light
from jitterkit.loci import Mvn
from jitterkit.refit import Status
from jitterkit.scene import Binary, FurtherStars, Star
from jitterkit.shutter import Drifting
from jitterkit.simulate import simulate_frame
from jitterkit.trade import TradeScene
from jitterkit.trade.grid import without_noise
from jitterkit.trade.methods import separations

PAIR = Binary(5.0, 30.0, 0.3, -0.2, 4e6, 2.5)
BLUR = Mvn.of(0.1)
A = PAIR.x - 2.5 * np.cos(np.pi / 6), PAIR.y - 2.5 * np.sin(np.pi / 6)
NONE = np.zeros(2)


@pytest.fixture(scope="module")
def shifts(telescope):
    """Displacements along x and y of a few sizes [pixels], each pixel's drawn."""
    rng = np.random.default_rng(7)
    return tuple(rng.choice([-0.02, -0.005, 0.01, 0.025], telescope.shape) for _ in "xy")


@pytest.fixture(scope="module")
def displaced(telescope, otf, shifts):
    """Return what makes an image of a scene whose pixels are each taken from a scene moved the other way."""

    def image(scene, shutter=None):
        found = np.zeros(telescope.shape)
        for dx in np.unique(shifts[0]):
            for dy in np.unique(shifts[1]):
                by = np.array([dx, dy]) * telescope.plate_scale
                moved = Parameters(scene.shifted(*-by), BLUR, NONE, 3.0, shutter=shutter)
                here = (shifts[0] == dx) & (shifts[1] == dy)
                found[here] = np.asarray(expected_image(moved, otf))[here]
        return found

    return image


def processed(instrument, image, wcs=None):
    raw = RawFrame.from_array(image, unit="electron", read_noise=1.0, exposure=0.1, wcs=wcs)
    processor = FrameProcessor(instrument, kernel="score", locus="mvn", scene="binary")
    return processor.process(raw).result


def bias(result):
    """Errors by which the separation is off."""
    return (float(result.parameters.scene.separation) - 5.0) / result.error("separation")


def test_a_displaced_pixel_sees_the_light_of_where_it_is(otf, shifts, displaced, telescope):
    truth = Parameters(PAIR, BLUR, NONE, 3.0)
    dx, dy = (part * telescope.plate_scale for part in shifts)
    change = displaced(PAIR) - np.asarray(expected_image(truth, otf))
    found = np.asarray(displacement_effect(truth, otf, dx, dy))
    assert np.abs(change).max() > 0.01 * np.asarray(expected_image(truth, otf)).max()
    np.testing.assert_allclose(found, change, atol=1e-3 * np.abs(change).max())  # third order


def test_a_displaced_pixel_of_a_rolling_shutter_sees_its_own_row(otf, shifts, displaced, telescope):
    """The image drifts by three pixels from the first row to the last."""
    shutter = Drifting(0.006, np.array([0.0, 4.0]))
    truth = Parameters(PAIR, BLUR, NONE, 3.0, shutter=shutter)
    dx, dy = (part * telescope.plate_scale for part in shifts)
    change = displaced(PAIR, shutter) - np.asarray(expected_image(truth, otf))
    found = np.asarray(displacement_effect(truth, otf, dx, dy))
    np.testing.assert_allclose(found, change, atol=1e-3 * np.abs(change).max())
    still = np.asarray(displacement_effect(Parameters(PAIR, BLUR, NONE, 3.0), otf, dx, dy))
    assert np.abs(still - change).max() > 0.1 * np.abs(change).max()


def test_a_simulated_frame_has_its_pixels_where_they_are(telescope, shifts, displaced):
    detector = Detector(gain=1.0, pixel_shift_x=shifts[0], pixel_shift_y=shifts[1])
    made = simulate_frame(replace(telescope, detector=detector), PAIR, BLUR, background=3.0)
    exact = displaced(PAIR)
    np.testing.assert_allclose(made.expected, exact, atol=2e-5 * exact.max())


def test_a_map_takes_away_the_bias_of_displaced_pixels(telescope, shifts, displaced):
    known = Detector(pixel_shift_x=shifts[0], pixel_shift_y=shifts[1])
    image = displaced(PAIR)
    blind = processed(telescope, image)
    fitted = processed(replace(telescope, detector=known), image)
    assert abs(bias(blind)) > 1
    assert blind.chi2 > 0.1 * blind.dof
    assert abs(bias(fitted)) < 5e-3
    assert fitted.chi2 < 1e-5 * fitted.dof
    assert fitted.error("separation") == pytest.approx(blind.error("separation"), rel=0.01)


def test_a_map_is_that_of_the_place_on_the_detector(telescope, shifts, displaced):
    """A region of a larger detector has its own part of the maps."""
    wide = [np.pad(part, ((3, 5), (7, 2))) for part in shifts]
    detector = Detector(pixel_shift_x=wide[0], pixel_shift_y=wide[1])
    processor = FrameProcessor(replace(telescope, detector=detector), locus="mvn", scene="binary")
    raw = RawFrame.from_array(displaced(PAIR), unit="electron", read_noise=1.0, exposure=0.1)
    result = processor.process(replace(raw, origin=(7, 3))).result
    assert result.chi2 < 1e-5 * result.dof
    beyond = processor.process(replace(raw, origin=(12, 3))).result
    assert beyond.status is Status.MISMATCH
    assert "pixel_shift_x" in beyond.message


def test_the_frames_of_a_sequence_are_freed_of_it_too(telescope, optics, shifts, displaced):
    detector = Detector(pixel_shift_x=shifts[0], pixel_shift_y=shifts[1])
    known = replace(telescope, detector=detector)
    exposures = []
    for i, (x, y) in enumerate(np.random.default_rng(3).uniform(-1, 1, (4, 2))):
        image = displaced(Binary(5.0, 30.0, x, y, 4e6, 2.5))
        raw = RawFrame.from_array(image, unit="electron", read_noise=1.0, exposure=0.1)
        exposures.append(Exposure(str(i), 0.1 * i, calibrate(raw, known)))
    values = [
        refit_sequence(exposures, FrameFitter(optics, known_light=light)).separation
        for light in (None, KnownLight.of(known))
    ]
    (blind, _), (found, error) = values
    assert abs(blind - 5.0) > 0.3 * error
    assert abs(found - 5.0) < 2e-3 * error


def test_a_trade_off_tries_settings_on_frames_that_show_it(telescope, shifts):
    """Else what its fits take out was never there, a bias of 1.7 errors."""
    detector = Detector(gain=1.0, read_noise=1.0, bits=32, pixel_shift_x=shifts[0], pixel_shift_y=shifts[1])
    known = replace(telescope, detector=detector)
    scene = TradeScene.of(known, PAIR, BLUR, 1, np.random.default_rng(5))
    processor = FrameProcessor(known, locus="mvn", scene="binary")
    frame = without_noise(processor.calibrate(scene.plain[0]), scene.images[0])
    ((found, error),) = separations("refit", processor, [frame])
    assert abs(found - float(scene.truths[0].binary.separation)) < 0.1 * error


def turned(degrees, parity):
    """World coordinates of a frame about its centre; parity -1 has east to the left of north."""
    turn, scale = np.radians(degrees), 0.375 / 3600
    wcs = WCS(naxis=2)
    wcs.wcs.ctype, wcs.wcs.crval, wcs.wcs.crpix = ["RA---TAN", "DEC--TAN"], [210.0, -60.0], [22.5, 24.5]
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    wcs.wcs.cd = scale * rotation @ np.diag([parity, 1.0])
    return wcs


def with_stars(instrument, **more):
    faint = BackgroundStars(
        np.array([4.0, 6.5, 500.0]), np.array([100.0, 320.0, 0.0]), np.full(3, 5.5), **more
    )
    return replace(instrument, sky=Sky(stars=faint))


@pytest.mark.parametrize("parity", [-1, 1])
@pytest.mark.parametrize("says", ["wcs", "pair_angle"])
def test_the_light_of_known_stars_is_left_out(telescope, otf, parity, says):
    """Astropy puts the stars on the frame."""
    wcs = turned(25.0, parity)

    def pixel(x, y):
        return x / 0.375 + 21.5, y / 0.375 + 23.5

    primary = wcs.pixel_to_world(*pixel(*A))
    angle = primary.position_angle(wcs.pixel_to_world(*pixel(2 * PAIR.x - A[0], 2 * PAIR.y - A[1]))).deg
    positions = []
    for separation, position_angle in ((4.0, 100.0), (6.5, 320.0)):
        sky: SkyCoord = primary.directional_offset_by(position_angle * units.deg, separation * units.arcsec)
        positions.append(np.array(wcs.world_to_pixel(sky)))
    x, y = (np.array(positions) - [21.5, 23.5]).T * 0.375
    light = np.full(2, float(PAIR.stars()[2][0]) * 10**-2.2)
    scene = PAIR.joined(FurtherStars(x, y, light))
    image = np.asarray(expected_image(Parameters(scene, BLUR, NONE, 3.0), otf))
    more = {"pair_angle": float(angle), "mirrored": parity == 1} if says == "pair_angle" else {}
    result = processed(with_stars(telescope, **more), image, wcs if says == "wcs" else None)
    assert result.parameters.scene.others is None
    assert result.chi2 < 1e-4 * result.dof
    assert abs(bias(result)) < 2e-3


def test_a_reference_frame_does_not_count_known_stars_as_its_own(telescope, otf):
    """Else frames that are registered to it would look for stars whose light has been left out."""
    stars = with_stars(telescope, pair_angle=0.0)
    truth = Parameters(PAIR, BLUR, NONE, 3.0)
    image = np.asarray(expected_image(truth, otf)) + KnownLight.of(stars).image(truth, otf)
    raw = RawFrame.from_array(image, unit="electron", read_noise=1.0)
    found = []
    for instrument in (telescope, stars):
        processor = FrameProcessor(instrument, locus="mvn", scene="binary")
        found.append(processor.choose_scene(processor.calibrate(raw)).start.parameters.scene.others)
    assert len(found[0].x) == 2
    assert found[1] is None


def test_the_photon_noise_of_what_is_left_out_stays(telescope, otf):
    """Counts and variance grow by the same, so that the likelihood is that of the counts."""
    stars = with_stars(telescope, pair_angle=0.0)
    raw = RawFrame.from_array(np.full(telescope.shape, 9.0), unit="electron", read_noise=1.0)
    frame, truth = calibrate(raw, stars), Parameters(PAIR, BLUR, NONE, 3.0)
    light = KnownLight.of(stars)
    added = light.of_frame(frame, truth, otf)
    free = without_light(frame, added)
    two = 2 * float(PAIR.stars()[2][0]) * 10**-2.2  # the third is out of sight
    assert added.sum() == pytest.approx(two, rel=0.05)
    np.testing.assert_allclose(free.electrons + added, frame.electrons)
    np.testing.assert_allclose(free.read_variance, np.maximum(frame.read_variance + added, 0.0))


def test_stars_that_cannot_be_placed_are_refused(telescope, otf):
    image = np.asarray(expected_image(Parameters(PAIR, BLUR, NONE, 3.0), otf))
    result = processed(with_stars(telescope), image)
    assert not result.status.usable
    assert "pair_angle" in result.message
    with refused(ErrorCode.MISSING_VALUE, "WCS", "no pair"):
        star = Parameters(Star(0.0, 0.0, 1e5), BLUR, NONE, 0.0)
        KnownLight.of(with_stars(telescope, pair_angle=3.0)).image(star, otf)


def test_an_instrument_file_names_its_catalogue(tmp_path):
    (tmp_path / "stars.csv").write_text("separation,position_angle,delta_mag\n3.5,120,8.5\n9,300,9\n")
    text = '[instrument]\nbase = "smallsat"\n[sky]\nstars = "stars.csv"\npair_angle = 12.5\nmirrored = true\n'
    (tmp_path / "bed.toml").write_text(text)
    stars = read_instrument(tmp_path / "bed.toml").sky.stars
    np.testing.assert_array_equal(stars.separation, [3.5, 9.0])
    assert (stars.pair_angle, stars.mirrored) == (12.5, True)
    rows = describe_instrument(read_instrument(tmp_path / "bed.toml"))
    assert (
        "stars",
        "2 in a catalogue, pair_angle 12.5 deg, mirrored",
        "",
        "instrument file bed.toml [sky]",
    ) in rows


@pytest.mark.parametrize(
    ("table", "sky", "code", "words"),
    [
        ("separation,position_angle\n3,1\n", "", ErrorCode.MISSING_VALUE, "delta_mag"),
        ("separation,position_angle,delta_mag\n-3,1,8\n", "", ErrorCode.OUT_OF_RANGE, "180"),
        ("separation,position_angle,delta_mag\n3,east,8\n", "", ErrorCode.MALFORMED, "arcsec"),
        ("separation,position_angle,delta_mag\n3,1,nan\n", "", ErrorCode.OUT_OF_RANGE, "finite"),
        ("separation,position_angle,delta_mag\n3,1,\n2,1,8\n", "", ErrorCode.OUT_OF_RANGE, "finite"),
        ("separation,position_angle,delta_mag\n", "", ErrorCode.OUT_OF_RANGE, "no star"),
    ],
)
def test_a_catalogue_that_is_none_is_refused(tmp_path, table, sky, code, words):
    (tmp_path / "stars.csv").write_text(table)
    (tmp_path / "bed.toml").write_text(f'[instrument]\nbase = "smallsat"\n[sky]\nstars = "stars.csv"\n{sky}')
    with refused(code, "stars.csv", words, error=FrameError):
        read_instrument(tmp_path / "bed.toml")


def test_how_a_frame_is_turned_is_asked_for_with_stars_only(tmp_path):
    (tmp_path / "bed.toml").write_text('[instrument]\nbase = "smallsat"\n[sky]\npair_angle = 3\n')
    with refused(ErrorCode.MISSING_VALUE, "pair_angle", "stars"):
        read_instrument(tmp_path / "bed.toml")
