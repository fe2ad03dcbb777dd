"""``jitterkit forecast``: one forecast, a sweep, and the question the other way round."""

import re
from dataclasses import replace

import numpy as np
import pytest
from refusals import refused
from typer.testing import CliRunner

from jitterkit.cli import options
from jitterkit.cli.forecast import _Setup
from jitterkit.cli.main import app
from jitterkit.cli.quantities import parse_allowed, parse_angle, parse_sweeps, parse_time
from jitterkit.errors import ErrorCode
from jitterkit.instruments import load_instrument
from jitterkit.report.table import read_table

runner = CliRunner()
SMALL = ["forecast", "-i", "plain"]


def errors(*arguments):
    done = runner.invoke(app, [*SMALL, *arguments])
    assert done.exit_code == 0, done.output
    lines = [line.split() for line in done.stdout.splitlines()[2:]]
    return {line[0]: float(line[2]) for line in lines}, done.stderr


def test_one_forecast_says_every_error_and_what_it_takes(tmp_path):
    found, talk = errors(
        "--locus", "linear", "--length", "0.5", "--angle", "30", "--plot", str(tmp_path / "m.png")
    )
    assert {"separation", "flux", "linear_c", "noll7", "length", "jitter_angle"} <= set(found)
    frames = (found["separation"] / 1e-6) ** 2
    said = int(talk.split("1 µas takes ")[1].split(" frames")[0].replace(",", ""))
    assert said == pytest.approx(frames, rel=1e-4)  # the table shows six digits
    hours = float(talk.split("frames, ")[1].split(" h")[0].replace(" × 10³", "e3").replace(",", ""))
    assert hours == pytest.approx(frames * 0.1 / 3600, rel=0.01)
    assert float(re.search(r"([\d.]+) %", talk)[1]) > 0  # more time than without the jitter
    assert (tmp_path / "m.png").read_bytes().startswith(b"\x89PNG")


def test_frames_that_reach_a_target_are_whole():
    found, talk = errors("--target", "1mas")
    frames = (found["separation"] / 1e-3) ** 2
    said = int(re.search(r"takes ([\d,]+) frame", talk)[1].replace(",", ""))
    assert said == np.ceil(frames) > frames
    assert "takes 1 frame," in errors("--target", "1arcsec")[1]


def test_stars_are_a_pair_in_other_parameters(tmp_path):
    """The bound of a separation is the same whichever parameters two stars are described by."""
    contrast, angle = 2.5, np.radians(30)
    rows = [(-2.0, contrast), (2.0, 1.0)]
    table = tmp_path / "two.csv"
    lines = [f"{at * np.cos(angle)},{at * np.sin(angle)},{1e6 * part / 3.5}" for at, part in rows]
    table.write_text("\n".join(["x,y,flux", *lines]))
    telescope = replace(load_instrument("plain"), colours=None)
    own = {"sigma_major": 0.2, "sigma_minor": 0.1, "angle": 70.0}
    pair = {"separation": 4.0, "theta": 30.0, "x": 0.0, "y": 0.0, "flux": 1e6, "contrast": contrast}
    stars = options.read_stars(table)
    two = _Setup(telescope, "mvn", own, {"x": 0.0, "y": 0.0}, stars).point()
    names = list(two.names)
    slope = np.zeros(len(names))  # of the separation
    for name, value in zip(("x", "y"), (np.cos(angle), np.sin(angle)), strict=True):
        slope[names.index(name)], slope[names.index(f"{name}_2")] = -value, value
    bound = np.sqrt(slope @ two.covariance @ slope)
    expected = _Setup(telescope, "mvn", own, pair).point().error("separation")
    assert bound == pytest.approx(expected, rel=1e-6)


def test_a_third_star_far_away_costs_the_separation_little_and_a_near_one_more(tmp_path):
    jitter = ["--locus", "mvn", "--sigma", "0.2"]
    alone, _ = errors(*jitter, "--separation", "5", "--theta", "0")
    costs = []
    for number, at in enumerate(("-6,5,1000", "3.2,0.3,1000")):
        (tmp_path / f"{number}.csv").write_text(f"x,y,flux\n{at}\n")
        beside, _ = errors(
            *jitter, "--separation", "5", "--theta", "0", "--stars", str(tmp_path / f"{number}.csv")
        )
        costs.append(beside["separation"] / alone["separation"] - 1)
    assert -1e-3 < costs[0] < 0.01 < costs[1]


@pytest.mark.parametrize(
    ("given", "code", "values"),
    [
        ([], ErrorCode.MISSING_VALUE, ["--stars"]),
        (["--stars", "none.csv"], ErrorCode.NOT_FOUND, ["none.csv"]),
        (["--stars", "none.csv", "--flux", "3"], ErrorCode.CONFLICT, ["--flux", "--scene stars"]),
        (["--stars", "none.csv", "--sweep", "x=1,2"], ErrorCode.CONFLICT, ["--sweep"]),
    ],
)
def test_stars_need_a_table_and_have_no_separation(given, code, values, check_error):
    check_error(runner.invoke(app, [*SMALL, "--scene", "stars", *given]), code, *values)


def test_no_more_than_two_settings_are_swept(check_error):
    ideal = ["--sweep", "flux=1e9,4e9", "--sweep", "read_noise=0"]
    check_error(
        runner.invoke(app, [*SMALL, *ideal, "--sweep", "full_well=1e12"]), ErrorCode.TOO_MANY, 3, "--sweep"
    )


def test_what_is_no_jitter_costs_no_more_time_than_without_jitter(tmp_path):
    table = tmp_path / "flux.ecsv"
    done = runner.invoke(
        app, [*SMALL, "--sweep", "flux=1e4:1e5:3:log", "--sweep", "separation=5,10", "-o", str(table)]
    )
    assert done.exit_code == 0, done.output
    kept = read_table(table)
    np.testing.assert_allclose(kept["time_ratio"], 1)
    assert np.all(np.diff(kept["separation_err"].to_value("uas")[::2]) < 0)
    assert np.all(kept["masked"] == 0)


def test_a_sweep_is_a_table_with_units_and_a_picture(tmp_path, check_error):
    table, picture = tmp_path / "sweep.ecsv", tmp_path / "sweep.png"
    sweep = ["--locus", "shm", "--sweep", "length=0.1:0.5:3", "--sweep", "angle=0,90"]
    done = runner.invoke(app, [*SMALL, *sweep, "--target", "10uas", "-o", str(table), "--plot", str(picture)])
    assert done.exit_code == 0, done.output
    kept = read_table(table)
    np.testing.assert_allclose(kept["length"].to_value("arcsec"), [0.1, 0.1, 0.3, 0.3, 0.5, 0.5])
    error = kept["separation_err"].to_value("uas")
    np.testing.assert_array_equal(kept["frames"], np.ceil((error / 10) ** 2))
    np.testing.assert_allclose(kept["time"].to_value("s"), (error / 10) ** 2 * 0.1)
    assert np.all(np.diff(kept["time_ratio"][::2]) > 0)
    assert picture.read_bytes().startswith(b"\x89PNG")
    again = runner.invoke(app, [*SMALL, *sweep, "-o", str(table)])
    check_error(again, ErrorCode.EXISTS, table, "--overwrite")


@pytest.mark.parametrize(
    ("arguments", "code", "values"),
    [
        (["--sweep", "flux"], ErrorCode.MALFORMED, ["--sweep flux"]),
        (["--sweep", "wobble=1,2"], ErrorCode.UNKNOWN_NAME, ["--set wobble", "--locus"]),
        (["--target", "1"], ErrorCode.UNKNOWN_UNIT, ["--target 1", "1uas"]),
        (["--target", "-1uas"], ErrorCode.OUT_OF_RANGE, ["--target -1uas"]),
        (["--target", "small"], ErrorCode.MALFORMED, ["--target small", "1uas"]),
        (["--allow", "-3%"], ErrorCode.OUT_OF_RANGE, ["--allow -3%"]),
        (["--allow", "ten%"], ErrorCode.MALFORMED, ["--allow ten%", "10%"]),
        (["--allow", "10%", "--sweep", "flux=1e5"], ErrorCode.CONFLICT, ["--allow", "--sweep"]),
        (["--allow", "10%", "--target", "2uas"], ErrorCode.CONFLICT, ["--target", "--allow"]),
        (["--scene", "star", "--target", "2uas"], ErrorCode.CONFLICT, ["--target", "--scene star"]),
        (["--flux", "5e4", "--sweep", "flux=1e5"], ErrorCode.CONFLICT, ["--flux", "--sweep flux"]),
        (
            ["--locus", "linear", "--length", "0.5", "--sweep", "length=0.1,0.2"],
            ErrorCode.CONFLICT,
            ["--length", "--sweep length"],
        ),
        (
            ["--locus", "mvn", "--sigma", "0.1", "--sweep", "sigma_major=0.1,0.2"],
            ErrorCode.CONFLICT,
            ["--sigma", "--sweep sigma_major"],
        ),
        (["--locus", "linear"], ErrorCode.MISSING_VALUE, ["linear", "--length"]),
        (["--fitted", "wobble", "--allow", "1uas"], ErrorCode.UNKNOWN_NAME, ["'wobble'", "linear"]),
        (["--allow", "10%", "--locus", "shm"], ErrorCode.CONFLICT, ["--allow", "--locus shm"]),
        (["--sweep", "flux=1e5", "--sweep", "flux=1e6"], ErrorCode.DUPLICATE, ["flux"]),
        (["--sweep", "length=-1:1:3:log"], ErrorCode.MALFORMED, ["--sweep length=-1:1:3:log"]),
        (["--sweep", "flux=1e4:inf:3"], ErrorCode.OUT_OF_RANGE, ["--sweep = inf"]),
        (["--sweep", "flux=nan"], ErrorCode.OUT_OF_RANGE, ["--sweep = nan"]),
        (["--target", "1e-300uas"], ErrorCode.OUT_OF_RANGE, ["--target = 1e-306"]),
        (["--allow", "1e-300%"], ErrorCode.OUT_OF_RANGE, ["--allow 1e-300%"]),
        (["--allow", "1e-9%"], ErrorCode.OUT_OF_RANGE, ["1e-11", "1e-06"]),
        (
            ["--locus", "ellipse", "--set", "semi_major=1e300"],
            ErrorCode.OUT_OF_RANGE,
            ["semi_major = 1e+300"],
        ),
        (["--sweep", "gain=-1"], ErrorCode.OUT_OF_RANGE, ["gain = -1.0 "]),
        (["--contrast", "-2"], ErrorCode.OUT_OF_RANGE, ["contrast = -2"]),
        (["--x", "96"], ErrorCode.SAMPLING, ["along x"]),
        (["--flux", "1e12"], ErrorCode.NOT_CONSTRAINED, ["flux 1e+12"]),
        (["--plot", "x.pdf"], ErrorCode.WRONG_SUFFIX, ["x.pdf", ".png"]),
    ],
)
def test_what_is_wrong_is_reported_in_a_sentence(arguments, code, values, check_error):
    check_error(runner.invoke(app, [*SMALL, *arguments]), code, *values)


@pytest.mark.parametrize(
    ("text", "arcsec"),
    [
        ('2"', 2.0), ("1e-3 arcsec", 1e-3), (".5mas", 5e-4), ("7 µas", 7e-6), ("1 milli-arcsec", 1e-3),
        ("2 microarcsec", 2e-6), ("1 nrad", 648e-6 / np.pi), ("2 deg", 7200.0), ("1\u00b0", 3600.0),
        *((text, ErrorCode.MALFORMED) for text in ("1 2 mas", "1,5mas", "mas")),
        *((text, ErrorCode.UNKNOWN_UNIT) for text in ("1", "1as", "1nm", "1 mas/s", "1 Mrad")),
        *((text, ErrorCode.UNKNOWN_UNIT) for text in ("1 MAS", "1 Mas", "1 NM", "1mas/pixel", "1 mas/px")),
        ("1 ARCSEC", 1.0), ("1 MILLIARCSEC", 1e-3), ("1 UAS", 1e-6),
        *((text, ErrorCode.OUT_OF_RANGE) for text in ("-1mas", "0 mas", "1e400mas")),
    ],
)  # fmt: skip
def test_an_angle_is_one_number_and_its_unit(text, arcsec):
    if isinstance(arcsec, ErrorCode):
        with refused(arcsec, f"--target {text}"):
            parse_angle(text, "--target")
    else:
        assert parse_angle(text, "--target") == pytest.approx(arcsec, rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["budget", "--effect", "flat=0.01", "--effect", "flat=0.02"], "--effect flat=0.02: flat"),
        (["causes", "--aberration", "noll7=1", "--aberration", "noll7=2"], "--aberration noll7=2: noll7"),
        (["forecast", "--locus", "linear", "--length", "1", "--set", "length=2"], "--set length=2: length"),
        (["forecast", "--locus", "partial", "--set", "cycles=1", "--set", " cycles=2"], "cycles=2: cycles"),
    ],
)  # fmt: skip
def test_a_size_that_is_given_twice_is_refused(arguments, named, check_error):
    check_error(runner.invoke(app, [*arguments, "-i", "plain"]), ErrorCode.DUPLICATE, named)


def test_angles_and_shares_are_read_with_their_units():
    assert parse_time("20 sec", "--budget") == 20.0
    assert parse_time("2 MIN", "--budget") == 120.0
    assert parse_time("1 Ms", "--budget") == pytest.approx(1e6)  # as SI has it
    for text in ("1 MS", "1 MSEC", "1 s/frame"):
        with refused(ErrorCode.UNKNOWN_UNIT, f"--budget {text}"):
            parse_time(text, "--budget")
    assert parse_angle("3mas", "--target") == pytest.approx(3e-3)
    assert parse_allowed("5 %") == ("time", pytest.approx(0.05))
    assert parse_allowed("2uas") == ("bias", pytest.approx(2e-6))
    assert parse_sweeps(["flux=1:100:3:log"]) == {"flux": pytest.approx([1, 10, 100])}
    with refused(ErrorCode.TOO_MANY, 3):
        parse_sweeps(["a=1", "b=1", "c=1"])


@pytest.mark.slow
def test_a_cross_fit_is_a_table_and_a_picture(tmp_path, check_error):
    table, picture = tmp_path / "cross.ecsv", tmp_path / "cross.png"
    asked = ["--data", "linear", "--fit", "stable", "--fit", "linear", "--size", "0.5", "--angle", "0"]
    done = runner.invoke(
        app, ["crossfit", "-i", "plain", *asked, "--draws", "50", "-o", str(table), "--plot", str(picture)]
    )
    assert done.exit_code == 0, done.output
    kept = read_table(table)
    assert list(kept["fitted"]) == ["stable", "linear"]
    still, right = (abs(value) for value in kept["bias"].to_value("uas"))
    assert right < 0.1 < still
    assert picture.read_bytes().startswith(b"\x89PNG")
    check_error(runner.invoke(app, ["crossfit", "--data", "wobble"]), ErrorCode.UNKNOWN_NAME, "'wobble'")
