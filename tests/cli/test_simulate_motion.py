"""``jitterkit simulate`` of a telescope that moves, under detectors that roll and that do not."""

import numpy as np
import pytest
from astropy.io import fits
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.cli.pointing import shaken
from jitterkit.errors import ErrorCode
from jitterkit.frames import open_frames
from jitterkit.instruments import load_instrument
from jitterkit.loci import Linear, Mvn, Product
from jitterkit.scene import Binary
from jitterkit.shutter import Drifting
from jitterkit.simulate import simulate_frame

runner = CliRunner()
ROLLING = '[instrument]\nname = "roller"\nbase = "smallsat"\n[detector]\nline_time = 2e-4\n'
SPECTRUM = "f,x,y,xy\n5,1e-4,4e-5,3e-5\n50,1e-4,4e-5,3e-5\n800,1e-6,1e-6,0\n"


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "roller.toml").write_text(ROLLING)
    (tmp_path / "motion.csv").write_text(SPECTRUM)
    t = np.arange(0, 0.2, 1e-3)
    rows = [f"{time:.3f},{2 * time},{-time}" for time in t]
    (tmp_path / "gyro.csv").write_text("\n".join(["t,x,y", *rows]))
    return tmp_path


def simulate(*arguments):
    done = runner.invoke(app, ["simulate", *arguments])
    assert "Traceback" not in done.output
    return done


def test_a_drift_smears_every_frame_and_moves_the_pair_between_them(here):
    done = simulate("a.fits", "-i", "smallsat", "--drift", "3,-4", "--frames", "3", "--x", "0.1")
    assert done.exit_code == 0, done.output
    headers = [fits.getheader(f"a-{k}.fits") for k in range(3)]
    # 5 arcsec/s for 0.1 s towards -53.13 degrees, an axis of 126.87; the middle frame stands at --x and --y
    assert [h["TRULEN"] for h in headers] == pytest.approx([0.5] * 3)
    assert [h["TRUANG"] for h in headers] == pytest.approx([180 - 53.1301] * 3, abs=1e-4)
    assert [h["TRUX"] for h in headers] == pytest.approx([-0.2, 0.1, 0.4])
    assert [h["TRUY"] for h in headers] == pytest.approx([0.4, 0.0, -0.4])
    assert "TRULINE" not in headers[0]


@pytest.mark.parametrize(("ending", "order"), [("fits", 1), ("tif", -1)])
def test_a_detector_that_rolls_exposes_the_stored_rows_one_after_the_other(here, ending, order):
    options = ["--drift", "30,-70", "--no-noise", "--no-detector", "--locus", "mvn", "--sigma", "0.1"]
    done = simulate(f"a.{ending}", "-i", "roller.toml", *options)
    assert done.exit_code == 0, done.output
    with open_frames(f"a.{ending}") as file:
        found = file[0].data
    truth = simulate_frame(
        load_instrument("smallsat"),
        Binary(10.0, 180.0, 0.0, 0.0, 1.3e5, 3.37),
        Product(Linear.of(0.1 * np.hypot(30, 70), np.degrees(np.arctan2(-70, 30))), Mvn.of(0.1)),
        shutter=Drifting(order * 2e-4, (30.0, -70.0)),
        detector=False,
    )
    assert found == pytest.approx(truth.expected, rel=1e-6, abs=1e-4)


def test_a_steady_trace_under_a_rolling_detector_is_a_drift(here):
    options = ["-i", "roller.toml", "--no-noise", "--no-detector"]
    assert simulate("drift.fits", "--drift", "2,-1", *options).exit_code == 0
    done = simulate("trace.fits", "--trace", "gyro.csv", *options)
    assert done.exit_code == 0, done.output
    drift, trace = fits.getdata("drift.fits"), fits.getdata("trace.fits")
    assert trace == pytest.approx(drift, rel=1e-5, abs=1e-3)
    header = fits.getheader("trace.fits")
    assert (header["TRULOCUS"], header["TRULINE"]) == ("trace", 2e-4)
    assert header["TRUSXX"] == pytest.approx(0.2**2 / 12, rel=1e-6)


def test_frames_in_a_spectrum_of_motion_are_pieces_of_one_record(here):
    roller = load_instrument("roller.toml")
    pointing = shaken(here / "motion.csv", roller, 3, 1, np.random.default_rng(5))
    assert all(isinstance(locus, Mvn) for locus in pointing.loci)  # what is faster than 320 Hz
    first, second = pointing.shutters[:2]
    # the record goes on where the exposure ends, in the next frame: 0.1 s later, about another mean
    apart = pointing.positions[1] - pointing.positions[0]
    late = 0.1 + np.linspace(0.0, 0.012, 50)
    for axis in (0, 1):
        seen = np.interp(late, first.times, first.positions[:, axis])
        again = np.interp(late - 0.1, second.times, second.positions[:, axis]) + apart[axis]
        assert seen == pytest.approx(again, abs=1e-9)
    still = shaken(here / "motion.csv", load_instrument("smallsat"), 3, 1, np.random.default_rng(5))
    assert still.shutters is None
    assert np.abs(pointing.positions.mean(axis=0)).max() < 1e-12


@pytest.mark.slow
def test_a_shaken_sequence_rolls(here):
    done = simulate("a.fits", "-i", "roller.toml", "--spectrum", "motion.csv", "--frames", "2")
    assert done.exit_code == 0, done.output
    header = fits.getheader("a-1.fits")
    assert (header["TRULOCUS"], header["TRULINE"]) == ("trace*mvn", 2e-4)


def test_a_rolling_detector_is_warned_of_a_locus_that_has_no_time(here):
    done = simulate("a.fits", "-i", "roller.toml", "--locus", "linear", "--length", "0.5")
    assert done.exit_code == 0
    advice = {"linear", "--drift", "--trace", "--spectrum"}
    assert any(all(value in line for value in advice) for line in done.stderr.splitlines())
    quiet = simulate("b.fits", "-i", "smallsat", "--locus", "linear", "--length", "0.5")
    assert "linear" not in quiet.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "values"),
    [
        ("--drift 3", ErrorCode.MALFORMED, ["--drift 3"]),
        ("--drift inf,0", ErrorCode.OUT_OF_RANGE, ["--drift inf,0"]),
        ("--drift 0,nan", ErrorCode.OUT_OF_RANGE, ["--drift 0,nan"]),
        ("--drift 3,4 --trace gyro.csv", ErrorCode.CONFLICT, ["--trace", "--drift"]),
        ("--drift 3,4 --spectrum motion.csv", ErrorCode.CONFLICT, ["--spectrum", "--drift"]),
        (
            "--trace gyro.csv --set start=0",
            ErrorCode.OUT_OF_RANGE,
            ["gyro.csv", "-0.0127 to 0.1127 s", "0 to 0.199 s"],
        ),
        ("--trace gyro.csv --locus shm", ErrorCode.CONFLICT, ["--trace", "--locus"]),
        ("--trace gyro.csv --kind bins", ErrorCode.CONFLICT, ["--kind", "--spectrum"]),
        ("--kind curve", ErrorCode.CONFLICT, ["--kind", "--spectrum"]),
    ],
)
def test_what_cannot_be_moved_so_is_one_sentence(here, arguments, code, values, check_error):
    check_error(simulate("a.fits", "-i", "roller.toml", *arguments.split()), code, *values)


def test_a_drift_needs_an_exposure(here, check_error):
    toml = ROLLING.replace('base = "smallsat"', "plate_scale = 0.375\nshape = [32, 32]")
    toml += "[telescope]\ndiameter = 0.125\n[spectrum]\nband = [530, 640]\n"
    (here / "roller.toml").write_text(toml)
    done = simulate("a.fits", "-i", "roller.toml", "--drift", "3,4", "--flux", "1e5")
    check_error(done, ErrorCode.MISSING_VALUE, "'roller'", "--drift")
