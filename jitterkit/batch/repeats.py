"""What the frames of a run show again and again, so that the blur of each is found in milliseconds."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain

from jitterkit.batch.finder import Finder, GridKey
from jitterkit.batch.survey import Item, read_items
from jitterkit.errors import JitterkitError
from jitterkit.estimators.repeat import Repeat, Repeated
from jitterkit.forward import Parameters
from jitterkit.frames import Frame
from jitterkit.likelihood import Data
from jitterkit.optics import OpticalSystem

__all__ = ["Repeats"]


class Repeats:
    """Looks at the leads of batches, one after the other.

    What half of the frames of a lead repeat is kept while their wavefront is near, and follows it where it
    has moved on.  Where less than half do, it is made anew from the first of them that half of them repeat,
    and where there is none they are too unlike each other.  So what a batch is given depends on the leads up
    to it, and on nothing else.

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
            for repeat in chain([self._followed(grid, here)], map(self._anew, here)):
                if repeat is not None and 2 * len(_repeated(repeat, here)) >= len(here):
                    found[grid] = repeat
                    break
        return found

    def _followed(self, grid: GridKey, frames: list[Frame]) -> Repeat | None:
        """What is known, or what it has moved on to; None if no frame repeats what is known."""
        known = self._known.get(grid)
        repeated = [] if known is None else _repeated(known, frames)
        if any(one.near for one in repeated):
            return known
        return self._made(frames[0], repeated[0].parameters) if repeated else None

    def _anew(self, frame: Frame) -> Repeat | None:
        aberrations = self._finder.instrument.aberrations
        shown = self._finder.wavefront(frame) if aberrations else None
        return None if shown is None else self._made(frame, shown)

    def _made(self, frame: Frame, shown: Parameters) -> Repeat | None:
        """From what has been shown on the grid of a frame."""
        system = self._finder.optics(frame)
        if not isinstance(system, OpticalSystem):
            return None
        return Repeat.of(shown, system, self._finder.options.hold)


def _repeated(repeat: Repeat, frames: list[Frame]) -> list[Repeated]:
    """What the frames have told that repeat what one has shown."""
    ends = repeat.compare([Data.of(frame) for frame in frames])
    return list(filter(None, map(repeat.told, filter(None, ends))))
