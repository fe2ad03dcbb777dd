"""Commands that look ahead count the noise of a dark current, in the exposure of the instrument."""

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.errors import ErrorCode
from jitterkit.forecast import forecast, jitter_requirements
from jitterkit.forward import Parameters
from jitterkit.instruments import load_instrument
from jitterkit.loci import Linear, Stable
from jitterkit.report.table import read_table
from jitterkit.scene import Binary

runner = CliRunner()
BENCH = """[instrument]
base = "smallsat"
shape = [32, 32]
flux = 1e5
exposure = {exposure}
[detector]
dark_current = {dark}
read_noise = 2.0
"""
PAIR = ["--separation", "5"]


@pytest.fixture
def bench(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, exposure, dark in (("dark", 100.0, 2.0), ("even", 0.1, 0.0), ("unknown", 0, 0.5)):
        (tmp_path / f"{name}.toml").write_text(BENCH.format(exposure=exposure, dark=dark))
    return tmp_path


def tabulated(name, *arguments):
    done = runner.invoke(app, [*arguments, "-i", f"{name}.toml", "-o", "t.ecsv", "--overwrite"])
    assert done.exit_code == 0, done.output
    return read_table("t.ecsv")


def test_commands_agree_on_the_error_of_a_frame_with_dark_current(bench):
    jitter = ["--locus", "linear", "--length", "0.2"]
    rows = tabulated("dark", "forecast", *PAIR, *jitter)
    alone = tabulated("even", "forecast", *PAIR, *jitter)
    assert rows["error"][0] > 1.2 * alone["error"][0]
    drawn = ["--data", "linear", "--fit", "linear", "--size", "0.2", "--angle", "0", "--draws", "2"]
    (crossed,) = tabulated("dark", "crossfit", *PAIR, *drawn)
    assert crossed["error"].to_value("arcsec") == pytest.approx(rows["error"][0], rel=1e-6)
    (bench / "lines.csv").write_text("frequency [Hz],amplitude [mas],angle [deg]\n3,1,0\n")
    wide, narrow = (
        tabulated(name, "motion", "lines.csv").meta["loss"]["error_without"][0] for name in ("dark", "even")
    )
    assert wide > 1.2 * narrow


@pytest.mark.slow
def test_causes_are_told_apart_less_well_in_the_dark(bench):
    jitter = ["--locus", "linear", "--length", "0.2"]
    wide, narrow = (
        tabulated(name, "causes", *PAIR, *jitter)["jitter_along"][0].value for name in ("dark", "even")
    )
    assert wide > 1.2 * narrow


def test_a_jitter_that_is_allowed_costs_that_in_the_dark_too(bench):
    telescope = replace(load_instrument("dark.toml"), colours=None)
    otf, exposure = telescope.system().nominal, telescope.exposure
    still = Parameters(Binary(5.0, 0.0, 0.0, 0.0, 1e5, 3.0), Stable.of(), np.zeros(len(otf.names)))
    still = still.completed(otf)
    found = jitter_requirements(
        still, otf, 0.1, telescope.detector, angles=(0.0,), cycles=(), exposure=exposure
    )
    errors = [
        forecast(still.with_locus(one), otf, telescope.detector, exposure=exposure).error("separation")
        for one in (Linear.of(found[0].size), Stable.of())
    ]
    assert (errors[0] / errors[1]) ** 2 == pytest.approx(1.1, rel=1e-3)


@pytest.mark.parametrize("command", ["forecast", "budget", "causes", "crossfit"])
def test_a_dark_current_without_an_exposure_is_refused(bench, command, check_error):
    done = runner.invoke(app, [command, *PAIR, "-i", "unknown.toml"])
    check_error(done, ErrorCode.MISSING_VALUE, "dark_current", "exposure")
