"""A sequence of frames from files, in the order of time, as often as they are asked for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from functools import cached_property
from pathlib import Path

from jitterkit.batch.finder import Finder
from jitterkit.errors import ErrorCode, FrameError, JitterkitError
from jitterkit.frames import Frame, RawFrame, find_files, open_frames
from jitterkit.joint import Exposure
from jitterkit.optics.system import Optics
from jitterkit.refit import FitResult, Status

__all__ = ["FileExposures"]


class FileExposures:
    """The frames of files, calibrated one at a time whenever they are gone over.

    Parameters
    ----------
    paths : sequence of str or Path
        Files, and directories whose FITS and TIFF files are taken in order of name.
    finder : Finder
        Calibrates them, and cuts the stars out of large ones.
    hdu : int, optional
    cadence : float, optional
        s from frame to frame, in place of what headers say; without either, frames follow each other without
        a pause, as those of one file do.

    Attributes
    ----------
    timed : bool
        Whether headers or the cadence said when; known once the frames have been gone over.

    Raises
    ------
    FrameError
        If a path does not exist or holds no frame.
    """

    def __init__(
        self,
        paths: Sequence[str | Path],
        finder: Finder,
        *,
        hdu: int | None = None,
        cadence: float | None = None,
    ) -> None:
        self.files = find_files(paths)
        self.finder, self.hdu, self.cadence = finder, hdu, cadence
        self.timed = True

    def __iter__(self) -> Iterator[Exposure]:
        clock = _Clock(self.cadence)
        for path in self.files:
            index = 0
            try:
                with open_frames(path, hdu=self.hdu) as file:
                    for index in range(len(file)):
                        yield self._exposure(file[index], clock)
            except FrameError as error:
                name = path.name if index == 0 else f"{path.name}[{index}]"
                yield Exposure(name, clock.lost(), None, FitResult.from_error(Status.UNREADABLE, error))
        self.timed = clock.timed

    @cached_property
    def optics(self) -> Optics:
        """The optics of the sequence: on the grid of its first frame.

        Raises
        ------
        JitterkitError
            If there is no frame that can be read.
        """
        told, code = "there is none.", ErrorCode.NO_IMAGE
        for path in self.files:
            try:
                with open_frames(path, hdu=self.hdu) as file:
                    return self.finder.optics(self.finder.calibrate(file[0]))
            except JitterkitError as error:
                told, code = str(error), error.code
        raise JitterkitError(code, f"No frame of the sequence can be used; the last: {told}")

    def _exposure(self, raw: RawFrame, clock: _Clock) -> Exposure:
        try:
            frame = self.finder.calibrate(raw)
            optics, when = self.finder.optics(frame), clock.middle(frame)
        except JitterkitError as error:
            return Exposure(raw.name, clock.lost(), None, self.finder.trouble(error))
        if optics is self.optics:
            return Exposure(raw.name, when, frame)
        told = f"{Status.MISMATCH.value}: its pixels or its plate scale are not those of the first frame."
        return Exposure(raw.name, when, None, FitResult(Status.MISMATCH, told))


class _Clock:
    """When frames were taken: by their headers, or one after the other."""

    def __init__(self, cadence: float | None) -> None:
        self.cadence, self.timed = cadence, True
        self._zero: datetime | None = None
        self._count = 0

    def lost(self) -> float:
        """The time of a frame of which nothing is known; its place in the sequence counts."""
        self._count += 1
        return float("nan")

    def middle(self, frame: Frame) -> float:
        """Middle of an exposure, s from the beginning of the first."""
        exposure = frame.exposure or 0.0
        step = self.cadence or exposure or 1.0
        known = frame.metadata.time
        if known is None and self._zero is not None:
            raise FrameError(
                ErrorCode.MISSING_VALUE,
                frame.path or frame.name,
                "does not say when it was taken, as others do",
                "give the --cadence",
            )
        if known is None or self.cadence is not None:
            self.timed = self.timed and self.cadence is not None
            self._count += 1
            return (self._count - 1) * step + exposure / 2
        when = datetime.fromisoformat(str(known.value))
        self._zero = self._zero or when
        begun = (when - self._zero).total_seconds() + frame.index * step * frame.several
        return begun + (0.0 if "DATE-AVG" in known.source else exposure / 2)
