"""What following files to their results has shown: numbers that were wrong, and what is said of them now.

``scripts/frames_study`` follows many more.  Rows are those of ``test_variants``.
"""

import numpy as np
import pytest
from astropy.io import fits
from headers import assert_number, assert_warned

from jitterkit.batch.steps import calibrate
from jitterkit.detectors import Detector
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import RawFrame, open_frames, read_frames
from jitterkit.instruments import load_instrument, resolve

SHAPE = (6, 10)
IMAGE = np.arange(60.0).reshape(SHAPE) + 100


def noise(comment="", value=0.0, **cards):
    return {"RDNOISE": (value, comment), **cards}, "read_noise"


def time(comment, value=60.0):
    return {"EXPTIME": (value, comment)}, "exposure"


def rows(comment, value=5.0):
    return {"LINETIME": (value, comment)}, "line_time"


def scale(comment, **cards):
    return {"PIXSCALE": (0.4, comment), **cards}, "plate_scale"


@pytest.mark.parametrize(
    ("cards", "name", "value", "named"),
    [
        (*noise(), None, "RDNOISE = 0 is taken to be unknown"),
        (*noise(READNOIS=4.0), 4.0, "RDNOISE = 0"),
        (*noise("[e-] photon counting"), 0.0, ""),
        (*noise(value=0.5), 0.5, ""),
        ({"EGAIN": "4,5"}, "gain", 4.5, "if it is a list"),
        ({"EXPTIME": "0,25"}, "exposure", 0.25, ""),
        (*time("(1/60 s)"), None, "1/60"),
        (*time("in 1/30 sec"), None, "1/30"),
        (*time("1/60 s", 0.0166667), 0.0166667, ""),
        (*rows("lines per second"), None, "lines per"),
        (*rows("rows/s"), None, "rows/"),
        (*rows("line rate"), None, "rate"),
        (*rows("line time [us]"), 5e-6, ""),
        ({"EXPTIME": 10.0, "FRAMES": 4}, "exposure", 10.0, "FRAMES = 4"),
        ({"EXPTIME": 10.0, "NUMACC": 20}, "exposure", 10.0, "NUMACC = 20"),
        ({"EXPTIME": 10.0, "FRAMES": 4, "NAXIS3": 4}, "exposure", 10.0, ""),
        ({"CALSTAT": "BDF"}, "bias", 0.0, ""),
        ({"ZEROCOR": "Nov 21 2:03 Zero is z.fits"}, "bias", 0.0, ""),
        ({"CALSTAT": "BDF", "PEDESTAL": -100}, "bias", None, "PEDESTAL = -100"),
        ({"OVERSCAN": 32}, "bias", None, ""),
        ({"OVERSCAN": "32 columns"}, "bias", None, ""),
        ({"OVERSCAN": True}, "bias", None, ""),  # it may say that the image has some
        ({"OVERSCAN": "Nov 21 2:03 Overscan section is [49:56,1:48]"}, "bias", 0.0, ""),
        ({"CALSTAT": "Uncalibrated"}, "bias", None, ""),
        ({"ZEROCOR": 0}, "bias", None, ""),
        ({"BIASCOR": "NOT DONE"}, "bias", None, ""),
        ({"SUBBIAS": False}, "bias", None, ""),
        ({"SUBOSCAN": "no"}, "bias", None, ""),
        ({"SUBBIAS": "ccd=<CCDData>, master=<CCDData>"}, "bias", 0.0, ""),
        ({"SOFTBIAS": (1000, "software bias added to all DN")}, "bias", 1000.0, ""),
        (*scale("native", XBINNING=2), None, "'native'"),
        (*scale("arcsec/pixel at 1x1", CCDSUM="2 2"), None, "'1x1'"),
        (*scale("native"), 0.4, "no binning is known"),
        (*scale("1x1", XBINNING=1), 0.4, ""),
    ],
)
def test_a_number_that_was_taken_as_it_stands_is_read_or_warned_of(cards, name, value, named):
    assert_number(cards, name, value, named)


def written(tmp_path, *hdus, **cards):
    fits.HDUList([fits.PrimaryHDU(None, fits.Header(cards)), *hdus]).writeto(tmp_path / "a.fits")
    return tmp_path / "a.fits"


def masked(tmp_path, **cards):
    """Return the columns, from 1, and the rows that are masked throughout, and the warnings."""
    path = written(tmp_path, fits.ImageHDU(IMAGE, fits.Header(cards)))
    (raw,) = read_frames(path)
    columns, lines = (np.flatnonzero(raw.mask.all(axis=axis)) + 1 for axis in (0, 1))
    return columns.tolist(), lines.tolist(), raw.metadata.warnings


@pytest.mark.parametrize(
    ("cards", "columns", "lines", "named"),
    [
        ({"TRIMSEC": "[1:8,1:6]", "BIASSEC": "[9:10,1:6]"}, [9, 10], [], "TRIMSEC"),
        ({"DATASEC": "[3:10,2:6]"}, [1, 2], [1], "DATASEC"),
        ({"BIASSEC": "[10:9,1:6]"}, [9, 10], [], "BIASSEC"),
        ({"TRIMSEC": "[33:42,1:6]", "BIASSEC": "[1:2,1:6]"}, [], [], ""),  # of before the image was trimmed
        ({"DATASEC": "[1:10,1:6]", "BIASSEC": "[1:2,1:6]"}, [], [], ""),
        ({"BIASSEC": "[1:10,6:6]", "ROWORDER": "TOP-DOWN"}, [], [1], "BIASSEC"),
        ({"TRIMSEC": "[1:10,1:6]", "BIASSEC": "[11:12,1:6]"}, [], [], ""),  # was cut off
        ({"DATASEC": "[3:12,1:6]"}, [], [], ""),  # of before it was cut off
        ({"DATASEC": "[1:2,1:2]"}, [], [], ""), ({"TRIMSEC": "none"}, [], [], ""),
    ],
)  # fmt: skip
def test_pixels_outside_of_the_section_of_data_are_masked(tmp_path, cards, columns, lines, named):
    found = masked(tmp_path, **cards)
    assert found[:2] == (columns, lines)
    assert_warned(found[2], named)


def filled(value, *, top=0, bottom=0, left=0, right=0):
    """Return an image of noise with lines of one value at its edges."""
    image = np.random.default_rng(7).normal(10, 3, (20, 24))
    image[len(image) - top :], image[:bottom] = value, value
    image[:, :left], image[:, 24 - right :] = value, value
    return image


def photons(shape, count, sigma):
    """Return photons of a star without sky."""
    y, x = np.random.default_rng(7).normal(np.array(shape)[:, None] / 2, sigma, (2, count))
    return np.histogram2d(y, x, shape, [(0, shape[0]), (0, shape[1])])[0]


def crossed():
    image = filled(0.0, top=3)
    image[:, -1] = 65535
    return image


@pytest.mark.parametrize(
    ("image", "masked"),
    [
        (filled(0.0, top=2, bottom=1, left=3, right=1), 480 - 17 * 20),
        (filled(-999.0, right=4), 80),
        (crossed(), 3 * 24 + 17),
        (photons((64, 64), 3000, 9.0), 0),
        (filled(10.0, bottom=1), 24),  # of floats no two are alike
        (filled(0.0), 0),
        (np.zeros((20, 24)), 0),
        (filled(0.0, left=15), 0),  # more than half
        (np.random.default_rng(7).poisson(0.01, (20, 24)) * 1.0, 0),  # photons
        (np.pad(np.random.default_rng(7).poisson(0.01, (18, 24)), ((1, 1), (0, 0))) * 1.0, 0),
    ],
)
def test_lines_of_one_value_at_the_edges_are_masked(image, masked):
    frame = calibrate(RawFrame(image), load_instrument("smallsat"))
    assert frame.mask.sum() == masked
    said = [text for text in frame.metadata.warnings if "edges" in text]
    assert_warned(said, f"{masked} pixels" * bool(masked))


def test_the_planes_of_a_file_may_be_named_by_exttype(tmp_path):
    variance = fits.ImageHDU(IMAGE + 9, fits.Header({"EXTTYPE": "VARIANCE"}))
    mask = fits.ImageHDU((IMAGE > 150).astype("i4"), fits.Header({"EXTTYPE": "MASK"}))
    path = written(tmp_path, fits.ImageHDU(IMAGE, fits.Header({"EXTTYPE": "IMAGE"})), mask, variance)
    with open_frames(path) as file:
        raw = file[0]
        assert len(file) == 1
    assert raw.metadata.warnings == ()
    assert np.array_equal(raw.variance, variance.data)
    assert np.array_equal(raw.mask, IMAGE > 150)


@pytest.mark.parametrize(("bias", "warned"), [(100.0, True), (0.0, False)])
def test_a_bias_of_an_instrument_file_that_was_subtracted_is_warned_of(tmp_path, bias, warned):
    (raw,) = read_frames(written(tmp_path, fits.ImageHDU(IMAGE), CALSTAT="BDF"))
    (tmp_path / "mine.toml").write_text(f'[instrument]\nbase = "smallsat"\n[detector]\nbias = {bias}\n')
    metadata = resolve(raw, load_instrument(str(tmp_path / "mine.toml"))).metadata
    assert metadata.value("bias") == bias
    assert_warned(metadata.warnings, "CALSTAT = 'BDF'" * warned)
    preset = resolve(raw, load_instrument("smallsat")).metadata  # whose word counts less than the file's
    assert (preset.value("bias"), preset.warnings) == (0.0, ())


def test_pixels_that_are_an_arcsine_of_counts_are_refused(tmp_path):
    path = written(tmp_path, fits.ImageHDU(IMAGE, fits.Header({"BSOFTEN": 50.0, "BOFFSET": 1.0})))
    (raw,) = read_frames(path)
    with pytest.raises(FrameError) as refusal:
        Detector(gain=1.0).calibrate(raw)
    assert refusal.value.code is ErrorCode.UNKNOWN_UNIT
    assert "BSOFTEN" in str(refusal.value)
