"""The two records of an image."""

import dataclasses
import hashlib
import struct

import numpy as np
import pytest
from astropy import units
from astropy.io import fits
from astropy.nddata import CCDData, StdDevUncertainty, VarianceUncertainty
from astropy.wcs import WCS
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode, JitterkitError
from jitterkit.frames import Frame, RawFrame, open_frames, read_frames, write_fits

IMAGE = np.arange(12.0).reshape(3, 4)

NORTH_UP = {
    "CTYPE1": "RA---TAN",
    "CTYPE2": "DEC--TAN",
    "CRVAL1": 150.0,
    "CRVAL2": 60.0,
    "CD1_1": -1e-4,
    "CD2_2": 1e-4,
}


def test_a_bare_array_of_any_byte_order_becomes_a_frame():
    raw = RawFrame.from_array(IMAGE.astype(">i2"), gain=3.7, exposure=0.5)
    np.testing.assert_array_equal(raw.data, IMAGE)
    assert raw.data.dtype.isnative
    assert (raw.metadata.gain.value, raw.metadata.gain.unit, raw.metadata.gain.source) == (
        3.7,
        "e-/ADU",
        "argument",
    )
    assert (raw.name, raw.shape, raw.unit) == ("array", (3, 4), "adu")


def test_the_array_given_is_not_changed_or_shared():
    image = IMAGE.copy()
    raw = RawFrame.from_array(image)
    image[0, 0] = 99
    assert raw.data[0, 0] == 0


def test_an_unknown_word_about_an_array_is_refused():
    with refused(ErrorCode.UNKNOWN_NAME, "'gian'", "exposure, gain", error=ConfigurationError):
        RawFrame.from_array(IMAGE, gian=3.7)


def test_what_is_not_finite_is_zero_and_masked():
    image = IMAGE.copy()
    image[1, 2], image[0, 0] = np.nan, -np.inf
    raw = RawFrame.from_array(image, mask=IMAGE == 11)
    assert np.argwhere(raw.mask).tolist() == [[0, 0], [1, 2], [2, 3]]
    assert raw.data[1, 2] == 0
    assert raw.data[0, 0] == 0
    assert raw.data[2, 3] == 11


def test_the_mask_of_a_masked_array_is_kept():
    raw = RawFrame.from_array(np.ma.masked_greater(IMAGE, 9))
    assert raw.mask.sum() == 2


def test_a_digest_is_of_the_pixels_and_of_nothing_else(tmp_path):
    # sha256 of the shape in words and the values as little-endian doubles, computed by the standard library
    changed = hashlib.sha256(b"(3, 4)" + struct.pack("<12d", *range(12))).hexdigest()[:16]
    raw = RawFrame.from_array(IMAGE)
    assert raw.digest == changed
    for stored in (np.uint16, ">f4", "<i8"):
        assert RawFrame.from_array(IMAGE.astype(stored), gain=3.7).digest == changed
    packed = write_fits(tmp_path / "packed.fits.gz", IMAGE.astype(np.uint16))
    with open_frames(packed) as file:
        assert file[0].digest == changed
    assert RawFrame.from_array(IMAGE.reshape(4, 3)).digest != changed
    assert RawFrame.from_array(IMAGE[::-1]).digest != changed
    assert RawFrame.from_array(IMAGE.T).digest != RawFrame.from_array(IMAGE.reshape(4, 3)).digest
    assert raw.region(0, 0, 4, 2).digest != changed


@pytest.mark.parametrize("image", [IMAGE[0], IMAGE[None], np.zeros((0, 4))])
def test_only_two_dimensions_make_a_frame(image):
    with refused(ErrorCode.WRONG_SHAPE, "data", image.shape, error=JitterkitError):
        RawFrame.from_array(image)


def test_complex_numbers_are_refused():
    with refused(ErrorCode.WRONG_TYPE, error=JitterkitError):
        RawFrame.from_array(IMAGE * 1j)


def test_a_mask_of_another_shape_is_refused():
    with refused(ErrorCode.WRONG_SHAPE, "mask", (4, 3), (3, 4), error=JitterkitError):
        RawFrame.from_array(IMAGE, mask=np.zeros((4, 3), bool))


def test_a_region_keeps_the_place_it_came_from_however_often_it_is_cut():
    raw = RawFrame.from_array(IMAGE, mask=IMAGE == 6)
    cut = raw.region(1, 0, 3, 2).region(1, 1, 2, 1)
    np.testing.assert_array_equal(cut.data, [[6, 7]])
    np.testing.assert_array_equal(cut.mask, [[True, False]])
    assert cut.origin == (2, 1)
    assert cut.data.base is None


@pytest.mark.parametrize("box", [(-1, 0, 2, 2), (0, 0, 5, 1), (0, 2, 1, 2), (0, 0, 0, 1)])
def test_a_region_must_lie_inside(box):
    x0, y0, nx, ny = box
    with refused(
        ErrorCode.OUT_OF_RANGE,
        f"{x0} to {x0 + nx - 1}",
        f"{y0} to {y0 + ny - 1}",
        "4 x 3",
        error=JitterkitError,
    ):
        RawFrame.from_array(IMAGE).region(*box)


def test_replaced_fields_of_a_frame_change_neither_its_pixels_nor_their_digest():
    raw = RawFrame.from_array(IMAGE, gain=2.0)
    digest = raw.digest
    changed = raw.with_fields(metadata=raw.metadata.override("argument", gain=3.0))
    assert (changed.metadata.value("gain"), raw.metadata.value("gain")) == (3.0, 2.0)
    assert changed.data is raw.data
    assert vars(changed)["digest"] == digest  # not found again
    for word in ("data", "gain"):
        with pytest.raises(TypeError, match=f"'{word}'.* RawFrame"):
            raw.with_fields(**{word: IMAGE})


def test_a_frame_keeps_pixels_of_its_own():
    buffer = IMAGE.copy()
    frame = Frame(buffer, 9.0)
    buffer[:] = np.nan
    np.testing.assert_array_equal(frame.electrons, IMAGE)


def test_variance_is_photons_plus_readout_and_never_less_than_readout():
    frame = Frame(IMAGE - 2, 9.0)
    np.testing.assert_array_equal(frame.variance, np.maximum(IMAGE - 2, 0) + 9)
    assert frame.read_variance.shape == frame.shape == (3, 4)


def test_a_frame_is_cut_with_everything_in_it():
    frame = Frame(IMAGE, IMAGE + 1, IMAGE == 5, exposure=1.0, plate_scale=0.375, flags=("odd",))
    cut = frame.region(1, 1, 2, 2)
    np.testing.assert_array_equal(cut.variance, 2 * cut.electrons + 1)
    assert cut.mask[0, 0]
    assert cut.mask.sum() == 1
    assert (cut.origin, cut.exposure, cut.plate_scale, cut.flags) == ((1, 1), 1.0, 0.375, ("odd",))


@pytest.mark.parametrize(
    ("given", "code", "values"),
    [
        ({"read_variance": -1.0}, ErrorCode.OUT_OF_RANGE, ["read_variance"]),
        ({"read_variance": None}, ErrorCode.OUT_OF_RANGE, ["read_variance"]),
        ({"read_variance": np.ones((2, 2))}, ErrorCode.WRONG_SHAPE, ["read_variance", (2, 2), (3, 4)]),
        ({"plate_scale": 0.0}, ErrorCode.OUT_OF_RANGE, ["plate_scale = 0.0 arcsec/pixel"]),
        ({"exposure": np.nan}, ErrorCode.OUT_OF_RANGE, ["exposure = nan s"]),
        ({"response": 0.0}, ErrorCode.OUT_OF_RANGE, ["response"]),
        ({"response": np.full((3, 4), np.nan)}, ErrorCode.OUT_OF_RANGE, ["response"]),
        ({"response": np.ones((2, 2))}, ErrorCode.WRONG_SHAPE, ["response", (2, 2), (3, 4)]),
        ({"ceiling": np.ones((2, 2))}, ErrorCode.WRONG_SHAPE, ["ceiling", (2, 2), (3, 4)]),
        ({"full": np.ones((2, 2), bool)}, ErrorCode.WRONG_SHAPE, ["full", (2, 2), (3, 4)]),
    ],
)
def test_a_frame_that_cannot_be_is_refused(given, code, values):
    with refused(code, *values, error=JitterkitError):
        Frame(**{"electrons": IMAGE, "read_variance": 1.0, **given})


def test_an_uneven_response_divides_photon_noise_once_and_the_rest_twice():
    # counts c = f s have variance f s + r; s = c/f has (f s + r)/f²
    flat = np.linspace(0.5, 2.0, 12).reshape(3, 4)
    frame = Frame(IMAGE, 9.0, response=flat)
    np.testing.assert_allclose(frame.variance, (flat * IMAGE + 9.0) / flat**2)
    assert frame.response.shape == (3, 4)
    assert Frame(IMAGE, 9.0).response == 1.0
    assert Frame(IMAGE, 9.0).ceiling == np.inf
    assert not Frame(IMAGE, 9.0).full.any()


def test_response_ceiling_and_full_pixels_are_cut_with_the_rest():
    frame = Frame(IMAGE, 1.0, response=IMAGE + 1, ceiling=IMAGE + 100, full=IMAGE == 6)
    cut = frame.region(1, 1, 2, 2)
    np.testing.assert_array_equal(cut.response, cut.electrons + 1)
    np.testing.assert_array_equal(cut.ceiling, cut.electrons + 100)
    assert np.argwhere(cut.full).tolist() == [[0, 1]]
    assert Frame(IMAGE, 1.0, ceiling=7).region(1, 1, 2, 2).ceiling == 7.0


def test_records_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError, match="cannot assign"):
        Frame(IMAGE, 1.0).exposure = 2.0


def test_a_ccddata_is_read_with_its_mask_unit_and_header():
    ccd = CCDData(IMAGE, unit="adu", mask=IMAGE == 3, meta={"EXPTIME": 2.5, "EGAIN": 1.5})
    raw = RawFrame.from_ccddata(ccd)
    np.testing.assert_array_equal(raw.data, IMAGE)
    assert raw.mask.sum() == 1
    assert raw.unit == "adu"
    assert raw.metadata.exposure.value == 2.5
    assert raw.metadata.gain.source == "header EGAIN (HDU 0)"


@pytest.mark.parametrize("unit", [units.electron, units.electron / units.s, units.adu])
def test_a_ccddata_may_be_in_counts_or_rates(unit):
    assert RawFrame.from_ccddata(CCDData(IMAGE, unit=unit)).unit == unit.to_string().replace(" ", "")


def test_a_ccddata_in_another_unit_is_refused_by_its_name():
    with refused(ErrorCode.UNKNOWN_UNIT, "Jy", error=JitterkitError):
        RawFrame.from_ccddata(CCDData(IMAGE, unit="Jy"))


def test_a_ccddata_without_dimension_is_adu_with_a_warning():
    raw = RawFrame.from_ccddata(CCDData(IMAGE, unit=units.dimensionless_unscaled))
    assert raw.unit == "adu"
    assert "dimensionless" in raw.metadata.warnings[0]


def test_rows_of_a_ccddata_from_the_top_are_turned_over_as_those_of_its_file(tmp_path):
    ccd = CCDData(IMAGE, unit="adu", mask=IMAGE == 3, uncertainty=VarianceUncertainty(IMAGE + 1))
    ccd.header["ROWORDER"] = "TOP-DOWN"
    ccd.wcs = WCS(fits.Header(NORTH_UP))
    ccd.write(tmp_path / "a.fits")
    (of_file,) = read_frames(tmp_path / "a.fits")
    raw = RawFrame.from_ccddata(ccd)
    np.testing.assert_array_equal(raw.data, IMAGE[::-1])
    for name in ("data", "mask", "variance"):
        np.testing.assert_array_equal(getattr(raw, name), getattr(of_file, name))
    sky = [one.metadata.wcs.pixel_to_world_values(1.0, 2.0) for one in (raw, of_file)]
    np.testing.assert_allclose(sky[0], sky[1], rtol=1e-12)
    assert raw.metadata.row_order == of_file.metadata.row_order == -1


def test_the_header_of_a_ccddata_that_was_converted_to_electrons_is_still_in_adu():
    ccd = CCDData(IMAGE, unit="electron", meta={"BUNIT": "adu", "SATURATE": 65535, "EGAIN": 0.5})
    assert RawFrame.from_ccddata(ccd).metadata.saturation.value == 65535 * 0.5


@pytest.mark.parametrize(
    "wcs", [WCS(naxis=2), WCS(fits.Header({"CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN"}))]
)
def test_a_wcs_of_a_ccddata_that_says_no_scale_is_not_used(wcs):
    metadata = RawFrame.from_ccddata(CCDData(IMAGE, unit="adu", wcs=wcs, meta={"PIXSCALE": 0.3})).metadata
    assert metadata.wcs is None
    assert metadata.plate_scale.value == 0.3


def test_a_negative_uncertainty_is_none_and_complex_data_are_refused():
    deviations = np.where(IMAGE == 3, -1.0, 1.0)
    raw = RawFrame.from_ccddata(CCDData(IMAGE, unit="adu", uncertainty=StdDevUncertainty(deviations)))
    assert np.flatnonzero(raw.mask).tolist() == [3]
    with refused(ErrorCode.WRONG_TYPE, "complex", error=JitterkitError):
        RawFrame.from_ccddata(CCDData(IMAGE + 1j, unit="adu"))
