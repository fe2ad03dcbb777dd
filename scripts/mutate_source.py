"""Read a module for mutation: its syntax tree, the nodes that hold code, and edits of its text.

Reach for :func:`read_source`.  Docstrings and other strings, annotations, decorators, ``__all__``, assertions
and messages (``raise``, warnings, f-strings) are not code and are never mutated.  An edit replaces the
bytes of one expression or operator and does not change the rest of the file.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate

__all__ = ["Edit", "Source", "called", "name_of", "read_source"]

_MESSAGES = re.compile(r"(Error|Warning|warn|warning|echo|print|join|format)$")


@dataclass(frozen=True)
class Edit:
    """Replacements of one span of a file.

    Attributes
    ----------
    start, end : int
        The span, in bytes of the UTF-8 text.
    new : tuple of str
        Alternative replacements; a mutation uses one of them.
    """

    start: int
    end: int
    new: tuple[str, ...]


@dataclass(frozen=True)
class Source:
    """Text and syntax tree of a module.

    Attributes
    ----------
    content : bytes
        Text in UTF-8, whose bytes the positions of ``ast`` count.
    blank : bytes
        The same with comments overwritten by spaces.
    nodes : tuple of ast.AST
        All nodes that hold code, depth first.
    parents : dict
        Parent of each node.
    starts : tuple of int
        First byte of each line.
    """

    content: bytes
    blank: bytes
    nodes: tuple[ast.AST, ...]
    parents: dict[ast.AST, ast.AST]
    starts: tuple[int, ...]

    def span(self, node: ast.AST) -> tuple[int, int]:
        """Return the first byte of a node and the byte after its last."""
        return (
            self.starts[node.lineno - 1] + node.col_offset,
            self.starts[node.end_lineno - 1] + node.end_col_offset,
        )

    def text(self, node: ast.AST) -> str:
        """Return the text of a node."""
        start, end = self.span(node)
        return self.content[start:end].decode()

    def operand(self, node: ast.AST) -> str:
        """Return the text of a node, in parentheses unless it binds as tightly as a name."""
        text = self.text(node)
        tight = isinstance(node, ast.Name | ast.Constant | ast.Call | ast.Attribute | ast.Subscript)
        return text if tight and "\n" not in text else f"({text})"

    def line(self, position: int) -> int:
        """Return the number, from 1, of the line that holds a byte."""
        return self.content.count(b"\n", 0, position) + 1

    def ancestors(self, node: ast.AST) -> Iterator[tuple[ast.AST, ast.AST]]:
        """Yield (child, parent) from a node up to its statement."""
        while not isinstance(node, ast.stmt) and node in self.parents:
            yield node, self.parents[node]
            node = self.parents[node]

    def is_index(self, node: ast.AST) -> bool:
        """Return whether a node is part of an index, in ``[...]`` or the arguments of ``range``."""
        return any(
            (isinstance(parent, ast.Subscript) and child is parent.slice) or called(parent) == "range"
            for child, parent in self.ancestors(node)
        )

    def replace(self, node: ast.AST, *new: str) -> Edit:
        """Return an edit that replaces a node."""
        return Edit(*self.span(node), new)

    def operator(self, left: ast.AST, right: ast.AST, old: str, new: str) -> Edit:
        """Return an edit that replaces the operator between two operands."""
        return self._token(self.span(left)[1], self.span(right)[0], old, new)

    def prefix(self, node: ast.UnaryOp, old: str) -> Edit:
        """Return an edit that removes a unary operator and the blanks after it."""
        return self._token(self.span(node)[0], self.span(node.operand)[0], old + r"\s*", "")

    def _token(self, start: int, end: int, old: str, new: str) -> Edit:
        found = re.search(old.encode(), self.blank[start:end])
        assert found, (old, self.blank[start:end])
        return Edit(start + found.start(), start + found.end(), (new,))


def read_source(content: bytes) -> Source:
    """Parse a module.

    Parameters
    ----------
    content : bytes
        Python source in UTF-8.

    Returns
    -------
    source : Source

    Raises
    ------
    SyntaxError
        If the content is not valid Python.
    """
    tree = ast.parse(content)
    lines = content.splitlines(keepends=True)
    starts = tuple(accumulate(map(len, lines), initial=0))
    parents = {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}
    return Source(content, _without_comments(content, lines, starts), tuple(_code(tree)), parents, starts)


def name_of(node: ast.AST | None) -> str:
    """Return the last name of a name or attribute; empty for other expressions."""
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


def called(node: ast.AST) -> str:
    """Return the last name of the function that a call names; empty for other nodes."""
    return name_of(node.func) if isinstance(node, ast.Call) else ""


def _without_comments(content: bytes, lines: list[bytes], starts: tuple[int, ...]) -> bytes:
    blank = bytearray(content)
    for token in tokenize.tokenize(io.BytesIO(content).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            start = starts[row - 1] + len(lines[row - 1].decode()[:column].encode())
            length = len(token.string.encode())
            blank[start : start + length] = b" " * length
    return bytes(blank)


def _code(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a node and its descendants, except those that are not code."""
    yield node
    fields = {"annotation", "returns", "decorator_list"}
    for name, value in ast.iter_fields(node):
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and name not in fields and not _is_text(child):
                yield from _code(child)


def _is_text(node: ast.AST) -> bool:
    if isinstance(node, ast.Assign) and [name_of(target) for target in node.targets] == ["__all__"]:
        return True
    return isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr) or bool(_MESSAGES.search(called(node)))
