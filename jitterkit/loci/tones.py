"""Two vibrations at unrelated frequencies, each in its own plane, over many cycles.

Nature makes it from two wheels at different speeds, or two modes of one structure.  The image is
a lozenge, brightest at its four corners.
"""

from __future__ import annotations

from typing import ClassVar, Self

from jitterkit.loci.base import principal_axes
from jitterkit.loci.product import Product
from jitterkit.loci.shm import Shm

_LEAST = 0.1
"""Of the greater length, that the lesser starts with: at none a streak has no slope to follow."""


class Tones(Product):
    """Two independent vibrations; their moments add.

    Which is the first, an image does not tell.  For three tones or more, multiply: ``Product(Shm.of(0.3),
    Shm.of(0.2, 40.0), Shm.of(0.1, 80.0))``.

    *Assumes* frequencies without a small common multiple; with one, the path closes and is another.
    """

    names: ClassVar[tuple[str, ...]] = ("tone1_c", "tone1_s", "tone2_c", "tone2_s")

    def __init__(self, first: Shm, second: Shm) -> None:
        super().__init__(first, second)

    @classmethod
    def of(cls, length1: float, angle1: float, length2: float, angle2: float) -> Self:
        """Build from both lengths, peak to peak [arcsec], and the angles of their axes [deg]."""
        return cls(Shm.of(length1, angle1), Shm.of(length2, angle2))

    @classmethod
    def near(cls, moments) -> Self:
        """Start with one tone along each principal axis."""
        major, minor, angle = principal_axes(moments)
        scale = Shm.variance**-0.5
        return cls.of(scale * major, angle, scale * max(minor, _LEAST * major), angle + 90)

    def describe(self) -> dict[str, float]:
        """Return ``length1``, ``angle1``, ``length2`` and ``angle2``, arcsec and degrees."""
        parts = enumerate(self.factors(), start=1)
        return {f"{name}{k}": value for k, part in parts for name, value in part.describe().items()}
