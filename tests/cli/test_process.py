"""What ``jitterkit process`` says of a run that was interrupted, and of many failures."""

import json
import re
from contextlib import nullcontext

import pytest
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.errors import ErrorCode

runner = CliRunner()


@pytest.fixture
def blanks(tmp_path):
    """Fifty-two files that are no frames."""
    directory = tmp_path / "frames"
    directory.mkdir()
    for number in range(52):
        (directory / f"{number:02d}.fits").write_text("exposure = 3\n" * 50)
    return directory


def how_to_go_on(stopped, out):
    """Options in the line that names the directory."""
    (line,) = [line for line in stopped.stderr.splitlines() if out in line]
    return set(re.findall(r"--\w+", line))


def test_a_run_that_is_interrupted_says_how_to_go_on_and_goes_on(blanks, tmp_path, monkeypatch, check_error):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    out = str(tmp_path / "out")
    command = ["process", str(blanks), "-o", out, "-i", "smallsat", "--locus", "mvn"]
    with monkeypatch.context() as patched:
        patched.setattr("jitterkit.run.process.execute", interrupted)
        stopped = runner.invoke(app, command)
    assert stopped.exit_code == 130
    assert how_to_go_on(stopped, out) == {"--resume"}
    check_error(runner.invoke(app, command), ErrorCode.EXISTS, out)  # which is not to be lost unasked
    assert runner.invoke(app, [*command, "--resume"]).exit_code == 1
    with monkeypatch.context() as patched:
        patched.setattr("jitterkit.run.process.execute", interrupted)
        stopped = runner.invoke(app, [*command, "--overwrite"])
    assert how_to_go_on(stopped, out) == {"--resume", "--overwrite"}


def test_a_file_that_was_overwritten_before_a_run_goes_on_is_reported(blanks, tmp_path, check_error):
    command = ["process", str(blanks), "-o", str(tmp_path / "out"), "-i", "smallsat", "--locus", "mvn"]
    assert runner.invoke(app, command).exit_code == 1
    (blanks / "07.fits").write_text("exposure = 4\n")
    check_error(runner.invoke(app, [*command, "--resume"]), ErrorCode.CHANGED, "07.fits", "650 bytes", "13")
    assert runner.invoke(app, [*command, "--overwrite"]).exit_code == 1


def test_the_line_on_the_screen_says_which_rows_are_of_an_earlier_session(blanks, tmp_path, monkeypatch):
    now, earlier = [], []
    monkeypatch.setattr(
        "jitterkit.cli.run.run_progress", lambda total: nullcontext((now.append, earlier.append))
    )
    command = ["process", str(blanks), "-o", str(tmp_path / "out"), "-i", "smallsat", "--locus", "mvn"]
    runner.invoke(app, command)
    assert (len(now), len(earlier)) == (52, 0)
    runner.invoke(app, [*command, "--resume"])
    assert (len(now), len(earlier)) == (52, 52)


def test_of_many_failures_some_are_reported_and_the_others_counted(blanks, tmp_path):
    done = runner.invoke(app, ["process", str(blanks), "-o", str(tmp_path / "out"), "-i", "smallsat"])
    assert done.stderr.count("] unreadable: ") == 50
    (others,) = [line for line in done.stderr.splitlines() if line.startswith("...")]
    assert re.findall(r"\d+", others) == ["2"]


def test_a_preset_is_what_a_run_was_made_with_and_goes_on_with(blanks, tmp_path, check_error):
    out = tmp_path / "out"
    command = ["process", str(blanks), "-o", str(out), "-i", "smallsat", "--locus", "mvn", "--preset"]
    assert runner.invoke(app, [*command, "fast"]).exit_code == 1
    kept = json.loads((out / "configuration.json").read_text())
    assert kept["instrument"]["pad"] == 16
    assert kept["options"]["tolerance"] == 0.01
    check_error(
        runner.invoke(app, [*command, "balanced", "--resume"]), ErrorCode.CONFLICT, out, "instrument.pad", 16
    )
    assert runner.invoke(app, [*command, "fast", "--resume"]).exit_code == 1


def test_a_preset_that_cannot_be_is_refused_before_a_frame_is_read(blanks, tmp_path, check_error):
    command = ["process", str(blanks), "-o", str(tmp_path / "out"), "-i", "smallsat", "--preset", "slow"]
    check_error(runner.invoke(app, command), ErrorCode.UNKNOWN_NAME, "'slow'", "fast, balanced, exact")
