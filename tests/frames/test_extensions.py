"""Masks, variances and chips of FITS files, in the structure in which observatories write them."""

import numpy as np
import pytest
from astropy.io import fits
from astropy.nddata import (
    CCDData,
    InverseVariance,
    NDData,
    StdDevUncertainty,
    UnknownUncertainty,
    VarianceUncertainty,
)
from refusals import refused

from jitterkit.errors import ErrorCode, FrameError, JitterkitError
from jitterkit.frames import RawFrame, find_files, open_frames, read_frames
from jitterkit.frames.files import sniff
from jitterkit.instruments import load_instrument, resolve

SHAPE = (6, 8)
SCI = np.arange(48.0).reshape(SHAPE) + 100
VARIANCE = SCI + 25 + np.arange(48.0).reshape(SHAPE) / 10


def hdu(name, data, version=None, **cards):
    return fits.ImageHDU(data, fits.Header(cards), name=name, ver=version)


def written(tmp_path, *hdus, name="a.fits", **cards):
    primary = (
        () if hdus and isinstance(hdus[0], fits.PrimaryHDU) else (fits.PrimaryHDU(header=fits.Header(cards)),)
    )
    fits.HDUList([*primary, *hdus]).writeto(tmp_path / name)
    return tmp_path / name


def plane(dtype=np.int16, **values):
    quality = np.zeros(SHAPE, dtype)
    for position, value in values.items():
        quality[int(position[1]), int(position[2])] = value
    return quality


def positions(mask):
    return [f"p{y}{x}" for y, x in np.argwhere(mask)]


def flc(tmp_path, **cards):
    """Two chips, as calacs and calwf3 write them; the chips have other sizes than each other."""
    unit = {"BUNIT": "ELECTRONS"}
    first = plane(p12=16, p23=64, p34=256, p45=8192)
    second = SCI[:4] + 1000, np.sqrt(VARIANCE[:4]), plane(p00=1)[:4]
    return written(
        tmp_path,
        hdu("SCI", SCI.astype("f4"), 1, **unit),
        hdu("ERR", np.sqrt(VARIANCE).astype("f4"), 1, **unit),
        hdu("DQ", first, 1),
        hdu("SCI", second[0], 2, **unit),
        hdu("ERR", second[1], 2, **unit),
        hdu("DQ", second[2], 2),
        TELESCOP="HST",
        INSTRUME="WFC3",
        EXPTIME=10.0,
        **cards,
    )


def cal(tmp_path, unit="MJy/sr", factor=0.5, shape=()):
    """As calwebb_image2 writes it; ``_rate`` has DN/s and no VAR_FLAT."""
    stack = [
        np.broadcast_to(a * s, (*shape, *SHAPE)).astype("f4")
        for a, s in (
            (SCI, factor),
            (np.sqrt(VARIANCE + SCI**2), factor),
            (SCI, factor**2),
            (VARIANCE - SCI, factor**2),
        )
    ]
    quality = plane(np.uint32, p12=1, p23=4, p34=512, p45=2)
    cards = {"BUNIT": unit, **({"PHOTMJSR": factor} if unit == "MJy/sr" else {})}
    return written(
        tmp_path,
        hdu("SCI", stack[0], 1, **cards),
        hdu("ERR", stack[1], 1, BUNIT=unit),
        hdu("DQ", np.broadcast_to(quality, (*shape, *SHAPE)), 1),
        hdu("VAR_POISSON", stack[2], 1),
        hdu("VAR_RNOISE", stack[3], 1),
        hdu("VAR_FLAT", stack[2] ** 2, 1),
        TELESCOP="JWST",
        EFFEXPTM=10.0,
        EFFINTTM=10.0,
    )


def calexp(tmp_path):
    """Compressed, with named bits, as the LSST and HSC pipelines write it."""
    names = {
        "MP_BAD": 0,
        "MP_SAT": 1,
        "HIERARCH MP_DETECTED": 5,
        "HIERARCH MP_DETECTED_NEGATIVE": 6,
        "MP_EDGE": 4,
    }
    quality = plane(np.int32, p12=1, p23=2, p34=32, p45=64, p50=48)
    packed = {"compression_type": "GZIP_2", "quantize_level": 0.0}
    return written(
        tmp_path,
        fits.CompImageHDU(SCI.astype("f4"), fits.Header({"BUNIT": "adu"}), name="IMAGE", **packed),
        fits.CompImageHDU(quality, fits.Header(names), name="MASK", compression_type="RICE_1"),
        fits.CompImageHDU(VARIANCE.astype("f4"), name="VARIANCE", **packed),
    )


def test_every_chip_of_hst_is_a_frame_with_its_own_error_and_quality(tmp_path):
    first, second = read_frames(flc(tmp_path))
    assert (first.hdu, second.hdu, first.name, second.name) == (1, 4, "a.fits[0]", "a.fits[1]")
    np.testing.assert_allclose(first.variance[~first.mask], VARIANCE[~first.mask], rtol=1e-6)
    np.testing.assert_allclose(second.data, SCI[:4] + 1000)
    assert positions(first.mask) == ["p12", "p34", "p45"]  # 64 is a warm pixel
    assert positions(second.mask) == ["p00"]
    assert (first.unit, first.metadata.warnings) == ("electron", ())


@pytest.mark.parametrize(
    ("name", "columns", "doubted"),
    [
        ("BADPIX", "RAWX RAWY TYPE YEXTENT BADFLAG", True), ("BPM", "TIME", True), ("", "x y", True),
        ("", "TYPE PIX", True), ("DEFECTS", "region", True), ("MASK", "COL1 COL2", True),
        ("CATALOG", "X Y FLUX", False), ("EVENTS", "TIME X Y PI", False), ("", "X", False),
        ("STARS", "X Y ID", False), ("PHOTOMETRY", "TIME", False), ("IMAGE_QUALITY", "TIME", False),
        ("HDRTAB", "ROOTNAME FILENAME", False), ("GTI", "START STOP", False),
        ("ASDF", "ASDF_METADATA", False),
    ],
)  # fmt: skip
@pytest.mark.parametrize("kind", [fits.BinTableHDU, fits.TableHDU])
def test_a_table_of_bad_pixels_is_named(tmp_path, name, columns, doubted, kind):
    columns = [
        fits.Column(one, "I" if kind is fits.BinTableHDU else "I5", array=[2]) for one in columns.split()
    ]
    table = kind.from_columns(columns, name=name)
    path = written(tmp_path, fits.PrimaryHDU(SCI), table)
    (frame,) = read_frames(path)
    said = "is a table that may list bad pixels" in " ".join(frame.metadata.warnings)
    assert (said, frame.mask.any()) == (doubted, False)
    (frame,) = read_frames(
        written(tmp_path, fits.PrimaryHDU(SCI), table, hdu("DQ", plane(p12=1)), name="b.fits")
    )
    assert frame.metadata.warnings == ()


@pytest.mark.parametrize(
    ("layout", "masked", "warned"),
    [
        ("SCI SCI DQ", [1], [0]), ("SCI DQ SCI DQ", [0, 1], []), ("SCI DQ SCI", [0], []),
        ("SCI,1 SCI,2 DQ,2", [1], []), ("SCI,1 SCI,2 DQ,1", [0], []), ("SCI1 SCI2 DQ2", [1], []),
        ("SCI,1 SCI,1 DQ,1", [1], [0]), ("SCI ERR SCI DQ", [1], [0]), ("IMG1 IMG2 MASK", [1], [0]),
        ("SCI SCI SCI DQ", [2], [0, 1]), ("SCI DQ", [0], []),
    ],
)  # fmt: skip
def test_a_mask_that_follows_several_images_without_numbers_is_doubted(tmp_path, layout, masked, warned):
    """By the order it is that of the image before it alone; EXTVER, or a digit of its name, may say it."""
    named = [name.split(",") for name in layout.split()]
    images = [SCI if not name[0].startswith(("DQ", "MASK")) else plane(p12=1) for name in named]
    hdus = [hdu(name[0], image, *map(int, name[1:])) for name, image in zip(named, images, strict=True)]
    path = written(tmp_path, *hdus)
    frames = list(read_frames(path))
    assert [n for n, frame in enumerate(frames) if frame.mask.any()] == masked
    said = ["as it follows another image" in " ".join(frame.metadata.warnings) for frame in frames]
    assert [n for n, found in enumerate(said) if found] == warned
    (alone,) = read_frames(path, hdu=frames[0].hdu)
    assert ("as it follows another image" in " ".join(alone.metadata.warnings)) == (0 in warned)


def test_one_chip_can_be_chosen_with_what_belongs_to_it(tmp_path):
    (frame,) = read_frames(flc(tmp_path), hdu=4)
    assert (positions(frame.mask), frame.variance_source) == (["p00"], "ERR (HDU 5)")


def test_hits_in_a_ramp_of_the_infrared_channel_are_no_bad_pixels(tmp_path):
    first, _ = read_frames(flc(tmp_path, DETECTOR="IR"))
    assert positions(first.mask) == ["p12", "p34"]


@pytest.mark.parametrize(("unit", "factor"), [("MJy/sr", 0.5), ("DN/s", 0.1)])
def test_jwst_is_read_without_the_error_of_its_flat(tmp_path, unit, factor):
    (frame,) = read_frames(cal(tmp_path, unit, factor))
    scale = factor if unit == "DN/s" else 1.0
    np.testing.assert_allclose(frame.data[frame.data > 0], SCI[frame.data > 0] * scale, rtol=1e-6)
    used = ~frame.mask
    np.testing.assert_allclose(frame.variance[used], VARIANCE[used] * scale**2, rtol=1e-5)
    assert positions(frame.mask) == ["p12", "p34"]  # neither a jump nor a saturated group
    assert frame.variance_source == "VAR_POISSON (HDU 4) + VAR_RNOISE (HDU 5)"


def test_the_integrations_of_jwst_have_each_its_plane(tmp_path):
    path = cal(tmp_path, "DN/s", 1.0, shape=(3,))
    with fits.open(path, mode="update") as hdus:
        hdus["DQ"].data[2, 0, 0] = 1
        hdus["VAR_POISSON"].data[1] *= 2
    frames = list(read_frames(path))
    assert [positions(f.mask)[0] for f in frames] == ["p12", "p12", "p00"]
    np.testing.assert_allclose(frames[1].variance[0], VARIANCE[0] + SCI[0], rtol=1e-6)
    np.testing.assert_allclose(frames[2].variance[1, 3], VARIANCE[1, 3], rtol=1e-6)


def test_the_planes_of_a_mask_of_lsst_are_known_by_name(tmp_path):
    (frame,) = read_frames(calexp(tmp_path))
    assert positions(frame.mask) == ["p12", "p23", "p50"]
    np.testing.assert_allclose(frame.variance[0], VARIANCE[0], rtol=1e-6)
    assert frame.metadata.bad_bits.value == 1 + 2 + 16


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.uint16, np.int32, np.uint32, np.int64, np.float32])
@pytest.mark.parametrize("name", ["MASK", "DQ", "BPM"])
def test_a_mask_behind_a_primary_image_marks_pixels_by_any_bit(tmp_path, dtype, name):
    mask = hdu(name, plane(dtype, p12=1, p23=2, p55=64))
    (frame,) = read_frames(written(tmp_path, fits.PrimaryHDU(SCI), mask))
    assert positions(frame.mask) == ["p12", "p23", "p55"]
    assert frame.variance is None


def test_the_sign_bit_of_a_plane_is_its_last_bit(tmp_path):
    path = written(tmp_path, fits.PrimaryHDU(SCI), hdu("DQ", plane(np.int16, p12=-32768)))
    (frame,) = read_frames(path)
    assert frame.quality[1, 2] == 32768


@pytest.mark.parametrize(
    ("name", "values"),
    [("ERR", np.sqrt(VARIANCE)), ("UNCERT", np.sqrt(VARIANCE)), ("VAR", VARIANCE), ("WHT", 1 / VARIANCE)],
)
def test_errors_variances_and_weights_give_one_variance(tmp_path, name, values):
    values = values.copy()
    values[1, 2], values[2, 3] = np.nan, 0
    (frame,) = read_frames(written(tmp_path, fits.PrimaryHDU(SCI), hdu(name, values)))
    assert positions(frame.mask) == ["p12", "p23"]
    np.testing.assert_allclose(frame.variance[~frame.mask], VARIANCE[~frame.mask])


def test_a_weight_that_may_be_an_exposure_time_only_masks(tmp_path):
    weight = np.full(SHAPE, 500.0)
    weight[1, 2] = 0
    hdus = hdu("SCI", SCI), hdu("WHT", weight), hdu("CTX", plane(np.int32))
    (frame,) = read_frames(written(tmp_path, *hdus))
    assert (positions(frame.mask), frame.variance) == (["p12"], None)
    assert any("WHT (HDU 2)" in text for text in frame.metadata.warnings)


@pytest.mark.parametrize(
    ("other", "named"),
    [
        (hdu("DQ", np.ones((6, 7), np.int16)), "7 x 6"),
        (hdu("ERR", np.zeros(SHAPE)), "no positive value"),
        (hdu("ERR", np.ones(SHAPE), BUNIT="electron/s"), "electron/s"),
    ],
)
def test_what_does_not_fit_an_image_is_named_and_not_used(tmp_path, other, named):
    image = fits.PrimaryHDU(SCI, fits.Header({"BUNIT": "electron"}))
    (frame,) = read_frames(written(tmp_path, image, other))
    assert not frame.mask.any()
    assert frame.variance is None
    assert any(other.name in text and named in text for text in frame.metadata.warnings)


def test_blank_pixels_stay_masked_whatever_bits_are_bad(tmp_path):
    image = fits.PrimaryHDU(SCI.astype(np.int16), fits.Header({"BLANK": 101}))
    (frame,) = read_frames(written(tmp_path, image, hdu("DQ", plane(p01=4, p12=4, p23=8))))
    told = {bits: resolve(frame, load_instrument("smallsat"), {"bad_bits": bits}) for bits in (0, 4, 8)}
    assert {bits: positions(raw.mask) for bits, raw in told.items()} == {
        0: ["p01"],
        4: ["p01", "p12"],
        8: ["p01", "p23"],
    }
    assert positions(told[0].region(0, 0, 3, 3).with_metadata(told[8].metadata).mask) == ["p01"]


def test_rows_from_the_top_take_mask_and_variance_along(tmp_path):
    image = fits.PrimaryHDU(SCI[::-1], fits.Header({"ROWORDER": "TOP-DOWN"}))
    quality = plane(p12=1)
    path = written(tmp_path, image, hdu("DQ", quality[::-1]), hdu("VARIANCE", VARIANCE[::-1]))
    (frame,) = read_frames(path)
    cut = frame.region(1, 1, 4, 3)
    assert (positions(frame.mask), positions(cut.mask)) == (["p12"], ["p01"])
    np.testing.assert_array_equal(cut.data, SCI[1:4, 1:5])
    np.testing.assert_array_equal(cut.variance[1:], VARIANCE[2:4, 1:5])


def test_quality_and_weight_files_beside_an_image_belong_to_it(tmp_path):
    def chips(kind, *arrays):
        parts = [fits.CompImageHDU(a, name=n) for a, n in zip(arrays, ("N1", "S1"), strict=True)]
        written(tmp_path, *parts, name=f"c4d_1_2_{kind}_g_v1.fits.fz")

    for part, arrays in {
        "ooi": (SCI, SCI + 50),
        "oow": (1 / VARIANCE, 2 / VARIANCE),
        "ood": (plane(p12=5), plane(p23=7)),
    }.items():
        chips(part, *[a.astype(np.int32 if part == "ood" else np.float64) for a in arrays])
    (path,) = find_files([tmp_path])
    assert "_ooi_" in path.name
    with open_frames(path, hdu=2) as file:
        frame = file[0]
    assert positions(frame.mask) == ["p23"]
    np.testing.assert_allclose(frame.variance[0], VARIANCE[0] / 2, rtol=0.01)


def test_chips_that_are_named_by_number_or_by_keyword_are_frames(tmp_path):
    assert len(list(read_frames(written(tmp_path, hdu("CCD1", SCI), hdu("CCD2", SCI), name="a.fits")))) == 2
    named = [hdu(name, SCI, CCDNUM=n) for n, name in enumerate(("N4", "S9"))]
    assert len(list(read_frames(written(tmp_path, *named, name="b.fits")))) == 2
    other = [fits.PrimaryHDU(SCI), hdu("BACKGROUND", SCI), hdu("MODEL", SCI), fits.ImageHDU(SCI)]
    assert len(list(read_frames(written(tmp_path, *other, name="c.fits")))) == 1


@pytest.mark.parametrize(
    "names",
    [("CCD%d", "CCD%d_ERR"), ("SCI%d", "ERR%d"), ("SCI_%d", "ERR_%d"), ("DET%d.DATA", "DET%d.ERR")],
)
@pytest.mark.parametrize("order", [(0, 1, 2, 3), (0, 2, 1, 3), (1, 3, 2, 0), (2, 3, 0, 1)])
def test_errors_that_name_their_detector_belong_to_it_in_any_order(tmp_path, names, order):
    hdus = [hdu(name % chip, SCI * 0 + 10 ** (chip * k)) for k, name in enumerate(names) for chip in (1, 2)]
    frames = list(read_frames(written(tmp_path, *[hdus[k] for k in order])))
    assert sorted(frame.variance[0, 0] for frame in frames) == [1e2, 1e4]
    names_of = {frame.hdu: frame.variance_source for frame in frames}
    for number, source in names_of.items():
        chip = 1 + order[number - 1]
        assert source.startswith(f"{names[1] % chip} ")


@pytest.mark.parametrize(
    ("one", "two", "frames"), [("SCI_A", "SCI_B", 2), ("SCI", "IMAGE", 1), ("A", "PSF_B", 1)]
)
def test_images_that_differ_in_a_letter_are_each_a_frame(tmp_path, one, two, frames):
    assert len(list(read_frames(written(tmp_path, hdu(one, SCI), hdu(two, SCI))))) == frames


@pytest.mark.parametrize(
    ("names", "left"),
    [
        (("FIRST", "SECOND"), "SECOND (HDU 2)"), (("SCI", "RAW"), ""),
        (("DQ", "SCI", "SCI"), "DQ (HDU 1)"), (("SCI", "SKY"), ""), (("SCI", "DQ"), ""),
        (("SCI1", "SCI2"), ""), (("SCI", "VAR", "VAR_POISSON"), ""),
    ],
)  # fmt: skip
def test_an_image_that_is_left_out_is_named(tmp_path, names, left):
    path = written(tmp_path, *[hdu(name, SCI.astype("i2") + k) for k, name in enumerate(names)])
    with open_frames(path) as file:
        found = [text for text in file[0].metadata.warnings if text.startswith("not used: ")]
    assert [text.removeprefix("not used: ").partition(";")[0] for text in found] == [left] * bool(left)
    small = written(tmp_path, fits.PrimaryHDU(SCI[:1]), hdu(None, SCI), name="b.fits")
    with open_frames(small) as file:
        assert any("image (HDU 1)" in text for text in file.metadata.warnings)


def test_the_contents_are_listed_with_their_use(tmp_path):
    with open_frames(flc(tmp_path)) as file:
        rows = {row[0]: row[1:] for row in file.describe()}
    assert rows["HDU 2 ERR,1"] == ("an array of 8 x 6", "", "error of HDU 1")
    assert rows["HDU 0"][2] == "not used"
    assert rows["HDU 6 DQ,2"][2] == "mask of HDU 4"


def test_the_planes_of_wfpc2_do_not_take_the_scale_of_the_first(tmp_path):
    sky = {"CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN", "CD1_1": -1e-5, "CD2_2": 1e-5}
    cube = fits.PrimaryHDU(np.stack([SCI] * 4), fits.Header(sky))
    table = fits.BinTableHDU.from_columns([fits.Column("CD1_1", "D", array=np.full(4, -1e-5))])
    first, second, *_ = read_frames(written(tmp_path, cube, table))
    assert first.metadata.value("plate_scale") == pytest.approx(0.036)
    assert (second.metadata.plate_scale, second.metadata.wcs) == (None, None)
    assert any("HDU 1" in text for text in second.metadata.warnings)


def test_a_distortion_in_lookup_tables_is_read_with_the_file(tmp_path):
    cards = {"CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN", "CD1_1": -1e-5, "CD2_2": 1e-5}
    header = fits.Header({**cards, "CRPIX1": 4.0, "CRPIX2": 3.0, "CRVAL1": 10.0, "CRVAL2": 20.0})
    for axis in (1, 2):
        header[f"CPDIS{axis}"] = "LOOKUP"
        for text in (f"EXTVER: {axis}", "NAXES: 2", "AXIS.1: 1", "AXIS.2: 2"):
            header.append(fits.Card.fromstring(f"DP{axis}     = '{text}'".ljust(80)))
    where = {"CRPIX1": 1.0, "CRPIX2": 1.0, "CRVAL1": 1.0, "CRVAL2": 1.0, "CDELT1": 1.0, "CDELT2": 1.0}
    tables = [hdu("WCSDVARR", np.full(SHAPE, by, np.float32), n, **where) for n, by in ((1, 1.5), (2, 0.0))]
    path = written(tmp_path, fits.ImageHDU(SCI, header, name="SCI"), *tables)
    (frame,) = read_frames(path)
    for key in ("CPDIS*", "DP1*", "DP2*"):
        del header[key]
    plain = written(tmp_path, fits.ImageHDU(SCI, header, name="SCI"), name="b.fits")
    (without,) = read_frames(plain)
    assert frame.metadata.warnings == ()
    shifted = without.metadata.wcs.pixel_to_world_values(4.5, 3.0)
    np.testing.assert_allclose(frame.metadata.wcs.pixel_to_world_values(3.0, 3.0), shifted, rtol=1e-12)


@pytest.mark.parametrize(
    "uncertainty",
    [StdDevUncertainty(np.sqrt(VARIANCE)), VarianceUncertainty(VARIANCE), InverseVariance(1 / VARIANCE)],
)
def test_a_ccddata_written_by_astropy_comes_back_whole(tmp_path, uncertainty):
    mask = plane(p12=1).astype(bool)
    ccd = CCDData(SCI, unit="electron", mask=mask, uncertainty=uncertainty)
    ccd.write(tmp_path / "a.fits")
    for frame in (next(read_frames(tmp_path / "a.fits")), RawFrame.from_ccddata(ccd)):
        assert positions(frame.mask) == ["p12"]
        np.testing.assert_allclose(frame.variance[0], VARIANCE[0])


def test_an_uncertainty_of_unknown_meaning_is_not_used_and_one_of_another_unit_is_refused():
    frame = RawFrame.from_ccddata(NDData(SCI, unit="electron", uncertainty=UnknownUncertainty(VARIANCE)))
    assert frame.variance is None
    assert any("'unknown'" in text for text in frame.metadata.warnings)
    ccd = NDData(SCI, unit="electron / s", uncertainty=StdDevUncertainty(VARIANCE, unit="electron / min"))
    with refused(ErrorCode.UNKNOWN_UNIT, "electron / min", "electron / s", error=JitterkitError):
        RawFrame.from_ccddata(ccd)


def test_what_is_damaged_behind_an_image_does_not_spoil_it(tmp_path):
    path = written(tmp_path, fits.PrimaryHDU(SCI), hdu("DQ", plane(p12=1)))
    path.write_bytes(
        path.read_bytes().replace(b"BITPIX  =                   16", b"BITPIX  =                   17")
    )
    (frame,) = read_frames(path)
    assert any("BITPIX = 17" in text for text in frame.metadata.warnings)
    path = written(tmp_path, fits.PrimaryHDU(SCI), hdu("DQ", plane(p12=1)), name="b.fits")
    path.write_bytes(path.read_bytes()[:-2880])
    with refused(ErrorCode.TRUNCATED, path, error=FrameError):
        list(read_frames(path))


def test_asdf_is_refused_by_its_name(tmp_path):
    path = tmp_path / "r.asdf"
    path.write_bytes(b"#ASDF 1.0.0\n#ASDF_STANDARD 1.5.0\n%YAML 1.1\n")
    with refused(ErrorCode.UNKNOWN_FORMAT, path, "ASDF", "Roman", "asdf.open", error=FrameError):
        sniff(path)
    with refused(ErrorCode.NO_IMAGE, tmp_path, "ASDF", "asdf.open", error=FrameError):
        find_files([tmp_path])
