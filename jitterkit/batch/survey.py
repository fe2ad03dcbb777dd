"""What the first frames of many show of the telescope, so that the others need not find it out again."""

from __future__ import annotations

from collections import OrderedDict, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby
from pathlib import Path
from threading import Lock

import numpy as np

from jitterkit.batch.finder import AUTO, Finder, GridKey
from jitterkit.batch.plan import Batch
from jitterkit.batch.shown import Shown
from jitterkit.errors import ErrorCode, FrameError, JitterkitError
from jitterkit.forward import Parameters
from jitterkit.frames import Frame, FrameFile, RawFrame, open_frames
from jitterkit.linearisation import SETTLED
from jitterkit.locate import ReferenceFrame
from jitterkit.optics import Anchor, AnchoredOptics, OpticalSystem
from jitterkit.refit import SceneChoice
from jitterkit.refit.fit import settled
from jitterkit.refit.scene_choice import DECIDED
from jitterkit.refit.together import scene_together

__all__ = ["Item", "Survey", "read_items"]

Item = tuple[Path, int]
"""File and place of the frame in it."""

Look = tuple[Frame, SceneChoice]
"""A frame, and what it shows by itself."""

_KEPT = 100_000_000
"""Bytes of anchors that are kept for leads to come: eight at 128 x 128 pixels."""


class Survey:
    """Looks at the leads of batches.

    An anchor's state is rounded to a whole nm, so that leads between which little has changed share one.

    The frames of a lead decide the scene together; two that agree and are in no doubt are enough.

    Parameters
    ----------
    finder : Finder
    hdu : int, optional
        To read in every FITS file.
    """

    def __init__(self, finder: Finder, hdu: int | None = None) -> None:
        self._finder, self._hdu = finder, hdu
        self._anchors: OrderedDict[tuple, Anchor] = OrderedDict()
        self._last: tuple[tuple[tuple[Item, ...], bool], Mapping[GridKey, Shown]] = (((), False), {})
        self._looking = Lock()

    def of(self, batch: Batch) -> Mapping[GridKey, Shown]:
        """By the grids of frames; nothing of a grid on which no frame of the batch's lead is sound.

        Of a batch that is its own lead only the scene is told: it has too few frames for more.
        """
        with self._looking:  # threads of two batches may ask
            few = batch.lead == batch.items
            if (batch.lead, few) != self._last[0]:
                looked = self._look(batch.lead, every=few)
                tell = self._scene_of if few else self._shown_together
                told = ((key, tell(list(seen))) for key, seen in looked.items())
                self._last = (batch.lead, few), {key: shown for key, shown in told if shown is not None}
            return self._last[1]

    def _look(self, lead: tuple[Item, ...], *, every: bool) -> dict[GridKey, list[Look]]:
        """What each frame shows by itself: of every frame, or until their scene is in no doubt."""
        found: defaultdict[GridKey, list[Look]] = defaultdict(list)
        for _, _, raw in read_items(lead, self._hdu):
            frame = None if isinstance(raw, JitterkitError) else self._finder.prepare(raw)
            if not isinstance(frame, Frame):
                continue
            seen = found[self._finder.grid(frame)]
            if self._agree(seen) and not every:
                continue
            choice = self._finder.choose_scene(frame)
            if choice is not None:
                seen.append((frame, choice))
        return found

    def _agree(self, seen: list[Look]) -> bool:
        """Whether enough frames show one scene without doubt; who names the scene needs one frame."""
        scenes = [choice.scene for _, choice in seen if not abs(choice.log_odds) < DECIDED]
        return len(set(scenes)) == 1 and len(scenes) >= (2 if self._finder.scene == AUTO else 1)

    def _shown_together(self, seen: list[Look]) -> Shown | None:
        """What frames show of their telescope, by the first that shows what they show together."""
        scene = scene_together([choice for _, choice in seen])
        looks = [look for look in seen if look[1].scene == scene]
        if looks:
            return self._shown(*looks[0])
        return None if scene is None else Shown(scene)

    def _scene_of(self, seen: list[Look]) -> Shown | None:
        """What scene a few frames show together, and what each shows by itself."""
        if self._finder.scene != AUTO:
            return None
        scene = scene_together([choice for _, choice in seen]) or AUTO
        return Shown(scene, choices={frame.digest: choice for frame, choice in seen})

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
