"""The table [detector] of an instrument file: numbers, maps, and a detector to begin with."""

from dataclasses import replace

import numpy as np
import pytest
from astropy.io import fits
from refusals import refused

from jitterkit.batch.steps import calibrate
from jitterkit.detectors import detector_preset
from jitterkit.errors import ConfigurationError, ErrorCode, FrameError
from jitterkit.frames import Metadata, RawFrame, read_frames, write_fits, write_tiff
from jitterkit.instruments import load_instrument, read_instrument

NUMBERS = """
gain = 2.0
read_noise = 3.0
bias = 100
dark_current = 0.5
full_well = 20000
bits = 14
nonlinearity = [-1e-6, 2e-11]
coupling = 0.004
diffusion = 0.2
line_time = -15e-6
cosmic_rays = 1e-6
"""


@pytest.fixture
def detector(tmp_path):
    """A function that reads a [detector]."""

    def read(table, head='base = "smallsat"'):
        path = tmp_path / "cam.toml"
        path.write_text(f"[instrument]\n{head}\n[detector]\n{table}\n")
        return read_instrument(path).detector

    return read


def test_every_number_of_a_camera_may_be_said(detector):
    found = detector(NUMBERS)
    said = {
        "gain": 2.0, "read_noise": 3.0, "bias": 100.0, "dark_current": 0.5, "full_well": 20000.0, "bits": 14,
        "nonlinearity": (-1e-6, 2e-11), "coupling": 0.004, "diffusion": 0.2, "line_time": -15e-6,
        "cosmic_rays": 1e-6,
    }  # fmt: skip
    for name, value in said.items():
        assert getattr(found, name) == value
        assert found.source(name) == f"instrument file cam.toml [detector] {name}"


@pytest.mark.parametrize("write", [write_fits, write_tiff])
def test_maps_come_from_files_beside_the_toml_on_the_rows_of_the_frames(detector, tmp_path, write):
    rng = np.random.default_rng(1)
    maps = {
        "bias": rng.uniform(90, 110, (6, 8)).astype(np.float32),
        "read_noise": rng.uniform(2, 5, (6, 8)).astype(np.float32),
        "dark_current": rng.uniform(0, 9, (6, 8)).astype(np.float32),
        "flat": (1 + np.linspace(-0.1, 0.1, 48).reshape(6, 8)).astype(np.float32),
        "bad_pixels": (rng.random((6, 8)) < 0.2).astype(np.uint8),
    }
    for name, values in maps.items():
        write(tmp_path / f"{name}.map", values)
    found = detector("\n".join(f'{name} = "{name}.map"' for name in maps))
    for name, values in maps.items():
        np.testing.assert_array_equal(getattr(found, name), values)
        assert found.source(name) == f"instrument file cam.toml [detector] {name}"


@pytest.mark.parametrize(
    ("suffix", "rows", "frame_order", "doubted"),
    [
        (".fits", None, 1, False), (".fits", None, -1, True), (".fits", "BOTTOM-UP", -1, False),
        (".fits", "TOP-DOWN", 1, False), (".tif", None, -1, False), (".tif", None, 1, True),
        (".fits", "UPSIDE", 1, False), (".fits", "UPSIDE", -1, True), (".fits", "", -1, True),
    ],
)  # fmt: skip
def test_a_map_whose_first_row_may_be_the_frames_last_is_doubted(
    detector, tmp_path, caplog, suffix, rows, frame_order, doubted
):
    """The first row of an array is the lowest in a FITS, and the top one in a TIFF, which is turned over.

    A word that is no order says as little as none, and is named.
    """
    path = tmp_path / f"bad{suffix}"
    if suffix == ".fits":
        write_fits(path, np.eye(6, 8), header={} if rows is None else {"ROWORDER": rows})
    else:
        write_tiff(path, np.eye(6, 8, dtype=np.uint8))
    camera = replace(load_instrument("smallsat"), detector=detector(f'bad_pixels = "{path.name}"'))
    known = Metadata(row_order=frame_order)
    frame = calibrate(RawFrame(np.arange(48.0).reshape(6, 8), metadata=known), camera)
    assert any("top row" in said for said in frame.metadata.warnings) == doubted
    assert ("bad.fits: ROWORDER = 'UPSIDE'" in caplog.text) == (rows == "UPSIDE")


@pytest.mark.parametrize(
    ("own", "of_map", "found"),
    [
        ({"XORGSUBF": 80, "YORGSUBF": 40}, {"XORGSUBF": 10, "YORGSUBF": 40}, "refused"),
        ({"XORGSUBF": 80, "YORGSUBF": 40}, {"XORGSUBF": "80", "YORGSUBF": 40.0}, ""),
        ({"XORGSUBF": 80, "YORGSUBF": 40}, {}, "doubted"),
        ({}, {"LTV1": -80.0, "LTV2": 0.0}, "doubted"),
        ({"LTV1": 0.25, "LTV2": 0.25, "CCDSEC": "[8:1,1:6]"}, {}, ""),  # binned, read backwards, whole
        ({"LTV1": -1000.0, "LTV2": 0.0}, {"LTV1": -1001.0, "LTV2": 0.0}, "refused"),
        ({"SUBSTRT1": 1, "SUBSTRT2": 1}, {}, ""),
        ({"SUBSTRT1": 1, "SUBSTRT2": 1}, {"SUBSTRT1": 1025, "SUBSTRT2": 1}, "refused"),
        ({"CCDSEC": "[9:16,1:6]"}, {"CCDSEC": "[1:8, 1:6]"}, "refused"),
        ({"CCDSEC": "[9:16,1:6]"}, {}, "doubted"),
        ({"DETSEC": "[9:16,1:6]"}, {}, ""),  # of a mosaic: its chip may begin there
        ({"DETSEC": "[9:16,1:6]"}, {"DETSEC": "[1:8,1:6]"}, "refused"),
        ({"ESO DET WIN1 STRX": 9, "ESO DET WIN1 STRY": 1}, {}, "doubted"),
        ({"SUBRECT": "9, 16, 6, 1"}, {"SUBRECT": "1, 8, 6, 1"}, "refused"),
    ],
)  # fmt: skip
def test_a_map_of_another_part_of_the_detector_is_not_used(detector, tmp_path, own, of_map, found):
    """A camera's window says where it begins: IRAF and HST, SBFITSEXT, JWST, ESO, Andor."""
    write_fits(tmp_path / "bad.fits", np.eye(6, 8), header=of_map)
    write_fits(tmp_path / "frame.fits", np.arange(48.0).reshape(6, 8), header=own)
    camera = replace(load_instrument("smallsat"), detector=detector('bad_pixels = "bad.fits"'))
    raw = next(read_frames(tmp_path / "frame.fits"))
    if found == "refused":
        with refused(ErrorCode.WRONG_INSTRUMENT, "bad_pixels", next(iter(own)), error=FrameError):
            calibrate(raw, camera)
        return
    said = [text for text in calibrate(raw, camera).metadata.warnings if "part of the detector" in text]
    assert len(said) == (found == "doubted")


def test_what_has_no_number_in_a_map_is_bad(detector, tmp_path):
    flat = np.ones((6, 8), np.float32)
    flat[2, 3] = np.nan
    write_fits(tmp_path / "flat.fits", flat)
    assert np.argwhere(detector('flat = "flat.fits"').bad_pixels).tolist() == [[2, 3]]
    write_fits(tmp_path / "bad.fits", flat - 1)
    assert np.argwhere(detector('bad_pixels = "bad.fits"').bad_pixels).tolist() == [[2, 3]]


def test_a_detector_preset_fills_what_is_not_said(detector):
    found, preset = detector('base = "imx183"\ngain = 3.5'), detector_preset("imx183")
    assert (found.gain, found.read_noise, found.line_time) == (3.5, preset.read_noise, preset.line_time)
    assert found.source("gain").startswith("instrument file cam.toml")
    assert found.source("read_noise") == preset.source("read_noise")
    assert detector('base = "imx183"\nline_time = 0').line_time == 0.0


def test_a_map_of_another_detector_is_found_out_at_the_frame(detector, tmp_path):
    write_fits(tmp_path / "bias.fits", np.full((6, 8), 100.0))
    found = detector('bias = "bias.fits"')
    with refused(ErrorCode.WRONG_INSTRUMENT, "column 9, row 5", "bias", "8 x 6", error=FrameError):
        found.calibrate(RawFrame.from_array(np.zeros((6, 10))))


@pytest.mark.parametrize(
    ("table", "code", "values"),
    [
        ("read_noise = [1]", ErrorCode.WRONG_TYPE, ("[detector] read_noise = [1]", "e-")),
        ("bias = true", ErrorCode.WRONG_TYPE, ("[detector] bias = True", "ADU")),
        ("bits = 12.5", ErrorCode.WRONG_TYPE, ("[detector] bits = 12.5",)),
        (
            'dark_current = "no.fits"',
            ErrorCode.NOT_FOUND,
            ("[detector] dark_current = 'no.fits'", "cam.toml"),
        ),
        ('flat = "no.fits"', ErrorCode.NOT_FOUND, ("[detector] flat = 'no.fits'", "cam.toml")),
        ('flat = "bright.fits"', ErrorCode.OUT_OF_RANGE, ("flat", " 2000 ")),
        (
            'flat = "even.fits"\nbias = "bright.fits"',
            ErrorCode.WRONG_SHAPE,
            ("bias", "8 x 6", "flat", "4 x 4"),
        ),
        ("nonlinearity = 1e-6", ErrorCode.WRONG_TYPE, ("[detector] nonlinearity = 1e-06", "1/e-")),
        ("nonlinearity = []", ErrorCode.WRONG_SHAPE, ("[detector] nonlinearity = []", "1/e-")),
        (
            "nonlinearity = [-1e-4]",
            ErrorCode.CONFLICT,
            ("nonlinearity = [-0.0001]", " 5000 e-", "full_well", " 15000 e-"),
        ),
        ("coupling = 0.2", ErrorCode.OUT_OF_RANGE, ("coupling = 0.2", "0 to 0.125")),
        ('base = "imx138"', ErrorCode.UNKNOWN_NAME, ("'imx138'", "'imx183'")),
        ("linetime = 0", ErrorCode.UNKNOWN_NAME, ("[detector] 'linetime'", "'line_time'")),
    ],
)
def test_a_mistake_is_refused_with_the_file_and_the_value(detector, tmp_path, table, code, values):
    write_fits(tmp_path / "bright.fits", np.full((6, 8), 2000.0))
    write_fits(tmp_path / "even.fits", np.ones((4, 4)))
    with refused(code, *values, error=ConfigurationError) as caught:
        detector(table)
    assert str(caught.value).startswith(str(tmp_path / "cam.toml"))


def test_a_map_that_is_no_image_is_refused_by_its_own_name(detector, tmp_path):
    (tmp_path / "flat.fits").write_text("hello")
    with refused(ErrorCode.UNKNOWN_FORMAT, tmp_path / "flat.fits", error=FrameError):
        detector('flat = "flat.fits"')


@pytest.mark.parametrize(
    ("key", "level", "cards", "values"),
    [
        ("dark_current", 0.5, {"BUNIT": "adu/s"}, ("'adu/s'", "BUNIT", "e-/s")),
        ("dark_current", 0.5, {"BUNIT": "electron", "EXPTIME": 60.0}, ("'electron'", "e-/s")),
        ("dark_current", 0.5, {"BUNIT": "electron/h"}, ("'electron/h'", "e-/s")),
        ("dark_current", 130.0, {"EXPTIME": 60.0}, ("60 s", "EXPTIME", "'electron/s'")),
        ("bias", 100.0, {"BUNIT": "electron"}, ("'electron'", "ADU")),
        ("read_noise", 3.0, {"BUNIT": "adu"}, ("'adu'", "e-")),
        ("read_noise", 9.0, {"BUNIT": "electron2"}, ("'electron2'", "e-")),
    ],
)
def test_a_map_in_another_unit_and_a_dark_frame_as_dark_current_are_refused(
    detector, tmp_path, key, level, cards, values
):
    path = tmp_path / "map.fits"
    fits.PrimaryHDU(np.full((6, 8), level), fits.Header(cards)).writeto(path)
    with refused(ErrorCode.UNKNOWN_UNIT, path, *values, error=FrameError):
        detector(f'{key} = "map.fits"')


@pytest.mark.parametrize(
    ("key", "level", "cards"),
    [
        ("dark_current", 0.5, {"BUNIT": "e-/s", "EXPTIME": 60.0}),
        ("dark_current", 0.5, {"BUNIT": "  "}),
        ("bias", 100.0, {"BUNIT": "DN", "EXPTIME": 0.0}),
        ("read_noise", 3.0, {"BUNIT": "electrons"}),
        ("flat", 1.0, {"BUNIT": "adu", "EXPTIME": 2.0}),
    ],
)
def test_a_map_in_its_own_unit_is_read(detector, tmp_path, caplog, key, level, cards):
    fits.PrimaryHDU(np.full((6, 8), level), fits.Header(cards)).writeto(tmp_path / "map.fits")
    assert np.all(getattr(detector(f'{key} = "map.fits"'), key) == level)
    assert not caplog.messages


def test_a_dark_frame_as_the_bias_is_warned_of(detector, tmp_path, caplog):
    fits.PrimaryHDU(np.full((6, 8), 100.0), fits.Header({"EXPTIME": 60.0})).writeto(tmp_path / "bias.fits")
    detector('bias = "bias.fits"')
    assert ["60 s" in text and "bias.fits" in text for text in caplog.messages] == [True]


def test_a_cube_is_no_map(detector, tmp_path):
    """Its first plane, one dark of several, is not their mean."""
    for key, level in (("dark_current", 1.0), ("bias", 100.0), ("flat", 1.0), ("bad_pixels", 0.0)):
        fits.PrimaryHDU(np.full((3, 6, 8), level)).writeto(tmp_path / f"{key}.fits")
        with refused(ErrorCode.WRONG_SHAPE, tmp_path / f"{key}.fits", 3, key, error=FrameError):
            detector(f'{key} = "{key}.fits"')


def test_noise_below_zero_is_no_dark_current_and_a_dead_pixel(detector, tmp_path):
    dark, flat = np.ones((6, 8), np.float32), np.ones((6, 8), np.float32)
    dark[1, 2], flat[3, 4] = -0.7, -0.01
    write_fits(tmp_path / "dark.fits", dark)
    write_fits(tmp_path / "flat.fits", flat)
    found = detector('dark_current = "dark.fits"\nflat = "flat.fits"')
    assert (found.dark_current[1, 2], found.dark_current.sum()) == (0.0, 47.0)
    frame = found.calibrate(RawFrame.from_array(np.full((6, 8), 500.0), exposure=1.0))
    assert np.argwhere(frame.mask).tolist() == [[3, 4]]


def test_a_mask_with_one_for_good_is_warned_of_and_one_without_a_good_pixel_refused(
    detector, tmp_path, caplog
):
    good = np.ones((6, 8), np.uint8)
    good[2, 3] = 0
    write_fits(tmp_path / "good.fits", good)
    detector('bad_pixels = "good.fits"')
    assert ["97.9 %" in text and "good.fits" in text for text in caplog.messages] == [True]  # 47 of 48
    science = fits.ImageHDU(np.full((6, 8), 900.0), name="SCI")
    fits.HDUList([fits.PrimaryHDU(), science, fits.ImageHDU(1 - good, name="DQ")]).writeto(
        tmp_path / "sci.fits"
    )
    with refused(ErrorCode.OUT_OF_RANGE, "[detector] bad_pixels = 'sci.fits'", "zeros"):
        detector('bad_pixels = "sci.fits"')
