"""What the frames of a run show again and again, so that the blur of each is found in milliseconds."""

from __future__ import annotations

from collections.abc import Mapping

from jitterkit.batch.finder import Finder, GridKey
from jitterkit.batch.survey import Item, read_items
from jitterkit.errors import JitterkitError
from jitterkit.estimators.repeat import Repeat
from jitterkit.frames import Frame
from jitterkit.likelihood import Data
from jitterkit.optics import OpticalSystem

__all__ = ["Repeats"]


class Repeats:
    """Looks at the leads of batches, one after the other.

    What a frame of the lead repeats is kept; what none repeats any more is made anew from one of them; and if
    less than half of them repeat that, they are too unlike each other.  So what a batch is given depends on
    the leads up to it, and on nothing else.

    Parameters
    ----------
    finder : Finder
    hdu : int, optional
        To read in every FITS file.
    """

    def __init__(self, finder: Finder, hdu: int | None = None) -> None:
        self._finder, self._hdu = finder, hdu
        self._known: dict[GridKey, Repeat] = {}
        self._lead: tuple[Item, ...] = ()

    def of(self, lead: tuple[Item, ...]) -> Mapping[GridKey, Repeat]:
        """What the frames of a batch may repeat, by their grids; of grids that its lead has."""
        if lead != self._lead:
            self._lead, self._known = lead, self._look(lead)
        return self._known

    def _look(self, lead: tuple[Item, ...]) -> dict[GridKey, Repeat]:
        found: dict[GridKey, Repeat] = {}
        frames: dict[GridKey, list[Frame]] = {}
        for _, _, raw in read_items(lead, self._hdu):
            frame = None if isinstance(raw, JitterkitError) else self._finder.prepare(raw)
            if isinstance(frame, Frame):
                frames.setdefault(self._finder.grid(frame), []).append(frame)
        for grid, here in frames.items():
            repeat = self._known.get(grid)
            if repeat is None or not _repeating(repeat, here):
                repeat = next(filter(None, map(self._anew, here)), None)
            if repeat is not None and 2 * _repeating(repeat, here) >= len(here):
                found[grid] = repeat
        return found

    def _anew(self, frame: Frame) -> Repeat | None:
        aberrations = self._finder.instrument.aberrations
        shown = self._finder.wavefront(frame) if aberrations else None
        if shown is None:
            return None
        system = self._finder.optics(frame)
        return (
            Repeat.of(shown, system, self._finder.options.hold) if isinstance(system, OpticalSystem) else None
        )


def _repeating(repeat: Repeat, frames: list[Frame]) -> int:
    """How many frames repeat what one has shown."""
    return sum(repeat.estimate(Data.of(frame)) is not None for frame in frames)
