"""Every command that writes a table obeys the one rule for endings."""

import pytest
import typer.testing

from jitterkit.cli.main import app
from jitterkit.errors import ErrorCode
from jitterkit.report.outputs import TABLES

COMMANDS = {
    "estimate": ["here.fits"],
    "motion": ["here.csv"],
    "photons": [],
    "forecast": [],
    "budget": [],
    "trade": [],
    "crossfit": [],
    "causes": [],
}


def test_all_commands_that_write_a_table_are_known_here():
    commands = typer.main.get_command(app).commands
    found = {name for name, one in commands.items() if any(p.metavar == "FILE.ecsv" for p in one.params)}
    assert found == set(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_refuses_another_ending_before_any_work(command, tmp_path, monkeypatch, check_error):
    monkeypatch.chdir(tmp_path)
    for name in COMMANDS[command]:
        (tmp_path / name).touch()
    done = typer.testing.CliRunner().invoke(app, [command, *COMMANDS[command], "-o", "t.txt"])
    check_error(done, ErrorCode.WRONG_SUFFIX, "t.txt", *TABLES)
