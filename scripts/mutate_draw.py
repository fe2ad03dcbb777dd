"""Draw mutations of the package: the same from the same tree and seed, of every kind alike.

Reach for :func:`find_sites` and :func:`draw`.  The shell, pictures and wording are left out: their slips show
to the eye.
"""

from __future__ import annotations

import difflib
import random
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from mutate_kinds import KINDS
from mutate_source import read_source

__all__ = ["Mutation", "Site", "draw", "find_sites", "sites_of"]

_LEFT_OUT = (
    "jitterkit/cli/*",
    "jitterkit/report/*plots.py",
    "jitterkit/report/*pictures.py",
    "jitterkit/report/axes.py",
    "jitterkit/report/html.py",
    "jitterkit/report/*words.py",
    "jitterkit/report/*_text.py",
    "*/__init__.py",
    "*/__main__.py",
)
_A_FILE = 2
"""Mutations of one file at most, so that a long file does not stand for the package."""


@dataclass(frozen=True)
class Site:
    """A place where a mutation may happen.

    Attributes
    ----------
    kind : str
        One of ``mutate_kinds.KINDS``.
    path : str
        Of the module, from the root of the tree, with slashes.
    line, start : int
        Where it begins: the line, from 1, and the byte of the UTF-8 text.
    old : str
        What stands there.
    new : tuple of str
        What may stand there instead.
    """

    kind: str
    path: str
    line: int
    start: int
    old: str
    new: tuple[str, ...]


@dataclass(frozen=True)
class Mutation:
    """One replacement at a site, with the attributes of the site."""

    kind: str
    path: str
    line: int
    start: int
    old: str
    new: str

    def of(self, content: bytes) -> bytes:
        """Return a module with this mutation."""
        end = self.start + len(self.old.encode())
        return content[: self.start] + self.new.encode() + content[end:]

    def diff(self, content: bytes) -> str:
        """Return the changed lines of a module as a unified diff without context."""
        before, after = (text.decode().splitlines() for text in (content, self.of(content)))
        lines = difflib.unified_diff(before, after, self.path, self.path, lineterm="", n=0)
        return "\n".join(lines)


def sites_of(content: bytes, path: str) -> Iterator[Site]:
    """Yield the sites of a module, in the order of kinds and of the text."""
    source = read_source(content)
    for kind, edits in KINDS.items():
        for edit in sorted(edits(source), key=lambda edit: (edit.start, edit.end)):
            old = content[edit.start : edit.end].decode()
            yield Site(kind, path, source.line(edit.start), edit.start, old, edit.new)


def find_sites(root: Path) -> list[Site]:
    """Return the sites of all modules of the package, pictures and shell left out."""
    paths = sorted(path.relative_to(root).as_posix() for path in (root / "jitterkit").rglob("*.py"))
    chosen = [path for path in paths if not any(fnmatch(path, pattern) for pattern in _LEFT_OUT)]
    return [site for path in chosen for site in sites_of((root / path).read_bytes(), path)]


def draw(sites: Iterable[Site], number: int, seed: int) -> list[Mutation]:
    """Draw sites, and of each what replaces it.

    Parameters
    ----------
    sites : iterable of Site
    number : int
        Shared equally among the kinds; the first kinds get what is left over.
    seed : int

    Returns
    -------
    drawn : list of Mutation
        Sorted by kind, path and line.  Within a kind every site has the same chance, but for the rules: two
        mutations a file and one a line.  Fewer than ``number`` if there are no more sites.
    """
    queues: dict[str, list[Site]] = {kind: [] for kind in KINDS}
    for site in sites:
        queues[site.kind].append(site)
    rngs = {
        kind: random.Random(f"{seed} {kind}") for kind in KINDS
    }  # more sites of one do not change another
    for kind, queue in queues.items():
        rngs[kind].shuffle(queue)
    drawn: list[Mutation] = []
    files: Counter[str] = Counter()
    lines: set[tuple[str, int]] = set()
    while len(drawn) < number and any(queues.values()):
        for kind, queue in queues.items():
            while queue and len(drawn) < number:
                site = queue.pop()
                if files[site.path] < _A_FILE and (site.path, site.line) not in lines:
                    drawn.append(Mutation(**vars(site) | {"new": rngs[kind].choice(site.new)}))
                    files[site.path] += 1
                    lines.add((site.path, site.line))
                    break
    order = list(KINDS)
    return sorted(drawn, key=lambda one: (order.index(one.kind), one.path, one.start))
