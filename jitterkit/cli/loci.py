"""A jitter locus from what stands on the command line: its name and its sizes.

Every locus is built by its ``of``; its signature says what it needs and what it may have, and so do the
sentences here.  Those of ``--help`` are read off the source, because to import a locus is to import JAX.
"""

from __future__ import annotations

import ast
import functools
import inspect
from pathlib import Path
from typing import Any

import jitterkit
from jitterkit.cli.runtime import say

__all__ = ["build_locus", "locus_sizes", "other_sizes", "parse_sizes", "size_option", "trace_of"]

_OPTIONS = {"length": "--length", "angle": "--angle", "sigma_major": "--sigma", "shear": "--shear"}
"""Sizes with an option of their own; the others go by ``--set``."""


@functools.cache
def locus_sizes() -> dict[str, list[str]]:
    """Sizes that each locus of the registry is built from, by its name; without importing it."""
    room = Path(jitterkit.__file__).parent / "loci"
    nodes = [node for file in sorted(room.glob("*.py")) for node in ast.parse(file.read_text("utf-8")).body]
    classes = {node.name: node for node in nodes if isinstance(node, ast.ClassDef)}
    (registry,) = (
        node.value for node in nodes if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "LOCI"
    )
    assert isinstance(registry, ast.Dict)
    names = [ast.literal_eval(key) for key in registry.keys if key is not None]
    built = [_built_from(ast.unparse(value), classes) for value in registry.values]
    return dict(zip(names, built, strict=True))


def other_sizes() -> str:
    """The sizes without an option of their own, locus by locus, in a line."""
    others = {name: [s for s in sizes if s not in _OPTIONS] for name, sizes in locus_sizes().items()}
    return "; ".join(f"{', '.join(sizes)} of {name}" for name, sizes in others.items() if sizes)


def _built_from(name: str, classes: dict[str, ast.ClassDef]) -> list[str]:
    """Parameters of the ``of`` of a class, or else of its base."""
    for node in classes[name].body:
        if isinstance(node, ast.FunctionDef) and node.name == "of":
            return [argument.arg for argument in node.args.args[1:]]
    return _built_from(ast.unparse(classes[name].bases[0]), classes)


def parse_sizes(settings: list[str]) -> dict[str, Any]:
    """Sizes by name from ``name=value``, or ``name=x:y,x:y,...`` for places.

    Raises
    ------
    ConfigurationError
        If one is neither.
    """
    from jitterkit.errors import ConfigurationError, ErrorCode

    sizes: dict[str, Any] = {}
    for setting in settings:
        name, _, value = setting.partition("=")
        try:
            sizes[name.strip()] = _places(value) if ":" in value else float(value)
        except ValueError:
            raise ConfigurationError(
                ErrorCode.MALFORMED,
                f"--set {setting} is not understood; write a number, --set cycles=0.7, or places in arcsec, "
                "--set knots=0:0,0.2:0.1.",
            ) from None
    return sizes


def build_locus(name: str, sizes: dict[str, Any]):
    """The locus of a name with given sizes.

    Raises
    ------
    ConfigurationError
        If it needs a size that is not given, or takes none of that name; the message lists what it does.
    """
    from jitterkit.errors import ConfigurationError, ErrorCode
    from jitterkit.loci import Mvn, locus_class

    kind = locus_class(name)
    build = Mvn.sheared if kind is Mvn and "shear" in sizes else kind.of  # type: ignore[attr-defined]
    taken = inspect.signature(build).parameters
    if not taken and sizes:
        extra = size_option(next(iter(sizes)))
        raise ConfigurationError(
            ErrorCode.UNKNOWN_NAME, f"A stable telescope has no {extra}; choose another --locus."
        )
    needed = [size for size, parameter in taken.items() if parameter.default is parameter.empty]
    foreign, missing = [s for s in sizes if s not in taken], [s for s in needed if s not in sizes]
    wrong = [s for s in sizes if s in taken and (s == "knots") != (not isinstance(sizes[s], float))]
    if not (foreign or missing or wrong):
        return build(**sizes)
    if {"shear", "sigma_minor"} <= sizes.keys() and kind is Mvn:
        raise ConfigurationError(
            ErrorCode.CONFLICT, f"The locus {name} takes --shear or --set sigma_minor, not both."
        )
    may = [size for size in taken if size not in needed]
    may += ["shear"] if kind is Mvn and "shear" not in taken else []
    code, problem = ErrorCode.MISSING_VALUE, ""
    if foreign:
        code, problem = ErrorCode.UNKNOWN_NAME, f"takes no {size_option(foreign[0])}; it "
    elif wrong and not missing:
        option, given = size_option(wrong[0]), sizes[wrong[0]]
        unlike = f"as places, not the number {given:g}" if wrong[0] == "knots" else "as a number, not places"
        code, problem = ErrorCode.WRONG_TYPE, f"takes {option} {unlike}; it "
    problem += f"needs {_listed(needed)}"
    problem += f" and may have {_listed(may)}" if may else ""
    raise ConfigurationError(code, f"The locus {name} {problem}.")


def trace_of(path: Path, exposure: float | None, locus: str, sizes: dict[str, Any]):
    """The measured pointing in a file, from its start (or ``start``) over one exposure, where that is known.

    Raises
    ------
    ConfigurationError
        If another locus or its sizes are given too, or the record does not serve.
    """
    from jitterkit.errors import ConfigurationError, ErrorCode
    from jitterkit.loci import Trace, read_trace

    others = [size_option(size) for size in sizes if size != "start"]
    others += ["--locus"] if locus != "stable" else []
    if others:
        raise ConfigurationError(
            ErrorCode.CONFLICT, f"A --trace takes the place of a locus; leave out {others[0]}."
        )
    try:
        t, x, y = read_trace(path)
        trace = Trace.of(t, x, y, start=sizes.get("start"), exposure=exposure)
    except ConfigurationError as error:
        told = str(error)
        raise ConfigurationError(
            error.code, told if told.startswith(str(path)) else f"{path}: {told}"
        ) from None
    duration = float(t[-1] - t[0])
    if exposure is not None and duration > 1.01 * exposure:  # beyond a sample or two over
        first = "" if "start" in sizes else "the first "
        say(f"{path}: {first}{exposure:g} of {duration:g} s of the trace are used for every frame.")
    return trace


def _places(text: str) -> list[list[float]]:
    pairs = (place.split(":") for place in text.split(","))
    return [[float(x), float(y)] for x, y in pairs]


def size_option(size: str) -> str:
    """Return the option that sets a size on the command line: ``--length``, ``--set cycles``."""
    return _OPTIONS.get(size, f"--set {size}")


def _listed(sizes: list[str]) -> str:
    return ", ".join(size_option(size) for size in sizes)
