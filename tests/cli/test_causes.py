"""``jitterkit causes``: tables, words and a picture of what widens an image."""

import numpy as np
import pytest
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.report.table import read_table

runner = CliRunner()
SMALL = ["causes", "-i", "smallsat"]


def test_a_free_jitter_is_taken_for_diffusion_and_telemetry_tells_them_apart(tmp_path):
    table, picture = tmp_path / "causes.ecsv", tmp_path / "causes.png"
    asked = [*SMALL, "--diffusion", "0.4px", "--frames", "1", "--telemetry", "4%"]
    done = runner.invoke(app, [*asked, "-o", str(table), "--plot", str(picture)])
    assert done.exit_code == 0, done.output
    assert "diffusion is taken for jitter along 0° and jitter across 0°" in done.stdout
    assert (
        "The cheapest that tells every cause that has a size to 10 %, and jitter turned from 0° and defocus, "
        "of size 0, to a blur of 0.1 pixel: telemetry of the jitter to 4 %."
    ) in done.stdout
    (row,) = [line.split() for line in done.stdout.splitlines() if line.startswith("diffusion  ")]
    assert (row[1], row[3], row[4], row[-2:]) == ("0.4", "inf", "pix", ["not", "told"])
    kept = read_table(table)
    assert kept["data"][0] == "the frame alone"
    assert np.isinf(kept["diffusion"][0])
    known = kept[kept["data"] == "+ telemetry of the jitter to 4 %"]
    # the variance is known to 4 % (as sigma to 2 %), and a little better with what the frame adds
    assert 0.015 < known["jitter_along"][0].to_value("mas") / (300 * 0.375) < 0.02
    assert kept.meta["remedy"] in done.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--target", "0.1"], "--target 0.1 is not a positive share; write 10%"),
        (["--telemetry", "-3%"], "--telemetry -3% is not a positive share"),
        (["--diffusion", "widepx"], "--diffusion widepx is not a size in pixels; write 0.3px"),
        (["--diffusion", "0.3"], "--diffusion 0.3 is not a positive angle"),
        (["--seeing", "1"], "--seeing 1 is not a positive angle"),
        (["--aberration", "noll99=3"], "no aberration 'noll99'; there are noll4"),
        (["--aberration", "noll4"], "--aberration noll4 is not understood; write noll4=30"),
        (["--locus", "linear"], "The locus linear needs --length"),
        (["--locus", "linear", "--length", "0"], "no length has no axis"),
        (["--plot", "x.pdf"], "x.pdf does not end in .png"),
    ],
)
def test_what_is_wrong_is_told_in_a_sentence(arguments, words):
    done = runner.invoke(app, [*SMALL, *arguments])
    assert done.exit_code == 2
    assert words in " ".join(done.output.split())
