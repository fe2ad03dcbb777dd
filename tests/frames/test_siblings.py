"""Further siblings of the headers in ``test_variants``, in the same form: no row may be silent and wrong.

A row has cards, the quantity, the number that their writer meant, or None where it must not be guessed, and
what a warning names, empty where none is needed: a good file is not to be refused for its prose.
"""

import numpy as np
import pytest
from astropy.io import fits
from headers import assert_number, assert_warned, header

from jitterkit.frames import read_frames, resolve_header

DAY = "2023-05-10T19:00:48"


def time(comment="", value=2.0, **cards):
    return {"EXPTIME": (value, comment), **cards}, "exposure"


def late(**cards):
    """An exposure of 2000 ms that is written as one of 2000 s."""
    return {"EXPTIME": 2000.0, "DATE-OBS": DAY, **cards}, "exposure", 2000.0


def noise(comment):
    return {"RDNOISE": (2.0, comment), "EGAIN": 3.0}, "read_noise"


def scale(comment):
    return {"PIXSCALE": (0.4, comment)}, "plate_scale"


def gain(comment):
    return {"GAIN": (2.0, comment), "OBSERVAT": "SAAO"}, "gain"


def level(comment="", value=15000.0, **cards):
    return {"SATURATE": (value, comment), "EGAIN": 3.0, **cards}, "saturation"


NUMBERS = [
    # a word of prose that is a unit elsewhere
    *[(*time(comment), 2.0, "") for comment in (
        "exposure time of the day sky flat", "exposure of day 3", "time, used day calibration",
        "H band exposure", "exposure in M band", "exposure [s] of this 1 day program",
        "time at hour angle 2", "exposure time for this pixel")],
    # a unit behind another sign, or in quotes
    *[(*time(comment, 2000.0), 2.0, "") for comment in (
        "exposure - ms", "exposure: ms", "exposure time; ms", "exposure time in 'ms'",
        "exposure time = 2000 ms", "[ms]")],
    (*noise("Readnoise - ADU"), 6.0, ""), (*noise("LSB"), 6.0, ""),
    *[(*noise(comment), 2.0, "") for comment in (
        "[rms electrons]", "[e- (rms)]", "e-/frame")],
    (*level("linearity limit; e-"), 5000.0, ""), (*scale("[''/pix]"), 0.4, ""),
    # a multiple, a part, another quantity
    *[(*time(comment), None, named) for comment, named in (
        ("exposure s*1e-3", "*1e-3"), ("time in units of frame time", "units of"),
        ("in TDI lines", "TDI lines"), ("in samples", "samples"), ("in units of readouts", "readouts"))],
    *[(*scale(comment), None, named) for comment, named in (
        ("km/pixel", "km/pixel"), ("in m/pix", "m/pix"), ("lambda/D per pixel", "lambda"),
        ("nm/px", "nm/px"))],
    *[(*level(comment), None, "mag") for comment in ("magnitude of saturation", "mag")],
    # a gain whose units stand in brackets of their own, and one that is none
    *[(*gain(comment), 2.0, "") for comment in (
        "(e-)/ADU", "[e-]/[ADU]", "e^-/ADU", "[e/cnt]", "e-/ADU, low gain mode")],
    *[(*gain(comment), None, named) for comment, named in (
        ("cnt/e-", "cnt/e-"), ("(ADU)/(e-)", "ADU"), ("analog gain", "analog"),
        ("digital gain", "digital gain"), ("ratio to unity gain", "ratio"), ("relative to low gain", "rel"))],
    # an exposure that something else in the header says to be shorter
    *[(*late(**{key: value}), key) for key, value in (
        ("DATE", "2023-05-10T19:00:52"), ("DATE-END", "2023-05-10T19:00:50"), ("MJD-END", 60074.79224537),
        ("DATE-AVG", "2023-05-10T19:00:49"), ("UTEND", "19:00:50"), ("DARKTIME", 2.1), ("ELAPTIME", 2.0))],
    *[(*late(**{key: value}), "") for key, value in (
        ("DATE", DAY), ("DATE", "2023-05-10T19:00:49"), ("DATE", "2023-05-10"), ("DATE", "2023-05-10T16:01"),
        ("DATE", "2023-05-10T19:34:10"), ("DATE-AVG", DAY), ("UTEND", "19:34:08"), ("DARKTIME", 2001.0),
        ("DARKTIME", 0.0))],
    # several exposures, by many keywords; and those of a sequence
    *[(*time(**{key: value}), 2.0, key) for key, value in (
        ("NEXP", 4), ("NDIT", 4), ("NUM_EXPS", 4), ("NCOMB", 4), ("COMBINED", True), ("STACKED", True),
        ("NINPUTS", 4), ("NDRIZIM", 4), ("NSUBEXPS", 4), ("NSUBS", 4), ("STACKNUM", 4), ("NUM_FRM", 270),
        ("COADD_NO", 4), ("TOTEXP", 8.0), ("EXPTOT", 8.0), ("SUBEXP", 0.5),
        ("SINGEXP", 0.5))],
    *[(*time(**{key: value}), 2.0, "") for key, value in (
        ("NEXP", 1), ("NEXP", (9, "exposures in the sequence")), ("HIERARCH ESO TPL NEXP", 9), ("NAXIS", 4),
        ("NIMAGES", (8, "number of image extensions")), ("COMBINED", False), ("TOTEXP", 2.0),
        ("SUBFRAME", 4), ("IMAGEID", 4), ("SUBEXP", 2.0))],
    # numbers in keywords that are not read
    *[({key: value}, name, None, "is not read") for key, value, name in (
        ("TEXPTIME", 10.0, "exposure"), ("EXPOSED", 10.0, "exposure"), ("FRAMETIM", 10.0, "exposure"),
        ("HIERARCH ExposureTime", 10.0, "exposure"), ("RON1", 4.0, "read_noise"), ("RONA", 4.0, "read_noise"),
        ("HIERARCH ESO DET CHIP1 RON", 4.0, "read_noise"), ("HIERARCH ESO QC DET OUT1 CONAD", 2.0, "gain"),
        ("E_PER_DN", 2.0, "gain"), ("DETGAIN", 2.0, "gain"), ("SATLVL", 4e4, "saturation"),
        ("SKYSCALE", 0.4, "plate_scale"), ("HIERARCH ESO INS PIXSCALE", 0.4, "plate_scale"),
        ("ARCSECPX", 0.4, "plate_scale"))],
    *[({"EXPTIME": 2.0, key: value}, "exposure", 2.0, "") for key, value in (
        ("SCA", 7), ("SCANRATE", 2.0), ("EXPID", 7), ("SATELLIT", 1), ("GAINMODE", 2))],
    # a lower limit of the range
    (*level(SATLEVEL=9000.0), 15000.0, "SATLEVEL = 9000"), (*level(MAXLIN=9000.0), 15000.0, "MAXLIN = 9000"),
    (*level(SATLEVEL=15000.0), 15000.0, ""), (*level(DATAMAX=9000.0), 15000.0, ""),
]  # fmt: skip


@pytest.mark.parametrize(("cards", "name", "value", "named"), NUMBERS, ids=lambda x: str(x)[:70])
def test_a_number_is_what_its_writer_meant_or_is_not_used(cards, name, value, named):
    assert named or value is not None
    assert_number(cards, name, value, named)


@pytest.mark.parametrize("text", ["cnts", "Raw ADU", "DU", "Data Units", "electron^1", "LSB"])
def test_spellings_of_counts_are_read(text):
    unit = "electron" if text.startswith("electron") else "adu"
    metadata = resolve_header(header({"BUNIT": text}))
    assert metadata.unit.value == unit
    assert_warned(metadata.warnings, "")


@pytest.mark.parametrize(
    ("unit", "used"), [("adu*adu", True), ("adu adu", True), ("adu.adu", True), ("adu*s", False)]
)
def test_a_variance_in_a_product_of_units_is_used(tmp_path, unit, used):
    image = fits.ImageHDU(np.full((4, 5), 9.0), fits.Header({"BUNIT": "adu"}), name="SCI")
    variance = fits.ImageHDU(np.full((4, 5), 9.0), fits.Header({"BUNIT": unit}), name="VAR")
    fits.HDUList([fits.PrimaryHDU(), image, variance]).writeto(tmp_path / "a.fits")
    (frame,) = read_frames(tmp_path / "a.fits")
    assert (frame.variance is not None) == used
    assert_warned(frame.metadata.warnings, "" if used else unit)
