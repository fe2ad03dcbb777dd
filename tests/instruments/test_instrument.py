"""Instruments as records: presets, optics, and whose word counts."""

import itertools
import pickle
import subprocess
import sys

import numpy as np
import pytest
from refusals import refused

import jitterkit.optics
from jitterkit.detectors import Detector
from jitterkit.errors import ErrorCode
from jitterkit.frames import RawFrame, read_frames, write_fits, write_tiff
from jitterkit.instruments import PRESETS, Instrument, load_instrument, resolve
from jitterkit.instruments.description import describe_detector, describe_instrument
from jitterkit.optics import flat_band, obstructed_circle

BAND = flat_band(530.0, 640.0, 3)


def plain(**changes):
    fields = {
        "name": "plain",
        "plate_scale": 0.375,
        "shape": (32, 24),
        "spectrum": BAND,
        "pupil_from": obstructed_circle(0.125, noll=(4, 5), samples=64),
    }
    return Instrument(**{**fields, **changes})


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_says_where_each_number_comes_from(name):
    instrument = load_instrument(name)
    raw = resolve(RawFrame.from_array(np.zeros((4, 4))), instrument)
    assert instrument.name == name
    for known in (*raw.metadata.known().values(),):
        assert known.source.startswith((f"preset {name}", "preset imx183 ("))
    assert instrument.source("flux").startswith(f"preset {name}")


def test_the_preset_of_toliman_has_the_true_photons_and_the_papers_are_one_name_away():
    true, paper = load_instrument("toliman"), load_instrument("toliman-paper")
    assert (true.flux, paper.flux) == (9.53e6, 3.811e7)
    assert paper.flux / true.flux == pytest.approx(458.7 / 114.67, rel=1e-3)  # the ratio of the areas
    assert np.all(np.isinf([paper.detector.full_well or np.inf, paper.detector.bits or np.inf]))
    assert (len(true.pupil.names), len(paper.pupil.names)) == (19, 7)
    np.testing.assert_array_equal(true.pupil.basis[:7], paper.pupil.basis)


def test_the_well_of_the_preset_fills_before_its_converter_ends():
    detector = load_instrument("toliman").detector
    reading = detector.expose(np.full((200, 200), 1e6), np.random.default_rng(0))
    assert reading.max() < 4095


def test_presets_travel_to_another_process():
    for name in PRESETS:
        assert pickle.loads(pickle.dumps(load_instrument(name))).name == name


def test_a_pupil_is_made_once_and_only_when_asked_for():
    made = []

    def make():
        made.append(1)
        return obstructed_circle(0.125, noll=(4,), samples=32)

    instrument = plain(pupil_from=make)
    assert not made
    assert instrument.aberrations == ("noll4",)
    assert instrument.pupil is instrument.pupil
    assert made == [1]


def test_optics_sum_to_the_light_on_the_padded_grid_and_take_a_frames_own_shape_and_scale():
    otf = plain().system(pad=8, shape=(20, 16), plate_scale=0.4).otf([0.0, 0.0])
    assert otf.grid.shape == (20, 16)
    assert otf.grid.plate_scale == 0.4
    assert otf.names == ("noll4", "noll5", "wavelength_shift")
    assert 0.8 < float(otf.value[0, 0].real) < 1.0
    assert plain().optics(pad=8, derivatives=False).names == ()


def test_aberrations_move_the_optics_to_their_state():
    otf = plain().optics([20.0, 0.0], pad=8)
    assert np.asarray(otf.state).tolist() == [20.0, 0.0, 0.0]  # the last is the wavelength's shift
    assert not np.allclose(otf.value, plain().optics(pad=8).value, atol=1e-3)


def test_a_star_image_stands_for_the_pupil():
    x, y = np.meshgrid(np.arange(15) - 7, np.arange(15) - 7)
    star = np.exp(-(x**2 + y**2) / 4.0)
    instrument = plain(pupil_from=None, spectrum=None, psf_from=lambda: star)
    otf = instrument.optics(pad=8)
    assert otf.pixel_included
    assert instrument.aberrations == ()
    with refused(ErrorCode.CONFLICT, "'plain'", "aberrations"):
        instrument.optics([1.0])


@pytest.mark.parametrize(
    ("changes", "code", "values"),
    [
        ({"plate_scale": -0.1}, ErrorCode.OUT_OF_RANGE, ("plate_scale = -0.1", "arcsec/pixel")),
        ({"plate_scale_err": 0.375}, ErrorCode.OUT_OF_RANGE, ("plate_scale_err = 0.375", "relative")),
        ({"shape": (0, 5)}, ErrorCode.WRONG_SHAPE, ("shape = [0, 5]",)),
        ({"shape": (5,)}, ErrorCode.WRONG_SHAPE, ("shape = [5]",)),
        ({"exposure": float("inf")}, ErrorCode.OUT_OF_RANGE, ("exposure = inf",)),
        ({"flux": 0.0}, ErrorCode.OUT_OF_RANGE, ("flux = 0",)),
        ({"aberration_sigma": 0.0}, ErrorCode.OUT_OF_RANGE, ("aberration_sigma = 0", "nm")),
        ({"spectrum": None}, ErrorCode.MISSING_VALUE, ("'plain'", "spectrum")),
        ({"pupil_from": None}, ErrorCode.MISSING_VALUE, ("'plain'", "pupil", "PSF")),
        ({"psf_from": np.ones((3, 3))}, ErrorCode.CONFLICT, ("'plain'", "pupil", "PSF")),
    ],
)
def test_an_instrument_that_cannot_be_is_refused(changes, code, values):
    with refused(code, *values):
        plain(**changes)


def test_an_unknown_instrument_names_the_nearest():
    with refused(ErrorCode.UNKNOWN_NAME, "'tolliman'", "'toliman'", *PRESETS):
        load_instrument("tolliman")


LADDER = ("command line", "sidecar x.toml", "instrument file i.toml", "header EGAIN (HDU 0)", "preset p")


# an instrument is a file or a preset, never both
PAIRS = [pair for pair in itertools.combinations(LADDER, 2) if pair != LADDER[2:5:2]]


@pytest.mark.parametrize("pair", PAIRS)
def test_of_two_sources_the_more_authoritative_one_is_heard(pair):
    raw, instrument, overrides = RawFrame.from_array(np.zeros((2, 2))), plain(), None
    for source, gain in zip(reversed(pair), (3.0, 2.0), strict=True):
        if source == "command line":
            overrides = {"gain": gain}
        elif source in LADDER[2::2]:
            instrument = plain(detector=Detector(gain=gain, sources={"gain": source}))
        else:
            raw = RawFrame(raw.data, metadata=raw.metadata.apply(source, gain=gain))
    known = resolve(raw, instrument, overrides).metadata.gain
    assert (known.value, known.source) == (2.0, pair[0])


def test_an_instrument_that_knows_no_gain_leaves_the_frames_own():
    raw = RawFrame.from_array(np.zeros((2, 2)), source="header EGAIN (HDU 0)", gain=1.5)
    assert resolve(raw, plain()).metadata.value("gain") == 1.5


def test_an_instrument_file_that_contradicts_a_header_is_a_warning(tmp_path):
    cards = {"PIXSCALE": 0.30, "EXPTIME": 2.0, "EGAIN": 1.0}
    (raw,) = read_frames(write_fits(tmp_path / "a.fits", np.ones((4, 4)), header=cards))
    table = (
        "[instrument]\nplate_scale = {}\nexposure = {}\n"
        "[telescope]\ndiameter = 0.1\n[spectrum]\nlines = [600]\n"
    )
    warnings = {}
    for name, scale, exposure in (("same", 0.301, 1.9), ("other", 0.31, 1.0)):
        (tmp_path / f"{name}.toml").write_text(table.format(scale, exposure))
        warnings[name] = resolve(raw, load_instrument(tmp_path / f"{name}.toml")).metadata.warnings
    assert warnings["same"] == ()
    scale, exposure = warnings["other"]
    assert "PIXSCALE (HDU 0) = 0.3 " in scale
    assert "0.31 arcsec/pixel" in scale
    assert "EXPTIME (HDU 0) = 2 " in exposure
    assert "1 s" in exposure


def test_the_scale_and_exposure_of_a_frame_outrank_a_presets():
    preset = plain(exposure=0.1, sources=dict.fromkeys(("plate_scale", "exposure"), "preset p"))
    raw = RawFrame.from_array(np.zeros((2, 2)), source="header WCS (HDU 0)", plate_scale=0.5)
    metadata = resolve(raw, preset).metadata
    assert (metadata.value("plate_scale"), metadata.value("exposure")) == (0.5, 0.1)


@pytest.mark.parametrize(
    ("own", "overrides", "stated"),
    [
        ({}, {}, 1e-5),  # the instrument's scale and its error
        ({"plate_scale": 0.375}, {}, 1e-5),  # the header has the same scale
        ({"plate_scale": 0.375 * (1 + 0.9e-5)}, {}, 1e-5),
        ({"plate_scale": 0.375 * (1 + 1.1e-5)}, {}, None),  # another scale, of which nobody states an error
        ({"plate_scale": 0.376, "plate_scale_err": 1e-3}, {}, 1e-3),  # one of its own
        ({"plate_scale_err": 1e-3}, {}, 1e-3),
        ({"plate_scale_err": 1e-3}, {"plate_scale": 0.38}, None),
        ({"plate_scale": 0.376, "plate_scale_err": 1e-3}, {"plate_scale": 0.375}, None),
        ({"plate_scale": 0.376}, {"plate_scale": 0.38, "plate_scale_err": 1e-4}, 1e-4),
    ],
)
def test_an_error_is_stated_of_one_plate_scale_and_holds_for_no_other(own, overrides, stated):
    said = {"plate_scale": "preset p", "plate_scale_err": "instrument file p.toml"}
    instrument = plain(plate_scale_err=1e-5, sources=said)
    raw = RawFrame.from_array(np.zeros((2, 2)), source="header X (HDU 0)", **own)
    metadata = resolve(raw, instrument, overrides).metadata
    assert metadata.value("plate_scale_err") == stated
    assert bool(metadata.warnings) == (stated is None)
    assert resolve(RawFrame.from_array(np.zeros((2, 2))), plain()).metadata.plate_scale_err is None


def test_a_frame_and_an_instrument_made_by_hand_agree_that_the_frame_knows_itself_best():
    raw = RawFrame.from_array(np.zeros((2, 2)), exposure=3.0)
    assert resolve(raw, plain(exposure=0.1)).metadata.value("exposure") == 3.0


def test_a_corrected_gain_moves_the_level_of_a_full_well():
    instrument = load_instrument("toliman")
    once = resolve(RawFrame.from_array(np.zeros((2, 2))), instrument)
    twice = resolve(once, instrument, {"gain": 7.4})
    signal = [raw.metadata.value("saturation") - 30.0 for raw in (once, twice)]
    assert signal[1] == pytest.approx(signal[0] / 2, rel=1e-3)  # the margin of 5 sigma differs a little


def test_an_override_that_does_not_exist_is_refused():
    with refused(ErrorCode.UNKNOWN_NAME, "'gane'", "gain"):
        resolve(RawFrame.from_array(np.zeros((2, 2))), plain(), {"gane": 1.0})


def test_a_given_saturation_level_replaces_the_wells():
    raw = RawFrame.from_array(np.array([[4090.0]]))
    instrument = load_instrument("toliman")
    assert instrument.detector.calibrate(resolve(raw, instrument)).saturated == 1
    assert instrument.detector.calibrate(resolve(raw, instrument, {"saturation": 4095.0})).saturated == 0


def test_reading_an_instrument_and_resolving_a_frame_load_no_jax():
    code = (
        "import sys\n"
        "from jitterkit.instruments import load_instrument, resolve\n"
        "from jitterkit.frames import RawFrame\n"
        "resolve(RawFrame.from_array([[1.0]]), load_instrument('toliman'))\n"
        "sys.exit('jax' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_every_name_of_the_optics_is_found():
    code = "import jitterkit.optics as it, sys; sys.exit(not set(it.__all__) <= set(dir(it)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    assert all(hasattr(jitterkit.optics, name) for name in jitterkit.optics.__all__)
    with pytest.raises(AttributeError, match="no attribute 'lense'"):
        _ = jitterkit.optics.lense


def test_the_time_between_rows_is_of_the_file_s_rows_and_turns_with_them(tmp_path):
    # a TIFF's first stored row is its top one: in memory, upwards, its rows are exposed in the other order
    image = np.arange(12, dtype=np.uint16).reshape(3, 4)
    camera = load_instrument("toliman-camera")
    line_time = camera.detector.line_time
    assert line_time > 0
    for path, wanted in (
        (write_tiff(tmp_path / "a.tif", image), -line_time),
        (write_fits(tmp_path / "a.fits", image), line_time),
    ):
        (raw,) = read_frames(path)
        known = resolve(raw, camera).metadata.line_time
        assert known.value == wanted, path
        assert known.source.startswith("preset imx183 (")
        assert camera.detector.calibrate(raw).metadata.value("line_time") == wanted
    (raw,) = read_frames(write_tiff(tmp_path / "b.tif", image, metadata={"line_time": 4e-6}))
    assert resolve(raw, camera).metadata.value("line_time") == -4e-6
    assert resolve(raw, load_instrument("toliman")).metadata.value("line_time") == -4e-6


def test_an_instrument_is_described_with_who_says_each_number():
    rows = {row[0]: row[1:] for row in describe_instrument(load_instrument("toliman-camera"))}
    assert rows["plate_scale"] == ("0.375", "arcsec/pixel", "preset toliman-camera")
    assert rows["shape"][0] == "128 x 128"
    assert rows["full_well"][2].startswith("preset imx183 (EMVA 1288")
    assert rows["flat"] == ("not modelled", "shares of the mean response", "")
    bad = np.eye(4, 5, dtype=bool)
    maps = Detector(bias=np.full((4, 5), 31.5), bad_pixels=bad, nonlinearity=[-1e-6, 2e-11], full_well=1e4)
    rows = {row[0]: row[1:] for row in describe_detector(maps)}
    assert rows["bias"] == ("map 5 x 4, median 31.5", "ADU", "argument Detector")
    assert rows["bad_pixels"][0] == "map 5 x 4, 4 bad"
    assert rows["nonlinearity"][0] == "-1e-06, 2e-11"
