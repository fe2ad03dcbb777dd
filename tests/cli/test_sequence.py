"""``jitterkit sequence`` from files to a separation."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from refusals import assert_names
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.errors import ErrorCode
from jitterkit.report.table import read_table

TELESCOPE = """
[instrument]
base = "plain"
name = "little"

[detector]
line_time = 1e-4
"""


@pytest.fixture(scope="module")
def night(tmp_path_factory) -> Path:
    """Eight frames of a drift over a rolling shutter, and one that is torn."""
    folder = tmp_path_factory.mktemp("night")
    (folder / "little.toml").write_text(TELESCOPE)
    made = [
        "simulate", str(folder / "frame.fits"), "-i", str(folder / "little.toml"), "--drift", "-1.5,2.0",
        "--frames", "8", "--separation", "4", "--theta", "80", "--seed", "3",
    ]  # fmt: skip
    assert CliRunner().invoke(app, made).exit_code == 0
    (folder / "frame-99.fits").write_bytes((folder / "frame-0.fits").read_bytes()[:3000])
    return folder


def run(night: Path, *more: str):
    found = sorted(map(str, night.glob("frame-[0-7].fits")))
    return CliRunner().invoke(app, ["sequence", *found, "-i", str(night / "little.toml"), *more])


@pytest.fixture(scope="module")
def fitted(night):
    result = run(night, str(night / "frame-99.fits"), "-o", str(night / "out"), "--locus", "linear")
    return result, night / "out"


def test_every_frame_has_a_row_and_the_torn_one_a_reason(fitted):
    result, out = fitted
    assert result.exit_code == 1
    table = read_table(out / "sequence.ecsv")
    assert len(table) == 9
    assert list(table["status"]) == ["ok"] * 8 + ["unreadable"]
    assert "frame-99.fits" in table["message"][-1]
    assert "frame-99.fits unreadable" in result.stderr
    assert list(table["counted"]) == [True] * 8 + [False]


def test_separation_and_sense_of_the_motion(fitted):
    result, out = fitted
    summary = json.loads((out / "sequence.json").read_text())
    value, error = (summary["separation"][name] for name in ("mean", "error"))
    assert abs(value - 4.0) < 4 * error
    assert result.stdout.startswith("separation ")
    table = read_table(out / "sequence.ecsv")[:-1]
    # 2.5 arcsec/s towards 126.87 degrees: both ways along the axis look the same in one frame
    assert np.allclose(table["velocity_x"].value, -1.5, atol=0.05)
    assert np.allclose(table["velocity_y"].value, 2.0, atol=0.05)
    # four errors: those of one frame are 3.5 degrees
    assert np.allclose(table["smear_direction"].value, 126.87, atol=14)
    assert str(table["velocity_x"].unit) == "arcsec / s"


@pytest.mark.slow
def test_no_header_says_when_is_reported_unless_the_cadence_is_given(fitted, night, tmp_path):
    # The torn frame's message names its header too; this warning is the first line, before any frame's.
    warning = fitted[0].stderr.splitlines()[0]
    assert_names(warning, ["header", "order of their names"])
    np.testing.assert_allclose(np.diff(read_table(fitted[1] / "sequence.ecsv")["time"][:-1].value), 0.1)
    timed = run(night, "-o", str(tmp_path / "timed"), "--locus", "linear", "--cadence", "2")
    assert timed.exit_code == 0
    assert warning not in timed.stderr
    np.testing.assert_allclose(np.diff(read_table(tmp_path / "timed/sequence.ecsv")["time"].value), 2.0)


def test_pictures_are_there(fitted):
    for name in ("run.png", "residual.png"):
        assert (fitted[1] / name).read_bytes().startswith(b"\x89PNG")


def test_the_residuals_of_all_frames_are_stacked(fitted):
    result, out = fitted
    fit = json.loads((out / "sequence.json").read_text())["fit"]
    assert fit["stack_frames"] == 8
    assert abs(fit["structure_sigmas"]) < 4
    assert len(result.stdout.splitlines()) == 1  # nothing is lacking


def test_results_are_not_replaced_unasked(night, fitted, check_error):
    check_error(run(night, "-o", str(night / "out")), ErrorCode.EXISTS, night / "out", "--overwrite")


@pytest.mark.parametrize(
    ("words", "code", "values"),
    [
        (["--law", "separation"], ErrorCode.MALFORMED, ["--law", "'separation'"]),
        (["--law", "separation=never"], ErrorCode.MALFORMED, ["'never'", "constant", "wander"]),
        (["--law", "flux=constant"], ErrorCode.UNKNOWN_NAME, ["'flux'", "separation"]),
        (
            ["--law", "theta=constant", "--law", "theta=wander"],
            ErrorCode.DUPLICATE,
            ["theta=wander", "theta"],
        ),
        (["--diffusion"], ErrorCode.NOT_CONSTRAINED, ["'mvn'", "linear"]),
        (["--telemetry", "nothing.csv"], ErrorCode.NOT_FOUND, ["nothing.csv"]),
        (
            ["--telemetry", "nothing.csv", "--global-shutter"],
            ErrorCode.CONFLICT,
            ["--telemetry", "--global-shutter"],
        ),
    ],
)
def test_bad_words_are_refused_in_a_sentence_before_anything_is_written(
    night, words, code, values, check_error
):
    check_error(run(night, "-o", str(night / "other"), *words), code, *values)
    assert not (night / "other").exists() or not any((night / "other").iterdir())
