"""The causes of an image's width as a person gives them, and the coordinates that are regular at zero.

Reach for :func:`causes_between`; a :class:`Cause` turns the error of its coordinate into one of its size.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jitterkit.forecast.causes_frame import SQUARE, Setting, seeing_power
from jitterkit.loci import Locus, axis_variances

_LINE = 1e-12
"""Of the variance along the jitter, below which that across it is rounding: it is a line."""


class Cause(NamedTuple):
    """Something that widens the image.

    Attributes
    ----------
    name : str
        Of its coordinate in the information.
    words : str
    value : float
        Of the coordinate, which is regular at zero: a variance, say.
    power : float
        Of the size that the coordinate is.
    unit : str
        Of the size, as astropy reads it.
    per : float
        How many of that unit make one of the coordinate's.
    """

    name: str
    words: str
    value: float
    power: float
    unit: str
    per: float

    @property
    def size(self) -> float:
        """As a person would give it, in ``unit``."""
        if self.power == 1:
            return self.per * self.value
        return self.per * max(self.value, 0.0) ** (1 / self.power)

    def size_error(self, error: float) -> float:
        """By how much the size grows where the coordinate grows by its error; finite at zero size too."""
        if self.power == 1:
            return self.per * error
        start = max(self.value, 0.0)
        return self.per * ((start + error) ** (1 / self.power) - start ** (1 / self.power))


def causes_between(setting: Setting, locus: Locus, moments: Sequence[str]) -> tuple[Cause, ...]:
    """The causes that a frame might show: some moments of its jitter, and what the setting has.

    Parameters
    ----------
    setting : Setting
    locus : Locus
    moments : sequence of str
        Of :data:`~jitterkit.forecast.causes_frame.JITTER`, those that are free.
    """
    return tuple([_jitter(name, locus) for name in moments] + _shared(setting))


def _jitter(name: str, locus: Locus) -> Cause:
    major, minor, angle = axis_variances(np.asarray(locus.moments()))
    axis = f"{angle:.0f}°"
    if name == "jitter_turn":
        return Cause(name, f"jitter turned from {axis}", 0.0, 1.0, "mas2", 1e6)
    along = name == "jitter_along"
    minor = minor if minor > _LINE * major else 0.0
    words = f"jitter {'along' if along else 'across'} {axis}"
    return Cause(name, words, major if along else minor, 2.0, "mas", 1e3)


def _shared(setting: Setting) -> list[Cause]:
    otf, causes = setting.otf, []
    if setting.square:
        causes.append(Cause(SQUARE, "defocus, either sign", 0.0, 2.0, "nm", 1.0))
    elif "noll4" in otf.names and "noll4" not in otf.blind():
        value = float(otf.state[otf.names.index("noll4")])
        causes.append(Cause("noll4", "defocus", value, 1.0, "nm", 1.0))
    if setting.seeing is not None:
        causes.append(Cause("seeing", "seeing", seeing_power(setting.seeing), 5 / 3, "arcsec", 1.0))
    pixel = 1 / otf.grid.plate_scale
    return [*causes, Cause("diffusion", "diffusion", setting.diffusion, 2.0, "pix", pixel)]
