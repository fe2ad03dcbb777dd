"""``jitterkit forecast``: one forecast, a sweep, and the question the other way round."""

import numpy as np
import pytest
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.cli.quantities import parse_allowed, parse_angle, parse_sweeps
from jitterkit.errors import ConfigurationError
from jitterkit.report.table import read_table

runner = CliRunner()
SMALL = ["forecast", "-i", "smallsat"]


def errors(*arguments):
    done = runner.invoke(app, [*SMALL, *arguments])
    assert done.exit_code == 0, done.output
    lines = [line.split() for line in done.stdout.splitlines()[2:]]
    return {line[0]: float(line[2]) for line in lines}, done.stderr


def test_one_forecast_says_every_error_and_what_it_takes(tmp_path):
    found, talk = errors(
        "--locus", "linear", "--length", "0.5", "--angle", "30", "--plot", str(tmp_path / "m.png")
    )
    assert {"separation", "flux", "linear_c", "noll4", "length", "jitter_angle"} <= set(found)
    frames = (found["separation"] / 1e-6) ** 2
    said = int(talk.split("1 µas takes ")[1].split(" frames")[0].replace(",", ""))
    assert said == pytest.approx(frames, rel=1e-4)  # the table shows six digits
    hours = float(talk.split("frames, ")[1].split(" h")[0].replace(" × 10³", "e3").replace(",", ""))
    assert hours == pytest.approx(frames * 0.1 / 3600, rel=0.01)
    assert "more time than none" in talk
    assert (tmp_path / "m.png").read_bytes().startswith(b"\x89PNG")


def test_four_times_the_light_halves_the_error_of_a_bright_star():
    ideal = ["--sweep", "flux=1e9,4e9", "--sweep", "read_noise=0"]
    done = runner.invoke(app, [*SMALL, *ideal, "--sweep", "full_well=1e12"])
    assert "two" in done.output  # and no more
    assert done.exit_code == 2


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


def test_a_sweep_is_a_table_with_units_and_a_picture(tmp_path):
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
    assert again.exit_code == 2
    assert "exists; give --overwrite" in again.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--sweep", "length"], "--sweep length is not understood; write --sweep length=0.05:0.75:15"),
        (["--sweep", "wobble=1,2"], "A stable telescope has no --set wobble"),
        (["--target", "1"], "--target 1 is not a positive angle; write one with its unit, 1uas"),
        (["--allow", "-3%"], "--allow -3% is not a positive share of the time"),
        (["--allow", "10%", "--sweep", "flux=1e5"], "two questions; ask them one at a time"),
        (["--locus", "linear"], "The locus linear needs --length"),
        (["--fitted", "wobble", "--allow", "1uas"], "There is no jitter locus 'wobble'"),
        (["--allow", "10%", "--locus", "shm"], "--allow asks about every jitter; leave out the locus"),
        (["--sweep", "flux=1e5", "--sweep", "flux=1e6"], "flux is swept twice"),
        (["--sweep", "length=-1:1:3:log"], "is not understood"),
        (["--contrast", "-2"], "contrast = -2 must be at least one"),
        (["--x", "96"], "leaves the modelled field"),
        (["--flux", "1e12"], "does not determine its parameters"),
        (["--plot", "x.pdf"], "x.pdf does not end in .png"),
    ],
)
def test_what_is_wrong_is_told_in_a_sentence(arguments, words):
    done = runner.invoke(app, [*SMALL, *arguments])
    assert done.exit_code == 2
    assert words in " ".join(done.output.split())


def test_angles_and_shares_are_read_with_their_units():
    assert parse_angle("3mas", "--target") == pytest.approx(3e-3)
    assert parse_allowed("5 %") == ("time", pytest.approx(0.05))
    assert parse_allowed("2uas") == ("bias", pytest.approx(2e-6))
    assert parse_sweeps(["flux=1:100:3:log"]) == {"flux": pytest.approx([1, 10, 100])}
    with pytest.raises(ConfigurationError, match="3 settings are swept"):
        parse_sweeps(["a=1", "b=1", "c=1"])


def test_a_cross_fit_is_a_table_and_a_picture(tmp_path):
    table, picture = tmp_path / "cross.ecsv", tmp_path / "cross.png"
    asked = ["--data", "linear", "--fit", "stable", "--fit", "linear", "--size", "0.5", "--angle", "0"]
    done = runner.invoke(
        app, ["crossfit", "-i", "smallsat", *asked, "--draws", "50", "-o", str(table), "--plot", str(picture)]
    )
    assert done.exit_code == 0, done.output
    kept = read_table(table)
    assert list(kept["fitted"]) == ["stable", "linear"]
    still, right = (abs(value) for value in kept["bias"].to_value("uas"))
    assert right < 0.1 < still
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert runner.invoke(app, ["crossfit", "--data", "wobble"]).exit_code == 2
