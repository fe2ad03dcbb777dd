"""Build a jitter locus from its name and sizes on the command line.

The signature of its ``of`` holds the sizes that a locus needs and those that it may have.  The help reads
them from the source, because the import of a locus imports JAX.
"""

from __future__ import annotations

import ast
import functools
import inspect
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

import jitterkit
from jitterkit.cli.quantities import computable, named
from jitterkit.errors import ConfigurationError, ErrorCode, refuse_if

_OPTIONS = {"length": "--length", "angle": "--angle", "sigma_major": "--sigma", "shear": "--shear"}
"""Sizes with an option of their own; the others go by ``--set``."""


@functools.cache
def locus_sizes() -> dict[str, list[str]]:
    """Return the sizes of each locus of the registry by its name, without importing it."""
    folder = Path(jitterkit.__file__).parent / "loci"
    nodes = [node for file in sorted(folder.glob("*.py")) for node in ast.parse(file.read_text("utf-8")).body]
    classes = {node.name: node for node in nodes if isinstance(node, ast.ClassDef)}
    (registry,) = (
        node.value for node in nodes if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "LOCI"
    )
    assert isinstance(registry, ast.Dict)
    names = [ast.literal_eval(key) for key in registry.keys if key is not None]
    built = [_built_from(ast.unparse(value), classes) for value in registry.values]
    return dict(zip(names, built, strict=True))


def other_sizes() -> str:
    """Return the sizes without an option of their own, locus by locus, in a line."""
    others = {name: [s for s in sizes if s not in _OPTIONS] for name, sizes in locus_sizes().items()}
    return "; ".join(f"{', '.join(sizes)} of {name}" for name, sizes in others.items() if sizes)


def _built_from(name: str, classes: dict[str, ast.ClassDef]) -> list[str]:
    """Return the parameters of the ``of`` of a class, or else of its base."""
    for node in classes[name].body:
        if isinstance(node, ast.FunctionDef) and node.name == "of":
            return [argument.arg for argument in node.args.args[1:]]
    return _built_from(ast.unparse(classes[name].bases[0]), classes)


def parse_sizes(settings: list[str], others: Collection[str] = ()) -> dict[str, Any]:
    """Return sizes by name from ``name=value``, or ``name=x:y,x:y,...`` for positions.

    Raises
    ------
    ConfigurationError
        If one is neither, or is given twice, or is among the ``others`` that have options.
    """
    sizes: dict[str, Any] = {}
    for name, value in named(settings, "--set", others):
        try:
            sizes[name] = _positions(value) if ":" in value else computable(float(value), f"--set {name}")
        except ConfigurationError:
            raise
        except ValueError:
            problem = f"--set {name}={value} is not understood"
            remedy = "write a number, --set cycles=0.7, or positions in arcsec, --set knots=0:0,0.2:0.1"
            raise ConfigurationError(ErrorCode.MALFORMED, f"{problem}; {remedy}.") from None
    return sizes


def build_locus(name: str, sizes: dict[str, Any]):
    """Return the locus of a name with given sizes.

    Raises
    ------
    ConfigurationError
        If it needs a size that is not given, or takes none of that name; the message lists its sizes.
    """
    from jitterkit.loci import Mvn, locus_class

    kind = locus_class(name)
    build = Mvn.sheared if kind is Mvn and "shear" in sizes else kind.of  # type: ignore[attr-defined]
    taken = inspect.signature(build).parameters
    if not taken and sizes:
        extra = size_option(next(iter(sizes)))
        message = f"A stable telescope has no {extra}; choose another --locus."
        raise ConfigurationError(ErrorCode.UNKNOWN_NAME, message)
    needed = [size for size, parameter in taken.items() if parameter.default is parameter.empty]
    foreign, missing = [s for s in sizes if s not in taken], [s for s in needed if s not in sizes]
    wrong = [s for s in sizes if s in taken and (s == "knots") != (not isinstance(sizes[s], float))]
    if not (foreign or missing or wrong):
        return build(**sizes)
    message = f"The locus {name} takes --shear or --set sigma_minor, not both."
    refuse_if({"shear", "sigma_minor"} <= sizes.keys() and kind is Mvn, ErrorCode.CONFLICT, message)
    may = [size for size in taken if size not in needed]
    may += ["shear"] if kind is Mvn and "shear" not in taken else []
    code, problem = ErrorCode.MISSING_VALUE, ""
    if foreign:
        code, problem = ErrorCode.UNKNOWN_NAME, f"takes no {size_option(foreign[0])}; it "
    elif wrong and not missing:
        bad = wrong[0]
        form = f"positions, not the number {sizes[bad]:g}" if bad == "knots" else "a number, not positions"
        code, problem = ErrorCode.WRONG_TYPE, f"takes {size_option(bad)} as {form}; it "
    problem += f"needs {_listed(needed)}"
    problem += f" and may have {_listed(may)}" if may else ""
    raise ConfigurationError(code, f"The locus {name} {problem}.")


def refuse_other_motions(option: str, locus: str, sizes: Iterable[str], **motions: Any) -> None:
    """Refuse another motion, a locus or its sizes beside a measured or drawn motion.

    Raises
    ------
    ConfigurationError
    """
    others = [f"--{name}" for name, motion in motions.items() if motion is not None]
    others += ["--locus"] if locus != "stable" else []
    others += [size_option(size) for size in sizes]
    if others:
        problem = f"A {option} takes the place of a locus; leave out {others[0]}."
        raise ConfigurationError(ErrorCode.CONFLICT, problem)


def _positions(text: str) -> list[list[float]]:
    pairs = (position.split(":") for position in text.split(","))
    return [[computable(float(one), "--set knots") for one in (x, y)] for x, y in pairs]


def size_option(size: str) -> str:
    """Return the option that sets a size on the command line: ``--length``, ``--set cycles``."""
    return _OPTIONS.get(size, f"--set {size}")


def _listed(sizes: list[str]) -> str:
    return ", ".join(size_option(size) for size in sizes)
