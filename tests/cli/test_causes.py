"""``jitterkit causes``: tables, words and a picture of what widens an image."""

import numpy as np
import pytest
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.errors import ErrorCode
from jitterkit.report.table import read_table

runner = CliRunner()
SMALL = ["causes", "-i", "smallsat"]
PLAIN = ["causes", "-i", "plain"]  # whose pupil takes less time


@pytest.mark.slow
def test_a_free_jitter_is_taken_for_diffusion_and_telemetry_separates_them(tmp_path):
    table, picture = tmp_path / "causes.ecsv", tmp_path / "causes.png"
    asked = [*SMALL, "--diffusion", "0.4px", "--frames", "1", "--telemetry", "4%"]
    done = runner.invoke(app, [*asked, "-o", str(table), "--plot", str(picture)])
    assert done.exit_code == 0, done.output
    confused = {"diffusion", "jitter along 0°", "jitter across 0°"}
    assert any(all(cause in line for cause in confused) for line in done.stdout.splitlines())
    (row,) = [line.split() for line in done.stdout.splitlines() if line.startswith("diffusion  ")]
    assert (row[1], row[3], row[4], row[-1]) == ("0.4", "inf", "pix", "undetermined")
    kept = read_table(table)
    assert kept["data"][0] == "the frame alone"
    assert np.isinf(kept["diffusion"][0])
    known = kept[kept["data"] == "+ telemetry of the jitter to 4 %"]
    # the variance is known to 4 % (as sigma to 2 %), and a little better with what the frame adds
    assert 0.015 < known["jitter_along"][0].to_value("mas") / (300 * 0.375) < 0.02
    remedy = kept.meta["remedy"]
    for named in ("10 %", "jitter turned from 0°", "defocus", "0.1 pixel", "telemetry of the jitter to 4 %"):
        assert named in remedy
    assert remedy in done.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "code", "values"),
    [
        (["--target", "0.1"], ErrorCode.MALFORMED, ["--target 0.1"]),
        (["--telemetry", "-3%"], ErrorCode.OUT_OF_RANGE, ["--telemetry -3%"]),
        (["--diffusion", "widepx"], ErrorCode.MALFORMED, ["--diffusion widepx"]),
        (["--diffusion", "-1px"], ErrorCode.OUT_OF_RANGE, ["--diffusion -1px"]),
        (["--diffusion", "0.3"], ErrorCode.UNKNOWN_UNIT, ["--diffusion 0.3"]),
        (["--seeing", "1"], ErrorCode.UNKNOWN_UNIT, ["--seeing 1"]),
        (["--aberration", "noll99=3"], ErrorCode.UNKNOWN_NAME, ["'noll99'", "noll7"]),
        (["--aberration", "noll7"], ErrorCode.MALFORMED, ["--aberration noll7"]),
        (["--aberration", "noll7=inf"], ErrorCode.OUT_OF_RANGE, ["--aberration noll7=inf"]),
        (["--locus", "linear"], ErrorCode.MISSING_VALUE, ["linear", "--length"]),
        pytest.param(
            ["--locus", "linear", "--length", "0"],
            ErrorCode.OUT_OF_RANGE,
            ["length 0", "mvn"],
            marks=pytest.mark.slow,
        ),
        (["--plot", "x.pdf"], ErrorCode.WRONG_SUFFIX, ["x.pdf", ".png"]),
    ],
)
def test_what_is_wrong_is_reported_in_a_sentence(arguments, code, values, check_error):
    check_error(runner.invoke(app, [*PLAIN, *arguments]), code, *values)
