"""Find where x may be mistaken for y: names, attributes, pairs, the axes of a shape, cosine and sine.

Reach for :func:`axes`.  The mate of a name is the same name with the other axis.  A name is a site only if
its mate is already bound in the same scope, so that the mutated program computes with a wrong number and does
not stop at an unknown name.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from mutate_source import Edit, Source, called, name_of

__all__ = ["axes", "mate"]

_AXIS = re.compile(r"(?:^|(?<=_))([a-z]?)(xx|yy|x|y)(\d?)(?=_|$)")
_OTHER = {"x": "y", "y": "x", "xx": "yy", "yy": "xx"}
_SHAPE_INDEX = {"0": "1", "1": "0"}
"""Indices from the front only; those from the back mostly select equal sides of a square matrix."""

_SYMMETRIC = {"hypot", "max", "min", "maximum", "minimum", "broadcast_arrays", "broadcast_shapes"}
"""Functions that are symmetric in two axes: exchanging the arguments changes nothing."""

_COMPREHENSIONS = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp
_SCOPES = ast.Module | ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.ClassDef | _COMPREHENSIONS


def mate(name: str) -> str:
    """Return a name with the other axis in place of its own; empty if it has none.

    >>> mate("fx"), mate("syy"), mate("amplitude_x"), mate("x0"), mate("index")
    ('fy', 'sxx', 'amplitude_y', 'y0', '')
    """
    found = _AXIS.search(name)
    return name[: found.start(2)] + _OTHER[found[2]] + name[found.end(2) :] if found else ""


def axes(source: Source) -> Iterator[Edit]:
    """Yield the edits that replace one axis by the other."""
    bound = _bindings(source)
    attributes = {node.attr for node in source.nodes if isinstance(node, ast.Attribute)}
    for node in source.nodes:
        match node:
            case ast.Name(id=name, ctx=ast.Load()) if _is_bound(source, bound, node, mate(name)):
                yield source.replace(node, mate(name))
            case ast.Attribute(attr="cos" | "sin" as name) if called(source.parents[node]) == name:
                yield _last_name(source, node, "sin" if name == "cos" else "cos")
            case ast.Attribute(attr=name, ctx=ast.Load()) if mate(name) in attributes:
                if called(source.parents[node]) != name:
                    yield _last_name(source, node, mate(name))
            case ast.Subscript(value=value, slice=index) if "shape" in name_of(value):
                if (number := source.text(index)) in _SHAPE_INDEX and not _is_area(source, node):
                    yield source.replace(index, _SHAPE_INDEX[number])
            case ast.Tuple(elts=[first, second]) | ast.List(elts=[first, second]):
                yield from _swapped(source, first, second)
            case ast.Call(args=[first, second]) if called(node) not in _SYMMETRIC:
                yield from _swapped(source, first, second)


def _is_area(source: Source, node: ast.Subscript) -> bool:
    """Return whether one side is multiplied by the other, as for a number of pixels in a chunk size."""
    parent = source.parents[node]
    is_product = isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Mult)
    return is_product and all(isinstance(side, ast.Subscript) for side in (parent.left, parent.right))


def _last_name(source: Source, node: ast.Attribute, new: str) -> Edit:
    end = source.span(node)[1]
    return Edit(end - len(node.attr.encode()), end, (new,))


def _swapped(source: Source, first: ast.expr, second: ast.expr) -> Iterator[Edit]:
    """Yield an edit that exchanges two neighbours, if they are mates."""
    if name_of(second) and mate(name_of(first)) == name_of(second):
        (start, middle), (after, end) = source.span(first), source.span(second)
        between = source.content[middle:after].decode()
        yield Edit(start, end, (source.text(second) + between + source.text(first),))


def _scope(source: Source, node: ast.AST) -> ast.AST:
    node = source.parents[node]
    while not isinstance(node, _SCOPES):
        node = source.parents[node]
    return node


def _bindings(source: Source) -> dict[ast.AST, dict[str, int]]:
    """Return, for each scope, the line after which each name is bound; 0 for arguments and comprehensions."""
    bound: dict[ast.AST, dict[str, int]] = {}
    for node in source.nodes:
        if isinstance(node, ast.arg):
            bound.setdefault(_scope(source, node), {})[node.arg] = 0
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            scope = _scope(source, node)
            line = 0 if isinstance(scope, _COMPREHENSIONS) else node.end_lineno
            names = bound.setdefault(scope, {})
            names[node.id] = min(names.get(node.id, line), line)
    return bound


def _is_bound(source: Source, bound: dict[ast.AST, dict[str, int]], node: ast.Name, other: str) -> bool:
    """Return whether the scope that binds a name also binds the other name, on an earlier line."""
    scope = _scope(source, node)
    while not isinstance(scope, ast.Module) and node.id not in bound.get(scope, {}):
        scope = _scope(source, scope)
    names = bound.get(scope, {})
    return node.id in names and other in names and names[other] < node.lineno
