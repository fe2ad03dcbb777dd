"""Rows from the top, mosaics and colours of FITS files, which are treated as in a TIFF."""

import numpy as np
import pytest
from astropy.io import fits
from refusals import refused

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import open_frames, read_frames, write_fits
from jitterkit.frames.planes import role_of_label

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


BIDS = ("spectrum - background fit", "raw - weights none", "background - fit", "sigma - weights variance")
STOKES = {"CTYPE3": "STOKES", "CRVAL3": 1, "CDELT3": 1, "CRPIX3": 1}

LABELLED = [  # planes (s science, e error, v variance, i inverse, m mask, x else), cards, frames, warned
    ("sem", {"PLANE1": "science", "PLANE2": "error", "PLANE3": "mask"}, 1, ""),
    ("sxxe", {f"BANDID{n}": text for n, text in enumerate(BIDS, 1)}, 1, "2 ('raw"),
    ("sem", {"EXTNAME": "SCI,ERR,DQ"}, 1, ""), ("mvs", {"CONTENT": "mask / variance / flux"}, 1, ""),
    ("sim", {"COMMENT": "plane 1: science\nplane 2 = inverse variance\nlayer 3 is the bad pixels"}, 1, ""),
    ("ssee", {"LAYER_01": "science 1", "LAYER_02": "science 2", "LAYER_03": "error 1", "LAYER_04": "error 2"},
     2, ""),
    ("ssse", {"BAND0": "J", "BAND1": "H", "BAND2": "K", "BAND3": "1-sigma uncertainty"}, 3, ""),
    ("sxx", STOKES, 1, "STOKES 2"), ("xs", {**STOKES, "CDELT3": -1, "CRVAL3": 2}, 1, "STOKES 2"),
    ("ss", {**STOKES, "CDELT3": -1, "CRVAL3": -1}, 2, ""), ("ss", {"CTYPE3": "WAVE"}, 2, "wavelength"),
    ("sx", {"PLANE1": "light", "PLANE2": "dark"}, 1, "2 ('dark')"),
    ("sx", {"PLANE1": "image", "PLANE2": "smoothed"}, 2, ""),  # nothing says that it is no frame
    ("ss", {"PLANE1": "dark", "PLANE2": "dark"}, 2, ""),
    ("ss", {"FILTER1": "DARK", "FILTER2": "CLEAR"}, 2, ""), ("ss", {"IMAGETYP": "Dark Frame"}, 2, ""),
    ("ss", {"OBJECT": "flux, error"}, 2, ""), ("ss", {"EXTNAME": "dark frame"}, 2, ""),
    ("ss", {"APERT1": "mask", "APERT2": "J"}, 2, ""),
    ("ss", {"INPUT1": "a.fits", "INPUT2": "mask.fits"}, 2, ""),
    ("ss", {"PLANE1": "science", "PLANE2": "mask", "PLANE3": "error"}, 2, ""),
]  # fmt: skip


@pytest.mark.parametrize(("planes", "cards", "frames", "warned"), LABELLED, ids=lambda x: str(x)[:60])
@pytest.mark.parametrize("ending", [".fits", ".fits.fz"])
def test_labelled_planes_are_what_their_labels_say(tmp_path, planes, cards, frames, warned, ending):
    """A variance of four times the image tells errors, variances and weights from each other."""
    signal = 10 + IMAGE.astype(np.float32)
    bad = IMAGE == 7
    made = {"s": signal, "e": 2 * signal**0.5, "v": 4 * signal, "i": 0.25 / signal, "m": bad, "x": -signal}
    cube = np.stack([made[kind] for kind in planes]).astype(np.float32)
    header = fits.Header({key: value for key, value in cards.items() if key != "COMMENT"})
    for line in cards.get("COMMENT", "").splitlines():
        header.add_comment(line)
    hdus = [fits.PrimaryHDU(), fits.CompImageHDU(cube, header, quantize_level=0, compression_type="GZIP_1")]
    hdus = hdus if ending.endswith("fz") else [fits.PrimaryHDU(cube, header)]
    fits.HDUList(hdus).writeto(tmp_path / f"a{ending}")
    read = list(read_frames(tmp_path / f"a{ending}"))
    assert len(read) == frames
    for frame in read:
        good = ~frame.mask
        assert np.array_equal(frame.mask, bad) == ("m" in planes)
        assert (frame.variance is not None) == any(kind in planes for kind in "evi")
        if "smoothed" not in cards.values():
            np.testing.assert_array_equal(frame.data[good], signal[good])
        if frame.variance is not None:
            np.testing.assert_allclose(frame.variance[good], 4 * signal[good], rtol=1e-6)
        warnings = frame.metadata.warnings
        assert any(warned in text for text in warnings) if warned else not warnings


@pytest.mark.parametrize(
    "cards", [{"PLANE1": "error", "PLANE2": "mask"}, {**STOKES, "CRVAL3": 2}, {"CTYPE3": "COMPLEX"}]
)
def test_planes_of_which_none_is_an_image_are_refused(tmp_path, cards):
    path = write_fits(tmp_path / "a.fits", np.stack([IMAGE] * 2), header=cards)
    with refused(ErrorCode.NO_IMAGE, path, "HDU 0", "planes are", error=FrameError):
        open_frames(path)


def test_labels_are_understood_by_their_first_known_words():
    labels = {"Data quality": "quality", "1-sigma error": "sigma", "3: inverse variance": "weight", "J": "",
              "flux - error excluded": "image", "science": "image", "exposure map": "none"}  # fmt: skip
    assert {label: role_of_label(label) for label in labels} == labels


def table(**columns):
    made = (fits.Column(name.replace("__", "-"), "D", array=np.array(c)) for name, c in columns.items())
    return fits.BinTableHDU.from_columns(list(made))


TAN = {"CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN", "CRVAL1": 150.0, "CDELT1": -1e-4, "CDELT2": 1e-4}
OTHER = {f"{key}A": 2 * value if key.startswith("CDELT") else value for key, value in TAN.items()}
NUMBERED = {f"EXPTIME{n}": float(n) for n in (1, 2, 3)}

OF_PLANES = [  # cards, columns of a table behind the cube, scale of first and last plane, what is warned of
    (TAN, {}, (0.36, 0.36), ""),
    (TAN, {"CDELT1": [1, 2, 3]}, (0.36, None), "WCS of each plane but the first"),
    (TAN, {"CD1_1": [1, 2, 3]}, (0.36, None), "WCS of each plane but the first"),
    ({**TAN, **OTHER}, {}, (0.36, 0.36), "the WCS A has another scale"),
    ({**TAN, **OTHER, "CDELT1A": -1e-4, "CDELT2A": 1e-4}, {}, (0.36, 0.36), ""),
    ({**TAN, "CTYPE3": "TIME-TAB", "PS3_0": "T", "PS3_1": "X"}, {}, (None, None), "-TAB"),
    ({"EXPTIME": 1.0}, {"EXPTIME": [1, 2, 3]}, (None, None), "EXPTIME of each plane, in the table of HDU 1"),
    ({"EXPTIME": 1.0}, {"EXPTIME": [1, 2]}, (None, None), ""),
    ({"EXPTIME": 1.0}, {"mjd_obs": [6e4, 6e4, 6e4]}, (None, None), "mjd_obs of each plane"),
    (NUMBERED, {}, (None, None), "EXPTIME of each plane, in cards"),
    ({**dict.fromkeys(NUMBERED, 1.0), "EXPTIME": 1.0}, {}, (None, None), ""),
]  # fmt: skip


@pytest.mark.parametrize(("cards", "columns", "scales", "warned"), OF_PLANES, ids=lambda x: str(x)[:60])
def test_numbers_that_planes_have_each_are_warned_of(tmp_path, cards, columns, scales, warned):
    hdus = [fits.PrimaryHDU(np.stack([IMAGE] * 3), fits.Header(cards)), *[table(**columns)] * bool(columns)]
    fits.HDUList(hdus).writeto(tmp_path / "a.fits")
    first, _, last = read_frames(tmp_path / "a.fits")
    got = tuple(frame.metadata.value("plate_scale") for frame in (first, last))
    assert got == tuple(None if scale is None else pytest.approx(scale) for scale in scales)
    said = last.metadata.warnings
    assert any(warned in text for text in said) if warned else not said
