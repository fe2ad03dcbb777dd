"""Rows from the top, mosaics and colours of FITS files, which are treated as in a TIFF."""

import numpy as np
import pytest
from astropy.io import fits
from refusals import refused

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import open_frames, read_frames, write_fits

IMAGE = np.arange(20).reshape(4, 5).astype(np.uint16)


@pytest.mark.parametrize("ending", [".fits", ".fits.gz", ".fits.fz"])
@pytest.mark.parametrize("word", ["TOP-DOWN", "top-down"])
def test_rows_from_the_top_are_turned_over(tmp_path, ending, word):
    cards = {"ROWORDER": word, "LINETIME": (2e-5, "[s]"), "BLANK": 1}
    stored = np.stack([IMAGE, IMAGE + 100])[:, ::-1].astype(np.int16)
    path = write_fits(tmp_path / f"a{ending}", stored, header=cards)
    first, second = read_frames(path)
    np.testing.assert_array_equal(second.data, IMAGE + 100)
    assert first.data.flags.c_contiguous
    assert np.argwhere(first.mask).tolist() == [[0, 1]]
    assert first.metadata.row_order == -1
    assert first.metadata.value("line_time") == -2e-5


@pytest.mark.parametrize(("word", "warned"), [("BOTTOM-UP", False), ("", False), ("SIDEWAYS", True)])
def test_other_rows_stay(tmp_path, word, warned):
    (frame,) = read_frames(write_fits(tmp_path / "a.fits", IMAGE, header={"ROWORDER": word}))
    np.testing.assert_array_equal(frame.data, IMAGE)
    assert any("ROWORDER = 'SIDEWAYS'" in text for text in frame.metadata.warnings) == warned


def test_the_sky_is_turned_with_the_rows(tmp_path):
    sky = {"CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN", "CRPIX1": 2.0, "CRPIX2": 3.0, "CRVAL1": 10.0}
    sky |= {"CRVAL2": 20.0, "CDELT1": -1e-3, "CDELT2": 1e-3, "CROTA2": 30.0}
    (stored,) = read_frames(write_fits(tmp_path / "a.fits", IMAGE, header=sky))
    (turned,) = read_frames(write_fits(tmp_path / "b.fits", IMAGE, header={**sky, "ROWORDER": "TOP-DOWN"}))
    x, y = np.arange(5.0), np.array([0.0, 1.0, 3.0, 2.0, 0.0])
    np.testing.assert_allclose(
        turned.metadata.wcs.pixel_to_world_values(x, 3 - y), stored.metadata.wcs.pixel_to_world_values(x, y)
    )


@pytest.mark.parametrize(
    ("cards", "planes", "named"),
    [
        ({"CTYPE3": "RGB"}, 3, "CTYPE3 = 'RGB'"),
        ({"CTYPE3": "RGB"}, 4, "CTYPE3 = 'RGB'"),
        ({"COLORSPC": "RGB"}, 3, "COLORSPC = 'RGB'"),
        ({"BAYERPAT": "RGGB"}, 3, "BAYERPAT = 'RGGB'"),
    ],
)
def test_planes_of_colours_are_refused(tmp_path, cards, planes, named):
    path = write_fits(tmp_path / "a.fits", np.stack([IMAGE] * planes), header=cards)
    with refused(ErrorCode.COLOUR, path, planes, named, error=FrameError):
        open_frames(path)


def test_colours_along_the_first_axis_are_refused(tmp_path):
    path = write_fits(tmp_path / "a.fits", np.zeros((4, 5, 3)), header={"CTYPE1": "RGB"})
    with refused(ErrorCode.COLOUR, path, 3, "CTYPE1 = 'RGB'", error=FrameError):
        open_frames(path)


def test_three_planes_are_three_frames_and_a_mosaic_is_a_warning(tmp_path):
    assert len(list(read_frames(write_fits(tmp_path / "a.fits", np.stack([IMAGE] * 3))))) == 3
    (frame,) = read_frames(write_fits(tmp_path / "b.fits", IMAGE, header={"BAYERPAT": "RGGB"}))
    assert any("mosaic" in text for text in frame.metadata.warnings)


@pytest.mark.parametrize("key", ["PHOTMJSR", "FLUXCONV"])
def test_surface_brightness_becomes_a_rate_where_the_header_says_how(tmp_path, key):
    image = IMAGE / 7.0
    hdus = [fits.PrimaryHDU(header=fits.Header({"TELESCOP": "JWST", "EFFEXPTM": 20.0})), fits.ImageHDU(image)]
    hdus[1].header.update({"BUNIT": "MJy/sr", key: 0.5})
    fits.HDUList(hdus).writeto(tmp_path / "a.fits")
    (frame,) = read_frames(tmp_path / "a.fits")
    np.testing.assert_allclose(frame.data, image / 0.5)
    assert frame.unit == "adu/s"
    assert (frame.metadata.value("exposure"), key in frame.metadata.unit.source) == (20.0, True)


def test_surface_brightness_keeps_its_name_where_the_header_does_not(tmp_path):
    (frame,) = read_frames(write_fits(tmp_path / "a.fits", IMAGE, header={"BUNIT": "MJy/sr"}))
    assert frame.unit == "MJy/sr"
    np.testing.assert_array_equal(frame.data, IMAGE)
