"""The truth in a header: legal, complete, and no hindrance to reading the frame."""

import tomllib

import numpy as np
import pytest
from astropy.io import fits

from jitterkit.detectors import Detector
from jitterkit.frames import open_frames, write_fits, write_tiff
from jitterkit.instruments import Instrument
from jitterkit.loci import LOCI, Linear, Mvn
from jitterkit.optics import flat_band, obstructed_circle
from jitterkit.scene import Binary
from jitterkit.simulate import fits_header, simulate_frame, simulate_sequence, tiff_metadata
from jitterkit.simulate.cards import truth_cards

# A telescope of its own: the cards must name aberrations whose numbers do not follow each other (4 and 10),
# and one wavelength and few pixels are enough, as no frame is fitted.
CAMERA = Instrument(
    "plain",
    0.375,
    (24, 20),
    Detector(gain=2.0, read_noise=3.0, bias=50.0, full_well=5000.0, bits=12),
    flat_band(530.0, 640.0, 1),
    obstructed_circle(0.125, noll=(4, 10), samples=48),
    exposure=0.5,
)
SCENE = Binary(separation=2.5, theta=200.0, x=0.1, y=-0.2, flux=3e4, contrast=3.37)


def one(locus=None):
    return simulate_frame(
        CAMERA, SCENE, locus or Linear.of(0.6, 35.0), aberrations=[3.0, -4.0], background=2.0, pad=8
    )


def three():
    shifts = np.array([0.0, 0.1, 0.2])
    return list(simulate_sequence(CAMERA, SCENE, Mvn.of(0.2, 0.1, 80.0), 3, x=shifts, pad=8))


def test_the_cards_say_what_went_in():
    cards = {key: value for key, (value, _) in truth_cards(one(), seed=17).items()}
    scene = {"TRUSEP": 2.5, "TRUTHETA": 200.0, "TRUX": 0.1, "TRUY": -0.2, "TRUFLUX": 3e4, "TRUCONT": 3.37}
    jitter = {"TRULEN": 0.6, "TRUANG": 35.0}
    rest = {"TRUN4": 3.0, "TRUN10": -4.0, "TRUBKG": 2.0, "TRUSEED": 17, "TRULOCUS": "linear"}
    for key, value in {**scene, **jitter, **rest}.items():
        assert cards[key] == (value if isinstance(value, str) else pytest.approx(value))
    # a uniform line of length L at 35 degrees: L²/12 along it; trace and axis by hand
    assert cards["TRUSXX"] + cards["TRUSYY"] == pytest.approx(0.36 / 12)
    assert cards["TRUSXY"] == pytest.approx(0.36 / 24 * np.sin(np.radians(70.0)))
    assert "JITRSIGM" not in cards  # poppy's is a round normal's
    assert cards["JITTER_MAJOR"] == pytest.approx(600 / np.sqrt(12))


@pytest.mark.parametrize("name", LOCI)
def test_keywords_fit_into_a_fits_header_for_every_locus(name):
    locus = LOCI[name].near((0.02, 0.01, 0.03))
    cards = fits_header(one(locus), CAMERA, seed=1, time="2026-11-21T03:00:00")
    longer = {key for key in cards if len(key) > 8}
    assert longer == {"JITTER_MAJOR", "JITTER_MINOR", "JITTER_POSITION_ANGLE"}
    for key, (value, comment) in cards.items():
        text = str(fits.Card(key if key not in longer else f"HIERARCH {key}", value, comment))
        assert comment in text  # nothing is cut off at the end of the card


def test_a_fits_file_carries_truth_and_metadata_and_reads_back(tmp_path):
    simulated = one()
    header = fits_header(simulated, CAMERA, seed=3, time="2026-11-21T03:00:00")
    path = write_fits(tmp_path / "one.fits", simulated.raw.data.astype(np.uint16), header=header)
    assert fits.getheader(path)["TRUSEP"] == 2.5
    with open_frames(path) as file:
        raw = file[0]
    assert np.array_equal(raw.data, simulated.raw.data)
    for name in ("exposure", "gain", "read_noise", "bias", "saturation", "plate_scale", "unit"):
        assert raw.metadata.value(name) == pytest.approx(simulated.raw.metadata.value(name))
    assert raw.metadata.value("time") == "2026-11-21T03:00:00"
    assert raw.metadata.warnings == ()


def test_what_differs_in_a_cube_is_numbered_and_the_rest_said_once(tmp_path):
    frames = three()
    path = write_fits(tmp_path / "cube.fits", [f.raw for f in frames], header=fits_header(frames, CAMERA))
    header = fits.getheader(path)
    assert [header[f"TRUX {i}"] for i in range(3)] == [0.0, 0.1, 0.2]
    assert "TRUX" not in header
    assert header["TRUSEP"] == 2.5


def test_a_tiff_carries_the_truth_in_its_toml_and_reads_back(tmp_path):
    frames = three()
    data = np.stack([f.raw.data for f in frames]).astype(np.uint16)
    path = write_tiff(tmp_path / "three.tif", data, metadata=tiff_metadata(frames, seed=5))
    truth = tomllib.loads((tmp_path / "three.toml").read_text())["truth"]
    assert (truth["TRUX"], truth["TRUSEP"], truth["TRUSEED"]) == ([0.0, 0.1, 0.2], 2.5, 5)
    with open_frames(path) as file:
        raw = file[2]
    assert np.array_equal(raw.data, frames[2].raw.data)
    assert raw.metadata.value("gain") == 2.0


def test_electrons_carry_no_gain(tmp_path):
    simulated = simulate_frame(CAMERA, SCENE, Linear.of(0.6), detector=False, pad=8)
    header = fits_header(simulated, CAMERA)
    assert header["BUNIT"][0] == "electron"
    assert {"EGAIN", "BIASLVL", "SATURATE"}.isdisjoint(header)
    with open_frames(write_fits(tmp_path / "e.fits", simulated.raw, header=header)) as file:
        assert file[0].unit == "electron"
