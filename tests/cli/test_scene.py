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


def test_what_does_not_go_with_a_scene_is_refused(guide, tmp_path, check_error):
    simulate = ["simulate", str(tmp_path / "x.fits"), "-i", "plain", "--scene"]
    check_error(runner.invoke(app, [*simulate, "star", "--theta", "30"]), ErrorCode.CONFLICT, "--theta")
    check_error(runner.invoke(app, [*simulate, "galaxy"]), ErrorCode.UNKNOWN_NAME, "'galaxy'", "star, binary")
    assert not list(tmp_path.iterdir())
    field = ["estimate", str(guide), "--stars", "--scene", "star"]
    check_error(runner.invoke(app, field), ErrorCode.CONFLICT, "--scene")
    unknown = ["process", str(guide), "-i", "plain", "--scene", "galaxy", "-o", str(tmp_path / "out")]
    check_error(runner.invoke(app, unknown), ErrorCode.UNKNOWN_NAME, "'galaxy'", "binary")


def test_a_forecast_for_one_star_knows_no_pair(tmp_path, check_error):
    command = ["forecast", "-i", "plain", "--scene", "star", "--locus", "mvn", "--sigma", "0.2"]
    done = runner.invoke(app, [*command, "-o", str(tmp_path / "f.ecsv")])
    assert done.exit_code == 0, done.output
    assert "position per frame:" in done.output
    assert "separation" not in done.output
    table = QTable.read(tmp_path / "f.ecsv")
    assert not {"separation", "contrast", "theta"} & set(table["parameter"])
    assert {"x", "y", "flux", "mvn_xx", "background"} <= set(table["parameter"])
    check_error(runner.invoke(app, [*command, "--allow", "10%"]), ErrorCode.CONFLICT, "--allow")
    check_error(runner.invoke(app, [*command, "--theta", "3"]), ErrorCode.CONFLICT, "--theta")
    check_error(
        runner.invoke(app, ["forecast", "--scene", "trio"]), ErrorCode.UNKNOWN_NAME, "'trio'", "binary"
    )


def test_a_sequence_is_of_a_pair(guide, tmp_path, check_error):
    command = ["sequence", str(guide), "-i", "plain", "--locus", "mvn", "-o", str(tmp_path / "out")]
    check_error(runner.invoke(app, [*command, "--scene", "star"]), ErrorCode.UNKNOWN_NAME, "'star'", "binary")


FIELD = "x,y,flux\n-5,4,60000\n5,5.5,30000\n5.5,-5,20000\n-3,-6,45000\n"


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    """Two frames of a field of four stars."""
    directory = tmp_path_factory.mktemp("field")
    (directory / "stars.csv").write_text(FIELD)
    command = ["simulate", str(directory / "field.fits"), "-i", "plain", "--scene", "stars"]
    more = ["--stars", str(directory / "stars.csv"), "--background", "5", "--frames", "2", "--seed", "6"]
    motion = ["--locus", "mvn", "--sigma", "0.2", "--shear", "0.3", "--angle", "60"]
    done = runner.invoke(app, [*command, *more, *motion])
    assert done.exit_code == 0, done.output
    return directory


def test_the_stars_of_a_field_are_listed_with_one_jitter_for_all(field, tmp_path):
    header = fits.getheader(field / "field-0.fits")
    assert (header["TRUX"], header["TRUX3"], header["TRUFLU4"]) == (-5.0, 5.0, 20000.0)
    done = runner.invoke(
        app, ["process", str(field), "-i", "plain", "--locus", "mvn", "-o", str(tmp_path / "out")]
    )
    assert done.exit_code == 0, done.output
    table = QTable.read(tmp_path / "out" / "results.ecsv")
    assert list(table["scene"]) == ["stars", "stars"]
    assert np.all(np.isnan(table["separation"].value))
    truth = 0.2**2 * (np.cos(np.radians(60)) ** 2 + 0.49 * np.sin(np.radians(60)) ** 2)
    assert np.all(np.abs(table["sxx"].value - truth) < 4 * table["sxx_err"].value)
    stars = QTable.read(tmp_path / "out" / "stars.ecsv")
    assert list(stars["star"]) == [1, 2, 3, 4] * 2
    for name, expected in {
        "x": [-5, -3, 5, 5.5],
        "y": [4, -6, 5.5, -5],
        "flux": [6e4, 4.5e4, 3e4, 2e4],
    }.items():
        off = stars[name].value - np.tile(expected, 2)
        assert np.all(np.abs(off) < 4.5 * stars[f"{name}_err"].value), name
    first = stars["x"][stars["star"] == 1].value  # the brightest stands for all in a row
    np.testing.assert_allclose(table["x"].value, first, rtol=1e-8)


def test_further_stars_beside_a_pair_are_listed_with_it(field, tmp_path):
    (tmp_path / "third.csv").write_text("x,y,flux\n-6,-5,3000\n")
    pair = ["--separation", "6", "--theta", "30", "--flux", "300000", "--background", "5", "--seed", "2"]
    command = [
        "simulate",
        str(tmp_path / "three.fits"),
        "-i",
        "plain",
        "--stars",
        str(tmp_path / "third.csv"),
    ]
    assert runner.invoke(app, [*command, *pair]).exit_code == 0
    where = ["-i", "plain", "--locus", "mvn", "-o", str(tmp_path / "out")]
    done = runner.invoke(app, ["process", str(tmp_path / "three.fits"), *where])
    assert done.exit_code == 0, done.output
    (row,) = QTable.read(tmp_path / "out" / "results.ecsv")
    assert row["scene"] == "binary"
    assert "1 further star" in row["message"]
    assert abs(row["separation"].value - 6) < 4 * row["separation_err"].value
    third = QTable.read(tmp_path / "out" / "stars.ecsv")[2]
    assert (third["x"].value, third["y"].value) == pytest.approx((-6, -5), abs=0.2)
    assert abs(third["flux"].value - 3000) < 4 * third["flux_err"].value


@pytest.mark.parametrize(
    ("table", "options", "code", "values"),
    [
        (None, [], ErrorCode.NOT_FOUND, ["s.csv"]),
        ("x,y\n1,2\n", [], ErrorCode.MISSING_VALUE, ["'flux'"]),
        ("x,y,flux\n", [], ErrorCode.OUT_OF_RANGE, ["s.csv"]),
        ("x,y,flux\n1,2,-3\n", [], ErrorCode.OUT_OF_RANGE, ["s.csv"]),
        ("x,y,flux\n1,b,3\n", [], ErrorCode.MALFORMED, ["s.csv"]),
        ("x,y,flux\n,2,3e4\n1,2,3e4\n", [], ErrorCode.OUT_OF_RANGE, ["s.csv"]),
        (FIELD, ["--separation", "3"], ErrorCode.CONFLICT, ["--separation", "--scene stars"]),
        (FIELD, ["--flux", "3"], ErrorCode.CONFLICT, ["--flux", "--scene stars"]),
    ],
)
def test_a_table_that_lists_no_stars_is_refused(table, options, code, values, tmp_path):
    if table is not None:
        (tmp_path / "s.csv").write_text(table)
    command = ["simulate", str(tmp_path / "a.fits"), "-i", "plain", "--scene", "stars"]
    done = runner.invoke(app, [*command, "--stars", str(tmp_path / "s.csv"), *options])
    assert done.exit_code == 2
    assert all(value in done.stderr for value in values)
    assert f"[{code.value}]" in done.stderr
    assert not (tmp_path / "a.fits").exists()
