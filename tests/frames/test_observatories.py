"""Headers and files of observatories: what their handbooks say, in the form of ``test_variants``."""

import struct

import numpy as np
import pytest
import tifffile
from astropy.io import fits
from headers import assert_number, assert_warned, header
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames import find_files, open_frames, read_frames, resolve_header
from jitterkit.frames.units import resolve_unit

SHAPE = (6, 8)
SCI = np.arange(48.0).reshape(SHAPE) + 100.5
LENS = {"PIXSIZE1": 10.0, "FOCALLEN": 1000.0}
BINNED = 2 * 2.0626480624709636
DAY = "2020-01-01T00:00:37"

NUMBERS = [
    # an exposure that a program did not know
    ({"EXPTIME": 0.0}, "exposure", 0.0, "if there was light"),
    ({"EXPTIME": 0.0, "IMAGETYP": "Bias Frame"}, "exposure", 0.0, ""),
    ({"EXPTIME": 0.0, "EXPOSURE": 30.0}, "exposure", 30.0, "EXPTIME = 0"),
    # the binning of a pixel that is given before binning
    *[({**LENS, x: 2, y: 2}, "plate_scale", BINNED, "") for x, y in (
        ("CCDBIN1", "CCDBIN2"), ("BIN-FCT1", "BIN-FCT2"), ("DETXBIN", "DETYBIN"), ("HBIN", "VBIN"),
        ("BIN1", "BIN2"))],
    # a gain that is none, and one before multiplication
    *[({"CVF": (2.12, comment)}, "gain", None, "CVF") for comment in (
        "wavelength in micron", "circular variable filter position")],
    *[({"GAIN": (1, comment), "OBSERVAT": "KECK"}, "gain", None, "is a camera setting") for comment in (
        "gain code", "gain level", "gain step", "0=low 1=high", "switch position", "gain register", "x1",
        "PGA gain", "Sensor gain", "set by user", "Gain (%)")],
    *[({"GAIN": (2.0, comment), "OBSERVAT": "KECK"}, "gain", 2.0, "") for comment in (
        "Inverse gain (e-/DN)", "inverse gain e-/ADU", "e-/ADU, high gain")],
    ({"EXPTIME": (30.0, "frames per second")}, "exposure", None, "frames per s"),
    ({"PIXSCALE": (2.5, "px/arcsec")}, "plate_scale", None, "px/"),
    *[({"EGAIN": 4.9, key: 100}, "gain", 4.9, key) for key in ("EMGAIN", "EMREALGN", "GAINEM", "EMGAIN_C")],
    ({"EGAIN": 4.9, "EMGAIN": 1}, "gain", 4.9, ""),
    ({"TELESCOP": "HST", "INSTRUME": "NICMOS", "ADCGAIN": (5.4, "gain (electrons/DN)")}, "gain", 5.4, ""),
    # several exposures, and numbers that are not read
    ({"EXPTIME": 26.8, "TOTALBCD": 49}, "exposure", 26.8, "TOTALBCD"),
    *[({key: 5.0, "EXPTIME": 2.0}, "exposure", 2.0, f"{key} = 5.0 is not read") for key in (
        "SATURVAL", "DETRON", "EFFRON", "CCDREAD", "ESCALE", "KGAINPAR", "PXSCAL1", "GS_SCALE")],
    *[({f"HIERARCH ESO DET CHIP1 OUT1 {key}": 1.2}, name, None, f"OUT1 {key} = 1.2 is not read")
      for key, name in (("CONAD", "gain"), ("RON", "read_noise"))],
    ({"GAIN": (1.7, "[e-/D.N.] Gain of detector.")}, "gain", 1.7, ""),
    *[({f"HIERARCH {key}": 5.0}, "exposure", None, f"{key} = 5.0 is not read") for key in (
        "EXPTIMEMS", "EXPOSURE_MS")],
]  # fmt: skip


@pytest.mark.parametrize(("cards", "name", "value", "named"), NUMBERS, ids=lambda x: str(x)[:70])
def test_a_number_is_what_its_writer_meant_or_is_warned_of(cards, name, value, named):
    assert_number(cards, name, value, named)


@pytest.mark.parametrize(
    ("own", "exposure"), [(0.0, 30.0), (1.0, 1.0)], ids=["unknown", "as if normalised to a second"]
)
def test_an_exposure_that_the_primary_header_contradicts_is_warned_of(tmp_path, own, exposure):
    image = fits.ImageHDU(SCI, fits.Header({"EXPTIME": own}))
    fits.HDUList([fits.PrimaryHDU(header=fits.Header({"EXPTIME": 30.0})), image]).writeto(tmp_path / "a.fits")
    (frame,) = read_frames(tmp_path / "a.fits")
    assert frame.metadata.value("exposure") == exposure
    assert_warned(frame.metadata.warnings, "contradicts")


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("count s-1 pix-1", "adu/s"), ("adu / (pix s)", "adu/s"), ("count pixel-1", "adu"),
        ("Data Numbers", "adu"), ("electron / (s pix)", "electron/s"), ("electron pix^-1", "electron"),
        ("e^-/s", "electron/s"), ("e^-", "electron"), ("electron / (pix min)", None), ("e^-1", None),
    ],
)  # fmt: skip
def test_what_is_counted_in_a_pixel_is_read_as_astropy_writes_it(text, unit):
    assert resolve_unit(text) == unit


@pytest.mark.parametrize(
    ("cards", "time", "named"),
    [
        ({"DATE-OBS": (DAY, "[TAI] start")}, "2020-01-01T00:00:00", ""),
        ({"DATE-OBS": (DAY, "UTC, 37 s behind TAI")}, DAY, ""),
        ({"DATE-OBS": DAY, "TIMESYS": "TAI", "UTC-OBS": "00:00:00"}, "2020-01-01T00:00:00", ""),
        # what LSST's pipelines made of headers of DECam and MegaPrime
        ({"DATE-OBS": DAY, "TIMESYS": "TAI", "TIME-OBS": ("00:00:37", "(UTC)")}, DAY, "TIME-OBS"),
        ({"DATE-OBS": ("2020-01-01", "(UTC)"), "TIMESYS": "TAI", "UTC-OBS": "00:00:37"}, DAY, "comment"),
        ({"DATE-OBS": "2020-01-01", "UT": "00:02:07", "UT-STR": "00:00:37"}, DAY, ""),
        ({"DATE-OBS": "2020-01-01", "UT-TIME": "00:00:37"}, DAY, ""),  # Magellan
        ({"DATE-OBS": (f"{DAY}Z", "TSTART as UTC calendar date"), "TIMESYS": "TDB"}, DAY, ""),  # TESS
        ({"DATE-OBS": "2020-01-01T02:00:37+02:00", "TIMESYS": "TAI"}, DAY, ""),
        # SolarSoft, whose MJD is a whole number with the time of day in another keyword
        ({"DATE-OBS": "01-JAN-20", "DATE_OBS": DAY}, DAY, "01-JAN-20"),
        ({"MJD": 58849, "TIME": 37000, "DATE_OBS": DAY}, DAY, ""),
        ({"MJD": 58849, "TIME_OBS": "00:00:37"}, f"{DAY}.000", ""),
        ({"MJD": 58849, "TIME": 37000}, "2020-01-01", ""),
    ],
)
def test_a_time_is_that_of_the_day_in_utc(cards, time, named):
    metadata = resolve_header(header(cards))
    assert metadata.value("time") == time
    assert_warned(metadata.warnings, named)


def written(tmp_path, *others, **cards):
    image = fits.ImageHDU(SCI.astype("f4"), fits.Header({"BUNIT": "adu"}), name="SCI")
    fits.HDUList([fits.PrimaryHDU(header=fits.Header(cards)), image, *others]).writeto(tmp_path / "a.fits")
    return next(iter(read_frames(tmp_path / "a.fits")))


def flags(name, *values, **cards):
    plane = np.zeros(SHAPE, np.int16)
    plane[0, : len(values)] = values
    return fits.ImageHDU(plane, fits.Header(cards), name=name)


def masked(frame):
    return np.flatnonzero(frame.mask[0]).tolist()


@pytest.mark.parametrize(
    ("camera", "usable"),
    [
        ({"INSTRUME": "WFC3", "DETECTOR": "UVIS"}, [64]),
        ({"INSTRUME": "WFC3", "DETECTOR": "IR"}, [64, 8192]),
        ({"INSTRUME": "NICMOS"}, [1024]),  # sources; 64 is saturation
        ({"INSTRUME": "WFPC2"}, [1024]),  # repaired warm pixels
        ({"INSTRUME": "STIS"}, []),
    ],
)
def test_bits_of_hst_mean_what_the_handbook_of_the_instrument_says(tmp_path, camera, usable):
    bits = [16, 64, 1024, 8192]
    frame = written(tmp_path, flags("DQ", *bits), TELESCOP="HST", **camera)
    assert masked(frame) == [n for n, bit in enumerate(bits) if bit not in usable]


def test_planes_of_lsst_are_known_by_their_newer_cards(tmp_path):
    names = {"MSKN0000": "BAD", "MSKM0000": 1, "MSKN0005": "DETECTED", "MSKM0005": 32,
             "MSKN0007": "SPIKE", "MSKM0007": 128}  # fmt: skip
    frame = written(tmp_path, flags("MASK", 1, 32, 128, 33, **names))
    assert (masked(frame), frame.metadata.value("bad_bits")) == ([0, 3], 1)


def test_the_mask_of_the_dark_energy_survey_is_used(tmp_path):
    assert masked(written(tmp_path, flags("MSK", 0, 2))) == [1]


@pytest.mark.parametrize("name", ["SATURATED", "DEFECTS", "STATUS", "BITS"])
def test_integers_beside_floats_may_be_flags_whatever_their_name(tmp_path, name):
    assert_warned(written(tmp_path, flags(name, 1)).metadata.warnings, f"{name} (HDU 2) may describe")


def test_an_image_of_another_name_beside_an_image_is_not_warned_of(tmp_path):
    assert_warned(written(tmp_path, fits.ImageHDU(SCI, name="ZODI")).metadata.warnings, "")


def test_the_aperture_of_a_target_of_tess_is_no_frame_without_a_word(tmp_path):
    fits.HDUList([fits.PrimaryHDU(), flags("APERTURE", 3)]).writeto(tmp_path / "a.fits")
    (frame,) = read_frames(tmp_path / "a.fits")
    assert_warned(frame.metadata.warnings, "APERTURE (HDU 1) is read as an image")


@pytest.mark.parametrize(("cards", "named"), [({"NSAMP": 3}, "NSAMP"), ({"NSAMP": 2}, "")])
def test_planes_as_many_as_reads_may_be_a_ramp(tmp_path, cards, named):
    fits.writeto(tmp_path / "a.fits", np.stack([SCI, 2 * SCI, 3 * SCI]), fits.Header(cards))
    assert_warned(next(iter(read_frames(tmp_path / "a.fits"))).metadata.warnings, named)


def test_the_mask_beside_a_reprojected_image_of_noao_belongs_to_it(tmp_path):
    for part, data in {"opi": SCI, "opd": flags("", 0, 4).data, "opw": 1 / SCI}.items():
        chip = fits.ImageHDU(data, name="N4")
        fits.HDUList([fits.PrimaryHDU(), chip]).writeto(tmp_path / f"c4d_1_{part}_r_v1.fits")
    (path,) = find_files([tmp_path])
    (frame,) = read_frames(path)
    assert masked(frame) == [1]


def test_the_data_section_of_la_palma_is_known(tmp_path):
    fits.writeto(tmp_path / "a.fits", SCI, fits.Header({"RTDATSEC": "[1:6,1:6]"}))
    assert masked(next(iter(read_frames(tmp_path / "a.fits")))) == [6, 7]


@pytest.mark.parametrize(("dtype", "text"), [("f4", "-9999"), ("u2", "65535")])
def test_the_number_for_no_data_of_a_tiff_is_masked(tmp_path, dtype, text):
    data = SCI.astype(dtype)
    data[-1, 2] = np.dtype(dtype).type(float(text))
    tag = (42113, 2, 0, text, True)
    tifffile.imwrite(tmp_path / "a.tif", data, metadata=None, extratags=[tag])
    assert masked(next(iter(read_frames(tmp_path / "a.tif")))) == [2]


@pytest.mark.parametrize(
    ("text", "time"),
    [('"2026-11-21T03:00:00+02:00"', "2026-11-21T01:00:00"), ("2026-11-21T03:00:00Z", "2026-11-21T03:00:00")],
)
def test_a_time_beside_a_tiff_is_in_utc(tmp_path, text, time):
    tifffile.imwrite(tmp_path / "a.tif", SCI.astype("u2"))
    (tmp_path / "a.toml").write_text(f"time = {text}\n")
    assert next(iter(read_frames(tmp_path / "a.tif"))).metadata.value("time") == time


def test_a_time_beside_a_tiff_that_is_none_is_refused(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", SCI.astype("u2"))
    (tmp_path / "a.toml").write_text('time = "yesterday"\n')
    with refused(ErrorCode.OUT_OF_RANGE, "yesterday", error=ConfigurationError):
        list(read_frames(tmp_path / "a.tif"))


SKY = {"CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN", "CRPIX1": 4.0, "CRPIX2": 3.0, "CRVAL1": 10.0,
       "CRVAL2": 20.0, "CD1_1": -1e-4, "CD1_2": 0.0, "CD2_1": 0.0, "CD2_2": 1e-4}  # fmt: skip


@pytest.mark.parametrize(
    ("planes", "cards"),
    [(2, {"CTYPE3": "TIME", "CRVAL3": 0.0, "CDELT3": 1.0}), (1, {"RADECSYS": "FK5", "EQUINOX": 2000.0})],
)
def test_coordinates_that_are_read_as_meant_are_not_warned_of(tmp_path, planes, cards):
    data = SCI if planes == 1 else np.stack([SCI] * planes)
    fits.writeto(tmp_path / "a.fits", data, fits.Header({**SKY, **cards}))
    frame = next(iter(read_frames(tmp_path / "a.fits")))
    assert frame.metadata.value("plate_scale") == pytest.approx(0.36, rel=1e-6)
    assert_warned(frame.metadata.warnings, "")


def test_the_quadrants_of_euclid_are_each_a_frame(tmp_path):
    quadrants = [f"{row}-1.{letter}" for row in (1, 2) for letter in "EF"]
    hdus = [
        hdu for name in quadrants for hdu in (fits.ImageHDU(SCI, name=f"{name}.SCI"), flags(f"{name}.FLG", 1))
    ]
    fits.HDUList([fits.PrimaryHDU(), *hdus]).writeto(tmp_path / "a.fits")
    assert [masked(frame) for frame in read_frames(tmp_path / "a.fits")] == [[0]] * 4


def test_flags_of_all_planes_are_those_of_the_planes_that_are_images(tmp_path):
    header = fits.Header({"CTYPE3": "STOKES", "CRVAL3": 1.0, "CDELT3": 1.0, "CRPIX3": 1.0})
    image = fits.ImageHDU(np.stack([SCI, SCI]), header, name="SCI")
    quality = fits.ImageHDU(np.stack([flags("", 0, 1).data, flags("", 1).data]), name="DQ")
    fits.HDUList([fits.PrimaryHDU(), image, quality]).writeto(tmp_path / "a.fits")
    (frame,) = read_frames(tmp_path / "a.fits")
    assert masked(frame) == [1]
    with open_frames(tmp_path / "a.fits") as file:
        assert [row[3] for row in file.describe() if "HDU 2" in row[0]] == ["mask of HDU 1"]


def test_cards_without_a_keyword_are_remarks(tmp_path):
    header = fits.Header([("", "of the detector"), ("EXPTIME", 2.0), ("", "of the telescope")])
    fits.writeto(tmp_path / "a.fits", np.stack([SCI, SCI]), header)
    assert_warned(next(iter(read_frames(tmp_path / "a.fits"))).metadata.warnings, "")


def test_every_plane_of_a_stack_of_metamorph_is_a_frame(tmp_path):
    planes = np.stack([SCI, SCI + 100]).astype("<u2")
    size = [(256, 4, 1, 8), (257, 4, 1, 6), (258, 3, 1, 16), (259, 3, 1, 1), (262, 3, 1, 1), (273, 4, 1, 8),
            (277, 3, 1, 1), (278, 4, 1, 6), (279, 4, 1, 96)]  # fmt: skip
    start = 8 + planes.nbytes
    lists = start + 2 + 12 * 11 + 4  # UIC1 and UIC2, six numbers for each plane
    entries = [*size, (33628, 4, 2, lists), (33629, 5, 2, lists + 8)]
    directory = b"".join(struct.pack("<HHII", *entry) for entry in entries)
    body = struct.pack("<H", 11) + directory + bytes(4 + 8 + 48)
    (tmp_path / "a.tif").write_bytes(b"II*\0" + struct.pack("<I", start) + planes.tobytes() + body)
    first, second = read_frames(tmp_path / "a.tif")
    np.testing.assert_array_equal(second.data, planes[1, ::-1])
    np.testing.assert_array_equal(first.data, planes[0, ::-1])
