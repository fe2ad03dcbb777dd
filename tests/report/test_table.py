import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from astropy import units
from astropy.table import QTable
from long_run import long_run
from refusals import refused

import jitterkit.report.table
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.refit.result import FitResult, Status
from jitterkit.report.columns import COLUMNS, Column, aberration_column, bind_rows, measured
from jitterkit.report.row import make_row
from jitterkit.report.table import aberration_names, make_table, read_table, write_table


@pytest.fixture(scope="module")
def rows(make_fit):
    fits = [make_row(make_fit(locus)[1], f"{locus}.fits") for locus in ("linear", "stable")]
    odd = make_row(FitResult(Status.UNREADABLE, 'the 2nd, "odd" one\n'), '/a b/"x", <y>--.fits')
    return [odd, *fits, odd]


def test_columns_have_units_and_descriptions(rows):
    table = make_table(rows)
    expected = {"separation": units.arcsec, "theta_err": units.deg, "flux": units.electron,
                "sxy_err": units.arcsec**2, "noll7": units.nm, "jitter_length": units.arcsec}  # fmt: skip
    assert {name: table[name].unit for name in expected} == expected
    assert all(table[name].info.description for name in table.colnames)
    assert table.colnames[:5] == ["file", "frame", "time", "exposure", "status"]
    assert table.colnames[5:7] == ["reason", "message"]
    position = table.colnames.index
    assert position("jitter_length") < position("noll4") < position("noll10") < position("background")


def test_frames_before_the_first_fit_get_nan_aberrations(rows):
    noll4 = make_table(rows)["noll4"].to_value("nm")
    np.testing.assert_array_equal(noll4, [np.nan, 4, 4, np.nan])


def test_a_table_comes_back_from_disk_to_the_last_digit(rows, tmp_path):
    meta = {"versions": {"jax": "0.10"}, "command line": ("jitterkit", "\udcff"), "where": Path("a"), "n": 3}
    table = make_table(rows, meta)
    write_table(tmp_path / "results.ecsv", table)
    again = read_table(tmp_path / "results.ecsv")
    assert again.colnames == table.colnames
    for name in table.colnames:
        assert again[name].unit == table[name].unit
        assert again[name].info.description == table[name].info.description
        np.testing.assert_array_equal(np.asarray(again[name]), np.asarray(table[name]))
    assert again.meta == table.meta
    assert again.meta["command line"] == ["jitterkit", r"\udcff"]
    assert again.meta["flags"][2].startswith("saturated")


def test_astropy_writes_a_results_table_as_fits(rows, tmp_path):
    message = "fitted: chi²/dof is 1.002. Undecided; the separation differs by 3 µas ± 1 µas at 12°, 5″ off."
    write_table(tmp_path / "results.ecsv", make_table([{**rows[1], "message": message}, *rows]))
    with warnings.catch_warnings():  # of metadata that have no place in a header, and of electron
        warnings.simplefilter("ignore")
        QTable.read(tmp_path / "results.ecsv").write(tmp_path / "results.fits")
        back = QTable.read(tmp_path / "results.fits")
    said = "fitted: chi2/dof is 1.002. Undecided; the separation differs by 3 uas +/- 1 uas at 12 deg, 5"
    assert back["message"][0] == said + '" off.'
    assert back["sxx"].unit == units.arcsec**2


def test_a_file_may_be_called_like_a_comment(rows, tmp_path):
    names = ["#1.fits", "# 2.fits", "#", '#"3".fits', "%ECSV"]
    write_table(tmp_path / "results.ecsv", make_table({**rows[0], "file": name} for name in names))
    assert read_table(tmp_path / "results.ecsv")["file"].tolist() == names


def test_a_long_table_is_written_as_astropy_would_at_once(tmp_path):
    table = make_table(long_run(2500, np.random.default_rng(1)), {"command": "jitterkit"})
    write_table(tmp_path / "in_parts.ecsv", table)
    table.write(tmp_path / "at_once.ecsv", format="ascii.ecsv")
    assert (tmp_path / "in_parts.ecsv").read_text() == (tmp_path / "at_once.ecsv").read_text()


def test_a_null_of_a_ledger_is_what_the_column_has_for_nothing(rows):
    nulls = dict.fromkeys(rows[0])
    table = make_table([nulls, rows[1]])
    assert (table["file"][0], table["flags"][0]) == ("", 0)
    assert np.isnan(table["separation"][0])


def test_a_run_without_frames_has_a_table_all_the_same(tmp_path):
    write_table(tmp_path / "none.ecsv", make_table([]))
    again = read_table(tmp_path / "none.ecsv")
    assert len(again) == 0
    assert again.colnames == [column.name for column in COLUMNS]


def test_a_table_is_replaced_only_when_allowed_and_only_whole(rows, tmp_path, monkeypatch):
    path = tmp_path / "results.ecsv"
    write_table(path, make_table(rows))
    before = path.read_bytes()
    with refused(ErrorCode.EXISTS, path, error=FrameError):
        write_table(path, make_table([]))

    lines, calls = jitterkit.report.table._ecsv, []

    def fill_the_disk(part):
        calls.append(len(part))
        if len(calls) > 2:
            raise OSError(28, "No space left on device")
        return lines(part)

    monkeypatch.setattr("jitterkit.report.table._ecsv", fill_the_disk)
    monkeypatch.setattr("jitterkit.report.table._CHUNK", 1)
    with refused(ErrorCode.NOT_WRITABLE, path, "No space left on device", error=FrameError):
        write_table(path, make_table(rows), overwrite=True)
    assert calls == [0, 1, 1]
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_an_aberration_cannot_take_the_place_of_a_column():
    assert [aberration_column(name) for name in ("noll4", "x", "separation", "chi2_dof")] == [
        "noll4", "aberration_x", "aberration_separation", "aberration_chi2_dof",
    ]  # fmt: skip
    assert aberration_names(["x", "x_err", "b2", "b2_err", "b10", "b10_err"]) == ["b2", "b10"]


def test_reading_a_table_loads_neither_jax_nor_matplotlib():
    code = (
        "import sys, jitterkit.report.table, jitterkit.report.summary;"
        "print(*({'jax', 'matplotlib', 'jinja2'} & set(sys.modules)))"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout.strip(), ended.stderr) == (0, "", "")


def test_declared_columns_have_unit_meaning_kind_and_format_with_rows_and_without():
    columns = (Column("n", kind=int), *measured("size", "of it", "mas", format=".1f"), Column("share"))
    for rows in ([], [(1, 2.0, 0.5, 1 / 3)]):
        table = bind_rows(columns, rows, {"command": "made"}, format=".3g")
        assert (table.colnames, len(table)) == (["n", "size", "size_err", "share"], len(rows))
        assert [table[name].dtype.kind for name in table.colnames] == list("ifff")
        assert [table[name].unit for name in ("size", "size_err")] == [units.mas] * 2
        assert [table[name].info.format for name in table.colnames] == [None, ".1f", ".1f", ".3g"]
        assert table["size"].info.description == "of it"
        assert table.meta == {"command": "made"}
    with pytest.raises(ValueError, match="argument 2 is shorter"):
        bind_rows(columns, [(1, 2.0)])
