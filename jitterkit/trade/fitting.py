"""Separations of frames as a long run has them, and how long each takes."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from jitterkit.batch import FrameProcessor
from jitterkit.frames import Frame, RawFrame
from jitterkit.trade.methods import separations

TOGETHER = 1024
"""Frames that share what one of them shows of the optics."""


@dataclass(frozen=True)
class Fitting:
    """What fits, and the share of a frame in what was done beforehand.

    Attributes
    ----------
    processor : FrameProcessor
    share : float
        s.
    method : str
        Of :mod:`jitterkit.trade.methods`.
    """

    processor: FrameProcessor
    share: float = 0.0
    method: str = "refit"

    @classmethod
    def anchored(
        cls, processor: FrameProcessor, raw: RawFrame, frames: int = TOGETHER, method: str = "refit"
    ) -> Fitting:
        """With the optics about what a first frame of several shows."""
        frame = processor.calibrate(raw)
        processor.with_warm_starts({}).warm_start(frame)  # compiles
        began = time.perf_counter()
        warm = processor.with_warm_starts({}).warm_start(frame)
        share = (time.perf_counter() - began) / min(max(frames, 1), TOGETHER)
        known = {} if warm is None else {processor.grid(frame): warm}
        return cls(processor.with_warm_starts(known), share, method)

    def separations(self, frames: Iterable[Frame]) -> np.ndarray:
        """Separations of calibrated frames with their errors (n, 2), arcsec.

        Raises
        ------
        JitterkitError
            If one cannot be had.
        """
        return separations(self.method, self.processor, frames)

    def timed(self, raws: Sequence[RawFrame]) -> tuple[np.ndarray, float]:
        """The same of raw frames, and the seconds that one takes, calibration included.

        The median, but of frames together their mean.
        """
        self._of_raw(raws)  # compiles what there is to
        if self.method == "joint":
            together, whole = self._clocked(raws)
            return together, whole / len(raws)
        found, spent = zip(*(self._clocked((raw,)) for raw in raws), strict=True)
        return np.concatenate(found), float(np.median(spent)) + self.share

    def _clocked(self, raws: Sequence[RawFrame]) -> tuple[np.ndarray, float]:
        began = time.perf_counter()
        return self._of_raw(raws), time.perf_counter() - began

    def _of_raw(self, raws: Sequence[RawFrame]) -> np.ndarray:
        return self.separations(map(self.processor.calibrate, raws))
