"""``jitterkit calibrate``: the rows it prints, the files it leaves, and what it refuses."""

import re

import numpy as np
import pytest
import typer
from astropy.table import QTable
from typer.testing import CliRunner

from jitterkit.calibration import Settings
from jitterkit.cli.calibrate import calibrate
from jitterkit.cli.command import as_command
from jitterkit.errors import ErrorCode
from jitterkit.frames import write_fits, write_tiff
from jitterkit.instruments import load_instrument

runner = CliRunner()
app = typer.Typer()
app.command()(as_command(calibrate))


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    """Directories of bias (a TIFF stack), dark and flat frames of 128 x 128 pixels: 3.7 e-/ADU, 2.4 e-."""
    root, rng = tmp_path_factory.mktemp("frames"), np.random.default_rng(20262)
    shape = (128, 128)
    positions = rng.choice(128**2, 15, replace=False)
    dark, response = np.full(shape, 0.8), 1 + 0.006 * rng.normal(size=shape)
    dark.flat[positions[:9]], response.flat[positions[9:]] = 50.0, 0.1

    def read(light, seconds, count):
        mean = light * response * (1 + 0.004 * rng.normal(size=(count, 1, 1))) + dark * seconds
        charge = np.minimum(rng.poisson(mean), 15000)
        return np.rint(100 + (charge + rng.normal(0, 2.4, charge.shape)) / 3.7).astype(np.uint16)

    for kind in ("bias", "dark", "flat"):
        (root / kind).mkdir()
    write_tiff(root / "bias" / "biases.tif", read(0.0, 0.0, 12))
    window = {"XORGSUBF": 80, "YORGSUBF": 40}
    write_fits(root / "dark" / "darks.fits", read(0.0, 20.0, 6), header={"EXPTIME": 20.0, **window})
    for t in (0.1, 0.4, 0.9, 1.3):
        write_fits(root / "flat" / f"{t}.fits", read(14000 * t, t, 4), header={"EXPTIME": t})
    return root


def run(*arguments):
    return runner.invoke(app, ["-i", "smallsat", *map(str, arguments)])


def rows(done):
    assert done.exit_code == 0, done.output
    cells = (re.split(r" {2,}", line) for line in done.stdout.splitlines())
    return {name: " ".join(rest).split() for name, *rest in cells}


def test_the_defaults_are_the_room_s():
    defaults = {p.name: p.default for p in typer.main.get_command(app).params}
    chosen = Settings()
    for name in ("clip", "hot", "dead", "smooth"):
        assert defaults[name] == getattr(chosen, name)
    assert defaults["memory"] * 1e6 == chosen.memory


def test_everything_is_measured_and_written(frames, tmp_path):
    out = tmp_path / "out"
    done = run("--bias", frames / "bias", "--dark", frames / "dark", "--flat", frames / "flat", "-o", out)
    said = rows(done)
    for name, truth, unit in (("gain", 3.7, "e-/ADU"), ("read noise", 2.4, "e-"), ("PRNU", 0.6, "%")):
        value, _, error, written = said[name]
        assert float(value) == pytest.approx(truth, abs=4 * float(error) + 0.01 * truth)
        assert written == unit
    assert said["hot pixels"] == ["9"]
    assert said["dead pixels"] == ["6"]
    assert sorted(path.name for path in out.iterdir()) == [
        "bad_pixels.fits",
        "bias.fits",
        "calibration.png",
        "dark_current.fits",
        "detector.toml",
        "flat.fits",
        "photon_transfer.ecsv",
        "read_noise.fits",
    ]
    assert (out / "calibration.png").read_bytes().startswith(b"\x89PNG")
    table = QTable.read(out / "photon_transfer.ecsv", format="ascii.ecsv")
    assert table["saturated"].tolist() == [False] * 4 + [True]
    assert table["signal"].unit == "adu"
    assert table["exposure"].to_value("s").tolist() == [0, 0.1, 0.4, 0.9, 1.3]
    assert table.meta["gain"][2] == "e-/ADU"
    windows = load_instrument(out / "detector.toml").detector.map_windows
    assert windows["flat"] == windows["bad_pixels"] == {"XORGSUBF, YORGSUBF": (80.0, 40.0)}
    assert str(out) in done.stderr
    assert str(out) not in done.stdout


def said_of_gain(done):
    """Values of the sentence on where the gain is from: the gain, and an option or a name."""
    (sentence,) = [line for line in done.stderr.splitlines() if "e-/ADU" in line]
    return set(re.findall(r"[\d.]+ e-/ADU|--\w+|'\w+'", sentence))


def test_biases_alone_take_the_gain_of_the_instrument(frames, tmp_path):
    done = run("--bias", frames / "bias", "-o", tmp_path / "out")
    assert set(rows(done)) == {"bias", "read noise", "noisy pixels"}
    assert {"3.7 e-/ADU", "'smallsat'"} <= said_of_gain(done)
    given = run("--bias", frames / "bias", "--gain", 2, "-o", tmp_path / "other")
    assert {"2 e-/ADU", "--gain"} <= said_of_gain(given)


def test_flats_alone_stand_on_a_level(frames, tmp_path):
    done = run("--flat", frames / "flat", "--bias-level", 100, "-o", tmp_path / "out")
    value, _, error, _ = rows(done)["gain"]
    assert float(value) == pytest.approx(3.7, abs=4 * float(error))


@pytest.mark.parametrize(
    ("arguments", "code", "values"),
    [
        ([], ErrorCode.MISSING_VALUE, []),
        (["--bias", "none"], ErrorCode.NOT_FOUND, ["none"]),
        (["--bias", "FRAMES/bias", "-i", "nowhere"], ErrorCode.UNKNOWN_NAME, ["'nowhere'"]),
        (["--bias", "FRAMES/bias", "--clip", "1"], ErrorCode.OUT_OF_RANGE, ["clip = 1", "3"]),
        (["--bias", "FRAMES/bias", "--gain", "-1"], ErrorCode.OUT_OF_RANGE, ["gain", "-1"]),
        (["--bias", "FRAMES/bias", "--gain", "nan"], ErrorCode.OUT_OF_RANGE, ["gain", "nan"]),
        (["--dark", "FRAMES/bias"], ErrorCode.MISSING_VALUE, ["biases.tif", "--exposure"]),
        (["--bias", "FRAMES/bias", "--dark", "FRAMES/flat/0.4.fits", "--bias", "FRAMES/flat/0.4.fits"],
         ErrorCode.WRONG_INSTRUMENT, ["0.4.fits", " ADU", "bias"]),
    ],
)  # fmt: skip
def test_what_cannot_be_measured_is_one_sentence_and_nothing_is_written(
    arguments, code, values, frames, tmp_path, monkeypatch, check_error
):
    monkeypatch.chdir(tmp_path)
    done = run(*(a.replace("FRAMES", str(frames)) for a in arguments), "-o", "out")
    check_error(done, code, *values)
    assert len(done.stderr.splitlines()) == 1  # not where a gain is taken from: it was not
    assert not (tmp_path / "out").exists()


def test_what_is_there_is_not_replaced_unasked(frames, tmp_path, check_error):
    (tmp_path / "bias.fits").touch()
    done = run("--bias", frames / "bias", "-o", tmp_path)
    check_error(done, ErrorCode.EXISTS, tmp_path / "bias.fits", "--overwrite")
    assert run("--bias", frames / "bias", "-o", tmp_path, "--overwrite").exit_code == 0


def test_frames_that_are_no_single_exposures_are_said_to_be_so(tmp_path, rng):
    """The mean of four has a quarter of the variance, so that the gain comes out four times too large."""
    (tmp_path / "bias").mkdir()
    for k in range(4):
        mean = rng.normal(1000.0, 2.0, (4, 64, 64)).round().mean(axis=0)
        write_fits(tmp_path / "bias" / f"{k}.fits", mean.astype(np.float32), header={"NCOMBINE": 4})
    done = runner.invoke(app, ["--bias", str(tmp_path / "bias"), "-o", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert "4 of 4 bias frames: NCOMBINE = 4 exposures are combined" in done.stderr
    assert "The bias frames are not whole numbers" in done.stderr


def test_variances_off_the_line_are_said(tmp_path, rng):
    """Of flats at another gain of the camera each, the variance does not rise in proportion to the light."""
    write_fits(tmp_path / "bias.fits", (100 + rng.normal(0, 1, (4, 64, 64))).round())
    (tmp_path / "flat").mkdir()
    for light, gain in ((1000, 1), (4000, 2), (5000, 4)):
        planes = 100 + gain * rng.poisson(light, (4, 64, 64))
        write_fits(tmp_path / "flat" / f"{gain}.fits", planes, header={"EXPTIME": float(gain)})
    given = {"--bias": "bias.fits", "--flat": "flat", "-o": "out"}
    done = runner.invoke(app, [word for key, name in given.items() for word in (key, str(tmp_path / name))])
    assert done.exit_code == 0, done.output
    assert "The variances do not lie on a line" in done.stderr


def test_a_level_of_bias_that_a_preset_chooses_is_no_camera_s(frames, tmp_path, check_error):
    done = run("--flat", frames / "flat", "-o", tmp_path / "out")
    check_error(done, ErrorCode.MISSING_VALUE, "--bias-level")
    (tmp_path / "bed.toml").write_text('[instrument]\nbase = "smallsat"\n[detector]\nbias = 100.0\n')
    done = run("--flat", frames / "flat", "-i", tmp_path / "bed.toml", "-o", tmp_path / "out")
    assert rows(done)["gain"]


def test_temperatures_and_filters_that_differ_are_said(tmp_path, rng):
    for kind, light, cards in (
        ("bias", 0, {"CCD-TEMP": -10.0}),
        ("flat", 1000, {"CCD-TEMP": 12.5, "FILTER": "R"}),
        ("other", 3000, {"CCD-TEMP": 12.5, "FILTER": "V"}),
    ):
        planes = 100 + rng.poisson(light, (4, 64, 64)) + rng.normal(0, 1, (4, 64, 64)).round()
        write_fits(tmp_path / f"{kind}.fits", planes, header={"EXPTIME": light / 1000, **cards})
    given = ("--bias", "bias", "--flat", "flat", "--flat", "other")
    words = (word if word.startswith("--") else str(tmp_path / f"{word}.fits") for word in given)
    done = runner.invoke(app, [*words, "-o", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert "-10 to 12.5 degrees (CCD-TEMP)" in done.stderr
    assert "several filters (R, V)" in done.stderr


def test_darks_of_several_exposures_under_one_are_said(tmp_path, rng):
    """A dark current of 3 e-/s in 10 and 60 s at 2 e-/ADU: levels 75 ADU apart, and a noise of 7 at most."""
    for seconds, stated in ((10, 10.0), (60, 60.0)):
        for name, header in (("said", stated), ("lost", 10.0)):
            planes = (
                100 + (rng.poisson(3.0 * seconds, (4, 64, 64)) / 2).round() + rng.normal(0, 2, (4, 64, 64))
            )
            write_fits(tmp_path / f"{name}{seconds}.fits", planes.round(), header={"EXPTIME": header})
    for name, doubtful in (("said", False), ("lost", True)):
        words = [str(tmp_path / f"{name}{seconds}.fits") for seconds in (10, 60)]
        given = ["--dark", words[0], "--dark", words[1], "--bias-level", "100", "--gain", "2"]
        done = runner.invoke(app, [*given, "-o", str(tmp_path / name)])
        assert done.exit_code == 0, done.output
        assert ("levels of the dark, 10 s frames" in done.stderr) is doubtful


def test_the_gain_by_which_electrons_were_counted_is_written(frames, tmp_path):
    """Else a read noise in electrons at one gain would stand beside another gain."""
    run("--bias", frames / "bias", "--gain", 2, "-o", tmp_path / "out")
    detector = load_instrument(tmp_path / "out" / "detector.toml").detector
    assert detector.gain == 2
    assert float(np.median(detector.read_noise)) == pytest.approx(2.4 * 2 / 3.7, rel=0.05)


@pytest.mark.parametrize("kind", ["plain", "gamma", "subtracted", "cut off"])
def test_frames_that_a_program_has_changed_are_said(tmp_path, rng, kind):
    """Of a camera of 2 e-/ADU, a stretch, a bias that flats lack, and one that is cut off shift the gain."""
    level = 0.0 if kind == "cut off" else 300.0
    write_fits(tmp_path / "bias.fits", np.clip(level + rng.normal(0, 2.5, (4, 96, 96)), 0, None).round())
    (tmp_path / "flat").mkdir()
    for light in (2000, 5000, 10000, 20000, 30000):
        pixels = level + rng.poisson(light, (2, 96, 96)) / 2 + rng.normal(0, 2.5, (2, 96, 96))
        pixels = 65535 * (pixels / 65535) ** (1 / 2.2) if kind == "gamma" else pixels
        pixels = pixels - level if kind == "subtracted" else pixels
        write_fits(tmp_path / "flat" / f"{light}.fits", pixels.round(), header={"EXPTIME": light / 1e3})
    frames = ("--bias", str(tmp_path / "bias.fits"), "--flat", str(tmp_path / "flat"))
    done = runner.invoke(app, [*frames, "-o", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    said = {"gamma": "full pixels", "subtracted": "No detector does that", "cut off": "cut off at zero"}
    assert {name for name, words in said.items() if words in done.stderr} == {kind} - {"plain"}, done.stderr


def test_flats_without_the_bias_that_biases_have_are_refused(tmp_path, rng, check_error):
    write_fits(tmp_path / "bias.fits", (300 + rng.normal(0, 2.5, (4, 32, 32))).round())
    header = {"EXPTIME": 1.0, "CALSTAT": "B"}
    write_fits(tmp_path / "flat.fits", rng.poisson(2000, (2, 32, 32)) / 2.0, header=header)
    done = run("--bias", tmp_path / "bias.fits", "--flat", tmp_path / "flat.fits", "-o", tmp_path / "out")
    check_error(done, ErrorCode.WRONG_INSTRUMENT, "flat.fits", "CALSTAT = 'B'")
