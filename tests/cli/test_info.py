"""``jitterkit info`` about instruments and detectors."""

import numpy as np
import pytest
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.errors import ErrorCode
from jitterkit.frames import write_fits

runner = CliRunner()


def rows(output):
    return {line.split()[0]: line for line in output.splitlines() if line.split()}


@pytest.mark.parametrize("name", ["toliman-camera", "imx183"])
def test_info_tells_a_preset_with_the_provenance_of_each_number(name):
    done = runner.invoke(app, ["info", name])
    assert done.exit_code == 0
    table = rows(done.stdout)
    assert "SNRmax 41.6 dB" in table["full_well"]
    assert "a choice" in table["dark_current"]
    assert "an estimate" in table["line_time"]
    assert "not modelled" in table["flat"]


def test_info_tells_an_instrument_file(tmp_path):
    path = tmp_path / "cam.toml"
    text = '[instrument]\nbase = "smallsat"\n[spectrum]\nlines = [633]\n'
    path.write_text(f'{text}[detector]\nbase = "imx183"\ncoupling = 0.004\n')
    table = rows(runner.invoke(app, ["info", str(path)]).stdout)
    assert "instrument file cam.toml [detector] coupling" in table["coupling"]
    assert "instrument file cam.toml [spectrum]" in table["spectrum"]
    assert "preset smallsat" in table["plate_scale"]


@pytest.mark.parametrize(
    ("line", "code", "values"),
    [
        ('modes_of_b = ["noll99"]', ErrorCode.UNKNOWN_NAME, ["'noll99'", "noll4"]),
        ('transmission = ["q"]', ErrorCode.OUT_OF_RANGE, ["'q'", "x, y, r"]),
    ],
)
def test_info_refuses_the_instrument_files_that_commands_refuse(tmp_path, check_error, line, code, values):
    path = tmp_path / "cam.toml"
    path.write_text(f'[instrument]\nbase = "smallsat"\n{line}\n')
    commands = [["info", str(path)], ["simulate", str(tmp_path / "s.fits"), "-i", str(path)]]
    info, simulate = (runner.invoke(app, command) for command in commands)
    check_error(info, code, *values)
    assert info.stderr == simulate.stderr


@pytest.mark.parametrize(
    ("header", "data", "said"),
    [
        ({"BUNIT": "MJy/sr"}, [[1.0, 2.0], [3.0, 4.0]], "MJy/sr"),
        ({}, [[0.1, 0.2], [0.3, 1.0]], "floats from 0 to 1"),
        ({"EXPTIME": "2 x 30 s"}, [[1.0, 2.0], [3.0, 4.0]], "'2 x 30 s'"),
    ],
)
def test_info_warns_of_what_it_does_not_use(tmp_path, header, data, said):
    write_fits(tmp_path / "a.fits", np.array(data), header=header)
    done = runner.invoke(app, ["info", str(tmp_path / "a.fits")])
    assert done.exit_code == 0
    assert said in rows(done.stdout)["warning:"]


def test_info_of_nothing_says_so(check_error):
    check_error(runner.invoke(app, ["info", "imx138"]), ErrorCode.NOT_FOUND, "imx138")
