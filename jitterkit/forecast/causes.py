"""Telling causes apart: jitter, charge diffusion, defocus and seeing all widen an image.

Reach for :func:`tell_causes`: how well one frame tells each, alone and together, and by
:meth:`Causes.confusions` what it takes for what.  What would tell them apart is in
:mod:`~jitterkit.forecast.causes_data`.  A :class:`Cause` turns the error of its coordinate, which is regular
at zero, into one of the size that a person gives.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.forecast.causes_frame import JITTER, SQUARE, Setting, choose_defocus, seeing_power
from jitterkit.forecast.causes_information import Information
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
        """Return the size as a person would give it, in ``unit``."""
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


_SHARE = 0.1
"""Of the largest weight, above which a cause has part in a confusion."""


class Confusion(NamedTuple):
    """A combination of causes that the frame tells badly.

    Attributes
    ----------
    stretch : float
        Its error over that which it would have if its causes looked nothing like each other; infinite where
        it leaves the image as it is.
    weights : dict of name to float
        Change of each cause along it, arcsec² of blur, the largest first; their squares sum to one.
    pivot : str
        The cause that is taken for the others.
    others : tuple of str
        These, the largest first.
    sums : dict of name to (float, float)
        What is known all the same: how much of one of the others is added to the pivot (a ratio of arcsec² of
        blur), and the error of that sum, arcsec².  Sums that another confusion hides are left out.
    """

    stretch: float
    weights: dict[str, float]
    pivot: str
    others: tuple[str, ...]
    sums: dict[str, tuple[float, float]]


@dataclass(frozen=True)
class Causes:
    """Causes of an image's width, and the information of one frame about them.

    Attributes
    ----------
    setting : Setting
    locus : Locus
    causes : tuple of Cause
    frame : Information
        Of the causes and of what else every frame shares, the scene not known.
    plate_scale : float
        arcsec/pixel.
    """

    setting: Setting
    locus: Locus
    causes: tuple[Cause, ...]
    frame: Information
    plate_scale: float

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the causes' coordinates."""
        return tuple(cause.name for cause in self.causes)

    @cached_property
    def told(self) -> Information:
        """Return what the frame tells about the causes, all else unknown."""
        return self.frame.about(self.names)

    def errors(self, extra: Information | None = None) -> np.ndarray:
        """Error (n,) of each coordinate, all unknown, where further data tell something too."""
        return self.told.errors if extra is None else (self.frame + extra).about(self.names).errors

    def shares(self, errors: np.ndarray) -> np.ndarray:
        """Errors (n,) of the coordinates as shares of the causes' sizes.

        Of a cause that is absent, the rms of the blur that it might be, in pixels.
        """
        pairs = zip(self.causes, errors, self.blurs, strict=True)
        return np.array(
            [
                cause.size_error(e) / cause.size if cause.value else math.sqrt(e * blur) / self.plate_scale
                for cause, e, blur in pairs
            ]
        )

    @cached_property
    def blurs(self) -> np.ndarray:
        """Variance [arcsec²] of the round blur that shows as strongly as one of each coordinate (n,).

        One for jitter and diffusion, whose coordinates are variances.
        """
        alone = self.told.alone
        round_blur = alone[self.names.index("diffusion")]
        own = [name in JITTER or name == "diffusion" for name in self.names]
        return np.where(own, 1.0, round_blur / alone)

    def confusions(self, least: float = 2.0) -> list[Confusion]:
        """Combinations that are told worse than their parts, the worst first.

        Parameters
        ----------
        least : float
            Stretch from which one is worth telling.

        Notes
        -----
        Eigenvectors of the information in units that make its diagonal one, with ``stretch =
        eigenvalue**-0.5``; their weights are then turned into blur.
        """
        values, vectors = self.told.modes()
        return [
            self._confusion(value, vector)
            for value, vector in zip(values, vectors.T, strict=True)
            if value < least**-2.0
        ]

    def _confusion(self, value: float, vector: np.ndarray) -> Confusion:
        weights = vector * self.told.alone * self.blurs
        weights = weights / np.linalg.norm(weights)
        order = [int(i) for i in np.argsort(-np.abs(weights))]
        named = [i for i in order if abs(weights[i]) > _SHARE * abs(weights[order[0]])]
        # sums read better than differences: those with the cause that most others make up for
        pivot = max(named, key=lambda i: sum(weights[i] * weights[j] < 0 for j in named))
        sums = {self.names[i]: self._sum(weights, pivot, i) for i in named if i != pivot}
        return Confusion(
            float(value**-0.5) if value > 0 else math.inf,
            {self.names[i]: float(weights[i]) for i in order},
            self.names[pivot],
            tuple(sums),
            {name: one for name, one in sums.items() if math.isfinite(one[1])},
        )

    def _sum(self, weights: np.ndarray, pivot: int, other: int) -> tuple[float, float]:
        """Return how much of the other keeps its sum with the pivot along the confusion, and its error."""
        ratio = -float(weights[pivot] / weights[other])
        combination = np.zeros(len(weights))
        combination[[pivot, other]] = self.blurs[pivot], ratio * self.blurs[other]
        return ratio, self.told.error_of(combination)


def tell_causes(setting: Setting, locus: Locus) -> Causes:
    """Ask what one frame tells about the causes of its width.

    Parameters
    ----------
    setting : Setting
    locus : Locus
        The jitter; its second moments on its own axis are causes, what else shapes it is not known.

    Returns
    -------
    causes : Causes

    Raises
    ------
    ConfigurationError
        If the jitter has no second moments to ask about, or a size is negative.
    UndeterminedError
        If the frame shows none of the causes.

    Notes
    -----
    *Assumes* that the errors are small: at a cause of zero size they are those of a coordinate that may turn
    negative, which a real blur cannot.  *Fails when* defocus is not zero but too small to show to first
    order.
    """
    for name, size in (("diffusion", setting.diffusion), ("seeing", setting.seeing or 0.0)):
        if size < 0:
            problem = f"The {name} is {size:g}; give zero for none, or a positive one."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    setting = choose_defocus(setting)
    jitter = setting.frame(locus)
    names = [name for name in JITTER if name in jitter.names]
    frame = jitter.about((*names, *setting.shared))
    causes = causes_between(setting, locus, names)
    found = Causes(setting, locus, causes, frame, setting.otf.grid.plate_scale)
    if not np.all(np.isfinite(found.told.alone)):
        problem = "The frame does not show its causes: too few pixels tell anything; change the flux."
        raise UndeterminedError(ErrorCode.NOT_CONSTRAINED, problem)
    return found
