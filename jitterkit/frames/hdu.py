"""One HDU of a FITS file as its header describes it, read with suspicion.

:class:`Unit` knows the few keywords by which FITS lays a file out, and refuses a file in which they say what
cannot be.  Everything else in a header is read elsewhere, and believed less strictly.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from jitterkit.errors import ErrorCode, FrameError

__all__ = ["CARD", "DAMAGED", "MOST_AXES", "Unit", "product_of"]

CARD = 80
#: FITS allows so many axes, and columns of a table.
MOST_AXES = 999
DAMAGED = "the file is damaged: copy it again or convert it"

_STRUCTURE = re.compile(
    rb"(SIMPLE|XTENSION|Z?BITPIX|Z?NAXIS\d{0,3}|[PG]COUNT|GROUPS|TFIELDS|ZIMAGE|ZTILE\d{1,3}) *=(.*)"
)
_WHOLE = re.compile(rb"[+-]?\d{1,25}")


@dataclass(frozen=True)
class Unit:
    """One HDU as its header describes it.

    Parameters
    ----------
    path : Path
        For sentences.
    number : int
        From 0.
    start, data : int
        Where its header and its data begin, in the unpacked file [bytes].
    text : bytes
        The cards of the header, 80 bytes each, without END.
    """

    path: Path
    number: int
    start: int
    data: int
    text: bytes

    @cached_property
    def structure(self) -> dict[str, bytes]:
        """What the keywords that lay the file out say, as written without the comment."""
        found: dict[str, bytes] = {}
        for at in range(0, len(self.text), CARD):
            match = _STRUCTURE.match(self.text, at, at + CARD)
            if match is None:
                continue
            key, value = match[1].decode(), match[2].split(b"/")[0].strip()
            if found.setdefault(key, value) != value:
                shown = " and ".join(map(_shown, (found[key], value)))
                problem = f"HDU {self.number} says {key} twice, {shown}"
                raise FrameError(ErrorCode.DAMAGED, self.path, problem, DAMAGED)
        return found

    def whole(self, key: str, default: int | None = None) -> int:
        """Return a whole number of the structure, or refuse the file."""
        if key not in self.structure and default is not None:
            return default
        words = self.structure.get(key)
        if words is None or _WHOLE.fullmatch(words) is None:
            has = f"no {key}" if words is None else f"{key} = {_shown(words)} where a whole number belongs"
            raise FrameError(ErrorCode.DAMAGED, self.path, f"HDU {self.number} has {has}", DAMAGED)
        return int(words)

    @cached_property
    def packed(self) -> bool:
        """Whether it is a table that holds a tile-compressed image."""
        return self.structure.get("ZIMAGE") == b"T" and self._extension == b"BINTABLE"

    @cached_property
    def _extension(self) -> bytes:
        return self.structure.get("XTENSION", b"").strip(b" '") if self.number else b"IMAGE"

    @cached_property
    def bitpix(self) -> int:
        """Bits of a stored pixel, negative for floating point."""
        return self._bits("ZBITPIX" if self.packed else "BITPIX")

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Of the image, slowest axis first; of a table its own."""
        return self._axes("ZNAXIS" if self.packed else "NAXIS")

    @property
    def is_image(self) -> bool:
        """Whether it holds frames: two axes with pixels, and at most one more to stack them along."""
        if self.what in ("random groups", "a table") or len(self.shape) < 2:
            return False
        *planes, ny, nx = self.shape
        return ny > 0 and nx > 0 and math.prod(planes) > 0 and sum(n > 1 for n in planes) <= 1

    @cached_property
    def what(self) -> str:
        """What it is, for a refusal."""
        if self.number == 0 and self.structure.get("GROUPS") == b"T":
            return "random groups"
        if self._extension not in (b"IMAGE", b"IUEIMAGE") and not self.packed:
            return "a table"
        return f"an array of {product_of(self.shape)}" if self.shape else "empty"

    @property
    def span(self) -> int:
        """Bytes of data it declares, without padding."""
        axes = self._axes("NAXIS")
        count = math.prod(axes[:-1] if axes and axes[-1] == 0 and self.what == "random groups" else axes)
        elements = self.whole("PCOUNT", 0) + (count if axes else 0)
        return abs(self._bits("BITPIX")) // 8 * max(self.whole("GCOUNT", 1) * elements, 0)

    def _bits(self, key: str) -> int:
        bits = self.whole(key)
        if bits not in (8, 16, 32, 64, -32, -64):
            problem = f"HDU {self.number} has {key} = {bits}, which FITS does not know"
            raise FrameError(ErrorCode.DAMAGED, self.path, problem, DAMAGED)
        return bits

    def _axes(self, stem: str) -> tuple[int, ...]:
        count = self.whole(stem)
        if not 0 <= count <= MOST_AXES:
            problem = f"HDU {self.number} declares {stem} = {count} axes"
            raise FrameError(ErrorCode.DAMAGED, self.path, problem, DAMAGED)
        sides = tuple(self.whole(f"{stem}{n}") for n in range(count, 0, -1))
        if any(side < 0 for side in sides):
            problem = f"HDU {self.number} declares {product_of(sides)} pixels"
            raise FrameError(ErrorCode.DAMAGED, self.path, problem, DAMAGED)
        return sides


def _shown(words: bytes) -> str:
    return repr("".join(chr(c) if 32 <= c < 127 else "?" for c in words[:30]))


def product_of(sides: tuple[int, ...]) -> str:
    """Sides in the order of FITS, the first of them where there are very many."""
    shown = " x ".join(map(str, sides[:-6:-1]))
    return f"{shown} x ..." if len(sides) > 5 else shown
