"""Siblings of the headers in ``test_variants``: what else may stand in a card, and beside it.

As there, a row has cards, the quantity, the number that their writer meant,
or None where it must not be guessed;
and what a warning names, empty where none is needed.  No row may be silent and wrong.
"""

import math

import numpy as np
import pytest
from astropy.io import fits
from astropy.wcs import WCS
from headers import assert_number, assert_warned, header
from refusals import refused

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import read_frames, resolve_header, sky_position_angle


def time(value, comment=""):
    return {"EXPTIME": (value, comment)}, "exposure"


def noise(comment):
    return {"RDNOISE": (2.0, comment), "EGAIN": 3.0}, "read_noise"


def level(comment):
    return {"SATURATE": (15000.0, comment), "EGAIN": 3.0}, "saturation"


def scale(comment, value=0.4):
    return {"PIXSCALE": (value, comment)}, "plate_scale"


def gain(comment, key="GAIN"):
    return {key: (2.0, comment), "OBSERVAT": "SAAO"}, "gain"


def lens(**cards):
    return {"FOCALLEN": 1000, **cards}, "plate_scale"


def aberration(comment, key="VAFACTOR"):
    return {key: (1.00007, comment)}, "va_factor"


def um(size, focus=1.0):
    """Arcsec that a pixel of so many micrometres sees behind a focal length in metres."""
    return math.degrees(size * 1e-6 / focus) * 3600


def exposed(comment):
    return {"EXPTIME": (30.0, comment)}, "exposure"


NUMBERS = [
    # a multiple of a unit
    *[(*exposed(comment), None, named) for comment, named in (
        ("integration time in units of 10ms", "units of 10"), ("in half seconds", "in half"),
        ("in 10 ms", "in 10 ms"),
        ("steps of 100 us", "steps of 100"), ("in units of 0.5 seconds", "units of 0.5"))],
    *[(*exposed(comment), 30.0, "") for comment in ("in units of 1 s", "in units of seconds", "in s")],
    # a focal reducer
    *[(*lens(XPIXSZ=3.8, REDUCER=reducer), um(3.8), named) for reducer, named in (
        (0.63, "REDUCER = 0.63"), ("0.8x", "REDUCER = 0.8x"), ("Optec", "REDUCER"), (1.0, ""), (1, ""),
        ("None", ""), ("", ""))],
    ({"FOCALLEN": 1000, "REDUCER": 0.63, "PIXSCALE": um(3.8)}, "plate_scale", um(3.8), ""),
    # amplifiers of ESO
    ({"HIERARCH ESO DET OUT1 CONAD": 1.1, "HIERARCH ESO DET OUT2 CONAD": 1.3}, "gain", 1.2,
      "OUT2 CONAD = 1.1 to 1.3"),
    ({"HIERARCH ESO DET OUT4 CONAD": 1.1, "HIERARCH ESO DET OUT3 CONAD": 1.1}, "gain", 1.1, ""),
    ({"HIERARCH ESO DET OUT2 RON": 4.9}, "read_noise", 4.9, ""),
    ({"READMODE": "Rolling"}, "line_time", None, "READMODE"),
    ({"READMODE": "Rolling", "LINETIME": 1e-5}, "line_time", 1e-5, ""),
    # another notation of a number, or something beside it
    (*time("1.000,5"), None, "'1.000,5'"), (*time("1,000.5"), None, "'1,000.5'"), (*time("0x10"),
    None, "'0x10'"),
    (*time("50%"), None, "%"), (*time("1-2"), None, "'1-2'"), (*time("10 - 20 s"), None, "'10 - 20 s'"),
    (*time("N/A"), None, "'N/A'"), (*time("inf"), None, "'inf'"), (*time("[1.0]"), None, "'[1.0]'"),
    (*time("1.0, 2.0"), None, "'1.0, 2.0'"), (*time("1.5+02"), None, "'1.5+02'"), (*time("1 1/2"),
    None, "'1 1/2'"),
    (*time("30s x 4"), None, "'30s x 4'"), (*time("1 min 30 s"), None, "'1 min 30 s'"), (*time("<1"),
    None, "'<1'"),
    (*time("10/60/3"), None, "'10/60/3'"), (*time(True), None, "True"), (*time("30 coadds"), None, "coadds"),
    (*time("1.5d+02"), 150.0, ""), (*time("2.5 sec."), 2.5, ""), (*time("1/60 sec"), 1 / 60, ""),
    (*time("1 Ms"), None, "Ms"), (*time("1 Msec"), None, "Msec"), (*time("1 MS"), 1e-3, ""),
    (*time("1 MIN"), 60.0, ""), (*time("2 cs"), None, "cs"), (*time("1/60th"), None, "th"),
    # units in other brackets, in two words, in another language
    (*time(2.0, "{ms}"), 0.002, ""), (*time(2.0, "<ms>"), 0.002, ""), (*time(2.0, "|ms|"), 0.002, ""),
    (*time(2.0, "[min.]"), 120.0, ""), (*time(2.0, "Exposure time/ms"), 0.002, ""),
    (*time(2.0, "exposure in milli-seconds"), 0.002, ""), (*time(2.0, "exposure in milli seconds"),
    0.002, ""),
    (*time(2.0, "Belichtungszeit in Millisekunden"), None, "Millisekunden"),
    (*time(2.0, "temps de pose en ms"), None, "ms"), (*time(2.0, "[0.1 s]"), None, "0.1 s"),
    (*scale("[Mas/pix]"), None, "Mas"), (*scale("[ARCSEC/PIXEL]"), 0.4, ""),
    (*scale("[MAS/PIXEL]", 400), 0.4, ""),
    ({"FOCALLEN": (1000, "[Mm]"), "XPIXSZ": 3.8}, "plate_scale", None, "Mm"),
    (*scale("arc-minutes per pixel"), 24.0, ""), (*scale("arc sec per pixel"), 0.4, ""),
    (*scale("milli-arcsec per pixel"), 0.0004, "unusual"), (*scale("[mas/pix]", 400), 0.4, ""),
    # a count, a power of ten, a logarithm, another quantity
    (*time(2.0, "exposure #"), None, "#"), (*time(2.0, "exposure counter"), None, "counter"),
    (*time(2.0, "frame count"), None, "EXPTIME = 2"), (*time(2.0, "log10 of the exposure"), None, "log10"),
    (*time(2.0, "% of full scale"), None, "%"), (*time(2.0, "[s] x 10"), None, "x 10"),
    (*time(2.0, "exposure in 0.01 s"), None, "0.01"), (*time(2.0, "exposure (1e-3 s)"), None, "1e-3"),
    (*time(2.0, "exposure time in tenths of a second"), None, "tenths of"),
    (*time(2.0, "in clock ticks"), None, "clock ticks"), (*time(2.0, "in lines"), None, "in lines"),
    (*time(0.01, "exposure of 0.01 s"), 0.01, ""), (*time(2.0, "[s] of 0.01 s steps"), None, "0.01"),
    (*level("kADU"), None, "kADU"), (*level("in thousands of ADU"), None, "thousands of"),
    (*gain("gain, 0.1 e-/ADU", "EGAIN"), None, "0.1"), (*gain("gain in 0.1 dB", "EGAIN"), None, "0.1"),
    (*time(2.0, "Integration time, 1/1000 s"), None, "1/1000"), (*time(2.0, "[s-1]"), None, "s-1"),
    (*time(2.0, "Total exposure time (30 x 60 s)"), 2.0, ""), (*time(2.0, "[s] dead time 10 ms"), 2.0, ""),
    (*noise("variance [e-]"), None, "variance"), (*noise("variance in e-**2"), None, "variance"),
    (*noise("[e-^2]"), None, "e-^2"), (*noise("e- FWHM"), None, "FWHM"), (*noise("peak to peak, e-"),
    None, "peak"),
    (*noise("mV"), None, "mV"), (*noise("dB"), None, "dB"), (*noise("[e-/s]"), None, "electron/s"),
    (*noise("[e- rms]"), 2.0, ""), (*noise("read noise in counts"), 6.0, ""), (*noise("READNOISE (ADU)"),
    6.0, ""),
    (*level("Full well capacity"), None, "SATURATE"), (*level("full well, e-"), 5000.0, ""),
    (*level("number of saturated pixels"), None, "number"), (*level("ADU above bias"), None, "above bias"),
    (*level("[%]"), None, "%"), (*level("percent"), None, "percent"), (*level("[V]"), None, "V"),
    (*level("1% non-linearity, adu"), 15000.0, ""),
    ({"BIASLVL": (300.0, "bias level, V")}, "bias", None, "V"),
    (*scale("pixels per arcsec"), None, "pixels per"), (*scale("[arcsec/pixel]^2"), None, "^2"),
    (*scale("pixel area"), None, "area"), (*scale("microradian"), 0.4 * 0.20626480624709636, ""),
    (*scale("in mrad"), 0.4 * 206.26480624709636, ""), (*scale("nanoradian"), None, "nanoradian"),
    (*scale("microns"), None, "microns"), (*scale("[arcsec] per 10 pixels"), None, "per 1"),
    (*scale("arcsec per unbinned pixel"), None, "unbinned"), (*scale("[rad/pix]"),
    82505.92249883855, "unusual"),
    ({"SCALE": (2.0, "zoom")}, "plate_scale", None, "zoom"), ({"SCALE": 1.0}, "plate_scale", 1.0, "no unit"),
    ({"SCALE": (0.4, "[arcsec/pixel]")}, "plate_scale", 0.4, ""),
    ({"PIXAR_A2": (9e-14, "[sr]")}, "plate_scale", None, "sr"),
    ({"PIXAR_A2": (9e-4, "[deg2]")}, "plate_scale", None, "deg2"),
    # gains
    (*gain("[e-/DN]"), 2.0, ""), (*gain("electron adu-1"), 2.0, ""), (*gain("[electron / digital number]"),
    None, "unit"),
    (*gain("[DN/e-]"), None, "DN/e-"), (*gain("[adu electron^-1]"), None, "adu electron"), (*gain("e-/LSB"),
    2.0, ""),
    (*gain("[LSB/e-]"), None, "LSB"), (*gain("uV/e-"), None, "uV"), (*gain("[V/V]"), None, "V"),
    (*gain("[ke-/ADU]"), None, "ke-"), (*gain("e-/1000 ADU"), None, "/1000"), (*gain("gain index"),
    None, "index"),
    (*gain("camera gain setting"), None, "setting"), (*gain("[%]"), None, "GAIN = 2"), (*gain("ISO"),
    None, "ISO"),
    (*gain("[uV/e-]", "EGAIN"), None, "uV"), (*gain("[x]", "EGAIN"), None, "[x]"),
    (*gain("[ADU/e-]", "CVF"), None, "ADU"),
    ({"GAIN": 10, "RDNOISE": 2, "SWCREATE": "AstroCapture"}, "gain", 10.0, "GAIN = 10"),
    ({"GAIN": 10, "RDNOISE": 2, "INSTRUME": "ASI294MC"}, "gain", 10.0, "RDNOISE"),
    # keywords that contradict each other
    ({"EXPTIME": 2.0, "EXPOSURE": 2000}, "exposure", 2.0, "EXPOSURE = 2000"),
    ({"EXPTIME": 30, "XPOSURE": 300}, "exposure", 30.0, "XPOSURE = 300"),
    ({"EXPTIME": 30, "EXPOSURE": "00006"}, "exposure", 30.0, ""),
    ({"EXPTIME": 0, "EXPOSURE": 0}, "exposure", 0.0, "if there was light"),
    ({"EXPTIME": 10, "COADDS": 5}, "exposure", 10.0, "COADDS = 5"),
    ({"EXPTIME": 10, "HIERARCH ESO DET NDIT": 12}, "exposure", 10.0, "NDIT = 12"),
    ({"EXPTIME": 10, "NCOMBINE": 4}, "exposure", 10.0, "NCOMBINE = 4"),
    ({"EXPTIME": 10, "STACKCNT": 40}, "exposure", 10.0, "STACKCNT = 40"),
    ({"EXPTIME": 10, "NCOMBINE": 1, "COADDS": 1}, "exposure", 10.0, ""),
    ({"PIXSCALE": 0.4, "SECPIX": 0.8}, "plate_scale", 0.4, "SECPIX = 0.8"),
    ({"SECPIX1": 0.4, "SECPIX2": 0.8}, "plate_scale", 0.4, "not square"),
    ({"SECPIX1": -0.4, "SECPIX2": 0.4}, "plate_scale", None, "SECPIX1 = -0.4"),
    ({"PIXSCALE": 0.4, "CCDSUM": "2 2"}, "plate_scale", 0.4, "binning of 2"),
    # focal lengths, pixels and binning
    (*lens(PIXSIZE1=3.8, CCDSUM="2 2"), um(7.6), ""), (*lens(PIXSIZE1=3.8, XBINNING="2x2"), um(7.6), ""),
    (*lens(PIXSIZE1=3.8, BINX=2), um(7.6), ""), (*lens(PIXSIZE1=3.8, XBINNING=2.0), um(7.6), ""),
    (*lens(PIXSIZE1=3.8, XBINNING=0), um(3.8), "XBINNING = '0'"),
    (*lens(PIXSIZE1=3.8, XBINNING=-2), um(3.8), "XBINNING = '-2'"),
    (*lens(PIXSIZE1=3.8, XBINNING=1, YBINNING=2), um(3.8 * 2**0.5), "not square"),
    (*lens(XPIXSZ=3.8, YPIXSZ=7.6), um(3.8 * 2**0.5), "not square"),
    (*lens(XPIXSZ=3.8e-6), None, "XPIXSZ = 3.8e-06"), (*lens(XPIXSZ=0.0038), None, "XPIXSZ = 0.0038"),
    (*lens(XPIXSZ=(3.8, "[mm]")), None, "XPIXSZ = 3800"),
    ({"FOCALLEN": 1.0, "XPIXSZ": 3.8}, "plate_scale", um(3.8, 1e-3), "unusual"),
    ({"FOCALLEN": 2.0, "APTDIA": 200, "XPIXSZ": 3.8}, "plate_scale", None, "aperture of 200 mm"),
    ({"FOCALLEN": "f/10", "XPIXSZ": 3.8}, "plate_scale", None, "'f/10'"),
    (*lens(XPIXSZ=(3.8, "f/10 telescope")), um(3.8), ""),
    # a factor without a unit
    *[(*aberration(comment), 1.00007, "") for comment in
      ("velocity aberration plate scale factor", "[none]", "[unitless]", "[1]", "[-]", "[ratio]",
      "[] factor")],
    (*aberration("Velocity aberration scale factor", "VA_SCALE"), 1.00007, ""),
    (*aberration("[km/s]"), None, "km/s"), (*aberration("[arcsec]"), None, "arcsec"),
    # words of other languages, numbers that are none, units in a card of their own
    *[(*time(2.0, comment), None, named) for comment, named in (
        ("tiempo de exposicion (milisegundos)", "milisegundos"), ("Belichtungszeit (Minuten)", "Minuten"),
        ("tempo di posa, ore", "ore"), ("duree de pose en heures", "heures"), ("dummy value", "dummy"),
        ("not yet known", "not yet known"))],
    (*time(2.0, "Belichtungszeit in Sekunden"), 2.0, ""), (*time(2.0, "duree de pose (minutes)"), 120.0, ""),
    *[(*time(2.0, comment), 2.0, "") for comment in
      ("seconds, -1 if unknown", "exposure in sec; unknown dead time", "[s] of the 2 exposures")],
    (*time(5, "EV"), None, "EV"), (*time(5, "exposure value"), None, "value"),
    (*time(120.0, "total exposure of 4 frames"), 120.0, "of 4 frames"),
    (*time(120.0, "integration time per coadd"), 120.0, "per coadd"),
    (*time(120.0, "total exposure time"), 120.0, ""),
    ({"EXPTIME": 2000, "EXPUNIT": "ms"}, "exposure", 2.0, ""),
    ({"EXPTIME": 2000, "EXPUNIT": "ticks"}, "exposure", None, "ticks"),
    ({"EXPTIME": 2000, "TIMEUNIT": "ms"}, "exposure", None, "TIMEUNIT = 'ms'"),
    ({"EXPTIME": 2, "TIMEUNIT": "s"}, "exposure", 2.0, ""),
    *[({"EXPTIME": 2.0, key: 10}, "exposure", 2.0, f"{key} = 10")
      for key in ("NFRAMES", "NSTACK", "STACKED")],
    ({"EXPTIME": 2.0, "NFRAMES": 10, "NAXIS3": 10}, "exposure", 2.0, ""),
    ({"TELESCOP": "JWST", "EFFINTTM": 2.0, "NFRAMES": 8}, "exposure", 2.0, ""),
    (*scale("mm"), None, "mm"), (*scale("pixel size in mm"), None, "mm"),
    (*scale("in 9 um pixels"), 0.4, ""), (*scale("plate scale at f = 800 mm"), 0.4, ""),
    (*scale("um/pixel", 9.0), None, "um"),
    (*scale("Bogenminuten"), None, "Bogenminuten"), ({"PIXSCALE": 0.01, "PIXUNIT": "arcmin"}, "plate_scale",
    0.6, ""),
    *[({"PIXSCALE": text}, "plate_scale", None, repr(text)) for text in ("0.4/0.5", "0.4x0.4", "0.4, 0.4")],
    ({"SCALE": (20.0, "arcsec/mm"), "PIXSIZE": 9.0}, "plate_scale", None, "arcsec/mm"),
    *[(*gain(comment), None, named) for comment, named in (
        ("relative gain", "relative"), ("EM gain", "EM gain"), ("placeholder", "placeholder"))],
    ({"EGAIN": 2.0, "EGAINU": "ADU/e-"}, "gain", None, "ADU/e-"),
    ({"EGAIN": 2.0, "EGAINU": "e-/ADU"}, "gain", 2.0, ""),
    ({"BIASLVL": 1000, "PEDESTAL": -100}, "bias", 1000.0, "PEDESTAL"),
    *[({"BIASLVL": (1000, comment)}, "bias", value, named) for comment, value, named in (
        ("subtracted", 0.0, "subtracted"), ("already removed", 0.0, "removed"),
        ("to be subtracted", 1000.0, ""),
        ("[ADU] not subtracted", 1000.0, ""))],
    *[(*level(comment), None, named) for comment, named in (
        ("fraction of full scale", "fraction"), ("not measured", "not measured"))],
    (*aberration("inverse of the factor"), None, "inverse"),
    (*aberration("[%]"), None, "VAFACTOR"), ({"VAFACTOR": 7e-5}, "va_factor", None, "VAFACTOR = 7e-05"),
]  # fmt: skip


@pytest.mark.parametrize(("cards", "name", "value", "named"), NUMBERS, ids=lambda x: str(x)[:70])
def test_a_number_is_what_its_writer_meant_or_is_not_used(cards, name, value, named):
    assert named or value is not None
    assert_number(cards, name, value, named)


TIMES = [  # cards, time in UTC, what a warning names
    ({"DATE-OBS": "2023-05-10", "UTSHUT": "2023-05-10T19:00:48"}, "2023-05-10T19:00:48", ""),
    ({"DATE-OBS": "2023-05-10", "UTC": "19:00:48"}, "2023-05-10T19:00:48", ""),
    ({"DATE-OBS": "2023-05-10T00:00:00", "UT": "19:00:48"}, "2023-05-10T19:00:48", ""),
    ({"DATE-OBS": "2023-05-10T00:00:00"}, "2023-05-10T00:00:00", ""),
    ({"DATE-OBS": "2023-05-10", "UT": 19.0133}, "2023-05-10", "19.0133"),
    ({"DATE-OBS": "2023-05-10", "TIME-OBS": "7:00:48 PM"}, "2023-05-10", "PM"),
    ({"DATE-OBS": "2023-05-10", "TIME-OBS": "20:00:00+02:00"}, "2023-05-10T18:00:00", ""),
    ({"DATE-OBS": ("2023-05-10T19:00:48", "local time")}, "2023-05-10T19:00:48", "local"),
    ({"DATE-OBS": "2023-05-10T19:00:48", "TIMESYS": "GPS"}, "2023-05-10T19:00:48", "GPS"),
    ({"DATE-OBS": "10/05/23"}, "1923-05-10", "1923"), ({"DATE-OBS": "05-10-2023"}, None, "05-10-2023"),
    ({"DATE-OBS": "2023-130"}, None, "2023-130"), ({"DATE-OBS": 1683745248.5}, None, "1683745248.5"),
    ({"DATE-OBS": "2023-02-29T00:00:00"}, None, "2023-02-29"), ({"MJD-OBS": 2460075.29}, None, "MJD-OBS"),
    ({"MJD-OBS": (74.79, "MJD-60000")}, None, "MJD-OBS = 74.79"),
    ({"DATE-OBS": "2026-11-21T03:00:00", "MJD-OBS": 61365.4167}, "2026-11-21T03:00:00",
      "MJD-OBS contradicts"),
    ({"DATE-OBS": "2026-11-21T03:00:00", "MJD-OBS": 61365.15, "EXPTIME": 7200}, "2026-11-21T03:00:00", ""),
    ({"DATE-OBS": "2026-11-21T03:00:00", "MJD-OBS": 61365.175, "EXPTIME": 7200}, "2026-11-21T03:00:00", ""),
    ({"DATE-OBS": "2026-11-27T03:00:00", "MJD-OBS": 61000.0}, "2026-11-27T03:00:00", "MJD-OBS contradicts"),
    ({"DATE-OBS": "2026-11-27T03:00:00", "MJD-OBS": 61371.125}, "2026-11-27T03:00:00", ""),
    *[({"DATE-OBS": ("2023-05-10T19:00:48", comment)}, "2023-05-10T19:00:48", named) for comment, named in (
        ("JST", "JST"), ("[LT]", "[LT]"), ("Ortszeit", "Ortszeit"), ("UTC+9", "UTC+9"),
        ("end of exposure", "'end'"),
        ("mid-exposure", "'mid'"), ("UTC start of exposure (mean of 2 clocks)", ""), ("UT", ""),
        ("UTC, for CET add 1 h", ""), ("UT at shutter opening", ""))],
    ({"DATE-OBS": "2023-05-10T19:00:48", "TIMEOFFS": 100.0}, "2023-05-10T19:00:48", "TIMEOFFS"),
    # 51544.5 in TT is the epoch J2000, 64.184 s earlier in UTC
    ({"MJD-OBS": 51544.5, "TIMESYS": "TT"}, "2000-01-01T11:58:55.816", ""),
]  # fmt: skip


@pytest.mark.parametrize(("cards", "time", "named"), TIMES)
def test_a_time_is_read_or_warned_of(cards, time, named):
    metadata = resolve_header(header(cards))
    assert metadata.value("time") == time
    assert_warned(metadata.warnings, named)


STEP = 0.4 / 3600
TAN = {
    "CTYPE1": "RA---TAN",
    "CTYPE2": "DEC--TAN",
    "CRPIX1": 32.5,
    "CRPIX2": 32.5,
    "CRVAL1": 150.0,
    "CRVAL2": 20.0,
}
CD = {**TAN, "CD1_1": -STEP, "CD2_2": STEP}
COS, SIN = math.cos(math.radians(30)), math.sin(math.radians(30))
CDELT = {**TAN, "CDELT1": -STEP, "CDELT2": STEP}
SIP = {"CTYPE1": "RA---TAN-SIP", "CTYPE2": "DEC--TAN-SIP", "A_ORDER": 2, "B_ORDER": 2}
PV = {"PV1_0": 0.0, "PV1_1": 2.0, "PV2_0": 0.0, "PV2_1": 2.0}

SKIES = [  # cards, arcsec/pixel in the middle, position angle of +y (None: not given), what a warning names
    (CD, 0.4, 0.0, ""), ({**CD, "CDELT1": -2 * STEP, "CDELT2": 2 * STEP}, 0.4, 0.0, ""),
    ({**CD, "PC1_1": 1.0, "PC2_2": 1.0, "CDELT1": -2 * STEP, "CDELT2": 2 * STEP}, 0.8, 0.0, "FITS forbids"),
    ({**CDELT, "PC1_1": 0.0, "PC2_2": 0.0}, None, None, "singular"),
    ({**CDELT, "CROTA2": 30.0}, 0.4, 330.0, ""), ({**CDELT, "CROTA1": 30.0}, 0.4, 0.0, "CROTA1"),
    *[({**CD, "CROTA2": angle}, 0.4, 0.0, named)
      for angle, named in ((0.5, ""), (180.0, ""), (60.0, "CROTA2"))],
    ({**TAN, "CD1_1": -STEP * COS, "CD1_2": STEP * SIN, "CD2_1": STEP * SIN, "CD2_2": STEP * COS,
      "CROTA2": -30.0}, 0.4, 30.0, ""),
    ({**CDELT, "CTYPE1": "RA--TAN", "CTYPE2": "DEC-TAN"}, None, None, "RA--TAN"),
    ({**CDELT, "CTYPE1": "LINEAR", "CTYPE2": "LINEAR"}, None, None, ""),
    ({**CDELT, "PC1_1": -1.0, "PC2_2": -1.0}, 0.4, 180.0, ""),
    ({**CDELT, "PC1_1": 2.0, "PC2_2": 2.0}, 0.8, 0.0, ""),
    ({**TAN, "CD001001": -STEP, "CD002002": STEP}, None, None, "no CD"),
    ({**CDELT, "LONPOLE": 90.0}, 0.4, 270.0, ""),
    ({**CDELT, "CUNIT1": "arcsec", "CUNIT2": "arcsec"}, 0.4 / 3600, 0.0, "unusual"),
    ({**TAN, "CDELT1": -0.4, "CDELT2": 0.4}, 1440.0, None, "unusual"),
    ({**TAN, "CD1_1": -STEP}, None, None, "1 degree"), ({**TAN, "CDELT1": -STEP}, None, None, "1 degree"),
    ({**CDELT, "CUNIT1": "pixel", "CUNIT2": "pixel"}, None, None, "pixel"),
    ({**CDELT, "CTYPE2": "DEC--SIN"}, None, None, "cannot be used"),
    ({**CDELT, "PIXSCALE": 0.8}, 0.4, 0.0, "PIXSCALE"),
    ({**CDELT, "FOCALLEN": 1000, "XPIXSZ": 3.8}, 0.4, 0.0, "FOCALLEN"),
    *[({**CD, "CD2_2": STEP * (1 + part)}, 0.4 * (1 + part)**0.5, 0.0, named)
      for part, named in ((5e-4, ""), (3e-3, "0.4 x 0.4012 arcsec, not square"))],
    ({**CD, "CD1_2": 3e-3 * STEP, "CD2_1": -3e-3 * STEP}, 0.4, None, "oblique"),
    ({**CDELT, **SIP}, 0.4, 0.0, ""),
    ({**CDELT, **SIP, "A_1_0": 0.1, "B_0_1": 0.1}, 0.44, 0.0, ""),
    ({**CDELT, **SIP, "A_2_0": 1e-3, "CRPIX1": -467.5}, 0.4 * 2**0.5, 0.0, "over the frame"),
    ({**CDELT, **SIP, "A_2_0": 1e-5, "CRPIX1": -1967.5}, 0.4 * 1.04**0.5, None, "fields outside"),
    ({**CDELT, **SIP, "A_2_0": 1e-6, "CRPIX1": -1967.5}, 0.4 * 1.004**0.5, None, "not square"),
    *[({**CDELT, "CRPIX2": 32.5 - math.tan(far) * math.degrees(1) / STEP},
       0.4 * math.cos(far)**1.5, 0.0, named)
      for far, named in ((0.02, ""), (0.12, "fields outside"))],
    ({**CDELT, "CTYPE1": "RA---SIN", "CTYPE2": "DEC--SIN", "CRPIX1": 1e6}, 0.4, None, "off the sky"),
    ({**CD, "CTYPE1": "RA---TPV", "CTYPE2": "DEC--TPV", **PV}, 0.8, 0.0, ""),
    ({**CD, **PV}, 0.8, 0.0, "SCAMP"),
    ({**CDELT, "CTYPE1": "RA---CAR", "CTYPE2": "DEC--CAR", "CRVAL2": 0.0, "CRPIX2": 32.5 - 60 / STEP},
     0.4 * 0.5**0.5, 0.0, "not square"),
]  # fmt: skip


@pytest.mark.parametrize(("cards", "scale", "angle", "named"), SKIES)
def test_a_scale_is_that_of_the_middle_of_the_frame_or_none(tmp_path, cards, scale, angle, named):
    fits.PrimaryHDU(np.ones((64, 64), np.float32), header(cards)).writeto(tmp_path / "a.fits")
    (frame,) = read_frames(tmp_path / "a.fits")
    metadata = frame.metadata
    assert metadata.value("plate_scale") == (None if scale is None else pytest.approx(scale, rel=1e-4))
    assert_warned(metadata.warnings, named)
    if scale is None:
        assert metadata.wcs is None
    elif angle is not None:
        got = sky_position_angle(metadata.wcs, 31.5, 31.5, 90.0)
        assert (got - angle + 180) % 360 - 180 == pytest.approx(
            0, abs=0.05
        )  # away from the reference meridians converge


def test_the_scale_of_a_distorted_frame_agrees_with_astropys_separations(tmp_path):
    """At a pixel in the middle, from the cross product of two steps on the sky."""
    cards = {**CDELT, **SIP, "A_2_0": 2e-4, "A_1_1": 1e-4, "B_0_2": -1e-4, "CRPIX1": -300.0, "CROTA2": 20.0}
    fits.PrimaryHDU(np.ones((64, 64), np.float32), header(cards)).writeto(tmp_path / "a.fits")
    (frame,) = read_frames(tmp_path / "a.fits")
    wcs = WCS(header(cards))
    middle, right, up = (
        wcs.pixel_to_world(*position) for position in ((31.5, 31.5), (31.6, 31.5), (31.5, 31.6))
    )
    angles = [middle.position_angle(other).rad for other in (right, up)]
    sides = [middle.separation(other).arcsec / 0.1 for other in (right, up)]
    area = sides[0] * sides[1] * abs(np.sin(angles[1] - angles[0]))
    assert frame.metadata.plate_scale.value == pytest.approx(area**0.5, rel=1e-4)


SHAPE = (40, 48)
IMAGE = np.random.default_rng(0).poisson(100, SHAPE).astype(np.float32)
BAD = np.zeros(SHAPE, np.uint8)
BAD[3, 3] = 1


def beside(name, data, version=None, **cards):
    return fits.ImageHDU(data, fits.Header(cards), name=name, ver=version)


def constant(name, value):
    return fits.ImageHDU(None, fits.Header({"NPIX1": 48, "NPIX2": 40, "PIXVALUE": value}), name=name)


def image(**cards):
    return fits.PrimaryHDU(IMAGE, fits.Header(cards))


ELECTRONS = image(BUNIT="electron")
FILES = [  # HDUs, pixels masked, median of the variance (None: not used), what a warning names
    ([image(), beside("MASK", 1 - BAD)], BAD.size - 1, None, "--bad-bits 0"),
    *[([image(), beside(name, BAD)], 0, None, name) for name in
      ("GOODPIX", "VALID", "HOTPIX", "CRMASK", "SATMASK", "COVERAGE", "DQ_2", "CCD1_MASK", "EXPMAP", "RMSMAP",
      "UNC", "WT",
       "VARMAP", "INVVARIANCE", "CONFIDENCE")],
    ([image(), fits.ImageHDU(BAD)], 0, None, "HDU 1"),
    ([image(), beside("DQ", BAD), beside("MASK", BAD)], 1, None, "MASK (HDU 2)"),
    ([image(), constant("DQ", 16)], 0, None, "DQ (HDU 1) is 16"),
    ([image(), constant("DQ", 0)], 0, None, ""), ([image(),
    constant("ERR", 4.0)], 0, None, "ERR (HDU 1) is 4"),
    *[([ELECTRONS, beside(name, data, BUNIT=unit)], 0, 100.0, "") for name, data, unit in
      (("VAR", IMAGE, "electron2"), ("VAR", IMAGE, "(e-)^2"), ("VAR", IMAGE, "e-**2"), ("VAR", IMAGE,
      "electron"),
       ("IVAR", 1 / IMAGE, "1/electron2"), ("IVAR", 1 / IMAGE, "electron-2"), ("ERR", IMAGE**0.5,
       "ELECTRONS"))],
    *[([ELECTRONS, beside(name, data, BUNIT=unit)], 0, None, unit) for name, data, unit in
      (("VAR", IMAGE, "adu2"), ("VAR", IMAGE, "adu^2"), ("VARIANCE", IMAGE, "(electron/s)**2"),
       ("IVAR", 1 / IMAGE, "1/adu2"), ("ERR", IMAGE**0.5, "%"), ("ERR", IMAGE**0.5, "mag"))],
    ([fits.PrimaryHDU(IMAGE[:8, :8].copy()), beside("SCI", IMAGE), beside("DQ", BAD)], 1, None, ""),
    *[([fits.PrimaryHDU(), beside(name, IMAGE[:9, :9].copy()), beside("SCI", IMAGE), beside("DQ", BAD)], 1,
    None, "")
      for name in ("THUMBNAIL", "PSF", "BIAS", "DIFF")],
    ([fits.PrimaryHDU(), beside("ERROR_MAP", IMAGE**0.5), beside("FLUX_MAP", IMAGE)], 0, None,
      "ERROR_MAP (HDU 1)"),
    ([fits.PrimaryHDU(IMAGE, fits.Header({"EXTNAME": "WHT"}))], 0, None, "WHT (HDU 0)"),
    ([fits.PrimaryHDU(), *[fits.CompImageHDU(data, quantize_level=0, compression_type="GZIP_1") for data in
      (IMAGE, BAD)]], 0, None, "HDU 2"),
    ([fits.PrimaryHDU(), beside("1-1.E.SCI", IMAGE), beside("1-1.E.FLG", BAD)], 1, None, ""),
    ([image(), beside("DATA QUALITY", BAD)], 1, None, ""),
    *[([fits.PrimaryHDU(), beside(science, IMAGE), beside(noise, IMAGE), beside(mask, BAD)], 1, 100.0, "")
      for science, noise, mask in
      (("SCI1", "VAR1", "DQ1"), ("SCI_1", "VAR_1", "MASK_1"), ("CCD1", "CCD1_VAR", "CCD1_DQ"),
       ("DET1.DATA", "DET1.STAT", "DET1.DQ"), ("CHIP1.INT1", "CHIP1.INT1.VAR", "CHIP1.INT1.DQ"),
       ("IMAGE", "VARIANCE_IMAGE", "IMAGE_MASK"))],
    *[([fits.PrimaryHDU(), beside("SCI1", IMAGE), beside(name, IMAGE)], 0, None, name)
      for name in ("VAR2", "VAR_FLAT_1", "SKY_VAR_1", "VARIANCES 1")],
    ([fits.PrimaryHDU(), beside("SCI1", IMAGE), beside("VAR1", IMAGE), beside("VAR_1", 2 * IMAGE)], 0, 100.0,
      "VAR_1 (HDU 3)"),
    ([fits.PrimaryHDU(), beside("DATA", IMAGE), beside("STAT", IMAGE)], 0, 100.0, ""),
    ([fits.PrimaryHDU(), beside("A1", IMAGE, HDUCLAS2="DATA"),
      beside("A2", IMAGE**0.5, HDUCLAS2="ERROR", HDUCLAS3="RMSE"),
      beside("A3", BAD, HDUCLAS2="QUALITY")], 1, 100.0, ""),
    ([fits.PrimaryHDU(), beside("A1", IMAGE),
      beside("A3", 1 - BAD, HDUCLAS2="QUALITY", HDUCLAS3="MASKZERO")], 0,
     None, "A3 (HDU 2)"),
    ([fits.PrimaryHDU(), *[beside(name, np.full(SHAPE, value, np.float32), version, SAMPNUM=number)
      for version, number, value in ((1, 2, 100.0), (2, 1, 50.0)) for name in ("SCI", "VAR")]], 0, 100.0, ""),
    ([fits.PrimaryHDU(np.where(BAD, -1e30, IMAGE))], 1, None, ""),
    ([fits.PrimaryHDU(np.where(BAD, np.finfo("f4").max, IMAGE))], 1, None, ""),
]  # fmt: skip


@pytest.mark.parametrize(("hdus", "masked", "variance", "named"), FILES)
def test_what_stands_beside_an_image_is_used_or_warned_of(tmp_path, hdus, masked, variance, named):
    fits.HDUList(hdus).writeto(tmp_path / "a.fits")
    (frame,) = read_frames(tmp_path / "a.fits")
    assert (frame.shape, int(frame.mask.sum())) == (SHAPE, masked)
    got = None if frame.variance is None else np.median(frame.variance[~frame.mask])
    assert got == (None if variance is None else pytest.approx(variance, rel=1e-6))
    assert_warned(frame.metadata.warnings, named)


PLANES = [  # sides of the data, cards, what a warning names
    ((4, 5), {"ROWORDER": 1}, "ROWORDER"), ((4, 5), {"ROWORDER": "TD"}, "ROWORDER"),
    ((4, 5), {"BAYERPAT": "MONO"}, ""), ((4, 5), {"CFA": "RGGB"}, "mosaic"),
    ((4, 5), {"BAYRPAT": "RGGB"}, "mosaic"), ((3, 4, 5), {"PROGRAM": "Siril 1.2"}, "three frames"),
    ((3, 4, 5), {}, ""), ((3, 4, 5), {"CTYPE3": "TIME"}, ""), ((4, 4, 5), {}, ""),
]  # fmt: skip


@pytest.mark.parametrize(("shape", "cards", "named"), PLANES)
def test_the_order_of_rows_and_colours_are_read_or_warned_of(tmp_path, shape, cards, named):
    fits.PrimaryHDU(np.ones(shape, np.float32), header(cards)).writeto(tmp_path / "a.fits")
    frame = next(iter(read_frames(tmp_path / "a.fits")))
    assert_warned(frame.metadata.warnings, named)


@pytest.mark.parametrize("shape", [(20, 24, 3), (24, 20, 4), (40, 40, 10), (1, 24, 24, 8)])
def test_a_cube_whose_frames_lie_along_the_first_axis_is_refused(tmp_path, shape):
    fits.PrimaryHDU(np.ones(shape, np.float32)).writeto(tmp_path / "a.fits")
    with refused(ErrorCode.WRONG_SHAPE, tmp_path / "a.fits", f"{shape[-1]} x", error=FrameError):
        next(iter(read_frames(tmp_path / "a.fits")))


STORED = [  # dtype, cards added to the file, pixels masked of which one is stored as -5, its value, warning
    (np.int16, ["BLANK   =                   -5"], 1, None, ""),
    (np.int16, ["BSCALE  =                  2.0", "BLANK   =                   -5"], 1, None, ""),
    (np.int16, ["BZERO   =                32768", "BLANK   =                32763"], 0, 32763.0, ""),
    (np.int16, ["BZERO   =                40000", "BLANK   =                39995"],
     1, None, "BLANK = 39995"),
    (np.int16, ["BLANK   =                70000"], 0, -5.0, "BLANK = 70000"),
    (np.float32, ["BLANK   =                   -5"], 0, -5.0, "BLANK = -5"),
    (np.int16, ["BSCALE  =                  2.0", "BSCALE  =                  3.0"], 0, -10.0, "BSCALE"),
    (np.int64, ["BZERO   =                  0.5"], 0, -4.5, ""), (np.int8, [], 0, -5.0, ""),
    (np.int16, ["EXPTIME =        5.0E+03/[ms]"], 0, -5.0, ""),
    (np.int16, ["EXPTIME =5.0"], 0, -5.0, "EXPTIME"),
    (np.int16, ["BUNIT   = 'electr&'", "CONTINUE  'on' / unit"], 0, -5.0, ""),
]  # fmt: skip


@pytest.mark.parametrize(("dtype", "cards", "masked", "value", "named"), STORED)
def test_stored_numbers_become_what_the_cards_say(tmp_path, dtype, cards, masked, value, named):
    fits.PrimaryHDU(np.where(BAD, -5, 7).astype(dtype)).writeto(tmp_path / "a.fits")
    content = (tmp_path / "a.fits").read_bytes()
    end = content.index(b"END".ljust(80))
    added = b"".join(card.encode().ljust(80) for card in [*cards, "END"])
    (tmp_path / "a.fits").write_bytes((content[:end] + added).ljust(2880) + content[2880:])
    (frame,) = read_frames(tmp_path / "a.fits")
    assert int(frame.mask.sum()) == masked
    assert value is None or frame.data[3, 3] == value
    assert frame.unit == ("electron" if "BUNIT" in str(cards) else "adu")
    assert frame.metadata.value("exposure") == (5.0 if "ms" in str(cards) else None)
    assert_warned(frame.metadata.warnings, named)


@pytest.mark.parametrize(("inherit", "exposure"), [(None, 5.0), (True, 5.0), (False, None), ("F", None)])
def test_an_extension_inherits_unless_it_says_no(tmp_path, inherit, exposure):
    cards = {} if inherit is None else {"INHERIT": inherit}
    hdus = [fits.PrimaryHDU(header=header({"EXPTIME": 5.0})), beside("SCI", IMAGE, **cards)]
    fits.HDUList(hdus).writeto(tmp_path / "a.fits")
    (frame,) = read_frames(tmp_path / "a.fits")
    assert frame.metadata.value("exposure") == exposure


def test_the_groups_of_a_ramp_are_warned_of(tmp_path):
    primary = header({"TELESCOP": "JWST", "NGROUPS": 3, "NINTS": 1, "EFFINTTM": 10.0})
    ramp = np.stack([IMAGE, 2 * IMAGE, 3 * IMAGE])[None]
    fits.HDUList([fits.PrimaryHDU(header=primary), beside("SCI", ramp)]).writeto(tmp_path / "a.fits")
    assert all("NGROUPS" in str(frame.metadata.warnings) for frame in read_frames(tmp_path / "a.fits"))
