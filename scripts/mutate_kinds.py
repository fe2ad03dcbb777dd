"""Find the sites in a module where a physicist could make a mistake, by kind of mistake.

Reach for :data:`KINDS`: each function yields edits of a source.  Sites where most mutations would not
change a result are excluded; a comment or docstring at the exclusion gives the reason.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise

from mutate_axes import axes
from mutate_numbers import pis, units
from mutate_source import Edit, Source, called, name_of

__all__ = ["KINDS"]

_SETS = {"set", "frozenset", "keys"}
_TEXTS = {"str", "repr", "bytes", "encode", "decode", "pack", "join", "format", "ljust", "rjust"}
_NO_NUMBERS = {"list", "tuple", "sorted"} | _TEXTS | _SETS
_TEXT_NAME = re.compile(r"(name|text|message|warning|stem|suffix|title|label|sentence|word)s?$")
_EVEN = {"abs", "cos", "cosh", "square", "hypot"}
_COMPARED = {ast.Lt: ("<", ">"), ast.Gt: (">", "<"), ast.LtE: ("<=", ">="), ast.GtE: (">=", "<=")}
_COMPARED |= {ast.Eq: ("==", "!="), ast.NotEq: ("!=", "==")}
_EXTREMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum"}
_MASK = re.compile(
    r"(.*_)?(mask|masked|used?|usable|unusable|good|bad|missing|blank|valid|finite|keep|kept|known|seen"
    r"|inside|shown|chosen|there|determined|informed|sound|bright|sized|both|near|null|lit|saturated|full)"
)
_LIMIT = re.compile(r"iteration|steps|expansions", re.IGNORECASE)
_COUNT = re.compile(r"n|count|number|pixels|frames|size")
_FREEDOM = re.compile(r"dof|freedom")


def signs(source: Source) -> Iterator[Edit]:
    """Yield edits that exchange plus and minus, or remove a unary minus."""
    for node in source.nodes:
        if source.is_index(node):  # a wrong index raises IndexError or loops forever
            continue
        match node:
            case ast.BinOp(left=left, op=ast.Add(), right=right) if _is_number(left) and _is_number(right):
                yield source.operator(left, right, r"\+", "-")
            case ast.BinOp(left=left, op=ast.Sub(), right=right) if _is_number(left) and _is_number(right):
                yield source.operator(left, right, "-", "+")
            case ast.AugAssign(value=ast.Constant()):  # a counter is an index too; loops wait for its value
                continue
            case ast.AugAssign(target=left, op=ast.Add(), value=right) if _is_number(right):
                yield source.operator(left, right, r"\+=", "-=")
            case ast.AugAssign(target=left, op=ast.Sub(), value=right) if _is_number(right):
                yield source.operator(left, right, "-=", "+=")
            case ast.UnaryOp(op=ast.USub()) if _is_signed(source, node):
                yield source.prefix(node, "-")


def _is_number(node: ast.expr) -> bool:
    """Return whether an operand may be a number that matters, not a text, length or guard against zero."""
    match node:
        case ast.Constant(value=value):
            return isinstance(value, int | float | complex) and abs(value) > 1e-6
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return _is_number(left) and _is_number(right)
        case ast.BinOp(op=ast.FloorDiv()):  # nx // 2 - 1 for nx // 2 + 1: no array has that length
            return False
        case ast.IfExp(body=body, orelse=other):
            return _is_number(body) and _is_number(other)
        case ast.JoinedStr() | ast.List() | ast.Tuple() | ast.ListComp() | ast.Dict() | ast.Set():
            return False
    return called(node) not in _NO_NUMBERS and not _TEXT_NAME.search(name_of(node))


def _is_signed(source: Source, node: ast.UnaryOp) -> bool:
    """Return whether a minus matters: not in an index or marker such as -1, nor inside an even function."""
    parent = source.parents[node]
    if isinstance(node.operand, ast.Constant) and not isinstance(parent, ast.BinOp):
        return False
    is_squared = isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Pow) and parent.left is node
    return not is_squared and called(parent) not in _EVEN


def comparisons(source: Source) -> Iterator[Edit]:
    """Yield edits that reverse comparisons, exchange ``and`` and ``or`` or min and max, or remove ``not``.

    ``<`` is never replaced by ``<=``, because between measured numbers the two are equivalent.
    """
    for node in source.nodes:
        match node:
            case ast.Compare(left=left, ops=ops, comparators=right):
                for one, op, other in zip([left, *right], ops, right, strict=False):
                    if type(op) in _COMPARED:
                        yield source.operator(one, other, *_COMPARED[type(op)])
            case ast.BoolOp(op=op, values=values):
                old, new = ("and", "or") if isinstance(op, ast.And) else ("or", "and")
                for one, other in pairwise(values):
                    yield source.operator(one, other, rf"\b{old}\b", new)
            case ast.UnaryOp(op=ast.Not()):
                yield source.prefix(node, "not")
            case ast.Call(func=function) if called(node) in _EXTREMES:
                end = source.span(function)[1]
                yield Edit(end - len(called(node)), end, (_EXTREMES[called(node)],))


def masks(source: Source) -> Iterator[Edit]:
    """Yield edits that remove a mask: one side of ``&``, the condition of ``where``, an index, or ``~``.

    A ``where`` whose condition is not a mask is excluded: it chooses between two forms of one number, or
    guards a division.
    """
    for node in source.nodes:
        match node:
            case ast.BinOp(left=left, op=ast.BitAnd(), right=right):
                if not any(_is_no_mask(source, side) for side in (left, right)):
                    yield source.replace(node, source.operand(left), source.operand(right))
            case ast.Call(args=[condition, chosen, other]) if called(node) == "where" and _is_mask(condition):
                if not _is_guarded(source, node, condition):
                    selected = other if _is_filler(chosen) else chosen
                    yield source.replace(node, source.operand(selected))
            case ast.Subscript(value=value, slice=index, ctx=ast.Load()):
                is_element = isinstance(index, ast.Subscript)  # most likely a number from a list
                if isinstance(index, ast.Compare) or (_is_mask(index) and not is_element):
                    yield source.replace(node, source.operand(value))
            case ast.UnaryOp(op=ast.Invert()):
                yield source.prefix(node, "~")


def _is_no_mask(source: Source, side: ast.expr) -> bool:
    """Return whether a side of ``&`` is a set, a number or an iteration limit that is not reached."""
    if isinstance(side, ast.Set | ast.SetComp | ast.Constant) or called(side) in _SETS:
        return True
    return isinstance(side, ast.Compare) and bool(_LIMIT.search(source.text(side)))


def _is_mask(node: ast.expr) -> bool:
    match node:
        case ast.Subscript(value=value):
            return _is_mask(value)
        case ast.UnaryOp(op=ast.Invert()) | ast.BinOp(op=ast.BitAnd() | ast.BitOr()):
            return True
    return called(node) == "isfinite" or bool(_MASK.fullmatch(name_of(node)))


def _is_filler(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) or name_of(node) in {"nan", "inf"}


def _is_guarded(source: Source, node: ast.expr, condition: ast.expr) -> bool:
    """Return whether an outer ``where`` with the same condition discards what the inner one changes."""
    return any(
        called(parent) == "where" and source.text(parent.args[0]) == source.text(condition)
        for _, parent in source.ancestors(node)
    )


def freedoms(source: Source) -> Iterator[Edit]:
    """Yield edits that ignore fitted parameters: ``n - 1`` in a denominator, ``ddof``, ``dof = ...``.

    Other counts minus one (the last index, the centre of a row of pixels, steps from -1 to 1) are not
    degrees of freedom.
    """
    for node in source.nodes:
        match node:
            case ast.keyword(arg="ddof", value=value) if source.text(value) != "0":
                yield source.replace(value, "0")
            case ast.BinOp(left=left, op=ast.Sub()) if _is_count(left) and _is_freedom(source, node):
                yield source.replace(node, source.operand(left))


def _is_count(node: ast.expr) -> bool:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub):
        return _is_count(node.left)
    if isinstance(node, ast.Call):
        return called(node) in {"len", "sum"} or (called(node) == "int" and _is_count(node.args[0]))
    return bool(_COUNT.fullmatch(name_of(node)))


def _is_freedom(source: Source, node: ast.expr) -> bool:
    """Return whether a difference is a denominator, or is assigned to a name for degrees of freedom."""
    for child, parent in source.ancestors(node):
        match parent:
            case ast.BinOp(op=ast.Div(), right=right) if right is child:
                return not _is_shifted(source, parent)
            case ast.Assign(targets=[target]):
                return any(_FREEDOM.search(name_of(name)) for name in [target, *getattr(target, "elts", [])])
            case ast.BinOp(op=ast.Mult()) | ast.Tuple():
                continue
            case ast.Call() if called(parent) in {"max", "maximum", "sqrt"}:
                continue
        return False
    return False


def _is_shifted(source: Source, quotient: ast.expr) -> bool:
    """Return whether a number is subtracted from a quotient, which is then a coordinate."""
    parent = source.parents[quotient]
    return isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Sub) and parent.left is quotient


KINDS: Mapping[str, Callable[[Source], Iterator[Edit]]] = {
    "sign": signs,
    "factor of 2π": pis,
    "x for y": axes,
    "unit": units,
    "comparison": comparisons,
    "dropped mask": masks,
    "degrees of freedom": freedoms,
}
