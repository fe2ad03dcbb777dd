"""Whole files as programs of amateur cameras write them, from the file to the separation."""

from dataclasses import replace

import numpy as np
import pytest
from astropy.io import fits
from astropy.time import Time

from jitterkit.batch import FrameProcessor
from jitterkit.detectors import NORMALISED
from jitterkit.frames import read_frames

GAIN, BIAS, READ_NOISE = 0.8, 500.0, 2.0
"""Of the camera: electrons per ADU, ADU and electrons; the preset has others."""

CAMERA = [
    ("XBINNING", 1, "[pixels] Binning factor, X-axis"), ("YBINNING", 1, "[pixels] Binning factor, Y-axis"),
    ("XPIXSZ", 2.4, "[um] Pixel X axis size"), ("YPIXSZ", 2.4, "[um] Pixel Y axis size"),
    ("INSTRUME", "ZWO ASI183MM Pro", "Imaging instrument name"), ("CCD-TEMP", -9.8, "[degC] CCD temperature"),
    ("TELESCOP", "Testbed", "Name of telescope"), ("FOCALLEN", 1320.1, "[mm] Focal length"),
]  # fmt: skip

NINA = [
    ("IMAGETYP", "LIGHT", "Type of exposure"), ("EXPOSURE", 0.1, "[s] Exposure duration"),
    ("EXPTIME", 0.1, "[s] Exposure duration"),
    ("DATE-LOC", "2026-05-01T23:10:00.100", "Time of exposure (local)"),
    ("DATE-OBS", "2026-05-01T21:10:00.100", "Time of exposure (UTC)"), *CAMERA,
    ("GAIN", 111, "Sensor gain"), ("OFFSET", 10, "Sensor gain offset"),
    ("EGAIN", GAIN, "[e-/ADU] Electrons per A/D unit"), ("USBLIMIT", 40, "Camera-specific USB setting"),
    ("SET-TEMP", -10.0, "[degC] CCD temperature setpoint"), ("FOCRATIO", 10.56, "Focal ratio"),
    ("OBJCTROT", 0.0, "[deg] planned rotation"), ("ROWORDER", "TOP-DOWN", "FITS Image Orientation"),
    ("EQUINOX", 2000.0, "Equinox of celestial coordinate system"),
    ("SWCREATE", "N.I.N.A. 3.1.2.9001 (x64)", "Software that created this file"),
]  # fmt: skip

SHARPCAP = [
    ("EXTEND", True, "Extensions are permitted"), ("EXPTIME", 0.1, "Exposure Time (seconds)"), *CAMERA,
    ("FRAMETYP", "Light", "Type of frame"), ("SWCREATE", "SharpCap v4.1.12075.0, 64 bit", "Capture software"),
    ("GAIN", 200, "Camera gain setting"), ("EGAIN", GAIN, "[e-/ADU] Conversion"), ("OFFSET", 10, "Offset"),
    ("DATE-OBS", "2026-05-01T21:10:00.1000000", "System Clock:Est. Frame Start"),
    ("DATE-AVG", "2026-05-01T21:10:00.1500000", "System Clock:Est. Frame Mid Point"),
    ("JD_UTC", 2461162.3820573, "Julian Date at mid exposure"), ("ROWORDER", "TOP-DOWN", "Row order"),
]  # fmt: skip

SIRIL = [
    ("MIPS-HI", 65535, "Upper visualization cutoff"), ("MIPS-LO", 0, "Lower visualization cutoff"),
    ("ROWORDER", "BOTTOM-UP", "Order of the rows in image array"), *CAMERA,
    ("DATE", "2026-05-02T09:00:00", "UTC date that FITS file was created"),
    ("DATE-OBS", "2026-05-01T21:10:00.100", "YYYY-MM-DDThh:mm:ss observation start, UT"),
    ("EXPTIME", 0.1, "[s] Exposure time duration"), ("GAIN", 111, "Sensor gain"),
    ("CVF", GAIN, "[e-/ADU] Conversion"),
    ("PROGRAM", "Siril 1.2.1", "Software that created this HDU"),
]  # fmt: skip


@pytest.fixture
def written(telescope, drawn, tmp_path, rng):
    """A frame of a pair at 8 arcsec and 30 degrees in a file of a program."""

    def write(cards, dtype):
        electrons = rng.poisson(drawn(rng).expected) + rng.normal(0, READ_NOISE, telescope.shape)
        counts = np.rint(electrons / GAIN + BIAS)
        rows = counts[::-1] if ("ROWORDER", "TOP-DOWN") in [card[:2] for card in cards] else counts
        pixels = rows / 65535 if dtype is np.float32 else rows
        fits.writeto(tmp_path / "light.fits", pixels.astype(dtype), fits.Header(cards))
        (raw,) = read_frames(tmp_path / "light.fits")
        other = {"bias": BIAS, "read_noise": READ_NOISE}
        return FrameProcessor(replace(telescope, plate_scale=0.4), other, locus="mvn").process(raw)

    return write


@pytest.mark.parametrize("cards", [NINA, SHARPCAP, SIRIL], ids=["nina", "sharpcap", "siril"])
def test_a_light_frame_has_the_camera_s_gain_the_pixels_scale_and_rows_as_they_are(written, cards):
    processed = written(cards, np.uint16)
    result, metadata = processed.result, processed.frame.metadata
    assert result.status.usable, result.message
    assert "misfit" not in result.flags
    assert metadata.gain.value == GAIN
    assert metadata.exposure.value == 0.1
    assert Time(metadata.time.value) == Time("2026-05-01T21:10:00.100")  # its begin
    for name, value in (("separation", 8.0), ("theta", 30.0), ("flux", 1.2e5)):
        assert abs(result.of_scene(name) - value) < 4 * result.error(name), name


def test_floats_that_siril_normalised_are_said_and_end_in_no_number(written):
    processed = written(SIRIL, np.float32)
    assert not processed.result.status.usable
    assert NORMALISED in processed.frame.flags
