"""``jitterkit watch``: what it shows, how it ends, and the options it shares with ``process``."""

import json
import re

import pytest
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.cli.progress import _EVERY, Screen, _lines
from jitterkit.errors import ErrorCode
from jitterkit.report.table import read_table

runner = CliRunner()


def row(number, status="ok", **changes):
    fitted = {"separation": 10.0 + 0.01 * (-1) ** number, "separation_err": 0.02}
    jitter = {"sxx": 0.04, "sxy": 0.0, "syy": 0.01}
    return {
        "path": f"night/{number}.fits", "file": f"{number}.fits", "frame": 0, "status": status,
        "message": "chi²/dof is 1.00.", **fitted, **jitter, **changes,
    }  # fmt: skip


def test_the_screen_waits_before_the_first_frame():
    assert Screen("night").lines() == {"waiting for": "frames in night"}


def test_the_screen_shows_what_was_found_and_how_fast():
    screen = Screen("night")
    for number in range(4):
        screen.add(row(number), now=0.5 * number)
    screen.add(row(4, "no_star", separation=float("nan"), message="nothing rises above the noise"), now=2.0)
    assert screen.lines() == {
        "separation": "10.000 ± 0.010 arcsec",  # 0.02 over the root of four
        "kernel": "200 × 100 mas rms at 0°, of the last 4",  # roots of 0.04 and 0.01
        "frames": "4 ok, 1 no_star",
        "rate": "2.00 frames/s",
        "last": "4.fits [0] nothing rises above the noise",
    }


def test_the_kernel_is_that_of_late_frames():
    screen = Screen("night")
    for number in range(60):
        late = {"sxx": 0.0, "syy": 0.0009} if number >= 10 else {}
        screen.add(row(number, **late))
    assert screen.kernel() == "30.0 × 0.0 mas rms at 90°, of the last 50"


def test_where_there_is_no_terminal_lines_come_every_few_seconds(capsys):
    times = iter([0.0, 1.0, _EVERY - 0.1, _EVERY + 0.1, _EVERY + 1])
    follow = _lines(Screen("night"), lambda: next(times))
    for number in range(5):
        follow(row(number))
    said = capsys.readouterr().err.splitlines()
    assert [re.search(r"; last (\d)", line)[1] for line in said] == ["0", "3"]


def test_frames_are_watched_for_and_the_result_is_reported_as_by_process(tmp_path):
    night = tmp_path / "night"
    night.mkdir()
    for seed, name in enumerate("ab"):
        simulated = ["simulate", str(night / f"{name}.fits"), "-i", "plain", "--seed", str(seed)]
        runner.invoke(app, simulated, catch_exceptions=False)
    (night / "half.fits").write_bytes((night / "a.fits").read_bytes()[:-4000])
    options = ["-i", "plain", "--locus", "stable", "--idle", "0.2", "--poll", "0.05"]
    done = runner.invoke(app, ["watch", str(night), "-o", str(night / "out"), *options])
    assert done.exit_code == 1, done.output
    assert re.search(r"^separation \S+ ± \S+ arcsec from 2 frames$", done.stdout, re.MULTILINE)
    assert "half.fits [0] unreadable" in done.stderr
    assert list(read_table(night / "out" / "results.ecsv")["file"]) == ["a.fits", "b.fits", "half.fits"]
    assert json.loads((night / "out" / "configuration.json").read_text())["locus"] == "stable"


def test_options_that_make_a_processor_are_those_of_process():
    from typer.main import get_command

    commands = get_command(app).commands
    planned = {"tolerance", "budget", "explain"}  # by frames that are there
    own = {"directory", "idle", "poll"}, {"files", "workers", "scheduler", *planned}
    shared = [
        {parameter.name for parameter in commands[name].params} - mine
        for name, mine in zip(("watch", "process"), own, strict=True)
    ]
    assert shared[0] == shared[1]
    assert {"locus", "prior", "rays", "device", "gain", "resume"} <= shared[0]


@pytest.mark.parametrize(
    ("arguments", "code", "values"),
    [
        ("watch nowhere -o out", ErrorCode.NOT_FOUND, ["nowhere"]),
        (
            "process . -o out --workers 2 --scheduler tcp://x:1",
            ErrorCode.CONFLICT,
            ["--workers", "--scheduler"],
        ),
    ],
    ids=["no directory", "workers and a scheduler"],
)
def test_what_cannot_be_is_reported(arguments, code, values, tmp_path, monkeypatch, check_error):
    monkeypatch.chdir(tmp_path)
    check_error(runner.invoke(app, arguments.split()), code, *values)
