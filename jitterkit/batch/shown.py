"""What frames have shown of their telescope, for others that are like them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from jitterkit.frames import Frame
from jitterkit.locate import ReferenceFrame
from jitterkit.optics import AnchoredOptics
from jitterkit.refit import SceneChoice

__all__ = ["Shown"]


@dataclass(frozen=True)
class Shown:
    """What is known of the frames on one grid before they are looked at.

    Attributes
    ----------
    scene : str
        Name of the scene that they show, or ``"auto"`` where they leave that open.
    doubt : str
        What else they may show that looks the same, in a sentence.
    anchored : AnchoredOptics or None
        None of optics that cannot change.
    reference : ReferenceFrame or None
        What they may be registered to; then stars and blur need not be searched for.
    choices : mapping
        What frames have shown by themselves at first sight, by their digests.
    """

    scene: str
    doubt: str = ""
    anchored: AnchoredOptics | None = None
    reference: ReferenceFrame | None = None
    choices: Mapping[str, SceneChoice] = field(default_factory=dict)

    def optics(self, frame: Frame) -> AnchoredOptics:
        """The optics for a frame: how far they reach depends on its light."""
        assert self.anchored is not None
        light = float(np.sum(frame.electrons, where=~frame.mask))
        return replace(self.anchored, photons=max(light, 1.0))
