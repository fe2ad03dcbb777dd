"""How frames are combined and pixels judged: :class:`Settings`, and what a bad pixel is called."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jitterkit.calibration.dark_frames import HOT
from jitterkit.calibration.flat_frames import DEAD
from jitterkit.calibration.master import CLIP, MEMORY
from jitterkit.errors import ConfigurationError, ErrorCode

FLAGS = {"hot": 1, "dead": 2, "noisy": 4, "blank": 8}
"""Bits of the bad-pixel map."""


@dataclass(frozen=True)
class Settings:
    """How frames are combined and pixels judged.

    Parameters
    ----------
    clip : float
        Noises of a frame beyond which a value is left out, 3 at least.
    hot : float
        Robust standard deviations over the median dark current from which a pixel is hot.
    dead : float
        Share of the response around it below which a pixel is dead.
    smooth : bool
        Whether the smooth part of the flats is divided out, as the lamp's.
    memory : float
        Bytes that the pixels read at a time may take.

    Raises
    ------
    ConfigurationError
        If one is out of range.
    """

    clip: float = CLIP
    hot: float = HOT
    dead: float = DEAD
    smooth: bool = False
    memory: float = MEMORY

    def __post_init__(self) -> None:
        for name, low, high in (("clip", 3.0, np.inf), ("hot", 3.0, np.inf), ("dead", 0.0, 1.0)):
            value = getattr(self, name)
            if not low <= value <= high:
                limits = f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} or more"
                raise ConfigurationError(
                    ErrorCode.OUT_OF_RANGE, f"{name} = {value:g} is out of range; give {limits}."
                )
