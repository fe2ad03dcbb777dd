"""``jitterkit motion``, and ``simulate`` shaken by a spectrum."""

import re
from pathlib import Path

import numpy as np
import pytest
import typer
from astropy.io import fits
from typer.testing import CliRunner

from jitterkit.cli.command import as_command
from jitterkit.cli.motion import motion
from jitterkit.cli.simulate import simulate
from jitterkit.errors import ErrorCode
from jitterkit.motion import Line, PowerSpectrum, split_spectrum
from jitterkit.report.table import read_table

runner = CliRunner()
app = typer.Typer()
for command in (motion, simulate):
    app.command()(as_command(command))
HST = Path(__file__).parents[2] / "sample_frames" / "motion" / "hst.csv"


def assess(*arguments):
    return runner.invoke(app, ["motion", *map(str, arguments), "-i", "smallsat"])


@pytest.fixture
def lines(tmp_path):
    path = tmp_path / "lines.csv"
    path.write_text("frequency,amplitude,angle\n61,0.4,30\n900,0.2,90\n")
    return path


def test_hst_is_a_worked_example_in_tables_on_stdout_and_talk_on_stderr(tmp_path):
    done = assess(HST, "--exposure", "0.1", "--no-loss")
    assert done.exit_code == 0, done.output
    rows = [line.split() for line in done.stdout.splitlines() if line.split()[:1] == ["line"]]
    assert {(row[1], row[5], row[6]) for row in rows} >= {
        ("0.1", "low", "linear"),
        ("4", "medium", "partial"),
        ("61", "high", "shm"),
        ("300", "high", "shm"),
    }
    assert re.search(r"\b10 Hz", done.stderr)  # the critical frequency, one over the exposure
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("61 Hz")]
    for value in ("0.020 arcsec", "high", "6.1", "shm"):
        assert value in line


@pytest.mark.slow
def test_the_cost_is_forecast_and_everything_is_kept(lines, tmp_path, check_error):
    table, picture = tmp_path / "budget.ecsv", tmp_path / "motion.png"
    done = assess(lines, "-o", table, "--plot", picture, "--cadence", "0.5")
    assert done.exit_code == 0, done.output
    assert picture.read_bytes().startswith(b"\x89PNG")
    kept = read_table(table)
    assert kept["amplitude"][:2].to_value("arcsec").tolist() == [0.4, 0.2]
    expected = split_spectrum(PowerSpectrum(lines=(Line(61, 0.4, 30), Line(900, 0.2, 90))), 0.1).jitter
    for name, value in zip(("sxx", "sxy", "syy"), expected, strict=True):
        assert kept[f"jitter_{name}"][-1].to_value("arcsec2") == pytest.approx(value, rel=1e-12)
    loss = kept.meta["loss"]
    along, across = loss["more_time"]
    assert along > across > 0  # light smeared along the pair tells least of its separation
    ratio = np.divide(loss["error_with"], loss["error_without"]) ** 2 - 1
    np.testing.assert_allclose(ratio, [along, across])
    assert "more_time" in done.stdout
    check_error(assess(lines, "-o", table), ErrorCode.EXISTS, table, "--overwrite")


@pytest.mark.slow
def test_no_motion_costs_what_free_moments_cost(tmp_path):
    path = tmp_path / "still.csv"
    path.write_text("frequency,amplitude,angle\n61,0,0\n")
    done = assess(path)
    assert done.exit_code == 0, done.output
    percents = [float(word[:-1]) for word in done.stdout.split() if word.endswith("%")]
    assert len(percents) == 2
    assert all(0 <= percent < 1 for percent in percents)


def test_without_a_flux_it_is_said_that_no_cost_is_forecast(lines, tmp_path):
    plain = tmp_path / "plain.toml"
    plain.write_text(
        '[instrument]\nname = "plain"\nplate_scale = 0.4\nshape = [32, 32]\nexposure = 0.1\n'
        "[telescope]\ndiameter = 0.1\n[spectrum]\nlines = [550]\n"
    )
    done = runner.invoke(app, ["motion", str(lines), "-i", str(plain)])
    assert done.exit_code == 0, done.output
    assert any("'plain'" in line and "flux" in line for line in done.stderr.splitlines())
    assert "more_time" not in done.stdout
    unasked = runner.invoke(app, ["motion", str(lines), "-i", str(plain), "--no-loss"])
    assert "flux" not in unasked.stderr


def test_a_trace_of_two_samples_is_assessed_and_drawn(tmp_path):
    path, picture = tmp_path / "two.csv", tmp_path / "two.png"
    path.write_text("t,x,y\n0,0,0\n1,0.3,0\n")
    done = assess(path, "--no-loss", "--plot", picture)
    assert done.exit_code == 0, done.output
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_trace_is_split_and_a_loop_takes_its_slow_part(tmp_path):
    path = tmp_path / "gyro.csv"
    t = np.linspace(0, 5, 2001)
    x = 0.3 * np.sin(2 * np.pi * t) + 0.02 * np.sin(2 * np.pi * 70 * t)
    path.write_text("t,x,y\n" + "\n".join(f"{a},{b},0" for a, b in zip(t, x, strict=True)))
    free, held = assess(path, "--no-loss"), assess(path, "--no-loss", "--bandwidth", "10")
    for done in (free, held):
        assert done.exit_code == 0, done.output
        assert "50 exposures" in done.stderr
    smear = [float(done.stdout.split()[-4]) for done in (free, held)]
    assert smear[1] < 0.2 * smear[0]
    of_loop = set(held.stderr.splitlines()) - set(free.stderr.splitlines())
    assert any("10 Hz" in line for line in of_loop)


def total(done) -> float:
    """The rms along x of the row of all sources, mas."""
    names = next(line for line in done.stdout.splitlines() if "jitter_x" in line).split()
    row = next(line for line in done.stdout.splitlines() if line.split()[:1] == ["all"]).split()
    values = zip(names[::-1], row[::-1], strict=False)
    return sum(float(value) ** 2 for name, value in values if name.endswith("_x")) ** 0.5


def test_what_the_rows_of_a_spectrum_are_is_said_and_can_be_given(tmp_path):
    """100 bins of 1e-6 arcsec²/Hz, one of them with a line of 0.01 arcsec²."""
    path = tmp_path / "psd.csv"
    density = np.full(101, 1e-6)
    density[61] += 0.01
    np.savetxt(path, np.c_[np.arange(101), density, density], delimiter=",", header="f,x,y", comments="")
    done = assess(path, "--no-loss")
    assert done.exit_code == 0, done.output
    assert total(done) == pytest.approx(1e3 * (0.01 + 1e-4) ** 0.5, rel=1e-3)
    (line,) = [row.split() for row in done.stdout.splitlines() if row.split()[:1] == ["line"]]
    assert line[1] == "61"
    for words in (["100 rows", "bins", "--kind curve"], ["0 Hz"], ["stand out", "61 Hz"]):
        assert any(all(word in said for word in words) for said in done.stderr.splitlines()), words
    curve = assess(path, "--no-loss", "--kind", "curve")
    assert any("points of a curve" in said for said in curve.stderr.splitlines())
    assert total(curve) < 0.6 * total(done)


def test_rates_in_a_unit_that_is_given_are_integrated(tmp_path, check_error):
    path, t = tmp_path / "gyro.csv", np.arange(0, 5, 0.001)
    rates = 0.1 * 2 * np.pi * 70 * np.cos(2 * np.pi * 70 * t) / 3600
    path.write_text("t,x,y\n" + "\n".join(f"{a},{b},0" for a, b in zip(t, rates, strict=True)))
    done = assess(path, "--no-loss", "--rates", "deg/s")
    assert done.exit_code == 0, done.output
    assert total(done) == pytest.approx(
        70.7, rel=0.02
    )  # straight lines of 1 ms leave out (2 pi 70 / 1000)² / 12
    assert "integrated" in done.stderr
    check_error(assess(path, "--rates", "deg"), ErrorCode.CONFLICT, path, "deg/s")


def test_exposures_with_a_gap_are_left_out_with_a_word(tmp_path):
    path, t = tmp_path / "trace.csv", np.arange(0, 5, 0.001)
    path.write_text("t,x,y\n" + "\n".join(f"{a},{a % 1},0" for a in t if not 1.05 < a < 1.95))
    done = assess(path, "--no-loss")
    assert done.exit_code == 0, done.output
    assert re.search(r"^39 exposures in the trace", done.stderr, re.MULTILINE)
    assert re.search(r"^10 more .*gaps", done.stderr, re.MULTILINE)


def test_samples_further_apart_than_half_an_exposure_are_remarked_on(tmp_path):
    """Times in ms pass for s."""
    path, t = tmp_path / "trace.csv", np.arange(0, 5000, 1.0)
    path.write_text("t,x,y\n" + "\n".join(f"{a},{a % 2},0" for a in t))
    assert any("1 s apart" in said for said in assess(path, "--no-loss").stderr.splitlines())
    path.write_text(path.read_text().replace("t,", "t [ms],", 1))
    assert not any("s apart: what" in said for said in assess(path, "--no-loss").stderr.splitlines())


def test_frames_shaken_by_a_spectrum_differ_and_know_their_truth(lines, tmp_path):
    path = tmp_path / "shaken.fits"
    arguments = [
        "simulate",
        str(path),
        "-i",
        "smallsat",
        "--spectrum",
        str(lines),
        "--frames",
        "2",
        "--seed",
        "5",
    ]
    done = runner.invoke(app, arguments)
    assert done.exit_code == 0, done.output
    headers = [fits.getheader(tmp_path / f"shaken-{k}.fits") for k in (0, 1)]
    for header in headers:
        assert header["TRULOCUS"] == "trace*shm"  # 61 Hz is drawn; 900 Hz, 90 cycles, is a blur
        # of 6.1 cycles a piece has the variance to a few percent; along y the fast line adds 0.02
        assert header["TRUSXX"] == pytest.approx(0.08 * 0.75, rel=0.1)
        assert header["TRUSYY"] == pytest.approx(0.08 * 0.25 + 0.02, rel=0.1)
    assert headers[0]["TRUSXX"] != headers[1]["TRUSXX"]
    positions = [(header["TRUX"], header["TRUY"]) for header in headers]
    np.testing.assert_allclose(np.sum(positions, axis=0), 0, atol=1e-12)  # about the mean of both
    assert 0 < np.hypot(*positions[0]) < 0.4  # and by no more than the slower line's amplitude


@pytest.mark.parametrize(
    ("arguments", "code", "values"),
    [
        ("motion none.csv", ErrorCode.NOT_FOUND, ["none.csv"]),
        ("motion short.csv", ErrorCode.OUT_OF_RANGE, ["0.01 s", "0.1 s"]),
        ("motion lines.csv --exposure -1", ErrorCode.OUT_OF_RANGE, ["-1 s"]),
        ("motion lines.csv --cadence 0.05", ErrorCode.OUT_OF_RANGE, ["0.1 s", "0.05 s"]),
        ("motion lines.csv --bandwidth 0", ErrorCode.OUT_OF_RANGE, ["0 Hz"]),
        ("motion none.csv --plot a.pdf", ErrorCode.WRONG_SUFFIX, ["a.pdf", ".png"]),
        ("motion none.csv -o a.txt", ErrorCode.WRONG_SUFFIX, ["a.txt", ".ecsv"]),
        ("motion lines.csv --plot nowhere/a.png", ErrorCode.NOT_FOUND, ["nowhere", "a.png"]),
        ("simulate a.fits --spectrum short.csv", ErrorCode.UNSUPPORTED, ["short.csv", "--trace"]),
        (
            "simulate a.fits --spectrum lines.csv --trace short.csv",
            ErrorCode.CONFLICT,
            ["--spectrum", "--trace"],
        ),
        ("simulate a.fits --spectrum lines.csv --locus shm", ErrorCode.CONFLICT, ["--spectrum", "--locus"]),
        ("simulate a.fits --spectrum lines.csv --length 1", ErrorCode.CONFLICT, ["--spectrum", "--length"]),
    ],
)
def test_what_cannot_be_done_is_one_sentence_and_exit_status_two(
    arguments, code, values, lines, monkeypatch, check_error
):
    monkeypatch.chdir(lines.parent)
    Path("short.csv").write_text("t,x,y\n0,0,0\n0.01,0,0\n")
    check_error(runner.invoke(app, [*arguments.split(), "-i", "smallsat"]), code, *values)
