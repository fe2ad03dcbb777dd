"""What is written is read back as it was measured, whole or not at all."""

import re
import tomllib

import numpy as np
import pytest
from refusals import refused

from jitterkit.calibration import calibrate, together, write_calibration
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import RawFrame
from jitterkit.instruments import load_instrument


@pytest.fixture
def measured(a_camera):
    camera = a_camera(hot=5, dead=4, bend=-4e-6)
    flats = [camera.flats(8, s, drift=0.0005) for s in (0.1, 0.3, 0.6, 1.0)]
    return camera, calibrate(camera.biases(20), [camera.darks(10, 20.0)], flats)


def test_the_instrument_file_gives_back_what_was_measured(measured, tmp_path):
    _, found = measured
    write_calibration(found, tmp_path, "smallsat")
    instrument = load_instrument(tmp_path / "detector.toml")
    detector = instrument.detector
    assert (instrument.name, instrument.plate_scale) == ("smallsat", 0.375)
    assert detector.gain == pytest.approx(found.gain, rel=1e-6)
    assert detector.bias == pytest.approx(found.bias.values, abs=1e-4)
    assert detector.read_noise == pytest.approx(found.read_noise.number, rel=1e-6)  # its map is worse
    assert detector.flat == pytest.approx(found.flat.values, abs=1e-6)
    assert detector.dark_current == pytest.approx(np.maximum(found.dark_current.values, 0), abs=1e-5)
    assert (detector.bad_pixels == (found.bad != 0)).all()
    assert detector.nonlinearity == pytest.approx(found.transfer.linearity.in_electrons(found.gain)[0])
    assert detector.source("gain") == "instrument file detector.toml [detector] gain"
    assert detector.map_orders == ()  # they say that they are on the rows of frames as these are read


def test_a_frame_calibrated_by_the_file_is_the_light_that_fell(measured, tmp_path):
    camera, found = measured
    write_calibration(found, tmp_path, "smallsat")
    detector = load_instrument(tmp_path / "detector.toml").detector
    light = 6000.0 * np.linspace(0.5, 1.5, camera.size)
    readings = camera.read(light * camera.response + camera.dark * 20.0)
    frame = detector.calibrate(RawFrame.from_array(readings, exposure=20.0))
    good = ~frame.mask
    assert good.mean() > 0.99
    pulls = ((frame.electrons - light) / np.sqrt(frame.variance))[good]
    # of 16,384 pixels; the gain is known to 0.3 % (0.2 sigma of 6000 e-), the flat to 0.3 % a pixel
    assert abs(pulls.mean()) < 4 * 6000 * found.gain_error / found.gain / 77
    assert pulls.std() == pytest.approx(1, abs=0.06)


def test_an_instrument_file_is_copied_with_the_files_it_names(measured, tmp_path):
    _, found = measured
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab" / "star.fits").touch()
    (tmp_path / "lab" / "bed.toml").write_text(
        '[instrument]\nplate_scale = 0.4\nshape = [64, 64]\n[psf]\nfile = "star.fits"\n'
        "[detector]\nbits = 16\ngain = 1.0\nfull_well = 16000\n"
    )
    out = tmp_path / "out"
    out.mkdir()
    write_calibration(found, out, str(tmp_path / "lab" / "bed.toml"), full_well=16000.0)
    written = tomllib.loads((out / "detector.toml").read_text())
    assert written["instrument"] == {"plate_scale": 0.4, "shape": [64, 64], "name": "bed"}
    assert written["psf"]["file"] == str(tmp_path / "lab" / "star.fits")
    detector = load_instrument(out / "detector.toml").detector
    assert (detector.bits, detector.full_well) == (16, 16000)
    assert detector.gain == pytest.approx(found.gain, rel=1e-6)


def test_only_what_was_measured_is_written(camera, tmp_path):
    write_calibration(calibrate(camera.biases(10), gain=3.7), tmp_path, "smallsat", gain=3.7)
    assert {path.name for path in tmp_path.iterdir()} == {
        "bias.fits",
        "read_noise.fits",
        "bad_pixels.fits",
        "detector.toml",
    }
    written = tomllib.loads((tmp_path / "detector.toml").read_text())["detector"]
    assert set(written) == {"bias", "read_noise", "bad_pixels"}  # the gain was not measured


def test_all_files_appear_or_none(tmp_path):
    class Broken(Exception):
        pass

    def fail(directory):
        with together(directory) as inside:
            (inside / "a").touch()
            raise Broken

    with pytest.raises(Broken):
        fail(tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []
    with together(tmp_path / "out") as inside:
        (inside / "a").touch()
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["a"]
    file = tmp_path / "out" / "a"
    with refused(ErrorCode.NOT_WRITABLE, file, error=FrameError), together(file):
        pass


def test_a_flat_that_is_noisier_than_the_pixels_differ_is_not_named(a_camera, tmp_path):
    camera = a_camera(prnu=0.003)
    found = calibrate(camera.biases(10), (), [camera.flats(3, 0.1), camera.flats(3, 0.2)])
    write_calibration(found, tmp_path, "smallsat")
    assert (tmp_path / "flat.fits").exists()
    assert "flat" not in tomllib.loads((tmp_path / "detector.toml").read_text())["detector"]
    assert not found.flat.serves
    frames, *_, enough = (int(n) for n in re.findall(r"\b(\d+)\b(?!\.)", found.flat.sentence()))
    assert frames == 6 < enough
