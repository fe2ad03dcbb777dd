"""What scene a frame shows, how far that is in doubt, and the search for it where the model has errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from jitterkit.forward import expected_image
from jitterkit.likelihood import Data
from jitterkit.locate import ModelError, Residual, Start, allow_for_model
from jitterkit.optics.otf import OTF
from jitterkit.refit.result import FitResult

__all__ = ["DECIDED", "SceneChoice", "SceneEvidence", "found_allowing"]

DECIDED = 3.0
"""Logarithm of the odds, 20 to 1, from which a pair is one; by less in its favour a frame does not decide."""


@dataclass(frozen=True)
class SceneEvidence:
    """What a frame says of one star and of a pair.

    Attributes
    ----------
    star, pair : float
        Logarithm of the evidence, if the prior density of each scene were one.
    alone : float
        Logarithm of the probability of one star beforehand.
    companions : float
        Logarithm of that of a companion, an e-fold of separation.
    values : (3,) array
        Separation [arcsec], theta [deg] and contrast of the pair.
    covariance : (3, 3) array
        Of these.
    """

    star: float
    pair: float
    alone: float
    companions: float
    values: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class SceneChoice:
    """What scene a frame shows.

    Attributes
    ----------
    start : Start
        Of the scene that is more probable, fitted briefly.
    log_odds : float
        Logarithm of the odds of a pair against one star, priors included; infinite where only one of them
        was worth a fit.
    readings : str
        Both, in words, where both were fitted.
    alike : bool
        Whether the odds are below 20 to 1; or a pair without jitter, closer than the resolution, fits the
        frame as well as one star, so that only what is probable beforehand tells them apart.
    fit : FitResult or None
        Of one star with the best of the loci, by the options that were given, if it was made and is chosen.
    evidence : SceneEvidence or None
        For other frames of the same target; None where only one scene was worth a fit.
    """

    start: Start
    log_odds: float
    readings: str = ""
    alike: bool = False
    fit: FitResult | None = None
    evidence: SceneEvidence | None = None

    @property
    def undecided(self) -> bool:
        """Whether a pair is the more probable, but not by enough."""
        return 0 < self.log_odds < DECIDED

    @property
    def is_sure(self) -> bool:
        """Whether the frame leaves no doubt about its scene."""
        return not abs(self.log_odds) < DECIDED

    @property
    def doubt(self) -> str:
        """That a pair may look the same as the star that was chosen, in a sentence; or nothing."""
        return f"It shows {self.readings}: both look alike." if self.alike and self.log_odds < 0 else ""

    @property
    def scene(self) -> str:
        """Name of the scene, one of :data:`SCENES`."""
        return self.start.parameters.scene.name


Found = TypeVar("Found", covariant=True)
"""What a search returns that finds no scene."""


class Search(Protocol[Found]):
    """Find the scene of data, or say why not; a rough search leaves the last steps to a fit."""

    def __call__(self, data: Data, *, rough: bool) -> SceneChoice | Found: ...


def found_allowing(
    search: Search[Found], data: Data, otf: OTF, error: ModelError, *, rough: bool
) -> tuple[SceneChoice | Found, Data]:
    """Search for a scene, and again with the model error that the first shows.

    Parameters
    ----------
    search : callable
    data : Data
    otf : OTF
        Nominal, of the frame.
    error : float or "auto"
        As for :func:`~jitterkit.locate.allow_for_model`.
    rough : bool
        Whether to leave the last steps to a fit.

    Returns
    -------
    found : SceneChoice, or what else the search returns
    data : Data
        Without pixels that no star can have made, which a search would take for stars; with a variance for
        the model error.

    Notes
    -----
    The first search takes speckles for stars, if anything, so that no star is hidden in the error that it
    shows; the second allows for them.
    """
    if np.any(data.used):
        data = data.without(Residual.of_dark(data, otf).outliers(0.0, surely=True))
    if not error:
        return search(data, rough=rough), data
    first = search(data, rough=False)
    if not isinstance(first, SceneChoice):
        return first, data
    p, otf = first.start.parameters, first.start.otf
    allowed = allow_for_model(data, p, np.asarray(expected_image(p, otf)), otf, error)
    if allowed.model_variance is None:
        return first, data
    again = search(allowed, rough=rough)
    return (again if isinstance(again, SceneChoice) else first), allowed
