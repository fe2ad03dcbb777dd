"""What :func:`~jitterkit.batch.kernels.estimate_files` asks of whoever measures the blur of frames."""

from __future__ import annotations

from typing import Protocol, TypeVar

from jitterkit.batch.measured import Measured
from jitterkit.batch.plan import Batch
from jitterkit.frames import RawFrame
from jitterkit.refit import FitResult

__all__ = ["Measurer"]

Begun = TypeVar("Begun")
"""A frame of which something has been done."""


class Measurer(Protocol[Begun]):
    """What measures the blur of frames.

    Attributes
    ----------
    name : str
        Of the estimator.
    """

    @property
    def name(self) -> str: ...

    @property
    def threads(self) -> int | None:
        """How many may measure at a time; None for as many as there are processors."""
        ...

    @property
    def together(self) -> int:
        """Frames of a batch, all of which are held until it is done."""
        ...

    def among(self, batch: Batch, hdu: int | None) -> Measurer[Begun]:
        """The same for the frames of a batch, with what they show together."""
        ...

    def begin(self, raw: RawFrame) -> Begun:
        """Do what is best done where frames are read; a JitterkitError says why it cannot be."""
        ...

    def measure(self, begun: Begun) -> Measured | FitResult:
        """Measure a frame; it says in a status why it cannot, or in a JitterkitError."""
        ...
