"""Every command that writes a table obeys the one rule for endings."""

from pathlib import Path

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


@pytest.mark.parametrize("option", ["-o", "--plot"])
def test_a_result_never_replaces_what_the_command_reads(option, tmp_path, monkeypatch, check_error):
    ending = "csv" if option == "-o" else "png"
    monkeypatch.chdir(tmp_path)
    (tmp_path / f"m.{ending}").write_text("t,x,y\n")
    (tmp_path / f"n.{ending}").symlink_to(f"m.{ending}")
    for name in (f"m.{ending}", f"./m.{ending}", f"n.{ending}"):
        arguments = ["motion", f"m.{ending}", option, name, "--overwrite"]
        done = typer.testing.CliRunner().invoke(app, arguments)
        check_error(done, ErrorCode.CONFLICT, Path(name).name)
    assert (tmp_path / f"m.{ending}").read_text() == "t,x,y\n"


def test_a_table_never_replaces_a_frame_of_a_directory(tmp_path, check_error):
    (tmp_path / "a.fits").write_text("a frame")
    arguments = ["estimate", str(tmp_path), "-o", str(tmp_path / "a.fits"), "--overwrite"]
    check_error(typer.testing.CliRunner().invoke(app, arguments), ErrorCode.CONFLICT, "a.fits")
    assert (tmp_path / "a.fits").read_text() == "a frame"
