"""What the sky does to a separation: against special relativity, astropy, and once only."""

import erfa
import numpy as np
import pytest
from astropy import units
from astropy.coordinates import GCRS, SkyCoord
from astropy.io import fits
from astropy.time import Time
from refusals import refused
from scipy.constants import c

from jitterkit.errors import ErrorCode
from jitterkit.frames import RawFrame, read_frames
from jitterkit.frames.times import epoch_seconds
from jitterkit.instruments import read_instrument, resolve
from jitterkit.instruments.description import describe_instrument
from jitterkit.instruments.sky import Sky, velocity_aberration

TARGET = (219.9021, -60.8340)
FILE = """
[instrument]
base = "smallsat"
[sky]
target = [219.9021, -60.8340]
velocity = "earth"
orbit_rate = 0.5
orbit_epoch = "2026-01-01"
"""
HST = {
    "VAFACTOR": 1.00007,
    "DATE-OBS": "2026-07-02T15:00:00",
    "EXPTIME": 100.0,
    "CTYPE1": "RA---TAN",
    "CTYPE2": "DEC--TAN",
    "CD1_1": -1e-5,
    "CD2_2": 1e-5,
}


@pytest.fixture
def frame(tmp_path):
    """Return what reads a frame with some cards in its header."""

    def read(cards):
        fits.PrimaryHDU(np.zeros((4, 4)), fits.Header(list(cards.items()))).writeto(tmp_path / "a.fits")
        (raw,) = read_frames(tmp_path / "a.fits")
        (tmp_path / "a.fits").unlink()
        return raw

    return read


@pytest.fixture
def bed(tmp_path):
    (tmp_path / "bed.toml").write_text(FILE)
    return read_instrument(tmp_path / "bed.toml")


def angle(a, b):
    return np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)


@pytest.mark.parametrize("speed", [7.6, 30.0, 250.0])  # km/s: a low orbit, the earth's, the Galaxy's
def test_two_directions_come_back_to_where_they_are_for_an_observer_at_rest(rng, speed):
    # SOFA's exact aberration, without the Sun's gravity (it is 1e12 au away), moves both stars
    for _ in range(20):
        first, along, velocity = rng.standard_normal((3, 3))
        first /= np.linalg.norm(first)
        along = np.cross(first, along)
        second = first + np.radians(10 / 3600) * along / np.linalg.norm(along)
        second /= np.linalg.norm(second)
        velocity *= speed / np.linalg.norm(velocity)
        beta = velocity / (c / 1e3)
        seen = [erfa.ab(star, beta, 1e12, np.sqrt(1 - beta @ beta)) for star in (first, second)]
        middle = (first + second) / np.linalg.norm(first + second)
        # the factor varies over the pair by beta times its square: 1e-12
        assert angle(*seen) * velocity_aberration(middle, velocity) == pytest.approx(
            angle(first, second), rel=1e-10
        )


def test_what_an_observer_flies_towards_looks_smaller():
    assert velocity_aberration([1.0, 0.0, 0.0], [30.0, 0.0, 0.0]) == pytest.approx(1 + 1.0007e-4, rel=1e-8)
    assert velocity_aberration([-1.0, 0.0, 0.0], [30.0, 0.0, 0.0]) < 1


@pytest.mark.parametrize("date", ["2026-01-10", "2026-04-10", "2026-07-10", "2026-10-10T12:00:00"])
def test_a_pair_seen_from_the_earth_is_that_of_astropy(date):
    first = SkyCoord(*TARGET, unit="deg")
    second = first.directional_offset_by(30 * units.deg, 10 * units.arcsec)
    seen = [star.transform_to(GCRS(obstime=Time(date))) for star in (first, second)]
    ratio = (first.separation(second) / seen[0].separation(seen[1])).to_value("")
    # astropy has the deflection of light by the Sun too: 2 GM/c²r / (1 - cos 42°) = 8e-8
    factor = Sky(TARGET, "earth").va_factor(epoch_seconds(date))
    assert factor == pytest.approx(ratio, abs=1e-7)
    assert abs(factor - 1) > 1e-6


def test_orbital_motion_grows_from_the_reference_epoch():
    sky = Sky(orbit_rate=0.5, orbit_epoch="2026-01-01")
    assert sky.orbit_change(epoch_seconds("2027-01-01T06:00:00")) == pytest.approx(0.5, rel=1e-12)
    assert sky.orbit_change(epoch_seconds("2025-12-31T23:00:00")) == pytest.approx(-0.5 / 8766, rel=1e-12)
    assert sky.orbit_change(np.nan) is None


def test_a_frame_is_corrected_at_the_middle_of_its_exposure(bed, frame):
    cards = {"DATE-OBS": "2026-07-02T14:59:10", "EXPTIME": 100.0}
    metadata = resolve(frame(cards), bed).metadata
    assert metadata.value("orbit_change") == pytest.approx(0.5 * 182.625 / 365.25, rel=1e-12)
    assert metadata.value("va_factor") == bed.sky.va_factor(epoch_seconds("2026-07-02T15:00:00"))
    assert metadata.va_factor.source == "instrument file bed.toml [sky]"
    assert metadata.warnings == ()


def test_the_frames_of_a_file_follow_each_other(bed, tmp_path):
    cube, header = np.zeros((3, 4, 4)), fits.Header([("DATE-OBS", "2026-07-02T00:00:00"), ("EXPTIME", 600.0)])
    fits.PrimaryHDU(cube, header).writeto(tmp_path / "cube.fits")
    changes = [
        resolve(raw, bed).metadata.value("orbit_change") for raw in read_frames(tmp_path / "cube.fits")
    ]
    assert np.diff(changes) == pytest.approx(2 * [0.5 * 600 / (365.25 * 86400)], rel=1e-6)


def test_images_with_times_of_their_own_do_not_follow_each_other(bed, tmp_path):
    images = [fits.ImageHDU(np.zeros((4, 4)), name="SCI", ver=k + 1) for k in range(3)]
    for hour, image in enumerate(images):
        image.header["DATE-OBS"], image.header["EXPTIME"] = f"2026-07-02T{hour:02}:00:00", 3600.0
    fits.HDUList([fits.PrimaryHDU(), *images]).writeto(tmp_path / "three.fits")
    changes = [
        resolve(raw, bed).metadata.value("orbit_change") for raw in read_frames(tmp_path / "three.fits")
    ]
    assert np.diff(changes) == pytest.approx(2 * [0.5 * 3600 / (365.25 * 86400)], rel=1e-6)


def test_a_day_without_a_time_of_day_is_no_time(bed, frame):
    day = resolve(frame({"DATE-OBS": "2026-07-02", "EXPTIME": 100.0}), bed).metadata
    assert day.va_factor is day.orbit_change is None
    assert any("time of day" in text for text in day.warnings)
    beside = resolve(frame({"DATE-OBS": "2026-07-02", "MJD-OBS": 61223.5, "EXPTIME": 0.0}), bed).metadata
    assert beside.value("orbit_change") == pytest.approx(0.5 * 182.5 / 365.25, rel=1e-9)


def test_a_factor_in_a_header_whose_scale_stars_may_have_determined_is_remarked_on(bed, frame):
    assert any("--plate-scale" in text for text in resolve(frame(HST), bed).metadata.warnings)


def test_a_velocity_of_two_numbers_is_refused():
    with refused(ErrorCode.OUT_OF_RANGE, "velocity"):
        Sky(target=(10.0, 20.0), velocity=[1.0, 2.0])
    with refused(ErrorCode.OUT_OF_RANGE, "velocity"):
        Sky(target=(10.0, 20.0), velocity=[1e6, 2.0, 3.0])


def test_an_instrument_is_described_with_its_sky(bed):
    rows = {row[0]: row[1:] for row in describe_instrument(bed)}
    source = "instrument file bed.toml [sky]"
    assert rows["target"] == ("219.902, -60.834", "deg", source)
    assert rows["velocity"] == ("earth", "km/s", source)
    assert rows["orbit_rate"] == ("0.5", "arcsec/yr", source)


def test_a_frame_without_a_time_has_no_correction_and_says_so(bed, frame):
    metadata = resolve(frame({"EXPTIME": 100.0}), bed).metadata
    assert metadata.va_factor is metadata.orbit_change is None
    assert any("[sky]" in text for text in metadata.warnings)


def test_a_header_knows_the_orbit_of_its_telescope_better_than_the_earth_s(bed, frame):
    plain = {key: HST[key] for key in ("VAFACTOR", "DATE-OBS", "EXPTIME")}
    assert resolve(frame(plain), bed).metadata.value("va_factor") == 1.00007
    jwst = {"TELESCOP": "JWST", "VA_SCALE": 0.99992}
    assert resolve(frame(jwst), bed).metadata.value("va_factor") == 0.99992


@pytest.mark.parametrize(
    ("more", "overrides", "factor"),
    [
        ({}, {}, 1.00007),  # as the telescope sent it: the nominal scale
        ({"UPWCSVER": "1.7.2"}, {}, 1.0),  # updatewcs has multiplied the CD matrix
        ({"S_WCS": "COMPLETE", "S_RESAMP": "COMPLETE"}, {}, 1.0),
        (
            {"S_WCS": "COMPLETE"},
            {},
            1.00007,
        ),  # without a fit of SIP, keywords stay as they were
        ({"UPWCSVER": "1.7.2"}, {"plate_scale": 0.036}, 1.00007),  # a scale that has not been multiplied
    ],
)
def test_a_scale_that_a_pipeline_has_corrected_is_not_corrected_again(bed, frame, more, overrides, factor):
    metadata = resolve(frame(HST | more), bed, overrides).metadata
    assert metadata.value("va_factor") == factor
    assert metadata.va_factor.source.startswith("header VAFACTOR")
    twice = resolve(RawFrame(np.zeros((4, 4)), metadata=metadata), bed, overrides).metadata
    assert twice.va_factor == metadata.va_factor


def test_the_scale_of_a_wcs_that_stars_may_have_determined_is_not_corrected(bed, frame):
    cards = {key: value for key, value in HST.items() if key != "VAFACTOR"}
    metadata = resolve(frame(cards), bed).metadata
    assert metadata.va_factor is None
    assert metadata.orbit_change is not None
    assert any("--plate-scale" in text for text in metadata.warnings)
    given = resolve(frame(cards), bed, {"plate_scale": 0.036}).metadata
    assert given.value("va_factor") == bed.sky.va_factor(epoch_seconds("2026-07-02T15:00:50"))


@pytest.mark.parametrize(
    ("was", "becomes", "code", "values"),
    [
        ("target = [219.9021, -60.8340]", "", ErrorCode.MISSING_VALUE, ("velocity", "target")),
        ("[219.9021, -60.8340]", "[-60.8340, 219.9021]", ErrorCode.OUT_OF_RANGE, ("target", "-60.834")),
        ("[219.9021, -60.8340]", "[219.9]", ErrorCode.WRONG_SHAPE, ("target", "deg")),
        ('"earth"', '"mars"', ErrorCode.OUT_OF_RANGE, ("velocity", "mars")),
        ('"earth"', "[30e3, 0, 0]", ErrorCode.OUT_OF_RANGE, ("velocity", "30000.0")),
        ('"earth"', "[30]", ErrorCode.WRONG_SHAPE, ("velocity", "km/s")),
        ("orbit_rate = 0.5", "", ErrorCode.MISSING_VALUE, ("orbit_epoch", "orbit_rate")),
        ("orbit_rate = 0.5", "orbit_rate = 1e9", ErrorCode.OUT_OF_RANGE, ("orbit_rate", "1000000000.0")),
        ('orbit_epoch = "2026-01-01"', "", ErrorCode.MISSING_VALUE, ("orbit_rate", "orbit_epoch")),
        ('"2026-01-01"', '"spring"', ErrorCode.OUT_OF_RANGE, ("orbit_epoch", "spring")),
        ('"2026-01-01"', "2026", ErrorCode.WRONG_TYPE, ("orbit_epoch", "2026")),
    ],
)
def test_an_impossible_sky_is_refused(tmp_path, was, becomes, code, values):
    assert was in FILE
    (tmp_path / "bed.toml").write_text(FILE.replace(was, becomes))
    with refused(code, "bed.toml", *values):
        read_instrument(tmp_path / "bed.toml")
