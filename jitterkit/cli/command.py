"""Turn a function into a command of the command line.

Reach for :func:`as_command`.  The parameters of the function are the options of the command.  Three rules:

* A parameter whose type is a dataclass is a *group*.  The fields of the group stand in its place on the
  command line, and the function receives the dataclass.  A field that is added to a group is an option of
  every command that has the group.
* Metavar and help of an option stand in the section *Parameters* of a docstring, as ``name : METAVAR`` with
  the text below.  The docstring of a command has precedence over those of its groups, these over that of
  :mod:`jitterkit.cli.options`, and a ``typer.Option`` or ``typer.Argument`` in the annotation over all.
* A switch that is off by default has no form with ``--no-``.
"""

from __future__ import annotations

import copy
import functools
import inspect
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import is_dataclass
from pathlib import Path
from typing import Annotated, Any, get_origin, get_type_hints

import typer
from typer.models import ArgumentInfo, OptionInfo

from jitterkit.cli import options as shared
from jitterkit.cli.quantities import computable
from jitterkit.cli.runtime import USAGE, log, log_error
from jitterkit.errors import ErrorCode, JitterkitError, refuse_if

_HEADING = "\n\nParameters\n----------\n"

_ENTRY = re.compile(r"^(\w+)(?: : (.+))?\n((?: {4}.*\n?)+)", re.MULTILINE)
"""Name, metavar and help of an option in a docstring."""

_MARKUP = re.compile(r"\[(?=[a-z])")
"""What typer would take for a style in brackets."""

Texts = Mapping[str, tuple[str, str]]
"""Metavar and help by the name of the option."""


class Default(dict):
    """Give options of a group another default in one command: ``Annotated[Pair, Default(contrast=1.0)]``."""


class Fixed(dict):
    """Set fields of a group that one command does not offer as options: ``Annotated[Pair, Fixed(x=0.0)]``."""


def as_command(function: Callable[..., None]) -> Callable[..., None]:
    """Return a function with a parameter per option, which builds the groups and reports errors.

    An error that the user can correct becomes its message and code on stderr, and exit status 2.
    """
    options = list(_options(function, {}, {}))

    @functools.wraps(function)
    def command(**given: Any) -> None:
        try:
            _refuse_infinite(given)
            _refuse_lost_input(given)
            function(**_arguments(function, given))
        except JitterkitError as error:
            log_error(error)
            raise typer.Exit(USAGE) from None
        except KeyboardInterrupt:
            log("jitterkit: interrupted.")
            raise typer.Exit(130) from None
        except BrokenPipeError:  # the reader of stdout has gone: `jitterkit info ... | head`
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

    command.__doc__ = inspect.cleandoc(function.__doc__ or "").partition(_HEADING)[0]
    command.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]
    command.__annotations__ = {option.name: option.annotation for option in options}
    return command


def _refuse_infinite(given: Mapping[str, Any]) -> None:
    """Refuse nan, inf and 1e300 for any option that takes a number."""
    for name, value in given.items():
        numbers = value if isinstance(value, list | tuple) else [value]
        for number in (number for number in numbers if isinstance(number, float)):
            computable(number, f"--{name.replace('_', '-')}")


def _refuse_lost_input(given: Mapping[str, Any]) -> None:
    """Refuse an output that would replace a file that the command reads, which --overwrite does not mean."""
    outputs = {name: Path(given[name]) for name in ("output", "plot") if given.get(name) is not None}
    values = [value for name, value in given.items() if name not in outputs]
    inputs = [one for value in values for one in (value if isinstance(value, list | tuple) else [value])]
    paths = {os.path.realpath(one) for one in inputs if isinstance(one, str | Path)}
    for name, output in outputs.items():
        within = output.suffix == ".fits" and os.path.realpath(output.parent) in paths
        read = within or os.path.realpath(output) in paths
        problem = f"--{name} {output} is a file that the command reads; give another name."
        refuse_if(output.is_file() and read, ErrorCode.CONFLICT, problem)


def _arguments(source: Callable, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a command or of a group, built from the values of its options."""
    return {
        parameter.name: kind(**_arguments(kind, {**given, **marks.get(Fixed, {})}))
        if _is_group(kind)
        else given[parameter.name]
        for parameter, kind, marks in _parameters(source)
    }


def _options(source: Callable, texts: Texts, defaults: Mapping[str, Any]) -> Iterator[inspect.Parameter]:
    """Yield the options of a command or of a group; the options of a group replace the group."""
    texts, common = {**_texts(source), **texts}, _texts(shared)
    for parameter, kind, marks in _parameters(source):
        if _is_group(kind):
            options = _options(kind, texts, marks.get(Default, {}))
            yield from (option for option in options if option.name not in marks.get(Fixed, {}))
        elif kind is typer.Context:
            yield parameter.replace(annotation=kind)
        else:
            default = defaults.get(parameter.name, parameter.default)
            info = copy.copy(marks.get(OptionInfo) or marks.get(ArgumentInfo) or typer.Option())
            metavar, help = texts.get(parameter.name, common.get(parameter.name, ("", "")))
            info.metavar, info.help = info.metavar or metavar or None, info.help or help or None
            if info.show_default is True:
                info.show_default = default not in (None, parameter.empty)
            if default is False and info.default is ...:  # no names in the annotation
                info.param_decls = (f"--{parameter.name.replace('_', '-')}",)
            yield parameter.replace(default=default, annotation=Annotated[kind, info])


def _parameters(source: Callable) -> Iterator[tuple[inspect.Parameter, Any, dict[type, Any]]]:
    """Yield each parameter of a command or of a group, its type, and the marks in its annotation."""
    hints = get_type_hints(source, include_extras=True)
    for parameter in inspect.signature(source).parameters.values():
        hint = hints[parameter.name]
        kind, marks = (hint.__origin__, hint.__metadata__) if get_origin(hint) is Annotated else (hint, ())
        keyword = parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        yield keyword, kind, {type(mark): mark for mark in marks}


def _is_group(kind: Any) -> bool:
    return is_dataclass(kind)


def _texts(source: object) -> dict[str, tuple[str, str]]:
    """Return metavar and help of the options that a docstring describes; ``[mas]`` is no markup in it."""
    _, _, section = inspect.cleandoc(source.__doc__ or "").partition(_HEADING)
    return {
        name: (metavar, _MARKUP.sub(r"\\[", " ".join(text.split())))
        for name, metavar, text in _ENTRY.findall(section)
    }
