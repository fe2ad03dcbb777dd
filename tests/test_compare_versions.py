"""The judge of versions: every kind of difference is found, in its unit and with its row."""

import json
import math
import runpy
from pathlib import Path

import compare_inputs
import compare_reference
import numpy as np
import pytest
from astropy.table import Table
from compare_columns import compare
from compare_report import TaskResult, as_json, markdown
from compare_runs import Run, Times, clean, run
from compare_tasks import FULL, QUICK, Sizes, make_tasks, read_options, select
from compare_values import Values, from_table, numbers, read_output, read_values, write_values

SCRIPTS = Path(__file__).parents[1] / "scripts"
KEYS = ("file", "frame")
ROWS = 4


def table(**columns) -> Values:
    """Four frames that were fitted, with some columns replaced or added."""
    frames = {
        "file": np.array(["a.fits", "a.fits", "b.fits", "c.fits"]),
        "frame": np.array(["0", "1", "0", "0"]),
        "status": np.full(ROWS, "ok"),
        "message": np.full(ROWS, "", dtype="U40"),
        "locus": np.full(ROWS, "mvn", dtype="U8"),
        "evidences": np.full(ROWS, "mvn:-10.0 linear:-12.0"),
        "separation": np.array([9.0, 9.1, 9.2, 9.3]),
        "separation_err": np.array([1e-3, 2e-3, 1e-3, 4e-3]),
    }
    return Values(KEYS, frames | {name: np.asarray(column) for name, column in columns.items()})


def replaced(name: str, row: int, value) -> Values:
    """The same frames, with one cell replaced."""
    column = table().columns[name].astype("U40" if isinstance(value, str) else float)
    column[row] = value
    return table(**{name: column})


def column(found, name):
    """The difference of one column."""
    return next(difference for difference in found.columns if difference.name == name)


def test_a_table_agrees_with_itself():
    found = compare(table(), table())
    assert found.agrees(0.0)
    assert found.compared == found.rows == ROWS
    assert {c.name for c in found.columns} == {"separation", "separation_err"}


def test_a_shift_is_found_in_units_of_the_old_error_with_its_row():
    old, new = table(), replaced("separation", 1, 9.1 + 0.1 * 2e-3)
    found = column(compare(old, new), "separation")
    assert found.unit == "error"
    assert found.row == "a.fits 1"
    assert found.largest == pytest.approx(0.1, rel=1e-9)
    assert found.rms == pytest.approx(0.1 / math.sqrt(ROWS), rel=1e-9)
    assert compare(old, new).agrees(0.11)
    assert not compare(old, new).agrees(0.09)


def test_rows_are_matched_by_file_and_frame():
    order = [3, 1, 0, 2]
    new = Values(KEYS, {name: cells[order] for name, cells in table().columns.items()})
    assert compare(table(), new).agrees(0.0)


def test_an_error_is_compared_by_its_ratio():
    found = column(compare(table(), replaced("separation_err", 3, 4.4e-3)), "separation_err")
    assert found.unit == "ratio"
    assert found.largest == pytest.approx(0.1)
    assert found.row == "c.fits 0"


@pytest.mark.parametrize(
    ("name", "old", "new", "error", "away"),
    [
        ("theta", 359.99, 0.01, 0.1, 0.2),
        ("pa", 0.02, 359.98, 0.1, 0.4),
        ("theta", 10.0, 190.0, 90.0, 2.0),
        ("angle", 179.9, 0.1, 0.1, 2.0),
        ("angle", 10.0, 190.0, 0.1, 0.0),
        ("contrast", 359.99, 0.01, 359.98, 1.0),
    ],
)
def test_angles_are_near_across_the_end_of_their_range(name, old, new, error, away):
    tables = [
        table(**{name: np.full(ROWS, value), f"{name}_err": np.full(ROWS, error)}) for value in (old, new)
    ]
    assert column(compare(*tables), name).largest == pytest.approx(away, abs=1e-9)


def test_the_axis_of_a_round_blur_does_not_count():
    blur = {f"{name}_err": np.full(ROWS, 1e-4) for name in ("sxx", "sxy", "syy")}
    blur |= {"sxx": np.array([0.01, 0.01, 0.01, 0.005]), "sxy": np.array([0.0, 0.0, 0.0, 0.005])}
    blur |= {"syy": np.array([0.01, 0.0099, 0.0, 0.005])}
    angle = np.array([0.0, 0.0, 179.0, 45.0])
    # an axis turned by a degree shifts sxy by pi/180 times the difference of the variances along both axes
    degree = math.pi / 180 * 0.01 / 1e-4
    for turn, row, expected in (
        ([80.0, 10.0, 2.0, 1.0], "b.fits 0", 2 * degree),
        ([80.0, 10.0, 1.0, 2.0], "c.fits 0", 2 * degree),
        ([80.0, 10.0, 0.0, 0.0], "a.fits 1", 10 * degree / 100),
    ):
        new = table(**blur, jitter_angle=(angle + turn) % 180)
        found = column(compare(table(**blur, jitter_angle=angle), new), "jitter_angle")
        assert (found.row, found.largest) == (row, pytest.approx(expected))


def test_a_minor_axis_near_zero_has_the_error_of_the_moments():
    blur = {f"{name}_err": np.full(ROWS, 1e-4) for name in ("sxx", "sxy", "syy")}
    old = table(**blur, jitter_minor=np.zeros(ROWS))
    new = table(**blur, jitter_minor=np.array([0.0, 1e-3, 0.0, 0.0]))
    assert column(compare(old, new), "jitter_minor").largest == pytest.approx(1e-2)


def test_chi_squared_is_counted_in_its_own_scatter():
    old = table(chi2_dof=np.ones(ROWS), dof=np.full(ROWS, 20000.0))
    new = table(chi2_dof=np.array([1.0, 1.0, 1.02, 1.0]), dof=np.full(ROWS, 20000.0))
    assert column(compare(old, new), "chi2_dof").largest == pytest.approx(2.0)


def test_other_numbers_are_relative_to_what_is_usual_in_their_column():
    old, new = table(rate=[1.0, 2.0, 1e-20, 2.0]), table(rate=[1.0, 2.0, 0.0, 2.2])
    found = column(compare(old, new), "rate")
    assert (found.unit, found.row) == ("relative", "c.fits 0")
    assert found.largest == pytest.approx(0.1)


def test_a_status_that_differs_is_listed_and_its_numbers_are_left_out():
    new = replaced("status", 2, "failed")
    new.columns["message"] = np.array(["", "", "broke down", ""])
    new.columns["separation"] = np.array([9.0, 9.1, 77.0, 9.3])
    found = compare(table(), new)
    (listed,) = found.statuses
    assert (listed.row, listed.old, listed.new) == ("b.fits 0", "ok", "failed")
    assert listed.new_message == "broke down"
    assert column(found, "separation").largest == 0.0
    assert found.compared == ROWS - 1
    assert not found.agrees(1e9)


def test_a_frame_that_no_version_fitted_is_no_difference():
    tables = [replaced("status", 0, "no_star") for _ in range(2)]
    tables[0].columns["separation"][0] = np.nan
    assert compare(*tables).agrees(0.0)


def test_a_number_in_one_version_only_is_listed():
    found = compare(table(), replaced("separation", 1, np.nan))
    (listed,) = found.not_numbers
    assert (listed.row, listed.column, listed.old, listed.new) == ("a.fits 1", "separation", "9.1", "nan")
    assert column(found, "separation").rows == ROWS - 1
    assert not found.agrees(1e9)


def test_no_number_in_both_versions_is_equal():
    tables = [table(background=np.full(ROWS, np.nan)) for _ in range(2)]
    assert compare(*tables).agrees(0.0)


def test_loci_that_differ_are_listed_apart_with_their_evidences():
    new = replaced("locus", 3, "linear")
    new.columns["separation"] = np.array([9.0, 9.1, 9.2, 9.308])
    new.columns["evidences"] = np.array(["", "", "", "linear:-9.0 mvn:-10.5"])
    found = compare(table(), new)
    (listed,) = found.loci
    assert (listed.row, listed.old, listed.new) == ("c.fits 0", "mvn", "linear")
    assert (listed.old_evidences, listed.new_evidences) == ("mvn:-10.0 linear:-12.0", "linear:-9.0 mvn:-10.5")
    assert listed.shift == pytest.approx(2.0)
    assert column(found, "separation").largest == 0.0
    assert not found.agrees(1e9)


def test_a_column_that_is_missing_is_a_difference_and_a_new_one_is_not():
    more = table(code=np.full(ROWS, "E1"))
    assert compare(more, table()).missing_columns == ("code",)
    assert not compare(more, table()).agrees(1e9)
    assert compare(table(), more).new_columns == ("code",)
    assert compare(table(), more).agrees(0.0)


def test_rows_of_one_version_only_are_listed():
    fewer = Values(KEYS, {name: cells[:-1] for name, cells in table().columns.items()})
    assert compare(table(), fewer).missing_rows == ("c.fits 0",)
    assert compare(fewer, table()).new_rows == ("c.fits 0",)
    assert not compare(table(), fewer).agrees(1e9)
    assert not compare(fewer, table()).agrees(1e9)


def test_flags_are_compared_as_they_are():
    old, new = (table(flags=np.array(flags)) for flags in (["0", "2", "0", "0"], ["0", "6", "0", "0"]))
    (listed,) = compare(old, new).texts
    assert (listed.row, listed.old, listed.new) == ("a.fits 1", "2", "6")
    assert not compare(old, new).agrees(1e9)


def test_single_numbers_have_the_error_beside_their_mean():
    old = numbers({"theta": {"mean": 359.9, "error": 0.1}, "seconds": 3.0, "counts": [1, 2]})
    new = numbers({"theta": {"mean": 0.1, "error": 0.1}, "seconds": 9.0, "counts": [1, 2], "more": 1})
    found = compare(old, new)
    assert "seconds" not in old.columns["name"]
    assert (column(found, "value").unit, column(found, "value").row) == ("error", "theta.mean")
    assert column(found, "value").largest == pytest.approx(2.0)
    assert (found.new_columns, found.new_rows) == (("more",), ())


def test_a_table_of_frames_is_read_without_what_may_differ(tmp_path):
    candidates = '[{"locus": "mvn", "evidence": -8.5}, {"locus": "shm", "evidence": -9.25}]'
    written = Table(
        {
            "file": ["a.fits", "b.fits"],
            "frame": [0, 0],
            "status": ["ok", "failed"],
            "message": ["fitted", "broke down"],
            "flags": [2, 0],
            "dof": [16366, 0],
            "x": [0.5, np.nan],
            "candidates": [candidates, ""],
            "seconds": [1.0, 2.0],
        }
    )
    written.write(tmp_path / "t.ecsv", format="ascii.ecsv")
    found = read_output(tmp_path / "t.ecsv", KEYS).columns
    assert found.keys() == {*written.colnames, "evidences"} - {"candidates", "seconds"}
    assert found["evidences"].tolist() == ["mvn:-8.5 shm:-9.25", ""]
    assert found["message"].tolist() == ["", "broke down"]
    assert found["flags"].tolist() == ["2", "0"]
    assert found["frame"].tolist() == ["0", "0"]
    assert found["dof"].tolist() == [16366.0, 0.0]
    assert from_table(written, KEYS).columns.keys() == found.keys()
    with pytest.raises(ValueError, match="'parameter'"):
        from_table(written, ("parameter",))


def test_a_reference_keeps_values_to_a_millionth_of_their_errors(tmp_path):
    rng = np.random.default_rng(7)
    error = 10 ** rng.uniform(-6, 3, ROWS)
    old = table(x=rng.normal(0, 1e3, ROWS), x_err=error, rate=rng.normal(0, 1e-5, ROWS), flags=list("0248"))
    write_values(tmp_path / "v.csv", old)
    kept = read_values(tmp_path / "v.csv", KEYS)
    assert {name: cells.dtype.kind for name, cells in kept.columns.items()} == {
        name: cells.dtype.kind for name, cells in old.columns.items()
    }
    assert compare(old, kept).agrees(5.1e-7)
    assert (tmp_path / "v.csv").stat().st_size < 500


def test_ratios_are_medians_over_the_pairs():
    def of(cpu: float, memory: float = 100.0) -> Run:
        return Run(cpu, cpu, memory, 0, "")

    pairs = ((of(1.0), of(2.0, 150.0)), (of(10.0), of(11.0, 110.0)), (of(2.0), of(3.0, 120.0)))
    times = Times((of(5.0), of(6.0)), pairs)
    assert times.ratio("cpu") == 1.5
    assert times.ratio("memory") == 1.2
    assert times.typical("cpu") == (2.0, 3.0)
    assert math.isnan(Times((of(5.0), of(6.0)), ()).ratio("cpu"))


def test_a_run_is_measured_with_its_children(tmp_path):
    busy = "i=0; while [ $i -lt 30000 ]; do i=$((i+1)); done; echo end >&2; exit 3"
    done = run(["sh", "-c", f"sh -c '{busy}'; exit $?"], tmp_path, tmp_path, tmp_path / "log")
    assert (done.status, done.said) == (3, "end")
    assert done.cpu > 0
    assert done.memory > 0.5


def test_a_child_has_a_cache_of_its_own_and_no_coverage(monkeypatch, tmp_path):
    monkeypatch.setenv("COVERAGE_PROCESS_START", "x")
    monkeypatch.setenv("PYTHONPATH", "x")
    assert clean(tmp_path)["JITTERKIT_CACHE"] == str(tmp_path)
    assert not {"COVERAGE_PROCESS_START", "PYTHONPATH"} & clean(tmp_path).keys()


def test_the_report_names_what_differs():
    new = replaced("status", 2, "failed")
    new.columns["separation"][1] += 1e-3
    results = [
        TaskResult("process", "", {"frames": compare(table(), new)}),
        TaskResult("sequence", "no table"),
    ]
    text = markdown(results, 0.05, ["OLD: one"])
    assert "**DIFFER**" in text
    assert "Status of b.fits 0: 'ok' -> 'failed'" in text
    assert "| separation | error | 3 | 0.289 | 0.5 | a.fits 1 |" in text
    assert "sequence: no table" in text
    record = json.loads(json.dumps(as_json(results, 0.05, {}), allow_nan=False))
    assert [task["agrees"] for task in record["tasks"]] == [False, False]


def test_options_go_to_the_commands_of_new_only():
    tasks = make_tasks(FULL)
    options = read_options(["process=--no-background --preset exact"], tasks)
    for task in tasks:
        more = task.words("out", options)[len(task.words("out")) :]
        assert more == (["--no-background", "--preset", "exact"] if task.command == "process" else [])
    one = read_options(["motion_trace=--no-loss", "sequence=--diffusion"], tasks)
    assert [task.name for task in tasks if task.words("out", one)[-1] == "--no-loss"] == ["motion_trace"]
    (sequence,) = select(tasks, ["sequence"])
    assert sequence.words("out", one).count("--diffusion") == 1
    for wrong in ("process", "nothing=--x"):
        with pytest.raises(ValueError, match=repr(wrong)):
            read_options([wrong], tasks)


def test_tasks_are_chosen_by_their_names_or_commands():
    tasks = make_tasks(QUICK)
    assert len({task.name for task in tasks}) == len(tasks)
    assert [task.name for task in select(tasks, ["sequence", "motion_trace"])] == ["sequence", "motion_trace"]
    assert {task.command for task in select(tasks, ["process"])} == {"process"}
    with pytest.raises(ValueError, match="'proces'"):
        select(tasks, ["proces"])


def test_the_digest_of_inputs_sees_one_pixel(tmp_path):
    sizes = Sizes(fields=1, stars=3, side=90)
    for name in ("one", "other"):
        compare_inputs.make_inputs(tmp_path / name, sizes, None, {"stars", "sample", "motion"})
    first = compare_inputs.digests(tmp_path / "one")
    assert compare_inputs.digests(tmp_path / "other") == first
    with compare_inputs.fits.open(tmp_path / "other" / "stars" / "sharp.fits", mode="update") as file:
        file[0].data[3, 4] += 1
    second = compare_inputs.digests(tmp_path / "other")
    assert {name for name in first if first[name] != second[name]} == {"stars"}


def test_inputs_that_differ_from_the_references_are_not_compared():
    task = select(make_tasks(QUICK), ["estimate_stars"])[0]
    record = {"exit_status": {task.name: 0}, "inputs": {"stars": "one"}}
    reference = compare_reference.Reference(Path(), record)
    result = compare_reference.against_reference(task, None, reference, Path(), {"stars": "other"}, {})
    assert "DIFFER" in result.problem
    assert not result.agrees(1e9)


@pytest.fixture
def script():
    """The names of the script itself."""
    return runpy.run_path(str(SCRIPTS / "compare_versions"))


PROGRAM = """#!/bin/sh
for word; do
    [ "$before" = -o ] && out=$word
    before=$word
done
[ "$word" = --break ] && exit 2
cp "${0%/*}/table.ecsv" "$out"
[ "$word" != --late ]
"""


def fake_environment(directory: Path, separation: float) -> Path:
    """An environment whose jitterkit writes one table; --break and --late make it fail before and after."""
    (directory / "bin").mkdir(parents=True)
    python, jitterkit = directory / "bin" / "python", directory / "bin" / "jitterkit"
    asked = f'["9", "{directory}/jitterkit/__init__.py"]'
    python.write_text(
        f"#!/bin/sh\ncase $3 in *find_spec*) echo '{asked}';; *) shift 3; exec {jitterkit} \"$@\";; esac\n"
    )
    jitterkit.write_text(PROGRAM)
    for path in (python, jitterkit):
        path.chmod(0o755)
    Table({"separation": [separation]}).write(directory / "bin" / "table.ecsv", format="ascii.ecsv")
    return directory


def test_the_exit_status_tells_whether_two_environments_agree(script, tmp_path, capsys):
    environments = [fake_environment(tmp_path / name, s) for name, s in (("a", 2.0), ("b", 2.2))]
    common = ["--only", "forecast_sweep", "--pairs", "1", "-o", str(tmp_path / "out")]
    a, b = map(str, environments)
    assert script["main"]([a, a, *common]) == 0
    assert "**agree**" in capsys.readouterr().out
    assert script["main"]([a, b, *common]) == 1
    assert script["main"]([a, b, *common, "--tolerance", "0.11"]) == 0
    assert script["main"]([a, a, *common, "--new-options", "forecast=--break"]) == 1
    assert "wrote no table.ecsv (exit status 2)" in (tmp_path / "out" / "comparison.md").read_text()
    assert script["main"]([a, a, *common, "--new-options", "forecast=--late"]) == 1
    assert "exit_status differs in 1 rows: 0: '0' -> '1'" in (tmp_path / "out" / "comparison.md").read_text()
    assert script["main"]([a, str(tmp_path / "none"), *common]) == 2
    assert "There is no environment" in capsys.readouterr().err


def test_a_directory_of_others_is_left_alone(script, tmp_path):
    (tmp_path / "mine").write_text("x")
    with pytest.raises(ValueError, match=str(tmp_path)):
        script["prepare"](tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


@pytest.mark.parametrize(
    "words", [[], ["a", "b", "c"], ["--write-reference", "a", "b"], ["a", "b", "--pairs", "-1"]]
)
def test_wrong_usage_ends_with_status_2(script, words, capsys):
    with pytest.raises(SystemExit, match="2"):
        script["main"](words)
    assert "usage:" in capsys.readouterr().err


REFERENCES = sorted((SCRIPTS / "versions_reference").glob("*/reference.json"))


def test_the_reference_is_of_version_0_1_9():
    assert {path.parent.name for path in REFERENCES} == {"full", "quick"}
    for path in REFERENCES:
        record = json.loads(path.read_text())
        assert (record["version"], record["commit"]) == ("0.1.9", "4130506")
        assert record["inputs"].keys() == set(compare_inputs.SETS)


@pytest.mark.parametrize(("size", "sizes"), [("full", FULL), ("quick", QUICK)])
def test_every_reference_file_is_read_and_holds_numbers(size, sizes):
    directory = SCRIPTS / "versions_reference" / size
    reference = compare_reference.read_reference(directory.parent, size)
    expected = {compare_reference.RECORD}
    for task in make_tasks(sizes):
        for output in task.outputs:
            expected.add(compare_reference.file_name(task, output))
            values = reference.values(task, output)
            assert len(values.rows()) > 0
            floats = [cells for cells in values.columns.values() if cells.dtype.kind == "f"]
            assert any(np.isfinite(cells).any() for cells in floats)
            assert compare(values, values).agrees(0.0)
            assert set(output.keys) <= values.columns.keys()
    assert {path.name for path in directory.iterdir()} == expected


def test_the_sample_frames_are_those_of_the_reference(tmp_path):
    compare_inputs.make_inputs(tmp_path, FULL, None, {"sample", "motion"})
    found = compare_inputs.digests(tmp_path)
    inputs = json.loads((SCRIPTS / "versions_reference" / "full" / "reference.json").read_text())["inputs"]
    assert {name: found[name] for name in ("sample", "motion")} == {
        name: inputs[name] for name in ("sample", "motion")
    }


def test_a_row_that_is_there_twice_is_refused():
    twice = Values(KEYS, {name: np.append(cells, cells[:1]) for name, cells in table().columns.items()})
    with pytest.raises(ValueError, match=r"NEW has more than one row 'a\.fits 0'"):
        compare(table(), twice)


def test_versions_that_both_fitted_nothing_do_not_agree():
    failed = table(status=np.full(ROWS, "failed"))
    assert compare(failed, failed).compared == 0
    assert not compare(failed, failed).agrees(1.0)


def test_an_infinite_error_hides_no_difference():
    old = table(separation_err=np.full(ROWS, np.inf))
    new = table(separation=np.array([9.0, 9.1, 9.2, 18.6]), separation_err=np.full(ROWS, np.inf))
    assert column(compare(old, new), "separation").largest == pytest.approx(1.0)


def test_axes_without_errors_are_compared_by_their_squares():
    old, new = (table(jitter_major=np.full(ROWS, size)) for size in (0.10, 0.11))
    assert column(compare(old, new), "jitter_major").largest == pytest.approx(0.21)
