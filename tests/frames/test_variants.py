"""Headers as people have them: each gives the right number, or none and a warning that names the card.

A row has cards, the quantity, and the number that the writer of the header meant, or None where it must not
be guessed: then a warning names what is expected behind it.  No row may be silent and wrong.
"""

import math

import pytest
from astropy.io import fits
from headers import assert_number, header

from jitterkit.frames import resolve_header

SIRIL, HST, JWST = {"PROGRAM": "Siril 1.2.1"}, {"TELESCOP": "HST"}, {"TELESCOP": "JWST"}
ATODGN = {"ATODGNA": 1.5, "ATODGNB": 1.51, "ATODGNC": 1.5, "ATODGND": 1.51}
E_PER_ADU = "[e-/ADU]"
SCALE = math.degrees(3.8e-6) * 3600  # 3.8 um at 1 m

NUMBERS = [  # cards, quantity, value or None, what a warning names
    ({"EGAIN": "3,7"}, "gain", 3.7, "'3,7' is read as 3.7"),
    ({"EGAIN": "0,375"}, "gain", 0.375, ""),
    ({"EGAIN": "1200,5"}, "gain", 1200.5, ""),
    ({"SATURATE": "65,535"}, "saturation", None, "'65,535'"),
    ({"SATURATE": "1,048,575"}, "saturation", None, "'1,048,575'"),
    ({"SATURATE": "65 535"}, "saturation", None, "'65 535'"),
    ({"EGAIN": "3.7 e-/ADU"}, "gain", 3.7, ""),
    ({"EGAIN": "~3.7"}, "gain", None, "'~3.7'"),
    ({"EGAIN": "3.7 +/- 0.1"}, "gain", None, "'3.7 +/- 0.1'"),
    ({"EXPTIME": "1/200"}, "exposure", 0.005, ""),
    ({"EXPTIME": "1 / 200 s"}, "exposure", 0.005, ""),
    ({"EXPTIME": "1/4 s"}, "exposure", 0.25, ""),
    ({"EXPTIME": "1/0"}, "exposure", None, "'1/0'"),
    ({"EXPTIME": "00:02:30"}, "exposure", None, "'00:02:30'"),
    ({"EXPTIME": "2 x 30 s"}, "exposure", None, "'2 x 30 s'"),
    ({"EXPTIME": "2x30s"}, "exposure", None, "'2x30s'"),
    ({"EXPTIME": "2m30s"}, "exposure", None, "'2m30s'"),
    ({"EXPTIME": "0.1s"}, "exposure", 0.1, ""),
    ({"EXPTIME": "250ms"}, "exposure", 0.25, ""),
    ({"EXPTIME": "1.5D-1"}, "exposure", 0.15, ""),
    ({"EXPTIME": ".5"}, "exposure", 0.5, ""),
    ({"EXPTIME": "5 parsec"}, "exposure", None, "parsec"),
    ({"EXPTIME": "1.95E+00,"}, "exposure", None, "'1.95E+00,'"),
    ({"EXPTIME": "00006"}, "exposure", None, "'00006'"),
    ({"EXPTIME": (2.0, "[s] rounded to ms")}, "exposure", 2.0, ""),
    ({"EXPTIME": (2.0, "seconds (was 2000 ms)")}, "exposure", 2.0, ""),
    ({"EXPTIME": (2.0, "Exposure (s), readout 30 ms excluded")}, "exposure", 2.0, ""),
    ({"EXPTIME": (2.0, "Exposure time, rounded to ms")}, "exposure", None, "EXPTIME = 2"),
    ({"EXPTIME": (2.0, "exposure in seconds, to the nearest ms")}, "exposure", 2.0, ""),
    ({"EXPTIME": (2.0, "[min]")}, "exposure", 120.0, ""),
    ({"EXPTIME": (2.0, "min exposure")}, "exposure", None, "EXPTIME = 2"),
    ({"EXPTIME": (2000, "Exposure time in ms")}, "exposure", 2.0, ""),
    ({"EXPTIME": (2000, "Exposure time (ms)")}, "exposure", 2.0, ""),
    ({"EXPTIME": (2000, "exposure time, milliseconds")}, "exposure", 2.0, ""),
    ({"EXPTIME": (2e6, "[us] exposure")}, "exposure", 2.0, ""),
    ({"EXPTIME": (7, "[ticks] exposure")}, "exposure", None, "ticks"),
    ({"EXPOSURE": (0.5, "[d] time on source")}, "exposure", 43200.0, ""),
    ({"EXPOSURE": (6, "exposure number of the visit")}, "exposure", None, "number"),
    ({"EXPOSURE": (6, "exposure ID")}, "exposure", None, "ID"),
    ({"XPOSURE": 30.0}, "exposure", 30.0, ""),
    ({"XPOSURE": 0.5, "TIMEUNIT": "min"}, "exposure", 30.0, ""),
    ({"EXPTIME": 2.0, "XPOSURE": 1.9}, "exposure", 2.0, ""),
    ({**JWST, "EXPOSURE": ("00006", "Exposure request number"), "EFFINTTM": 0.3772}, "exposure", 0.3772, ""),
    ({**JWST, "EXPOSURE": 6}, "exposure", None, ""),
    ({**JWST, "EFFINTTM": 2.0, "EFFEXPTM": 20.0, "XPOSURE": 20.0}, "exposure", 20.0, ""),
    ({**JWST, "EFFINTTM": 2.0, "EFFEXPTM": 20.0, "NAXIS3": 10}, "exposure", 2.0, ""),
    ({**JWST, "PIXAR_A2": (0.0009, "Nominal pixel area in arcsec^2")}, "plate_scale", 0.03, ""),
    ({**HST, "CCDGAIN": 1.5}, "gain", 1.5, ""),
    ({**HST, "CCDGAIN": 1.5, "ATODGAIN": 1.55}, "gain", 1.55, ""),
    ({**HST, "CCDGAIN": 1.5, **ATODGN}, "gain", 1.505, ""),
    ({**HST, "CCDAMP": "B", **ATODGN}, "gain", 1.51, ""),
    ({**HST, "READNSE": 3.1}, "read_noise", 3.1, ""),
    ({**HST, "READNSEA": 3.0, "READNSEB": 3.2}, "read_noise", 3.1, "READNSEA"),
    ({"CCDGAIN": "low"}, "gain", None, ""),
    ({"HIERARCH ESO DET OUT1 CONAD": 2.19, "HIERARCH ESO DET OUT1 GAIN": 0.46}, "gain", 2.19, ""),
    ({"HIERARCH ESO DET OUT1 RON": (4.9, "[e-]")}, "read_noise", 4.9, ""),
    ({"INSTRUME": "DECam", "GAINA": 4.0, "GAINB": 4.4}, "gain", 4.2, "GAINA"),
    ({"INSTRUME": "DECam", "RDNOISEA": 6.0, "RDNOISEB": 6.0}, "read_noise", 6.0, ""),
    ({"TELESCOP": "Spitzer", "GAIN": (3.7, "e/DN conversion")}, "gain", 3.7, ""),
    ({"GAIN": (1.9, E_PER_ADU)}, "gain", 1.9, ""),
    ({"GAIN": (1.9, "Gain, electrons per adu")}, "gain", 1.9, ""),
    ({"GAIN": (1.9, "el/count")}, "gain", 1.9, ""),
    ({"GAIN": (1.9, "electrons per A/D unit")}, "gain", 1.9, ""),
    ({"GAIN": (0.5, "[adu/electron]")}, "gain", None, "GAIN = 0.5"),
    ({"GAIN": (2.0, "e-/ADU (0.5 ADU/e-)")}, "gain", 2.0, ""),
    ({"GAIN": (1.5, "gain in dB")}, "gain", None, "dB"),
    ({"GAIN": (1.5, "unit: 0.1dB"), "RDNOISE": 2}, "gain", None, "dB"),
    ({"GAIN": "6 dB"}, "gain", None, "dB"),
    ({"GAIN": 1.9}, "gain", None, "GAIN = 1.9"),
    ({"GAIN": 1, "BUNIT": "electron"}, "gain", None, "GAIN = 1"),
    ({"GAIN": 1.9, "TELESCOP": "APO 80 mm"}, "gain", None, "GAIN = 1.9"),
    ({"GAIN": 10, "RDNOISE": 2, "INSTRUME": "ZWO ASI183MM Pro"}, "gain", None, "ZWO"),
    ({"GAIN": 10, "ORIGIN": "NOAO-IRAF FITS Image Kernel July 2003"}, "gain", None, "GAIN = 10"),
    ({**SIRIL, "GAIN": 10, "CVF": 3.7}, "gain", 3.7, ""),
    *[({key: program, "GAIN": 10, "RDNOISE": 2}, "gain", None, program) for key, program in (
        ("PROGRAM", "Siril 1.2.1"), ("PROGRAM", "PixInsight 1.8.9"), ("SOFTWARE", "ASTAP, version 2024"),
        ("PROGRAM", "INDIGO Imager"), ("SWCREATE", "CCDciel 0.9"), ("CREATOR", "INDI"), ("CREATOR", "Ekos"),
        ("SWCREATE", "N.I.N.A. 3.1 (x64)"), ("SWCREATE", "SharpCap v4.1"), ("CREATOR", "ZWO ASIAIR Plus"),
        ("SOFTWARE", "EZCAP_QT"), ("SWCREATE", "MaxIm DL 6"), ("SWMODIFY", "QHY Capture"))],
    ({"SWCREATE": "SharpCap", "GAIN": 200, "EGAIN": 0.21}, "gain", 0.21, ""),
    ({"RDNOISE": (2.0, "[adu]"), "EGAIN": 3.0}, "read_noise", 6.0, ""),
    ({"RDNOISE": (2.0, "Read noise in DN"), "EGAIN": 3.0}, "read_noise", 6.0, ""),
    ({"RDNOISE": (2.0, "readout noise ADU"), "EGAIN": 3.0}, "read_noise", None, "RDNOISE = 2"),
    ({"RDNOISE": "2.0 ADU"}, "read_noise", None, "ADU"),
    ({"RDNOISE": (2.0, "e-(rms), 0.7 ADU")}, "read_noise", 2.0, ""),
    ({"SATURATE": (15000.0, "[e-] full well"), "EGAIN": 3.0, "BIASLVL": 30}, "saturation", 5030.0, ""),
    ({"SATURATE": (15000.0, "full well in electrons"), "EGAIN": 3.0}, "saturation", 5000.0, ""),
    ({"SATURATE": (15, "[ke-] full well"), "EGAIN": 3.0}, "saturation", None, "ke-"),
    ({"SATURATE": (15000.0, "[e-]")}, "saturation", None, "SATURATE = 15000"),
    ({"SATURATE": 15000.0, "EGAIN": 3.0, "BUNIT": "electron"}, "saturation", 15000.0, ""),
    ({"SATURATE": (4000.0, "[adu]"), "EGAIN": 3.0, "BUNIT": "electron"}, "saturation", 12000.0, ""),
    ({"SATURATE": (4000.0, "[adu]"), "EGAIN": 3.0, "BUNIT": "electron/s"}, "saturation", 12000.0, ""),
    ({"SATURATE": 4000.0, "BUNIT": "electron/s"}, "saturation", None, "SATURATE = 4000"),
    ({"BIASLVL": (300.0, "[e-]"), "EGAIN": 3.0}, "bias", 100.0, ""),
    ({"PIXSCALE": (0.2, "[arcsec/pixel] (5.5e-5 deg)")}, "plate_scale", 0.2, ""),
    ({"PIXSCALE": (0.005, "[arcminutes/pixel]")}, "plate_scale", 0.3, ""),
    ({"PIXSCALE": (1e-4, "Pixel scale (deg)")}, "plate_scale", 0.36, ""),
    ({"PIXSCALE": (0.0135, "[mm]")}, "plate_scale", None, "mm"),
    ({"SCALE": (20.0, "arcsec/mm")}, "plate_scale", None, "arcsec/mm"),
    ({"SECPIX": "0,4"}, "plate_scale", 0.4, ""),
    ({"SECPIX": (0.4, "arcsec per pixel")}, "plate_scale", 0.4, ""),
    ({"PIXSCALE": (400, "mas/pix")}, "plate_scale", 0.4, ""),
    ({"PIXSCALE": 0.4, "XBINNING": 2}, "plate_scale", 0.4, "binning of 2"),
    ({"PIXSCALE": 0.4, "FOCALLEN": 1000, "XPIXSZ": 3.8}, "plate_scale", 0.4, "differs"),
    ({"FOCALLEN": (1.0, "[m]"), "XPIXSZ": (3.8, "[um]")}, "plate_scale", SCALE, ""),
    ({"FOCALLEN": (1000, "[mm]"), "XPIXSZ": (0.0038, "[mm]")}, "plate_scale", SCALE, ""),
    ({"FOCALLEN": "1000 furlong", "XPIXSZ": 3.8}, "plate_scale", None, "furlong"),
    ({"LINETIME": (15.0, "[us] from a row to the next")}, "line_time", 15e-6, ""),
    ({"SHUTTER": "Rolling"}, "line_time", None, "LINETIME"),
]  # fmt: skip


@pytest.mark.parametrize(("cards", "name", "value", "named"), NUMBERS, ids=lambda x: str(x)[:70])
def test_a_number_is_what_its_writer_meant_or_is_not_used(cards, name, value, named):
    assert_number(cards, name, value, named)


UNITS = [  # BUNIT, the unit that pixels are taken to have
    ("ADU", "adu"), ("adu/pixel", "adu"), ("DN", "adu"), ("counts", "adu"), ("COUNTS", "adu"), ("", "adu"),
    ("ELECTRONS", "electron"), ("e-", "electron"), ("ELECTRONS/S", "electron/s"), ("e-/s", "electron/s"),
    ("electron s-1", "electron/s"), ("COUNTS/S", "adu/s"), ("DN/s", "adu/s"), ("counts/sec", "adu/s"),
    ("adu.s-1", "adu/s"), ("none", "adu"), ("MJy/sr", "MJy/sr"), ("nJy", "nJy"), ("nanomaggy", "nanomaggy"),
    ("Counts (ADU)", "adu"), ("electrons [e-]", "electron"),
    ("electrons (per second)", "electrons (per second)"),
    ("Jy/beam", "Jy/beam"), ("mag", "mag"), ("erg/cm2/s", "erg/cm2/s"), ("e-/min", "e-/min"),
    ("10^3 electrons", "10^3 electrons"), ("W m-2", "W m-2"), ("K", "K"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "unit"), UNITS)
def test_the_unit_of_the_pixels_is_known_or_kept_by_its_name(text, unit):
    assert resolve_header(fits.Header({"BUNIT": text})).unit.value == unit


TIMES = [  # cards, time in UTC; the leap seconds are those of IERS Bulletin C
    ({"DATE-BEG": "2023-05-10T19:00:48"}, "2023-05-10T19:00:48"),
    ({"DATE-BEG": "2023-05-10T19:00:48", "DATE-OBS": "2023-05-10"}, "2023-05-10T19:00:48"),
    ({"MJD-BEG": 60074.5}, "2023-05-10T12:00:00.000"),
    ({"MJD-AVG": 60074.5}, "2023-05-10T12:00:00.000"),
    ({"DATE-OBS": "2023-05-10T19:00:48.1234567"}, "2023-05-10T19:00:48.123457"),
    ({"DATE-OBS": "2023/05/10 19:00:48"}, "2023-05-10T19:00:48"),
    ({"DATE-OBS": "2023-5-10T9:00:48"}, "2023-05-10T09:00:48"),
    ({"DATE-OBS": "2023-05-10T19:00:48 UTC"}, "2023-05-10T19:00:48"),
    ({"DATE-OBS": "2023-05-10T19:00"}, "2023-05-10T19:00:00"),
    ({"DATE-OBS": "2023-05-10T19:00:48,5"}, "2023-05-10T19:00:48.500000"),
    ({"DATE-OBS": "2023-05-10T19:00:60"}, "2023-05-10T19:01:00"),
    ({"DATE-OBS": "2016-12-31T23:59:60.5"}, "2017-01-01T00:00:00.500000"),
    ({"DATE-OBS": "2023-05-10", "TIME-OBS": "9:00:48.5"}, "2023-05-10T09:00:48.500000"),
    ({"DATE-OBS": "2023-05-10T19:01:25", "TIMESYS": "TAI"}, "2023-05-10T19:00:48"),
    ({"DATE-OBS": "2023-05-10T19:01:57.184", "TIMESYS": "TT"}, "2023-05-10T19:00:48"),
    ({"DATE-OBS": "20230510T190048"}, "2023-05-10T19:00:48"),
    ({"DATE-OBS": 20230510, "TIME-OBS": "19:00:48"}, "2023-05-10T19:00:48"),
    ({"DATE-OBS": "10/05/2023"}, None),
    ({"DATE-OBS": "2023-13-10T19:00:48"}, None),
    ({"DATE-OBS": "2023-05-10T25:00:48"}, None),
    ({"DATE-OBS": "10 May 2023"}, None),
    ({"MJD-OBS": "60074,5"}, "2023-05-10T12:00:00.000"),
]  # fmt: skip


@pytest.mark.parametrize(("cards", "time"), TIMES)
def test_a_time_is_read_or_warned_of(cards, time):
    metadata = resolve_header(header(cards))
    assert metadata.value("time") == time
    assert (time is None) == bool(metadata.warnings)
