"""Functions as commands: groups of options, help from docstrings, and errors as exit statuses."""

from dataclasses import dataclass
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from jitterkit.cli.command import Default, Fixed, as_command
from jitterkit.cli.main import app
from jitterkit.errors import ConfigurationError, ErrorCode


@dataclass(frozen=True, kw_only=True)
class Ellipse:
    """Describe an ellipse.

    Parameters
    ----------
    major : LENGTH
        Semi-major axis,
        metres.
    minor
        Semi-minor axis.
    """

    major: float = 2.0
    minor: float = 1.0
    filled: bool = False


def draw(
    *,
    name: Annotated[str, typer.Argument()],
    shape: Annotated[Ellipse, Default(major=5.0), Fixed(filled=True)],
    colour: str = "red",
) -> None:
    """Draw a shape.

    It is printed.

    Parameters
    ----------
    name : NAME
        Name of the drawing.
    minor
        Height of the ellipse [mas].
    """
    if name == "nothing":
        raise ConfigurationError(ErrorCode.UNKNOWN_NAME, "There is no shape 'nothing'.")
    if name == "interrupted":
        raise KeyboardInterrupt
    typer.echo(f"{name} {shape} {colour}")


def run(*arguments):
    single = typer.Typer()
    single.command()(as_command(draw))
    return CliRunner().invoke(single, arguments)


def options():
    single = typer.Typer()
    single.command()(as_command(draw))
    return {option.name: option for option in typer.main.get_command(single).params}


def test_the_fields_of_a_group_stand_in_its_place():
    assert [name for name in options() if "completion" not in name] == ["name", "major", "minor", "colour"]


def test_a_unit_in_brackets_stands_in_the_help():
    assert "Height of the ellipse [mas]." in " ".join(run("--help").stdout.replace("│", " ").split())


def test_a_group_is_built_from_its_options_changed_defaults_and_fixed_values():
    assert run("x").stdout == f"x {Ellipse(major=5.0, filled=True)} red\n"
    done = run("x", "--major", "3", "--minor", "0.5", "--colour", "blue")
    assert done.stdout == f"x {Ellipse(major=3.0, minor=0.5, filled=True)} blue\n"
    assert run("x", "--filled").exit_code == 2


def test_help_is_that_of_the_docstrings_and_the_command_has_precedence():
    found = options()
    assert (found["major"].metavar, found["major"].help) == ("LENGTH", "Semi-major axis, metres.")
    assert found["minor"].help == r"Height of the ellipse \[mas]."
    text = run("--help").stdout
    assert "It is printed." in text
    assert "Parameters" not in text
    assert "default: 5.0" in text


def test_errors_are_a_line_with_the_code_and_exit_statuses():
    done = run("nothing")
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.stderr == "jitterkit: There is no shape 'nothing'. [unknown_name]\n"
    assert run("interrupted").exit_code == 130


@pytest.mark.parametrize("number", ["nan", "inf", "-inf", "1e400", "1e300", "-1e-300"])
def test_no_option_takes_a_number_whose_square_is_not_finite_or_nothing(number):
    done = run("x", "--minor", number)
    assert (done.exit_code, done.stdout) == (2, "")
    assert f"--minor = {float(number):g} " in done.stderr
    assert "[out_of_range]" in done.stderr


@pytest.mark.parametrize("command", sorted(typer.main.get_command(app).commands))
def test_every_option_of_every_command_has_help(command):
    for option in typer.main.get_command(app).commands[command].params:
        assert option.help, option.name


@pytest.mark.parametrize(
    ("arguments", "code", "named"),
    [
        ("forecast -i plain --fitted mvn", ErrorCode.CONFLICT, "--fitted"),
        ("forecast -i plain --fitted mvn --allow 10%", ErrorCode.CONFLICT, "--fitted"),
        ("forecast -i plain --target 1uas --allow 10%", ErrorCode.CONFLICT, "--target"),
        ("forecast -i plain --target 1uas --scene star", ErrorCode.CONFLICT, "--target"),
        ("forecast -i plain --flux 1e5 --sweep flux=1e5,1e6", ErrorCode.CONFLICT, "--flux"),
        (
            "forecast -i plain --locus linear --length 1 --sweep length=1,2",
            ErrorCode.CONFLICT,
            "--length is replaced by --sweep length",
        ),
        ("simulate a.fits -i plain --scatter --dither 1", ErrorCode.CONFLICT, "--dither"),
        ("simulate a.fits -i plain --scatter --theta 1", ErrorCode.CONFLICT, "--theta"),
        ("simulate a.fits -i plain --kind bins", ErrorCode.CONFLICT, "--kind"),
        ("photons --spectrum-a a --spectrum-b b --temperatures 5 6", ErrorCode.CONFLICT, "--temperatures"),
        ("calibrate -o out --flat a --gain 2", ErrorCode.CONFLICT, "--gain"),
        ("calibrate -o out --bias a --bias-level 2", ErrorCode.CONFLICT, "--bias-level"),
        ("calibrate -o out --bias a --exposure 2", ErrorCode.CONFLICT, "--exposure"),
        ("calibrate -o out --flat a --hot 9", ErrorCode.CONFLICT, "--hot"),
        ("calibrate -o out --dark a --dead 0.4", ErrorCode.CONFLICT, "--dead"),
        ("calibrate -o out --bias a --smooth", ErrorCode.CONFLICT, "--smooth"),
        ("estimate a.fits -i plain --no-stars", ErrorCode.CONFLICT, "--no-stars"),
        ("estimate a.fits --reference roundest --no-stars", ErrorCode.CONFLICT, "--no-stars"),
    ],
)
def test_an_option_without_effect_is_refused(arguments, code, named, tmp_path, monkeypatch, check_error):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.fits").touch()
    words = arguments.split()
    check_error(CliRunner().invoke(app, [*words, *["--overwrite"] * (words[0] == "simulate")]), code, named)
