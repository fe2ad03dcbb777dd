"""``jitterkit trade`` from measured settings to a table and a picture; tests/trade measures them."""

from __future__ import annotations

import numpy as np
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.errors import ErrorCode
from jitterkit.report.table import read_table
from jitterkit.trade import PRESETS
from jitterkit.trade.grid import Point

POINTS = [
    Point("balanced", PRESETS["balanced"], 0.05, 3e-6, 4e-6, 1e-3, 1e-3),
    Point("exact", PRESETS["exact"], 2.0, 0.0, 0.0, 1e-3, 1e-3),
    Point("worse", PRESETS["fast"], 3.0, 3e-5, 4e-5, 1e-3, 1e-3),
    Point("impossible", PRESETS["fast"], message="too little memory"),
]
"""Errors of 5e-3, 0 and 5e-2 of the least: of three, one is beaten by both others in time and error."""


def run(tmp_path, monkeypatch, *more):
    asked = []

    def measure_grid(telescope, scene, *, locus):
        asked.append((telescope.name, locus, scene.truths[0].binary.separation))
        yield from POINTS

    monkeypatch.setattr("jitterkit.trade.measure_grid", measure_grid)
    table, picture = tmp_path / "trade.ecsv", tmp_path / "trade.png"
    given = ["trade", "-i", "plain", "--frames", "1", "-o", str(table), "--plot", str(picture), *more]
    return CliRunner().invoke(app, given), asked, table, picture


def test_every_setting_has_a_row_a_line_and_a_point(tmp_path, monkeypatch):
    done, asked, table, picture = run(tmp_path, monkeypatch, "--separation", "5")
    assert done.exit_code == 0, done.output
    assert asked == [("plain", "linear", 5.0)]
    lines = [line for line in done.stderr.splitlines() if "of the least" in line]
    assert [line.split(":")[0] for line in lines] == ["balanced", "exact", "worse"]
    assert "50.0 ms per frame" in lines[0]
    assert "impossible: too little memory" in done.stderr
    rows = read_table(table)
    assert list(rows["setting"]) == [point.name for point in POINTS]
    assert list(rows["front"]) == [True, True, False, False]
    np.testing.assert_allclose(rows["error"][:3], [5e-3, 0.0, 5e-2])
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_frames_that_stand_still_are_fitted_as_if_nobody_knew(tmp_path, monkeypatch):
    done, asked, *_ = run(tmp_path, monkeypatch, "--locus", "stable")
    assert done.exit_code == 0, done.output
    assert asked == [("plain", "auto", 10.0)]


def test_a_size_of_another_locus_is_refused_before_anything_is_measured(tmp_path, monkeypatch, check_error):
    done, asked, table, _ = run(tmp_path, monkeypatch, "--locus", "linear", "--shear", "0.3")
    check_error(done, ErrorCode.UNKNOWN_NAME, "linear", "--shear", "--length")
    assert asked == []
    assert not table.exists()
