"""``--scene``: one star or a pair, from simulated frames to tables."""

import re

import numpy as np
import pytest
from astropy.io import fits
from astropy.table import QTable
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.errors import ErrorCode

runner = CliRunner()


@pytest.fixture(scope="module")
def guide(tmp_path_factory):
    """Two frames of a guide star that is not where the frame has its centre."""
    directory = tmp_path_factory.mktemp("guide")
    command = ["simulate", str(directory / "guide.fits"), "-i", "plain", "--scene", "star"]
    motion = ["--locus", "mvn", "--sigma", "0.25", "--shear", "0.4", "--angle", "30"]
    done = runner.invoke(app, [*command, *motion, "--x", "1.5", "--frames", "2", "--seed", "4"])
    assert done.exit_code == 0, done.output
    return directory


def test_a_star_has_no_pair_in_its_header(guide):
    header = fits.getheader(guide / "guide-0.fits")
    assert header["TRUX"] == 1.5
    assert not {"TRUSEP", "TRUTHETA", "TRUCONT"} & set(header)


def test_a_star_is_processed_without_a_word_about_it(guide, tmp_path):
    done = runner.invoke(
        app, ["process", str(guide), "-i", "plain", "--locus", "mvn", "-o", str(tmp_path / "out")]
    )
    assert done.exit_code == 0, done.output
    assert "jitter, 1 sigma" in done.stdout
    assert "separation" not in done.stdout
    table = QTable.read(tmp_path / "out" / "results.ecsv")
    assert list(table["scene"]) == ["star", "star"]
    assert np.all(np.isnan(table["separation"].value))
    truth = 0.25**2 * (np.cos(np.radians(30)) ** 2 + 0.36 * np.sin(np.radians(30)) ** 2)
    assert np.all(np.abs(table["sxx"].value - truth) < 4 * table["sxx_err"].value)
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "guide-0.fits" in report
    text = re.sub(r"<[^>]*>", " ", report)
    assert "Jitter, 1σ" in text
    assert not re.search(r"\b(nan|Separation|Contrast)\b", text)


def test_an_estimate_is_as_near_the_truth(guide, tmp_path):
    done = runner.invoke(app, ["estimate", str(guide), "-i", "plain", "-o", str(tmp_path / "kernels.ecsv")])
    assert done.exit_code == 0, done.output
    table = QTable.read(tmp_path / "kernels.ecsv")
    assert list(table["scene"]) == ["star", "star"]
    truth = 0.25**2 * (np.cos(np.radians(30)) ** 2 + 0.36 * np.sin(np.radians(30)) ** 2)
    assert np.all(np.abs(table["sxx"].value - truth) < 4 * table["sxx_err"].value)


def test_a_pair_that_is_asked_for_is_not_found_in_one_star(guide, tmp_path):
    command = ["process", str(guide), "-i", "plain", "--locus", "mvn", "--scene", "binary"]
    done = runner.invoke(app, [*command, "-o", str(tmp_path / "out")])
    assert done.exit_code == 1
    assert not set(QTable.read(tmp_path / "out" / "results.ecsv")["status"]) & {"ok"}


def test_what_does_not_go_with_a_scene_is_refused(guide, tmp_path, told):
    simulate = ["simulate", str(tmp_path / "x.fits"), "-i", "plain", "--scene"]
    told(runner.invoke(app, [*simulate, "star", "--theta", "30"]), ErrorCode.CONFLICT, "--theta")
    told(runner.invoke(app, [*simulate, "galaxy"]), ErrorCode.UNKNOWN_NAME, "'galaxy'", "star, binary")
    assert not list(tmp_path.iterdir())
    field = ["estimate", str(guide), "--stars", "--scene", "star"]
    told(runner.invoke(app, field), ErrorCode.CONFLICT, "--scene")
    unknown = ["process", str(guide), "-i", "plain", "--scene", "galaxy", "-o", str(tmp_path / "out")]
    told(runner.invoke(app, unknown), ErrorCode.UNKNOWN_NAME, "'galaxy'", "binary")
