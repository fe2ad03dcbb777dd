"""A sequence of frames from files, in the order of time, as often as they are asked for."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from pathlib import Path

from jitterkit.batch.diagnose import status_from_exception
from jitterkit.batch.processor import FrameProcessor
from jitterkit.errors import ErrorCode, FrameError, JitterkitError
from jitterkit.frames import Frame, RawFrame, find_files, open_frames
from jitterkit.frames.reader import Duplicates
from jitterkit.frames.times import epoch_seconds
from jitterkit.joint import Exposure
from jitterkit.optics.system import Optics
from jitterkit.refit import FitResult, Status

_SHUTTER = 0.1
"""Share of an exposure by which headers differ in what they count of it (see the exposure's keywords)."""


class FileExposures:
    """The frames of files, calibrated one at a time whenever they are gone over.

    Parameters
    ----------
    paths : sequence of str or Path
        Files, and directories of FITS and TIFF files.
    processor : FrameProcessor
        Calibrates them, and cuts the stars out of large ones.
    hdu : int, optional
    cadence : float, optional
        s from frame to frame, in place of what headers say; without either, frames follow each other without
        a pause, as those of one file do.

    Attributes
    ----------
    files : list of Path
        By the times in their headers, those without one last.  If no header has a time, or if some have none
        and a cadence is given, in the natural order of their names: f2 before f10.
    timed : bool
        Whether headers or the cadence say when the frames were taken.
    overlap : str
        A sentence on exposures that began before an earlier one had ended, among the frames gone over so far;
        empty where there are none.
    unbroken : bool
        Whether some of these, of one file whose header has one time, are taken to follow each other without a
        pause.
    jump : str
        A sentence where hours lie between two files whose names are in the other order: a clock was reset, or
        midnight passed and the date stayed; empty otherwise.

    Raises
    ------
    FrameError
        If a path does not exist or holds no frame.

    Notes
    -----
    A frame with the pixels of an earlier one is passed on without them, with the status ``duplicate``.
    """

    def __init__(
        self,
        paths: Sequence[str | Path],
        processor: FrameProcessor,
        *,
        hdu: int | None = None,
        cadence: float | None = None,
    ) -> None:
        self.processor, self.hdu, self.cadence = processor, hdu, cadence
        files = sorted(find_files(paths), key=_natural)
        times = {path: time for path in files if (time := _start_time(path, hdu)) is not None}
        known = {path: time for path, time in times.items() if math.isfinite(time)}
        self.timed = cadence is not None or bool(known)
        self._times = {} if cadence is not None and len(known) < len(times) else known
        self.files = sorted(files, key=lambda path: self._times.get(path, math.inf))
        self.overlap, self.unbroken = "", False
        self.jump = _jump([path for path in self.files if path in self._times], self._times, files)

    def __iter__(self) -> Iterator[Exposure]:
        self.overlap, self.unbroken = "", False
        clock, known = _Clock(self.cadence, self._times), Duplicates()
        for path in self.files:
            index = 0
            try:
                with open_frames(path, hdu=self.hdu) as file:
                    for index in range(len(file)):
                        yield self._exposure(file[index], clock, known)
            except FrameError as error:
                name = path.name if index == 0 else f"{path.name}[{index}]"
                yield Exposure(name, clock.lost(path), None, FitResult.from_error(Status.UNREADABLE, error))

    @cached_property
    def optics(self) -> Optics:
        """Return the optics of the sequence: on the grid of its first frame.

        Raises
        ------
        JitterkitError
            If there is no frame that can be read.
        """
        message, code = "there is none.", ErrorCode.NO_IMAGE
        for path in self.files:
            try:
                with open_frames(path, hdu=self.hdu) as file:
                    return self.processor.optics(self.processor.calibrate(file[0]))
            except JitterkitError as error:
                message, code = str(error), error.code
        raise JitterkitError(code, f"No frame of the sequence can be used; the last: {message}")

    def _exposure(self, raw: RawFrame, clock: _Clock, known: Duplicates) -> Exposure:
        try:
            frame = self.processor.calibrate(raw)
            if original := known.original(frame.digest, f"{raw.path} [{raw.index}]"):
                return Exposure(raw.name, math.nan, None, FitResult.duplicate_of(original))
            optics, when = self.processor.optics(frame), clock.middle(frame, raw.after)
            clock.occupy(raw, when, frame.exposure)
            self.overlap, self.unbroken = clock.overlap, clock.unbroken
        except JitterkitError as error:
            result = status_from_exception(error, None, self.processor.plate_scale)
            return Exposure(raw.name, clock.lost(raw.path), None, result)
        if optics is self.optics:
            return Exposure(raw.name, when, frame)
        message = f"{Status.MISMATCH.value}: its pixels or its plate scale are not those of the first frame."
        return Exposure(raw.name, when, None, FitResult(Status.MISMATCH, message))


_HOURS = 8 * 3600.0
"""Between two nights there are more, in the frames of one night fewer."""


def _jump(ordered: Sequence[Path], times: Mapping[Path, float], named: Sequence[Path]) -> str:
    """Return a sentence on the longest pause, if the names of the files about it are in the other order."""
    pauses = [(times[after] - times[before], before, after) for before, after in pairwise(ordered)]
    pause, before, after = max(pauses, default=(0.0, None, None))
    if before is None or after is None or pause < _HOURS or named.index(before) < named.index(after):
        return ""
    return (
        f"By their headers {before.name} was taken {pause / 3600:.0f} hours before {after.name}, and their "
        "names are in the other order: see that no clock was reset, and that the date changes at midnight."
    )


def _natural(path: Path) -> list[tuple[str, int, str]]:
    """Key of a natural order of names: digits that stand together count as a number."""
    parts = re.findall(r"[0-9]+|[^0-9]", str(path))
    return [("0", int(part), part) if part.isdecimal() else (part, 0, part) for part in parts]


def _start_time(path: Path, hdu: int | None) -> float | None:
    """Return the time in a file's header [s], NaN if it has none or a day; None if it cannot be read."""
    try:
        with open_frames(path, hdu=hdu) as file:
            text = file.metadata.value("time", "")
    except JitterkitError:
        return None
    return epoch_seconds(text) if "T" in text else math.nan  # all of a day would be taken at once


class _Clock:
    """Determine when frames were taken: by their headers, or one after the other."""

    def __init__(self, cadence: float | None, times: Mapping[Path, float]) -> None:
        self._cadence, self._times = cadence, times
        self._zero: float | None = None
        self._elapsed, self._missed = 0.0, 0  # s of exposures without times, and lost ones since
        # file, time of a header in it, and the first image that has it
        self._own: tuple[Path | None, float, int] = (None, 0.0, 0)
        self._rounding = float(self._reads_times and all(time.is_integer() for time in times.values()))
        self._last: tuple[float, Path | None, str] = (-math.inf, None, "")
        self._overlaps: list[str] = []
        self._delay, self.unbroken = 0.0, False  # by which detectors exposed at once are modelled later, s

    @property
    def _reads_times(self) -> bool:
        return self._cadence is None and bool(self._times)

    def lost(self, path: Path | None) -> float:
        """Return the time of a frame of which nothing is known; its place in the sequence counts."""
        self._missed += 1
        if self._zero is None and path is not None:
            self._zero = self._times.get(path)
        return math.nan

    def middle(self, frame: Frame, after: int | None) -> float:
        """Return the middle of an exposure, s from the beginning of the first.

        An image whose header has a time of its own was taken then, after others of the file with that time.
        """
        exposure = frame.exposure or 0.0
        step = self._cadence or exposure or 1.0
        if not self._reads_times:
            self._elapsed += self._missed * step
            self._missed, middle = 0, self._elapsed + exposure / 2
            self._elapsed += step
            return middle
        assert frame.path is not None
        start, known = self._times.get(frame.path), frame.metadata.time
        if start is None or known is None:
            problem = "does not say when it was taken, as others do"
            raise FrameError(ErrorCode.MISSING_VALUE, frame.path, problem, "give the --cadence")
        index, own = frame.index * frame.several, epoch_seconds(known.value)
        if own != start and after is not None and "T" in known.value:
            if self._own[:2] != (frame.path, own):
                self._own = frame.path, own, frame.index
            start, index = own, (frame.index - self._own[2]) * frame.several
            self.unbroken |= index > 0
        ordinal = index if after is None else after
        self.unbroken |= ordinal > 0
        self._delay = (index - ordinal) * exposure
        start += index * step - ("-AVG" in known.source) * exposure / 2
        self._zero = start if self._zero is None else self._zero
        return start - self._zero + exposure / 2

    def occupy(self, raw: RawFrame, middle: float, exposure: float | None) -> None:
        """Note the time that an exposure takes, and whether it overlaps that of an earlier file or frame.

        The frames of one file follow each other, or are those of detectors exposed at once (``raw.after``).
        """
        if not exposure:
            return
        end, path, name = self._last
        start = middle - exposure / 2 - self._delay
        apart = not self._reads_times or raw.path != path
        if apart and end - start > _SHUTTER * exposure + self._rounding:
            self._overlaps.append(f"{raw.name} begins {end - start:.3g} s before {name} ends")
        if start + exposure > end:
            self._last = start + exposure, raw.path, raw.name

    @property
    def overlap(self) -> str:
        """Return a sentence on the exposures that overlap; empty where none do."""
        if not self._overlaps:
            return ""
        others = f", and {len(self._overlaps) - 1} more overlap" if len(self._overlaps) > 1 else ""
        wrong = "the times in the headers" if self._reads_times else "the --cadence"
        return f"{self._overlaps[0]}{others}: {wrong} or the exposure must be wrong."
