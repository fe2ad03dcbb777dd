"""What headers say and what is meant."""

import math

import pytest
from astropy.io import fits

from jitterkit.frames import resolve_header


def header(**cards):
    made = fits.Header()
    for key, value in cards.items():
        made[key.replace("_", "-")] = value
    return made


def named(warnings, *values):
    """Tell whether one of the warnings names all of the values."""
    return any(all(value in text for value in values) for text in warnings)


@pytest.mark.parametrize(
    ("cards", "name", "value", "source"),
    [
        ({"EXPTIME": 2}, "exposure", 2, "header EXPTIME (HDU 0)"),
        ({"EXPOSURE": 3.5}, "exposure", 3.5, "header EXPOSURE (HDU 0)"),
        ({"EXPOSURE": 3.5, "EXPTIME": 2}, "exposure", 2, "header EXPTIME (HDU 0)"),
        ({"EXPTIME": " 120.4 "}, "exposure", 120.4, "header EXPTIME (HDU 0)"),
        ({"EXPTIME": "1.5D1 s"}, "exposure", 15, "header EXPTIME (HDU 0)"),
        ({"EXPTIME": "250 ms"}, "exposure", 0.25, "header EXPTIME (HDU 0)"),
        ({"EXPTIME": (250, "[ms] exposure")}, "exposure", 0.25, "header EXPTIME (HDU 0)"),
        ({"EXPOSURE": (40, "in milliseconds")}, "exposure", 0.04, "header EXPOSURE (HDU 0)"),
        ({"EXPTIME": -1, "EXPOSURE": 4}, "exposure", 4, "header EXPOSURE (HDU 0)"),
        ({"GAIN": (1.9, "e-/ADU")}, "gain", 1.9, "header GAIN (HDU 0)"),
        ({"GAIN": 1.9, "OBSERVAT": "SAAO"}, "gain", 1.9, "header GAIN (HDU 0)"),
        ({"GAIN": 1.9, "RDNOISE": 5}, "gain", 1.9, "header GAIN (HDU 0)"),
        ({"GAIN": 1.9, "EPERADU": 2.1}, "gain", 2.1, "header EPERADU (HDU 0)"),
        ({"GAIN": 100, "EPERADU": 2.1, "EGAIN": 0.25}, "gain", 0.25, "header EGAIN (HDU 0)"),
        ({"EGAIN": 0, "EPERADU": 2.1}, "gain", 2.1, "header EPERADU (HDU 0)"),
        ({"GAIN": (120, "e-/ADU")}, "gain", 120, "header GAIN (HDU 0)"),
        ({"GAIN": (0.2, "Nominal Photo-electrons per ADU.")}, "gain", 0.2, "header GAIN (HDU 0)"),
        ({"RDNOISE": 5}, "read_noise", 5, "header RDNOISE (HDU 0)"),
        ({"READNOIS": "2.4 e-"}, "read_noise", 2.4, "header READNOIS (HDU 0)"),
        ({"RDNOISE": (2, "[ADU] rms"), "EGAIN": 3}, "read_noise", 6,
         "header RDNOISE (HDU 0) in ADU times header EGAIN (HDU 0)"),
        ({"SATURATE": 4095, "DATAMAX": 60000}, "saturation", 4095, "header SATURATE (HDU 0)"),
        ({"MAXLIN": 50000}, "saturation", 50000, "header MAXLIN (HDU 0)"),
        ({"PIXSCALE": 0.375}, "plate_scale", 0.375, "header PIXSCALE (HDU 0)"),
        ({"SECPIX": 2.0, "SCALE": 0.4}, "plate_scale", 0.4, "header SCALE (HDU 0)"),
        ({"PIXSCALE": (375, "[mas/pixel]")}, "plate_scale", 0.375, "header PIXSCALE (HDU 0)"),
        ({"BUNIT": "electrons"}, "unit", "electron", "header BUNIT (HDU 0)"),
        ({"BUNIT": ""}, "unit", "adu", "header BUNIT (HDU 0)"),
        ({"BIASLVL": 100}, "bias", 100, "header BIASLVL (HDU 0)"),
    ],
)  # fmt: skip
def test_aliases_precedence_and_units(cards, name, value, source):
    known = getattr(resolve_header(header(**cards)), name)
    assert (
        known.value == pytest.approx(value, rel=1e-15) if isinstance(value, float) else known.value == value
    )
    assert known.source == source


@pytest.mark.parametrize(
    ("cards", "values"),
    [
        ({"GAIN": 2, "EGAIN": 0}, ["GAIN = 2", "EGAIN"]),
        ({"GAIN": 1, "SWCREATE": "N.I.N.A. 3.1"}, ["GAIN = 1", "N.I.N.A. 3.1"]),
        ({"GAIN": 10, "CREATOR": "ZWO ASIAIR Plus"}, ["GAIN = 10", "ZWO ASIAIR Plus"]),
        ({"GAIN": 300}, ["GAIN = 300", "e-/ADU"]),
        ({"GAIN": 1.9}, ["GAIN = 1.9", "e-/ADU"]),
        ({"GAIN": 0}, ["GAIN = 0"]),
        ({"GAIN": -3}, ["GAIN = -3", "0 to 100000 e-/ADU"]),
        ({"GAIN": (0.5, "ADU/e-")}, ["GAIN = 0.5", "'ADU/e-'"]),
        ({"GAIN": "high"}, ["GAIN = 'high'"]),
        ({"GAIN": True}, ["GAIN = True"]),
    ],
)
def test_a_gain_that_is_a_camera_setting_or_nonsense_is_not_believed(cards, values):
    metadata = resolve_header(header(**cards))
    assert metadata.gain is None
    assert named(metadata.warnings, *values)


def test_an_egain_of_zero_means_unknown_without_a_word():
    metadata = resolve_header(header(EGAIN=0))
    assert metadata.gain is None
    assert metadata.warnings == ()


def test_an_observatory_in_india_is_not_taken_for_indi():
    assert resolve_header(header(GAIN=1.9, ORIGIN="IIA India")).gain.value == 1.9


@pytest.mark.parametrize(
    ("cards", "name", "values"),
    [
        ({"EXPTIME": -5}, "exposure", ["EXPTIME = -5", "0 to 1e+07 s"]),
        ({"EXPTIME": "1e400"}, "exposure", ["EXPTIME = inf"]),
        ({"EXPTIME": "n/a"}, "exposure", ["EXPTIME = 'n/a'"]),
        ({"RDNOISE": 1e9}, "read_noise", ["RDNOISE = 1e+09", "0 to 100000 e-"]),
        ({"RDNOISE": (3, "in ADU")}, "read_noise", ["RDNOISE = 3", "ADU"]),
        ({"SATURATE": 0}, "saturation", ["SATURATE = 0"]),
        ({"DATAMAX": 1037.89}, "saturation", ["DATAMAX = 1037.89"]),
        ({"PIXSCALE": 1e9}, "plate_scale", ["PIXSCALE = 1e+09", "0 to 100000 arcsec/pixel"]),
    ],
)
def test_malformed_negative_and_absurd_values_are_ignored_with_a_warning(cards, name, values):
    metadata = resolve_header(header(**cards))
    assert getattr(metadata, name) is None
    assert named(metadata.warnings, *values)


def test_a_whole_datamax_is_believed_with_a_warning():
    metadata = resolve_header(header(DATAMAX=65535))
    assert metadata.saturation.value == 65535
    assert "DATAMAX = 65535" in metadata.warnings[0]


def test_scale_follows_from_focal_length_and_pixel():
    # 2.4 um at 1320 mm: 2.4e-3/1320 rad
    metadata = resolve_header(header(FOCALLEN=1320, XPIXSZ=2.4))
    assert metadata.plate_scale.value == pytest.approx(math.degrees(2.4e-3 / 1320) * 3600, rel=1e-12)
    assert metadata.plate_scale.source == "header XPIXSZ/FOCALLEN (HDU 0)"


def test_xpixsz_includes_the_binning_and_pixsize1_does_not():
    included = resolve_header(header(FOCALLEN=1000, XPIXSZ=4.8, XBINNING=2))
    multiplied = resolve_header(header(FOCALLEN=1000, PIXSIZE1=2.4, XBINNING=2))
    assert included.plate_scale.value == pytest.approx(multiplied.plate_scale.value, rel=1e-12)
    assert named(included.warnings, "XPIXSZ = 4.8", "binning of 2")


def test_a_focal_length_of_zero_is_unknown():
    assert resolve_header(header(FOCALLEN=0, XPIXSZ=2.4)).plate_scale is None


def test_the_primary_header_answers_where_the_extension_is_silent():
    metadata = resolve_header(header(EXPTIME=1), hdu=2, inherit=header(EXPTIME=9, EGAIN=2))
    assert metadata.exposure.source == "header EXPTIME (HDU 2)"
    assert metadata.exposure.value == 1
    assert metadata.gain.source == "header EGAIN (HDU 0)"


def test_a_plain_dict_will_do():
    assert resolve_header({"EXPTIME": 1.0, "RDNOISE": None}).exposure.value == 1.0


@pytest.mark.parametrize(
    ("cards", "time"),
    [
        ({"DATE_OBS": "2016-09-09T08:12:26"}, "2016-09-09T08:12:26"),
        ({"DATE_OBS": "2016-09-09T08:12:26.5Z"}, "2016-09-09T08:12:26.500000"),
        ({"DATE_OBS": "2016-09-09T10:12:26+02:00"}, "2016-09-09T08:12:26"),
        ({"DATE_OBS": "2013-07-13"}, "2013-07-13"),
        ({"DATE_OBS": "2013-07-13", "TIME_OBS": "01:02:03"}, "2013-07-13T01:02:03"),
        ({"DATE_OBS": "2013-07-13", "TIME_OBS": "dusk", "UT": "01:02:03"}, "2013-07-13T01:02:03"),
        ({"DATE_OBS": "19/05/94"}, "1994-05-19"),
        ({"DATE_OBS": "26/07/102", "MJD_OBS": 57640.5}, "2016-09-09T12:00:00.000"),
        ({"MJD_OBS": 51544.0}, "2000-01-01T00:00:00.000"),
        ({"DATE_AVG": "2016-09-09T08:13:26"}, "2016-09-09T08:13:26"),
    ],
)
def test_the_time_is_found_in_every_spelling(cards, time):
    known = resolve_header(header(**cards)).time
    assert (known.value, known.unit) == (time, "UTC")


BEYOND_TIME = "9999-12-31T23:59:00-23:59"  # in UTC in the year 10000


@pytest.mark.parametrize(
    ("cards", "value"),
    [
        ({"DATE_OBS": "26/07/102"}, "DATE-OBS = '26/07/102'"),
        ({"DATE_OBS": ""}, "DATE-OBS = ''"),
        ({"MJD_OBS": 2457640.5}, "MJD-OBS = 2.45764e+06"),
        ({"DATE_OBS": BEYOND_TIME}, f"DATE-OBS = {BEYOND_TIME!r}"),
    ],
)
def test_a_malformed_time_is_a_warning(cards, value):
    metadata = resolve_header(header(**cards))
    assert metadata.time is None
    assert value in metadata.warnings[0]


def test_another_time_system_is_a_warning():
    assert "TIMESYS = 'TAI'" in resolve_header(header(TIMESYS="TAI", DATE_OBS="2016-09-09")).warnings[0]
