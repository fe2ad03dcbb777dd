"""Forecast how well causes of a width are separated: jitter, charge diffusion, defocus and seeing.

Reach for :func:`forecast_causes`: how well one frame determines each, alone and together, and by
:meth:`Causes.degeneracies` which it cannot separate.  Observations that would separate them are in
:mod:`~jitterkit.forecast.causes_data`.  A :class:`Cause` turns the error of its coordinate, which is regular
at zero, into one of the size that a person gives.
"""

from __future__ import annotations

import math
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
        """Return the growth of the size where the coordinate grows by its error; finite at zero size too."""
        if self.power == 1:
            return self.per * error
        start = max(self.value, 0.0)
        return self.per * ((start + error) ** (1 / self.power) - start ** (1 / self.power))


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
"""Of the largest weight, above which a cause belongs to a degeneracy."""


class Degeneracy(NamedTuple):
    """Hold a combination of causes that the frame determines badly.

    Attributes
    ----------
    stretch : float
        Its error over that which it would have if its causes were independent; infinite where
        it leaves the image as it is.
    weights : dict of name to float
        Change of each cause along it, arcsec² of blur, the largest first; their squares sum to one.
    pivot : str
        The cause that is degenerate with the others.
    others : tuple of str
        These, the largest first.
    sums : dict of name to (float, float)
        Sums that are determined: how much of one of the others is added to the pivot (a ratio of arcsec² of
        blur), and the error of that sum, arcsec².  Sums that another degeneracy hides are excluded.
    """

    stretch: float
    weights: dict[str, float]
    pivot: str
    others: tuple[str, ...]
    sums: dict[str, tuple[float, float]]


@dataclass(frozen=True)
class Causes:
    """Hold the causes of an image's width, and the information of one frame about them.

    Attributes
    ----------
    setting : Setting
    locus : Locus
    causes : tuple of Cause
    frame : Information
        Of the causes and of all else that every frame shares, the scene being free.
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
    def information(self) -> Information:
        """Return the frame's information about the causes, all else unknown."""
        return self.frame.about(self.names)

    def errors(self, extra: Information | None = None) -> np.ndarray:
        """Return the error (n,) of each coordinate, all unknown, with the information of further data."""
        return self.information.errors if extra is None else (self.frame + extra).about(self.names).errors

    def shares(self, errors: np.ndarray) -> np.ndarray:
        """Return the errors (n,) of the coordinates as shares of the causes' sizes.

        For a cause that is absent, it is the rms of its possible blur, in pixels.
        """
        shares = [
            cause.size_error(e) / cause.size if cause.value else math.sqrt(e * blur) / self.plate_scale
            for cause, e, blur in zip(self.causes, errors, self.blurs, strict=True)
        ]
        return np.array(shares)

    @cached_property
    def blurs(self) -> np.ndarray:
        """Return the variance [arcsec²] of the round blur that is as visible as one of each coordinate (n,).

        One for jitter and diffusion, whose coordinates are variances.
        """
        alone = self.information.alone
        round_blur = alone[self.names.index("diffusion")]
        own = [name in JITTER or name == "diffusion" for name in self.names]
        return np.where(own, 1.0, round_blur / alone)

    def degeneracies(self, least: float = 2.0) -> list[Degeneracy]:
        """List combinations that are determined worse than their parts, the worst first.

        Parameters
        ----------
        least : float
            Smallest stretch that is listed.

        Notes
        -----
        Eigenvectors of the information in units that make its diagonal one, with ``stretch =
        eigenvalue**-0.5``; their weights are then turned into blur.
        """
        values, vectors = self.information.modes()
        return [
            self._degeneracy(value, vector)
            for value, vector in zip(values, vectors.T, strict=True)
            if value < least**-2.0
        ]

    def _degeneracy(self, value: float, vector: np.ndarray) -> Degeneracy:
        weights = vector * self.information.alone * self.blurs
        weights = weights / np.linalg.norm(weights)
        order = [int(i) for i in np.argsort(-np.abs(weights))]
        named = [i for i in order if abs(weights[i]) > _SHARE * abs(weights[order[0]])]
        # sums read better than differences: those with the cause that most others make up for
        pivot = max(named, key=lambda i: sum(weights[i] * weights[j] < 0 for j in named))
        sums = {self.names[i]: self._sum(weights, pivot, i) for i in named if i != pivot}
        return Degeneracy(
            float(value**-0.5) if value > 0 else math.inf,
            {self.names[i]: float(weights[i]) for i in order},
            self.names[pivot],
            tuple(sums),
            {name: one for name, one in sums.items() if math.isfinite(one[1])},
        )

    def _sum(self, weights: np.ndarray, pivot: int, other: int) -> tuple[float, float]:
        """Return how much of the other keeps its sum with the pivot along the degeneracy, and its error."""
        ratio = -float(weights[pivot] / weights[other])
        combination = np.zeros(len(weights))
        combination[[pivot, other]] = self.blurs[pivot], ratio * self.blurs[other]
        return ratio, self.information.error_of(combination)


def forecast_causes(setting: Setting, locus: Locus) -> Causes:
    """Forecast how well one frame determines the causes of its width.

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
    causes = (*(_jitter(name, locus) for name in names), *_shared(setting))
    found = Causes(setting, locus, causes, frame, setting.otf.grid.plate_scale)
    if not np.all(np.isfinite(found.information.alone)):
        problem = "The frame does not show its causes: too few pixels have information; change the flux."
        raise UndeterminedError(ErrorCode.NOT_CONSTRAINED, problem)
    return found
