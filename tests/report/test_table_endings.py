"""One rule for the endings of tables: each is what its name says, with units where the format has them."""

import csv
import json
from importlib.util import find_spec

import numpy as np
import pytest
from astropy.io import fits
from astropy.table import QTable
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.report.outputs import TABLES, check_table
from jitterkit.report.table import _WRITERS, write_table

THIRD = 1 / 3
ODD = 'µ² "x",\ny'


@pytest.fixture
def table():
    table = QTable(
        {
            "file": ["a.fits", ODD],
            "sxx": np.array([THIRD, np.nan]) << units("arcsec2"),
            "flux": np.array([1e5, 2e5]) << units("electron"),
            "error": np.array([1.5, 2.5]) << units("uas"),
            "frame": [0, 1],
            "kept": [True, False],
        },
        meta={"command": "jitterkit ü", "versions": {"jax": "1", "list": [1, None]}, "flags": {1: "χ²"}},
    )
    table["sxx"].info.format = ".2g"  # for the terminal
    table["sxx"].info.description = "second moment, ″²"
    return table


def units(name):
    from astropy.units import Unit

    return Unit(name)


def test_every_ending_has_a_writer():
    assert set(_WRITERS) == set(TABLES)


def test_csv_is_a_line_of_names_and_one_for_each_row(table, tmp_path):
    write_table(tmp_path / "t.csv", table)
    with open(tmp_path / "t.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    assert rows[0] == table.colnames
    assert len(rows) == 3
    assert rows[2][0] == ODD
    assert float(rows[1][1]) == THIRD
    assert rows[1][2:] == ["100000.0", "1.5", "0", "True"]


def test_spaces_about_a_name_stay_in_csv(table, tmp_path):
    table["file"] = [" a.fits", "b.fits "]
    write_table(tmp_path / "t.csv", table)
    with open(tmp_path / "t.csv", newline="", encoding="utf-8") as file:
        assert [row[0] for row in csv.reader(file)] == ["file", " a.fits", "b.fits "]


def test_a_name_may_be_as_long_as_the_file_system_allows(table, tmp_path):
    path = tmp_path / ("x" * 250 + ".ecsv")
    write_table(path, table)
    assert len(QTable.read(path)) == 2


@pytest.mark.parametrize("ending", ["ecsv", "fits", "parquet"])
def test_numbers_and_units_survive(ending, table, tmp_path):
    if ending == "parquet":
        pytest.importorskip("pyarrow")
    write_table(tmp_path / f"t.{ending}", table)
    again = QTable.read(tmp_path / f"t.{ending}")
    assert again.colnames == table.colnames
    for name in ("sxx", "flux", "error", "frame", "kept"):
        wanted = getattr(table[name], "unit", None)
        found = again[name].to_value(wanted) if wanted else np.asarray(again[name])
        np.testing.assert_allclose(found, np.asarray(table[name]), rtol=1e-15)


def test_text_that_fits_cannot_hold_is_escaped(table, tmp_path):
    write_table(tmp_path / "t.fits", table)
    with fits.open(tmp_path / "t.fits") as hdus:
        assert list(hdus[1].data["file"]) == ["a.fits", ODD.encode("ascii", "backslashreplace").decode()]
        comments = "".join(hdus[1].header["COMMENT"])
        assert hdus[1].header["TUNIT2"] == "arcsec2"
    assert "jitterkit \\u00fc" in comments
    assert table["file"][1] == ODD  # the caller's own


def test_json_has_units_and_rows(table, tmp_path):
    write_table(tmp_path / "t.json", table)
    found = json.loads((tmp_path / "t.json").read_text(encoding="utf-8"))
    assert found["units"] == {"sxx": "arcsec2", "flux": "electron", "error": "uas"}
    assert found["rows"][0] == {
        "file": "a.fits", "sxx": THIRD, "flux": 1e5, "error": 1.5, "frame": 0, "kept": True,
    }  # fmt: skip
    assert (found["rows"][1]["file"], found["rows"][1]["sxx"]) == (ODD, None)
    assert found["meta"]["versions"] == {"jax": "1", "list": [1, None]}


@pytest.mark.parametrize("name", ["t.txt", "t", "t.ecsv.gz", "csv"])
def test_any_other_ending_is_refused_and_those_there_are_are_named(name, table, tmp_path):
    for refusing in (lambda path: write_table(path, table), lambda path: check_table(path, overwrite=True)):
        with refused(ErrorCode.WRONG_SUFFIX, tmp_path / name, *TABLES):
            refusing(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_capitals_are_no_other_ending(table, tmp_path):
    write_table(tmp_path / "T.CSV", table)
    assert (tmp_path / "T.CSV").read_text(encoding="utf-8").startswith("file,sxx")


@pytest.mark.skipif(find_spec("pyarrow") is not None, reason="tells that it is missing")
def test_a_package_that_is_missing_is_reported_before_any_work(tmp_path):
    with refused(ErrorCode.MISSING_PACKAGE, tmp_path / "t.parquet", "pyarrow", "jitterkit[parquet]"):
        check_table(tmp_path / "t.parquet", overwrite=False)
