"""``jitterkit instrument``: options become a file that other commands read."""

import numpy as np
import pytest
from astropy.io import fits
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.errors import ErrorCode

runner = CliRunner()


@pytest.fixture
def pupil(tmp_path):
    disc = np.hypot(*np.meshgrid(np.arange(64) - 31.5, np.arange(64) - 31.5)) < 31.5
    fits.writeto(tmp_path / "pupil.fits", disc.astype(float), fits.Header({"PUPLSCAL": 0.01}))
    return tmp_path / "pupil.fits"


def test_a_pupil_becomes_a_file_that_info_reads(tmp_path, pupil):
    path = tmp_path / "tel.toml"
    options = [
        "--band",
        "500",
        "600",
        "--plate-scale",
        "0.05",
        "--shape",
        "20",
        "24",
        "--noll",
        "7",
        "--noll",
        "8",
    ]
    done = runner.invoke(app, ["instrument", str(pupil), "-o", str(path), *options])
    assert done.exit_code == 0, done.output
    printed = runner.invoke(app, ["info", str(path)]).stdout
    assert "24 x 20" in printed
    assert "instrument file tel.toml [instrument] plate_scale" in printed


def test_what_is_missing_is_asked_for_and_nothing_is_replaced_unasked(tmp_path, pupil, check_error):
    words = ["instrument", str(pupil), "-o", str(tmp_path / "tel.toml"), "--wavelength", "550"]
    check_error(runner.invoke(app, words), ErrorCode.MISSING_VALUE, pupil, "--plate-scale")
    words += ["--plate-scale", "0.05", "--shape", "16", "16"]
    assert runner.invoke(app, words).exit_code == 0
    check_error(runner.invoke(app, words), ErrorCode.EXISTS, tmp_path / "tel-pupil.npz")
    assert runner.invoke(app, [*words, "--overwrite"]).exit_code == 0


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["jwst", "hst"])
def test_a_frame_of_a_space_telescope_is_simulated_and_fitted(tmp_path, preset):
    from astropy.table import QTable

    star = [
        "--scene",
        "star",
        "--x",
        "0.3",
        "--y",
        "-0.2",
        "--locus",
        "mvn",
        "--sigma",
        "0.02",
        "--shear",
        "0.4",
        "--angle",
        "30",
    ]
    frame, results = str(tmp_path / "a.fits"), tmp_path / "results"
    assert runner.invoke(app, ["simulate", frame, "-i", preset, *star]).exit_code == 0
    assert runner.invoke(app, ["process", frame, "-i", preset, "-o", str(results)]).exit_code == 0
    (row,) = QTable.read(results / "results.ecsv")
    assert row["status"] == "ok"
    for name, truth in (("x", 0.3), ("y", -0.2)):
        assert abs(row[name].value - truth) < 4 * row[f"{name}_err"].value
