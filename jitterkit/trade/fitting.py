"""Fits of single frames as a long run makes them, and how long they take."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jitterkit.batch import Processor
from jitterkit.batch.survey import Survey
from jitterkit.errors import JitterkitError
from jitterkit.frames import Frame, RawFrame

__all__ = ["TOGETHER", "Fitting"]

TOGETHER = 1024
"""Frames that share what one of them shows of the optics."""


@dataclass(frozen=True)
class Fitting:
    """What fits, and the share of a frame in what was done beforehand.

    Attributes
    ----------
    processor : Processor
    share : float
        s.
    """

    processor: Processor
    share: float = 0.0

    @classmethod
    def anchored(cls, processor: Processor, raw: RawFrame, frames: int = TOGETHER) -> Fitting:
        """With the optics about what a first frame of several shows."""
        frame = processor.calibrate(raw)
        Survey(processor).shown(frame)  # compiles
        began = time.perf_counter()
        shown = Survey(processor).shown(frame)
        share = (time.perf_counter() - began) / min(max(frames, 1), TOGETHER)
        known = {} if shown is None else {processor.grid(frame): shown}
        return cls(replace(processor, known=known), share)

    def separations(self, frames: Iterable[Frame]) -> np.ndarray:
        """Separations of calibrated frames with their errors (n, 2), arcsec.

        Raises
        ------
        JitterkitError
            If one cannot be fitted.
        """
        return np.array(list(map(self._fitted, frames)))

    def timed(self, raws: Sequence[RawFrame]) -> tuple[np.ndarray, float]:
        """The same of raw frames, and the median of the seconds that a frame takes, calibration included."""
        self.separations(map(self.processor.calibrate, raws))  # compiles what there is to
        found, spent = [], []
        for raw in raws:
            began = time.perf_counter()
            found.append(self._fitted(self.processor.calibrate(raw)))
            spent.append(time.perf_counter() - began)
        return np.array(found), float(np.median(spent)) + self.share

    def _fitted(self, frame: Frame) -> tuple[float, float]:
        result = self.processor.fit(frame).result
        if result.parameters is None or not result.status.usable:
            raise JitterkitError(result.message)
        return result.of_scene("separation"), result.error("separation")
