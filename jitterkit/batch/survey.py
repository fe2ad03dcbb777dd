"""What the first frames of many show of the telescope, so that the others need not find it out again."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby
from pathlib import Path
from threading import Lock

import numpy as np

from jitterkit.batch.finder import AUTO, Finder, GridKey
from jitterkit.batch.shown import Shown
from jitterkit.errors import ErrorCode, FrameError, JitterkitError
from jitterkit.forward import Parameters
from jitterkit.frames import Frame, FrameFile, RawFrame, open_frames
from jitterkit.linearisation import SETTLED
from jitterkit.locate import ReferenceFrame
from jitterkit.optics import Anchor, AnchoredOptics, OpticalSystem
from jitterkit.refit import SceneChoice
from jitterkit.refit.fit import settled
from jitterkit.refit.weigh_scenes import DECIDED

__all__ = ["Item", "Survey", "read_items"]

Item = tuple[Path, int]
"""File and place of the frame in it."""

_KEPT = 100_000_000
"""Bytes of anchors that are kept for leads to come: eight at 128 x 128 pixels."""


class Survey:
    """Looks at the leads of batches.

    An anchor's state is rounded to a whole nm, so that leads between which little has changed share one.

    The first frame of a lead whose scene is in no doubt decides for all that are registered to it.

    Parameters
    ----------
    finder : Finder
    hdu : int, optional
        To read in every FITS file.
    """

    def __init__(self, finder: Finder, hdu: int | None = None) -> None:
        self._finder, self._hdu = finder, hdu
        self._anchors: OrderedDict[tuple, Anchor] = OrderedDict()
        self._last: tuple[tuple[Item, ...], dict[GridKey, Shown]] = ((), {})
        self._looking = Lock()

    def of(self, lead: tuple[Item, ...]) -> Mapping[GridKey, Shown]:
        """By the grids of frames; nothing of a grid on which no frame of the lead is sound."""
        with self._looking:  # threads of two batches may ask
            if lead != self._last[0]:
                self._last = lead, self._look(lead)
            return self._last[1]

    def _look(self, lead: tuple[Item, ...]) -> dict[GridKey, Shown]:
        found: dict[GridKey, Shown] = {}
        for _, _, raw in read_items(lead, self._hdu):
            frame = None if isinstance(raw, JitterkitError) else self._finder.prepare(raw)
            if not isinstance(frame, Frame) or (key := self._finder.grid(frame)) in found:
                continue
            choice = self._finder.choose_scene(frame)
            if choice is None or abs(choice.log_odds) < DECIDED:
                continue  # the next may tell
            if (shown := self._shown(frame, choice)) is not None:
                found[key] = shown
        return found

    def shown(self, frame: Frame) -> Shown | None:
        """What one frame shows; None of one that is not sound, and where nothing is known by it."""
        choice = self._finder.choose_scene(frame)
        return None if choice is None else self._shown(frame, choice)

    def _shown(self, frame: Frame, choice: SceneChoice) -> Shown | None:
        parameters, optics = choice.start.parameters, self._finder.optics(frame)
        if not len(parameters.aberrations) or not isinstance(optics, OpticalSystem):  # nothing can change
            return Shown(choice.scene, choice.doubt) if self._finder.scene == AUTO else None
        anchored = self._anchored(self._finder.grid(frame), optics, parameters)
        hold = self._finder.options.hold
        reference = ReferenceFrame.of(parameters, optics, anchored.anchor, hold)
        return Shown(choice.scene, choice.doubt, anchored, reference)

    def _anchored(self, grid: GridKey, optics: OpticalSystem, shown: Parameters) -> AnchoredOptics:
        shown_state = np.asarray(shown.aberrations)
        state = np.round(shown_state)
        key = (grid, *state)
        anchor = self._anchors.pop(key, None) or Anchor.at(optics, state)
        self._anchors[key] = anchor
        while len(self._anchors) > 1 and sum(one.nbytes for one in self._anchors.values()) > _KEPT:
            self._anchors.popitem(last=False)
        strict = settled(self._finder.options.tolerance) / SETTLED  # it has to be as good as if more showed
        return AnchoredOptics.about(optics, anchor, float(shown.scene.flux) / strict**2, shown_state)


def read_items(
    items: Iterable[Item], hdu: int | None
) -> Iterator[tuple[Path, int, RawFrame | JitterkitError]]:
    """Frames, or what is wrong with their files or the TOML beside them; a file is opened once."""
    for path, group in groupby(items, key=lambda item: item[0]):
        places = [index for _, index in group]
        try:
            file = open_frames(path, hdu=hdu)
        except JitterkitError as error:
            yield from ((path, index, error) for index in places)
            continue
        with file:
            for index in places:
                yield path, index, _frame(file, index)


def _frame(file: FrameFile, index: int) -> RawFrame | JitterkitError:
    try:
        return file[index]
    except JitterkitError as error:
        return error
    except IndexError:
        return FrameError(
            ErrorCode.CHANGED, file.path, f"has {len(file)} frames, fewer than before", "see who writes to it"
        )
