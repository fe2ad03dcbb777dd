"""``process --tolerance``, ``--budget`` and ``--explain``."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.trade import examples, plan

runner = CliRunner()
FEW = {"pad": (8, 32), "samples": (3,), "binning": (1,), "region": (), "tolerance": (1e-2, 1e-4)}


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    path = tmp_path_factory.mktemp("night") / "frames.fits"
    made = runner.invoke(app, ["simulate", str(path), "-i", "smallsat", "--frames", "3", "--seed", "1"])
    assert made.exit_code == 0, made.output
    return path.parent


@pytest.fixture(autouse=True)
def few(monkeypatch):
    monkeypatch.setattr(plan, "RUNGS", FEW)


def test_a_run_is_made_with_what_its_frames_need_and_goes_on_with_it(frames, tmp_path, monkeypatch):
    out = tmp_path / "out"
    plain = ["process", str(frames), "-o", str(out), "-i", "smallsat", "--locus", "mvn"]
    command = [*plain, "--tolerance", "30%"]
    done = runner.invoke(app, [*command, "--explain"])
    assert done.exit_code == 0, done.output
    assert " ms a frame; what its model leaves out may cost " in done.stderr
    assert "  padding: " in done.stderr
    told = json.loads((out / "configuration.json").read_text())
    assert told["plan"]["asked"] == {"tolerance": "30%", "budget": None}
    assert told["instrument"]["pad"] == told["plan"]["settings"]["pad"] == 8
    assert told["options"]["tolerance"] == told["plan"]["settings"]["tolerance"] == 1e-2

    monkeypatch.setattr(examples, "examples_of", None)  # whoever looks again breaks down
    again = runner.invoke(app, [*command[:-1], "0.3e2%", "--resume"])  # the same in other words
    assert again.exit_code == 0, again.output
    assert runner.invoke(app, [*plain, "--resume"]).exit_code == 2  # another run


def test_frames_that_stand_still_get_no_jitter_where_the_promise_allows_it(tmp_path):
    night, out = tmp_path / "night", tmp_path / "out"
    night.mkdir()
    simulate = ["simulate", str(night / "still.fits"), "-i", "smallsat", "--frames", "3", "--locus", "stable"]
    assert runner.invoke(app, [*simulate, "--seed", "1"]).exit_code == 0
    command = ["process", str(night), "-o", str(out), "-i", "smallsat", "--tolerance", "60%"]
    done = runner.invoke(app, [*command, "--explain"])
    assert done.exit_code == 0, done.output
    assert "a frame that shows none gets no parameters of it, which may cost " in done.stderr
    told = json.loads((out / "configuration.json").read_text())
    assert told["plan"]["settings"]["jitter"] == "seen"
    assert told["options"]["may_be_still"] is True
    assert json.loads((out / "summary.json").read_text())["locus"] == {"stable": 3}
    again = runner.invoke(app, [*command, "--resume"])
    assert again.exit_code == 0, again.output


def test_explain_alone_changes_nothing(frames, tmp_path):
    results = []
    for name, more in (("plain", []), ("said", ["--explain"])):
        out = tmp_path / name
        command = ["process", str(frames), "-o", str(out), "-i", "smallsat", "--locus", "mvn", *more]
        done = runner.invoke(app, command)
        assert done.exit_code == 0, done.output
        assert ("  wavelengths: " in done.stderr) == bool(more)
        results.append(json.loads((out / "summary.json").read_text())["separation"])
    assert results[0] == results[1]
    assert np.isfinite(results[0]["mean"])


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (["--tolerance", "1uas", "--budget", "20ms"], "give one of the two"),
        (["--tolerance", "1 parsec"], "--tolerance 1 parsec is not a positive angle"),
        (["--tolerance", "-3%"], "--tolerance -3% is not a positive share of the error"),
        (["--budget", "20"], "--budget 20 is not a positive time; write one with its unit, 20ms"),
        (["--tolerance", "1e-6uas"], "No settings keep the separation of these frames within 1e-06 uas"),
        (["--budget", "1us"], "fit one in 0.001 ms on this machine; give more"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_written(frames, tmp_path, given, sentence):
    out = tmp_path / "out"
    done = runner.invoke(app, ["process", str(frames), "-o", str(out), "-i", "smallsat", *given])
    assert done.exit_code == 2
    assert sentence in " ".join(done.stderr.split())
    assert not out.exists()
