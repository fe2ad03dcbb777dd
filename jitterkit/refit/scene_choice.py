"""The choice of a frame's scene, its certainty, and the search for it where the model has errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from jitterkit.forward import expected_image
from jitterkit.likelihood import Data
from jitterkit.locate import ModelError, Residual, Start, allow_for_model
from jitterkit.optics.otf import OTF
from jitterkit.refit.result import FitResult

DECIDED = 3.0
"""Logarithm of the odds, 20 to 1, from which a pair is one; by less in its favour a frame does not decide."""


@dataclass(frozen=True)
class SceneEvidence:
    """Hold a frame's evidence for one star and for a pair.

    Attributes
    ----------
    star, pair : float
        Logarithm of the evidence, if the prior density of each scene were one.
    alone : float
        Logarithm of the prior probability of one star.
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
    """Hold the scene that a frame shows.

    Attributes
    ----------
    start : Start
        Of the scene that is more probable, fitted briefly.
    log_odds : float
        Logarithm of the odds of a pair against one star, priors included; infinite where only one of them
        was worth a fit.
    readings : str
        Both scenes, in words, where both were fitted.
    alike : bool
        Whether the odds are below 20 to 1; or a pair and one star fit the frame as well, so that only the
        priors distinguish them.
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
        """Return whether a pair is the more probable, but not by enough."""
        return 0 < self.log_odds < DECIDED

    @property
    def is_sure(self) -> bool:
        """Return whether the frame decides its scene."""
        return not abs(self.log_odds) < DECIDED

    @property
    def is_clear(self) -> bool:
        """Return whether it does, and no single star fits as well as the pair that it shows."""
        return self.is_sure and not (self.alike and self.log_odds > 0)

    @property
    def ambiguity(self) -> str:
        """Say in a sentence that the other scene looks the same as the chosen one; empty if it does not."""
        return f"It shows {self.readings}: both look alike." if self.alike and not self.undecided else ""

    @property
    def ambiguity_of_run(self) -> str:
        """Say the same about the other frames of a run, whose jitter may differ."""
        return f"The first frames of the run show {self.readings}." if self.ambiguity else ""

    @property
    def scene(self) -> str:
        """Return the name of the scene, one of :data:`SCENES`."""
        return self.start.parameters.scene.name


Found = TypeVar("Found", covariant=True)
"""What a search returns that finds no scene."""


class Search(Protocol[Found]):
    """Find the scene of data, or return a reason why not; a rough search leaves the last steps to a fit."""

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
    second = search(allowed, rough=rough)
    return (second if isinstance(second, SceneChoice) else first), allowed
