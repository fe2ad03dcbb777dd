"""Find factors of 2π and of units, which can be wrong in a formula that looks right.

Reach for :func:`pis` and :func:`units`.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from mutate_source import Edit, Source, called, name_of

__all__ = ["pis", "units"]

_TURNS = {"radians": "degrees", "degrees": "radians", "deg2rad": "rad2deg", "rad2deg": "deg2rad"}
_POWERS = {1e3: "1e6", 1e-3: "1e-6", 1e6: "1e3", 1e-6: "1e-3", 1e9: "1e6", 1e-9: "1e-6"}
_FACTORS = {3600: ("1", "60"), 60: ("1", "3600"), 12: ("1", "3")}
_ANGLES = {180: "360", 360: "180"}
_UNIT = re.compile(r"ARCSEC|RADIAN|SECONDS|_CM2")
_TOLERANCE = re.compile(r"slack|tol|eps|least|floor", re.IGNORECASE)
_GUARDS = {"max", "min", "maximum", "minimum", "clip", "isclose", "allclose"}


def pis(source: Source) -> Iterator[Edit]:
    """Yield edits that halve or remove 2π, or halve π.

    No factor is doubled: additional whole turns do not change angles that are spread over a circle.  Added
    random phases, and limits between two forms of one number, are excluded: they do not change a result.
    """
    for node in source.nodes:
        if name_of(node) != "pi" or _is_harmless(source, node):
            continue
        product = source.parents[node]
        factor = ""
        if isinstance(product, ast.BinOp) and isinstance(product.op, ast.Mult):
            factor = source.text(product.left)
        if re.fullmatch(r"-?2j?", factor):
            one = factor.replace("2", "1")
            yield source.replace(product, f"{one} * {source.text(node)}", one)
        else:
            yield source.replace(node, f"({source.text(node)} / 2)")


def _is_harmless(source: Source, node: ast.AST) -> bool:
    parents = [parent for _, parent in source.ancestors(node)]
    is_random = any(called(parent) == "uniform" for parent in parents)
    is_added = any(isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Add) for parent in parents)
    return (is_random and is_added) or any(isinstance(parent, ast.Compare) for parent in parents)


def units(source: Source) -> Iterator[Edit]:
    """Yield edits that remove or replace a conversion factor, or exchange degrees and radians.

    A power of ten is a conversion factor if it is written as ``1e3``, not ``1000``, and is not a tolerance.
    """
    for node in source.nodes:
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                if new := _other_factors(source, node, value):
                    yield source.replace(node, *new)
            case ast.Name(id=name, ctx=ast.Load()) if _UNIT.search(name) and _scales(source, node):
                yield source.replace(node, "1")
            case ast.Call(args=[angle]) if (name := called(node)) in _TURNS:
                new = source.text(node).replace(name, _TURNS[name], 1)
                yield source.replace(node, new, source.operand(angle))


def _other_factors(source: Source, node: ast.Constant, value: float) -> tuple[str, ...]:
    """Return the replacements of a number; none if it is not a conversion factor."""
    parent = source.parents[node]
    scales = _scales(source, node) or _is_entry(parent, node)
    if value in _POWERS and isinstance(value, float) and scales and not _is_tolerance(source, node):
        return "1", _POWERS[value]
    if value in _FACTORS and (scales or called(parent) == "sqrt"):
        return _FACTORS[value]
    if value in _ANGLES and isinstance(parent, ast.BinOp):
        return (_ANGLES[value],)
    return ("1", "3437.7467707849396") if 206264 < value < 206265 else ()


def _scales(source: Source, node: ast.AST) -> bool:
    parent = source.parents[node]
    return isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Mult | ast.Div)


def _is_entry(parent: ast.AST, node: ast.AST) -> bool:
    """Return whether a number is the value of a text key in a dictionary."""
    if not isinstance(parent, ast.Dict) or node not in parent.values:
        return False
    key = parent.keys[parent.values.index(node)]
    return isinstance(key, ast.Constant) and isinstance(key.value, str)


def _is_tolerance(source: Source, node: ast.Constant) -> bool:
    """Return whether a small number guards against rounding, so that a thousandth of it works as well."""
    for _, parent in source.ancestors(node):
        if isinstance(parent, ast.Compare) or called(parent) in _GUARDS:
            return True
        if isinstance(parent, ast.Assign) and any(_TOLERANCE.search(name_of(t)) for t in parent.targets):
            return True
        if node.value < 1e-5 and isinstance(parent, ast.stmt) and "max(" in source.text(parent):
            return True
    return False
