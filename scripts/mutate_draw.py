"""Draw mutations of the package, reproducibly from a tree and a seed, with equal numbers of each kind.

Reach for :func:`find_sites` and :func:`draw`.  The command line, pictures and wording are excluded,
because mistakes in them are visible.
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
    "jitterkit/report/html.py",
    "jitterkit/report/*words.py",
    "jitterkit/report/*_text.py",
    "*/__init__.py",
    "*/__main__.py",
)
_A_FILE = 2
"""Largest number of mutations in one file, so that long files do not dominate the draw."""


@dataclass(frozen=True)
class Site:
    """Position where a mutation can be made.

    Attributes
    ----------
    kind : str
        One of ``mutate_kinds.KINDS``.
    path : str
        Path of the module from the root of the tree, with slashes.
    line, start : int
        Beginning of the site: the line, counted from 1, and the byte in the UTF-8 text.
    old : str
        Text at the site.
    new : tuple of str
        Texts that can replace it.
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
        """Return the content of a module after this mutation."""
        end = self.start + len(self.old.encode())
        return content[: self.start] + self.new.encode() + content[end:]

    def diff(self, content: bytes) -> str:
        """Return the changed lines of a module as a unified diff without context."""
        before, after = (text.decode().splitlines() for text in (content, self.of(content)))
        lines = difflib.unified_diff(before, after, self.path, self.path, lineterm="", n=0)
        return "\n".join(lines)


def sites_of(content: bytes, path: str) -> Iterator[Site]:
    """Yield the sites of a module, sorted by kind and then by position."""
    source = read_source(content)
    for kind, edits in KINDS.items():
        for edit in sorted(edits(source), key=lambda edit: (edit.start, edit.end)):
            old = content[edit.start : edit.end].decode()
            yield Site(kind, path, source.line(edit.start), edit.start, old, edit.new)


def find_sites(root: Path) -> list[Site]:
    """Return the sites of the package, except in the command line, pictures and wording."""
    paths = sorted(path.relative_to(root).as_posix() for path in (root / "jitterkit").rglob("*.py"))
    chosen = [path for path in paths if not any(fnmatch(path, pattern) for pattern in _LEFT_OUT)]
    return [site for path in chosen for site in sites_of((root / path).read_bytes(), path)]


def draw(sites: Iterable[Site], number: int, seed: int) -> list[Mutation]:
    """Draw sites, and one replacement for each site.

    Parameters
    ----------
    sites : iterable of Site
    number : int
        Shared equally among the kinds; the first kinds get the remainder.
    seed : int

    Returns
    -------
    drawn : list of Mutation
        Sorted by kind, path and line.  Within a kind every site has the same chance, except that a file has
        at most two mutations and a line at most one.  Fewer than ``number`` if there are no more sites.
    """
    queues: dict[str, list[Site]] = {kind: [] for kind in KINDS}
    for site in sites:
        queues[site.kind].append(site)
    rngs = {
        kind: random.Random(f"{seed} {kind}") for kind in KINDS
    }  # more sites of one kind do not change the draw of another
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
