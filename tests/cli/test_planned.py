"""``process --tolerance``, ``--budget`` and ``--explain``."""

import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.errors import ErrorCode
from jitterkit.trade import plan, worst_case

runner = CliRunner()
FEW = {"pad": (8, 32), "samples": (3,), "binning": (1,), "region": (), "tolerance": (1e-2, 1e-4)}


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    path = tmp_path_factory.mktemp("night") / "frames.fits"
    made = runner.invoke(app, ["simulate", str(path), "-i", "plain", "--frames", "3", "--seed", "1"])
    assert made.exit_code == 0, made.output
    return path.parent


@pytest.fixture(autouse=True)
def few(monkeypatch):
    monkeypatch.setattr(plan, "GRID", FEW)


@pytest.mark.slow
def test_a_run_is_made_with_what_its_frames_need_and_goes_on_with_it(
    frames, tmp_path, monkeypatch, check_error
):
    out = tmp_path / "out"
    plain = ["process", str(frames), "-o", str(out), "-i", "plain", "--locus", "mvn"]
    command = [*plain, "--tolerance", "30%"]
    done = runner.invoke(app, [*command, "--explain"])
    assert done.exit_code == 0, done.output
    assert re.search(r"^[\d.e+]+ ms .* [mµ]as", done.stderr, re.MULTILINE)  # how long, and how exact
    assert "  padding: " in done.stderr
    kept = json.loads((out / "configuration.json").read_text())
    assert kept["plan"]["asked"] == {"tolerance": "30%", "budget": None}
    assert kept["instrument"]["pad"] == kept["plan"]["settings"]["pad"] == 8
    assert kept["options"]["tolerance"] == kept["plan"]["settings"]["tolerance"] == 1e-2

    monkeypatch.setattr(worst_case, "examples_of", None)  # whoever looks again breaks down
    again = runner.invoke(app, [*command[:-1], "0.3e2%", "--resume"])  # the same in other words
    assert again.exit_code == 0, again.output
    another = runner.invoke(app, [*plain, "--resume"])
    check_error(another, ErrorCode.CONFLICT, out)


@pytest.mark.slow
def test_frames_that_stand_still_get_no_jitter_where_the_promise_allows_it(tmp_path):
    night, out = tmp_path / "night", tmp_path / "out"
    night.mkdir()
    simulate = ["simulate", str(night / "still.fits"), "-i", "plain", "--frames", "3", "--locus", "stable"]
    assert runner.invoke(app, [*simulate, "--seed", "1"]).exit_code == 0
    command = ["process", str(night), "-o", str(out), "-i", "plain", "--tolerance", "60%"]
    done = runner.invoke(app, [*command, "--explain"])
    assert done.exit_code == 0, done.output
    assert re.search(r"^  jitter: .* [mµ]as", done.stderr, re.MULTILINE)
    written = json.loads((out / "configuration.json").read_text())
    assert written["plan"]["settings"]["jitter"] == "seen"
    assert written["options"]["may_be_still"] is True
    assert json.loads((out / "summary.json").read_text())["locus"] == {"stable": 3}
    again = runner.invoke(app, [*command, "--resume"])
    assert again.exit_code == 0, again.output


@pytest.mark.slow
def test_explain_alone_changes_nothing(frames, tmp_path):
    results = []
    for name, more in (("plain", []), ("said", ["--explain"])):
        out = tmp_path / name
        command = ["process", str(frames), "-o", str(out), "-i", "plain", "--locus", "mvn", *more]
        done = runner.invoke(app, command)
        assert done.exit_code == 0, done.output
        assert ("  wavelengths: " in done.stderr) == bool(more)
        results.append(json.loads((out / "summary.json").read_text())["separation"])
    assert results[0] == results[1]
    assert np.isfinite(results[0]["mean"])


@pytest.mark.parametrize(
    ("given", "code", "values"),
    [
        (["--tolerance", "1uas", "--budget", "20ms"], ErrorCode.CONFLICT, ["--tolerance", "--budget"]),
        (["--tolerance", "1 parsec"], ErrorCode.UNKNOWN_UNIT, ["--tolerance 1 parsec"]),
        (["--tolerance", "-3%"], ErrorCode.OUT_OF_RANGE, ["--tolerance -3%"]),
        (["--budget", "20"], ErrorCode.UNKNOWN_UNIT, ["--budget 20", "20ms"]),
        *(
            pytest.param(*those, marks=pytest.mark.slow)
            for those in (
                (["--tolerance", "1e-6uas"], ErrorCode.OUT_OF_RANGE, ["1e-06 uas"]),
                (["--budget", "1us"], ErrorCode.OUT_OF_RANGE, ["0.001 ms"]),
            )
        ),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_written(
    frames, tmp_path, given, code, values, check_error
):
    out = tmp_path / "out"
    done = runner.invoke(app, ["process", str(frames), "-o", str(out), "-i", "plain", *given])
    check_error(done, code, *values)
    assert not out.exists()
