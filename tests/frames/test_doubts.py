"""Headers and TIFFs whose numbers contradict what else stands there: used with a warning, or not used.

As in ``test_variants``, a row has cards, the quantity, the number that their writer meant, or None where it
must not be guessed, and what a warning names, empty where none is needed.  No row may be silent and wrong.
"""

import math

import numpy as np
import pytest
import tifffile
from astropy.io import fits
from headers import assert_number, assert_warned, header

from jitterkit.frames import read_frames, resolve_header


def lens(**cards):
    return {"FOCALLEN": 1000.0, **cards}, "plate_scale"


def um(size):
    """Arcsec that a pixel of so many micrometres sees behind a metre."""
    return math.degrees(size * 1e-6) * 3600


def scale(**cards):
    return {"PIXSCALE": 0.4, **cards}, "plate_scale", 0.4


def time(comment="", **cards):
    return {"EXPTIME": (60.0, comment), **cards}, "exposure"


def dates(end, exposure):
    return {"EXPTIME": exposure, "DATE-OBS": "2023-05-10T19:00:48", "DATE-END": end}, "exposure", exposure


def bias(**cards):
    return {"BIASLVL": 1000.0, **cards}, "bias", 1000.0


def noise(comment, **cards):
    return {"RDNOISE": (20.0, comment), **cards}, "read_noise", 20.0


def gain(comment="", **cards):
    return {"EGAIN": (2.0, comment), **cards}, "gain"


def level(**cards):
    return {"SATURATE": 65535, **cards}, "saturation"


NUMBERS = [
    # binning and resampling
    (*scale(LTM1_1=0.5, LTM2_2=0.5), "LTM1_1 = 0.5"), (*scale(LTM1_1=1.0, LTM2_2=-1.0), ""),
    (*scale(LTM1_1=0.5, LTM2_2=0.5, CCDSUM="2 2"), "binning of 2"), (*scale(LTM2_2=2.0), "LTM2_2 = 2"),
    (*scale(CCDSUM="1 2"), "1 x 2"), (*scale(CCDSUM="1 1"), ""),
    (*lens(XPIXSZ=3.8, LTM1_1=0.5), um(3.8), "LTM1_1 = 0.5"),
    (*lens(PIXSIZE1=3.8, XBINNING=1, CCDSUM="2 2"), um(3.8), "CCDSUM = 2 2 contradicts"),
    (*lens(PIXSIZE1=3.8, XBINNING=2, CCDSUM="2 2", BINNING="2x2"), um(7.6), ""),
    (*lens(XPIXSZ=3.8, PIXSIZE1=3.8, XBINNING=2), um(3.8), "PIXSIZE1 = 3.8"),
    (*lens(XPIXSZ=7.6, PIXSIZE1=3.8, XBINNING=2), um(7.6), ""), (*lens(XPIXSZ=3.8, PIXSIZE1=5.0),
    um(3.8), "PIXSIZE1 = 5"),
    # lenses before the detector
    (*lens(XPIXSZ=3.8, BARLOW=2.0), um(3.8), "BARLOW = 2.0"), (*lens(XPIXSZ=3.8, BARLOW=1.0), um(3.8), ""),
    (*lens(XPIXSZ=3.8, FOCRATIO=10.0, APTDIA=200.0), um(3.8), "FOCRATIO = 10"),
    (*lens(XPIXSZ=3.8, FOCRATIO=5.0, APTDIA=200.0), um(3.8), ""),
    ({"FOCALLEN": (1.0, "focal length, m"), "XPIXSZ": 3.8}, "plate_scale", um(3.8), ""),
    # units of an exposure
    *[(*time(comment), None, named) for comment, named in (
        ("exposure in centiseconds", "centiseconds"), ("exposure, deciseconds", "deciseconds"),
        ("Exposure in ks", "ks"), ("exposure time in csec", "csec"), ("in frames", "in frames"),
        ("exposure in fields", "in fields"), ("exposure time, jiffies", "jiffies"), ("[ksec]", "ksec"),
        ("exposure (mm.ss)", "mm.ss"), ("log2 s", "log2"), ("exposure (x0.1 s)", "0.1"),
        ("exposure time [10ms]", "10ms"), ("exposure time (s*1000)", "*1000"))],
    *[(*time(comment), 60.0, "") for comment in
      ("decimal seconds", "exposure dedicated to science", "kilometric pointing? no, s",
      "time, close to 60 s")],
    (*time("msec."), 0.06, ""),
    # an exposure that its dates contradict
    (*dates("2023-05-10T19:00:50", 2000.0), "DATE-END it lasted 2 s"),
    (*dates("2023-05-10T19:00:50", 2.0), ""),
    (*dates("2023-05-10T19:00:48", 0.5), ""), (*dates("2023-05-10T19:05:48", 60.0), ""),
    (*dates("2023-05-10T18:00:48", 30.0), "lasted -3600 s"), (*dates("2023-05-10", 30.0), ""),
    (*time(TELAPSE=0.06), 60.0, "TELAPSE it lasted 0.06 s"), (*time(TELAPSE=61.0), 60.0, ""),
    # exposures that were combined
    *[(*time(**{key: value}), 60.0, named) for key, value, named in (
        ("LIVETIME", 2400.0, "LIVETIME = 2400"), ("TOTALEXP", 2400.0, "TOTALEXP = 2400"),
        ("LIVETIME", 59.0, ""),
        ("LIGH_CNT", 10, "LIGH_CNT = 10"), ("NUMFRAME", 10, "NUMFRAME = 10"), ("IMCMB001", "a.fits", ""),
        ("IMCMB002", "b.fits", "IMCMB002"), ("COMBINET", "MEDIAN", "COMBINET"),
        ("CALSTAT", "BDFS", "CALSTAT"),
        ("HIERARCH ESO PRO DATANCOM", 5, "DATANCOM = 5"), ("CALSTAT", "BDF", ""),
        ("HISTORY", "ImageIntegration.numberOfImages: 20", "HISTORY"), ("HISTORY", "flat-fielded", ""))],
    *[(*time(comment), 60.0, comment) for comment in ("mean exposure", "exposure per sub",
    "average exposure")],
    # pixels that were reduced before
    *[(*bias(**{key: value}), key) for key, value in (
        ("CALSTAT", "BDF"), ("ZEROCOR", "Nov  1  2:03 Zero level correction image is z.fits"),
        ("OVERSCAN", "overscan section is [1:8,1:40] with mean=1000"), ("SUBBIAS", "ccd=<CCDData>"),
        ("BIASCORR", "COMPLETE"), ("BIASCOR", True))],
    *[(*bias(**{key: value}), "") for key, value in (
        ("CALSTAT", "DF"), ("BIASCORR", "OMIT"), ("BIASCOR", False), ("OVERSCAN", False))],
    *[(*gain(GAINCOR=value, **unit), 2.0, named) for value, unit, named in (
        ("gain=2.0", {}, "GAINCOR"), (True, {"BUNIT": "adu"}, "GAINCOR"), (False, {}, ""),
        ("gain=2.0", {"BUNIT": "electron"}, ""))],
    *[(*gain(comment), None, named) for comment, named in (
        ("inverse gain", "inverse"), ("[e-/ADU] already applied", "applied"),
        ("e-/ADU, multiplied", "multiplied"))],
    *[(*gain(comment), 2.0, "") for comment in ("e-/ADU, not applied", "e-/ADU to be applied")],
    # reads of one exposure
    (*noise("[e-] per read", NSAMP=16), "per read"), (*noise("e- single CDS read"), "single CDS read"),
    (*noise("[e-] per read", NSAMP=1), ""), (*noise("[e-] noise of the readout", NSAMP=16), ""),
    # the reciprocal, a part or another quantity
    *[(*time(comment), None, named) for comment, named in (
        ("shutter speed reciprocal", "reciprocal"), ("frame rate, Hz", "Hz"), ("fps", "fps"), ("1/s", "1/s"),
        ("live time fraction", "fraction"), ("[Hz]", "Hz"), ("seconds/100", "EXPTIME = 60"))],
    *[(*time(comment), 60.0, "several") for comment in ("integration time * coadds", "x 3", "coadd time")],
    *[({"FOCALLEN": (1000.0, comment), "XPIXSZ": 3.8}, "plate_scale", None, named) for comment, named in (
        ("35 mm equivalent", "35 mm"), ("without reducer", "without reducer"))],
    *[({"FOCALLEN": (39.37, comment), "XPIXSZ": 3.8}, "plate_scale", um(3.8 * 1000 / (39.37 * 25.4)), "")
      for comment in ("inch", "focal length in inches")],
    ({"FOCALLEN": '39.37"', "XPIXSZ": 3.8}, "plate_scale", um(3.8 * 1000 / (39.37 * 25.4)), ""),
    ({"FOCALLEN": (10.0, "[ft]"), "XPIXSZ": 3.8}, "plate_scale", um(3.8 * 1000 / (10 * 304.8)), ""),
    *[({"PIXSCALE": (0.4, comment)}, "plate_scale", None, named) for comment, named in (
        ("[arcsec] field of view", "field of view"), ("pix/arcsec", "pix/arcsec"),
        ("arcsec/micron", "micron"), ("[arcsec/2 pixels]", "2 pixels"), ("deg/1000 px", "1000"),
        ("10^-3 rad", "10^"))],
    *[({"SATURATE": (16, comment)}, "saturation", None, named) for comment, named in (
        ("bits", "bits"), ("ADC bit depth", "bit depth"), ("e-/s", "electron/s"))],
    *[(*gain(comment), None, named) for comment, named in (
        ("e-/ADU per 1000", "per 1"), ("e-/(10 ADU)", "/(1"), ("e-/ADU * 100", "* 100"))],
    (*gain(CVF=4.0), 2.0, "CVF = 4"), (*gain(CVF=2.0, EPERADU=2.1), 2.0, ""), (*gain(GAIN=120), 2.0, ""),
    ({"EGAIN": 0.0, "CVF": 1.5}, "gain", 1.5, ""),
    # numbers in keywords that are not read
    *[({key: value}, name, None, f"{key} = {value} is not read") for key, value, name in (
        *((key, 10.0, "exposure") for key in ("T_INT", "EXPTIME1", "IMEXPTIM", "EXPREQ", "EFFTIME")),
        *((key, 1.5, "gain") for key in ("E_ADU", "CONVFACT", "T_GAIN1", "PREGAIN", "ELECGAIN")),
        *((key, 4.5, "read_noise") for key in ("RMSNOISE", "RN", "READOUTN")), ("SATVAL", 6e4, "saturation"),
        *((key, 0.5, "plate_scale") for key in ("PIXSIZE", "PIXFOV", "SECPERPX", "FOCALLEN")),
        ("ITIME", 10.0, "exposure"), ("EXPOINUS", 500, "exposure"), ("GAIN1", 1.5, "gain"),
        ("GAINA", 1.5, "gain"),
        ("RDNOISE2", 5.0, "read_noise"), ("SATURATA", 4e4, "saturation"), ("XPIXSCAL", 0.4, "plate_scale"),
        ("PLTSCALE", 67.2, "plate_scale"), ("CDELT1", -1.1e-4, "plate_scale"))],
    *[({"CDELT1": 0.4, "CTYPE1": "LINEAR", "CUNIT1": unit}, "plate_scale", None, "CDELT1 = 0.4")
      for unit in ("arcsec", "deg", "mas")],
    *[({key: 100}, "bias", None, f"{key} = 100") for key in ("BLKLEVEL", "BLACKLVL", "BIAS", "BIASLEVL")],
    *[({key: 25.0}, "exposure", None, f"{key} = 25") for key in ("FPS", "FRAMERAT")],
    ({"EXPTIME": 2.0, "CDELT1": 0.4, "CTYPE1": "LINEAR", "CUNIT1": "mm"}, "exposure", 2.0, ""),
    ({"EXPTIME": 2.0, "BIASSEC": "[1:8,1:8]", "BIAS": "bias.fits", "BLACKBOX": 3}, "exposure", 2.0, ""),
    ({"BIASLVL": 300, "BLKLEVEL": 100}, "bias", 300.0, ""), ({"SUBBIAS": True, "BIAS": 100}, "bias", 0.0, ""),
    # the exposure of a cube that is that of all its planes
    *[({"EXPTIME": (20.0, "total exposure"), "NAXIS3": planes}, "exposure", 20.0, named)
      for planes, named in ((2, "'total exposure'"), (1, ""))],
    *[({"EXPTIME": 20.0, "HIERARCH ESO DET DIT": dit}, "exposure", 20.0, named)
      for dit, named in ((2.0, "DIT = 2"), (20.0, ""))],
    ({"EXPTIME": 0.0, "EXPOINUS": 500}, "exposure", 0.0, "EXPOINUS = 500"),
    *[({"EXPTIME": 2.0, key: value}, "exposure", 2.0, "") for key, value in (
        ("ITIME", 1.0), ("CDELT1", 1.0), ("GAIN1", "low"), ("BSCALE", 1.0), ("EXPNUM", 7), ("NEXPOS", 7),
        ("EXPSTART", 5e4), ("EMGAIN", 3))],
    ({"BUNIT": "electron", "EXPTIME": 2.0, "GAIN1": 1.5}, "exposure", 2.0, ""),
    # levels that the stored integers do not reach
    (*level(BITPIX=16), 32767.0, "32767"), (*level(BITPIX=16, BZERO=32768), 65535.0, ""),
    (*level(BITPIX=8), 255.0, "255"), (*level(BITPIX=-32), 65535.0, ""),
    (*level(BITPIX=16, BSCALE=4.0), 65535.0, ""),
]  # fmt: skip


@pytest.mark.parametrize(("cards", "name", "value", "named"), NUMBERS, ids=lambda x: str(x)[:70])
def test_a_doubtful_number_is_warned_of(cards, name, value, named):
    assert named or value is not None
    assert_number(cards, name, value, named)


PIXELS = [  # cards, unit of the pixels, what a warning names
    ({"UNITS": "electrons"}, "adu", "UNITS = 'electrons'"), ({"UNITS": "counts"}, "adu", ""),
    ({"BUNIT": "electron", "UNITS": "K"}, "electron", ""),
    *[({"BUNIT": ("DN", comment)}, "adu", named) for comment, named in (
        ("per second", "per second"), ("count rate", "rate"), ("DN/s", "/s"),
        ("normalised to 1 s", "normalised"),
        ("data numbers per pixel", ""), ("1 DN = 2 e-, see/side", ""))],
    *[({"BUNIT": unit}, unit, "") for unit in
      ("adu*s", "kADU", "adu/frame", "adu/coadd", "sqrt(adu)", "e-/ms", "adu/arcsec2", "photons")],
]  # fmt: skip


@pytest.mark.parametrize(("cards", "unit", "named"), PIXELS)
def test_a_unit_that_is_not_read_is_kept_by_its_name_or_warned_of(cards, unit, named):
    metadata = resolve_header(header(cards))
    assert metadata.value("unit", "adu") == unit
    assert_warned(metadata.warnings, named)


DAY = "2023-05-10T19:00:48"
TIMES = [  # cards, time in UTC, what a warning names
    ({"DATE-OBS": DAY, "JD": 2460000.5}, DAY, "JD contradicts"),
    ({"DATE-OBS": DAY, "JD": 2460075.2922}, DAY, ""),
    ({"JD": 2460075.25}, "2023-05-10T18:00:00.000", ""), ({"MJD": 60074.75}, "2023-05-10T18:00:00.000", ""),
    ({"DATE-OBS": "2023-05-10", "JD": 2460075.25}, "2023-05-10T18:00:00.000", ""),
    ({"MJD": (60074.75, "mid exposure")}, "2023-05-10T18:00:00.000", "'mid'"),
    ({"DATE-OBS": DAY, "UT": "10:00:48"}, DAY, "UT = 10:00:48"),
    ({"DATE-OBS": DAY, "UT": "19:00:48"}, DAY, ""),
    ({"DATE-OBS": "2023-05-10", "TIME-OBS": "19:00:48", "UT": "10:00:48"}, DAY, "UT = 10:00:48"),
    ({"DATE-OBS": "2023-05-10T23:59:59", "UT": "00:00:01"}, "2023-05-10T23:59:59", ""),
    ({"DATE-OBS": DAY, "UT": "20:30:00", "EXPTIME": 7200.0}, DAY, ""),
    ({"DATE-OBS": DAY, "UT": 19.0133}, DAY, ""),
    ({"MJD-OBS": (60074.5, "end of exposure")}, "2023-05-10T12:00:00.000", "'end'"),
    ({"DATE-OBS": f"{DAY}+09:00"}, "2023-05-10T10:00:48", ""), ({"DATE-OBS": f"{DAY} PM"}, None, "PM"),
]  # fmt: skip


@pytest.mark.parametrize(("cards", "when", "named"), TIMES)
def test_a_time_that_another_keyword_contradicts_is_warned_of(cards, when, named):
    metadata = resolve_header(header(cards))
    assert metadata.value("time") == when
    assert_warned(metadata.warnings, named)


IMAGE = np.random.default_rng(0).poisson(100, (40, 48))


def calibrated(**coefficients):
    return {"imagej": True, "metadata": {"vunit": "gray value", **coefficients}}


def tagged(code, kind, values):
    count = len(values)
    return {"metadata": None, "extratags": [(code, kind, count, values if count > 1 else values[0], True)]}


def exposed(times, units):
    return {
        "ome": True,
        "metadata": {"axes": "TYX", "Plane": {"ExposureTime": times, "ExposureTimeUnit": units}},
    }


TIFFS = [  # stored numbers, options of tifffile, the image that they mean, what a warning names
    (IMAGE + 32768, calibrated(cf=0, c0=-32768.0, c1=1.0), IMAGE, ""),  # signed integers of ImageJ
    (IMAGE, calibrated(cf=0, c0=1.0, c1=2.5), 1 + 2.5 * IMAGE, "2.5 x the stored numbers"),
    (IMAGE, calibrated(cf=20), IMAGE, ""), (IMAGE, calibrated(cf=21), IMAGE, "cf = 21"),
    (IMAGE, calibrated(cf=1, c0=0.0, c1=1.0, c2=0.1), IMAGE, "cf = 1"),
    (IMAGE, calibrated(unit="cm", spacing=2.0), IMAGE, ""),
    *[(IMAGE, tagged(*tag), IMAGE, named) for tag, named in (
        ((301, "H", (0, 100, 65535)), "TransferFunction"), ((34675, "B", (0, 1, 2)), "ICC"),
        ((50712, "H", (0, 100, 65535)), "LinearizationTable"), ((50714, "H", (64,)), "BlackLevel"),
        ((281, "H", (4095,)), ""))],
    (IMAGE, {"ome": True, "metadata": {"axes": "YX",
    "PhysicalSizeX": 6.5, "PhysicalSizeXUnit": "mm"}}, IMAGE, ""),
    (np.stack([IMAGE] * 2), exposed([20.0] * 2, ["ms", "s"]), IMAGE, "ExposureTime"),
    (np.stack([IMAGE] * 2), exposed([20.0, 30.0], ["ms"] * 2), IMAGE, "ExposureTime"),
    (np.stack([IMAGE] * 2), {"imagej": True, "metadata": {"axes": "CYX"}}, IMAGE, "channels"),
    (np.stack([IMAGE] * 2), {"ome": True, "metadata": {"axes": "CYX"}}, IMAGE, "channels"),
    (np.stack([IMAGE] * 2), {"imagej": True, "metadata": {"axes": "ZYX", "finterval": 0.1}}, IMAGE, ""),
]  # fmt: skip


@pytest.mark.parametrize(("stored", "options", "meant", "named"), TIFFS, ids=lambda x: str(x)[:60])
def test_the_numbers_of_a_tiff_are_what_it_says_or_warned_of(tmp_path, stored, options, meant, named):
    options = {"photometric": "minisblack"} | options
    tifffile.imwrite(tmp_path / "a.tif", stored.astype(np.uint16), **options)
    for frame in read_frames(tmp_path / "a.tif"):
        np.testing.assert_array_equal(frame.data, meant[::-1])
        assert frame.metadata.plate_scale is None
        assert frame.metadata.exposure is None
        assert_warned(frame.metadata.warnings, named)


@pytest.mark.parametrize("shape", [(10, 12), (20, 24), (39, 48), (10, 40)])
@pytest.mark.parametrize("first", [True, False])
def test_an_unmarked_thumbnail_is_warned_of(tmp_path, shape, first):
    small = IMAGE[: shape[0], : shape[1]]
    with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
        for page in (small, IMAGE) if first else (IMAGE, small):
            writer.write(page.astype(np.uint16), photometric="minisblack", metadata=None)
    named = f"pages {0 if first else 1} have" if shape in [(10, 12), (20, 24)] else ""
    for frame in read_frames(tmp_path / "a.tif"):
        assert_warned(frame.metadata.warnings, named)


@pytest.mark.parametrize("value", [32767, 30000])
def test_a_pixel_at_the_end_of_the_stored_integers_is_saturated(tmp_path, value):
    """A SATURATE of the camera, in an image that was written with fewer bits."""
    data = IMAGE.astype(np.int16)
    data[3, 4] = value
    fits.PrimaryHDU(data, header({"SATURATE": 65535})).writeto(tmp_path / "a.fits")
    (frame,) = read_frames(tmp_path / "a.fits")
    assert frame.metadata.value("saturation") == 32767.0
    assert (frame.data >= frame.metadata.value("saturation")).sum() == (value == 32767)
