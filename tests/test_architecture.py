"""The house rules, read off the source: who may import what.

Imports inside functions count too; only the shell (``cli``) may be lazy about them.
"""

from __future__ import annotations

import ast
import functools
import importlib
from pathlib import Path

import pytest

import jitterkit

ROOT = Path(jitterkit.__file__).parent
SCRIPTS = Path(__file__).parents[1] / "scripts"

FLOORS = [
    {"errors", "conventions", "metric", "precision"},
    {"vision", "loci", "scene", "series", "docs"},
    {"frames", "motion"},
    {"optics", "detectors", "shutter"},
    {"forward", "instruments", "photons", "calibration"},
    {"known_light"},
    {"likelihood", "simulate"},
    {"scoring_loop", "kernel_estimate"},
    {"scoring"},
    {"linearisation", "squares"},
    {"locate", "estimators", "extended", "starfield", "kernels"},
    {"refit"},
    {"forecast", "joint"},
    {"report", "batch"},
    {"run"},
    {"trade"},
    {"cli"},
    {"__main__"},
]
"""Rooms from the ground up; a room imports from lower floors only, never from its own."""

SAME_FLOOR = {("scene", "loci")}
ONLY_IN = {
    "cv2": {"vision.py"},
    "tifffile": {"frames/tiff.py"},
    "astropy.io": {"frames/fitsio.py"},
    "photutils": {"starfield/detect.py"},
    "dLux": set(),
    "dLuxToliman": {"optics/toliman.py", "trade/public.py"},
    "matplotlib": {"report/plots.py"}
    | {
        f"report/{noun}_plots.py"
        for noun in (
            "calibration",
            "causes",
            "crossfit",
            "time",
            "field",
            "forecast",
            "jitter",
            "joint",
            "kernel",
            "motion",
            "photon",
            "population",
            "series",
            "trade",
        )
    },
    "PIL": {"report/plots.py"},
    "jinja2": {"report/html.py"},
    "blackjax": {"refit/sampling.py"},
    "synphot": {"photons/stars.py"},
    "rich": {"cli/info.py", "cli/progress.py"},
}
"""Libraries with sharp edges, each behind one module."""

WITHOUT_JAX = ("frames", "detectors", "calibration", "series", "vision", "errors", "conventions")


def files() -> list[Path]:
    return sorted(ROOT.rglob("*.py"))


@functools.cache
def imports(path: Path) -> frozenset[str]:
    """Every module a file imports, absolutely, wherever the statement stands."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            found |= {node.module or ""} | {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)


def room(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def floor(name: str) -> int:
    return next(i for i, rooms in enumerate(FLOORS) if name in rooms)


def test_every_room_has_a_floor():
    rooms = {room(path) for path in files()} - {"__init__"}
    assert rooms == set().union(*FLOORS)


def test_imports_go_down_only():
    upward = []
    for path in files():
        here = room(path)
        for name in imports(path):
            parts = name.split(".")
            if parts[0] != "jitterkit" or len(parts) < 2 or here == "__init__":
                continue
            there = parts[1]
            if not (there == here or floor(there) < floor(here) or (here, there) in SAME_FLOOR):
                upward.append(f"{path.relative_to(ROOT)} imports {name} from the same floor or above")
    assert not upward


@pytest.mark.parametrize("library", ONLY_IN)
def test_a_library_with_sharp_edges_stays_behind_one_module(library):
    users = {
        str(path.relative_to(ROOT))
        for path in files()
        if any(name == library or name.startswith(library + ".") for name in imports(path))
    }
    assert users == ONLY_IN[library]


def test_no_jax_where_files_are_read():
    for path in files():
        if room(path) in WITHOUT_JAX:
            heavy = {name for name in imports(path) if name.split(".")[0] in ("jax", "equinox", "jaxtyping")}
            assert not heavy, f"{path.relative_to(ROOT)} imports {heavy}"


def test_no_cycles_between_files():
    modules = {
        ".".join(("jitterkit", *path.relative_to(ROOT).with_suffix("").parts)): path for path in files()
    }
    graph = {name: {i for i in imports(path) if i in modules} for name, path in modules.items()}
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, f"a cycle: {' -> '.join((*trail[trail.index(name) :], name))}"
        if name not in done:
            for target in graph[name]:
                visit(target, (*trail, name))
            done.add(name)

    for name in graph:
        visit(name, ())


def test_nothing_sets_64_bit_at_import():
    for path in files():
        calls = [n for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.Call)]
        arguments = [a.value for call in calls for a in call.args if isinstance(a, ast.Constant)]
        assert room(path) == "cli" or "jax_enable_x64" not in arguments, path


def test_what_a_script_imports_of_the_package_is_there():
    """Most scripts are run by hand, so that a name that moves would break those in silence."""
    texts = {path.name: path.read_text(encoding="utf-8") for path in SCRIPTS.iterdir() if path.is_file()}
    scripts = {n: t for n, t in texts.items() if n.endswith(".py") or t.startswith("#!/usr/bin/env python")}
    assert len(scripts) > 40
    missing = []
    for script, text in scripts.items():
        nodes = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom))
        for node in (node for node in nodes if (node.module or "").startswith("jitterkit")):
            absent = (alias.name for alias in node.names if not is_there(node.module, alias.name))
            missing += [f"{script}: {node.module}.{name}" for name in absent]
    assert not missing


def is_there(module: str, name: str) -> bool:
    """Return whether a module has a name, or a package a module of that name."""
    try:
        there = hasattr(importlib.import_module(module), name)
        return there or importlib.import_module(f"{module}.{name}") is not None
    except ModuleNotFoundError:
        return False
