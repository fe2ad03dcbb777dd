"""``jitterkit budget``: the table, and what is refused."""

import numpy as np
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.errors import ErrorCode
from jitterkit.report.table import read_table

runner = CliRunner()
SMALL = ["budget", "-i", "plain", "--separation", "5"]


def test_the_table_is_printed_and_kept(tmp_path):
    path = tmp_path / "budget.ecsv"
    done = runner.invoke(
        app, [*SMALL, "--effect", "flat=0.02", "--frames", "100", "--target", "10uas", "-o", str(path)]
    )
    assert done.exit_code == 0, done.output
    table = read_table(path)
    assert [line.split()[0] for line in done.stdout.splitlines()[3:]] == list(table["effect"])
    assert str(table["bias"].unit) == "uas"
    row = table[table["effect"] == "flat"][0]
    assert row["size"] == 0.02
    np.testing.assert_allclose(row["needed"], 0.02 * 10 / row["bias"].value)
    for one in table:
        sure = 5 / one["sigmas"] if one["sigmas"] else np.inf  # root of the frames that it takes
        assert one["shown_by"] == ("frame" if sure <= 1 else "night" if sure <= 10 else "nothing")
    fitted = set(table["effect"][np.asarray(table["fitted"], bool)])
    assert fitted == {"wavelength", "band", "index_a", "index_b", "background", "gradient"}


def test_a_size_that_is_none_is_refused(check_error):
    check_error(runner.invoke(app, [*SMALL, "--effect", "flat"]), ErrorCode.MALFORMED, "flat")
    check_error(runner.invoke(app, [*SMALL, "--effect", "flat=0"]), ErrorCode.OUT_OF_RANGE, "flat=0")
    check_error(runner.invoke(app, [*SMALL, "--effect", "seeing=1"]), ErrorCode.UNKNOWN_NAME, "seeing")


def test_a_change_that_leaves_no_separation_is_refused(check_error):
    check_error(
        runner.invoke(app, [*SMALL, "--effect", "velocity_aberration=2"]), ErrorCode.OUT_OF_RANGE, "2"
    )


def test_a_pair_outside_of_the_frame_is_refused(check_error):
    check_error(
        runner.invoke(app, ["budget", "-i", "plain", "--separation", "60"]), ErrorCode.OUT_OF_RANGE, "30"
    )
