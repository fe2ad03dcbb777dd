"""Decide between one star and a pair by several frames of one target.

The stars of a pair are where they are in every frame, while jitter, light and optics are each frame's own.
So the evidences of the frames do not just add up: the prior on separation, direction and contrast counts
once, and what the frames say of these must agree.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from jitterkit.refit.scene_choice import DECIDED, SceneChoice, SceneEvidence
from jitterkit.refit.scene_prior import FAINTEST


def scene_together(choices: Sequence[SceneChoice]) -> str | None:
    """Return the name of the scene that frames of one target show; None where they leave it open.

    Parameters
    ----------
    choices : sequence of SceneChoice
        Of each frame by itself.

    Returns
    -------
    scene : str or None

    Notes
    -----
    Each frame that shows one scene for certain has a vote.  Where none does, or as many show the one as
    the other, the evidences decide for one star by odds of 20 to 1.  They do not decide for a pair: a drift
    that is the same in every frame looks like a pair that persists, and the evidence of one star takes the
    jitter of each frame for its own.  A field of stars is always certain.
    """
    votes = Counter(choice.scene for choice in choices if choice.evidence is None).most_common(2)
    if votes and (len(votes) < 2 or votes[0][1] > votes[1][1]):
        return votes[0][0]
    odds = log_odds_together([choice.evidence for choice in choices if choice.evidence is not None])
    return "star" if odds < -DECIDED else None


def log_odds_together(frames: Sequence[SceneEvidence]) -> float:
    """Return the logarithm of the odds of a pair against one star by frames of one target.

    Parameters
    ----------
    frames : sequence of SceneEvidence

    Returns
    -------
    odds : float
        Priors included, once.  NaN without frames.

    Notes
    -----
    Laplace's approximation: what a frame says of the pair is a normal density N_i over the offset of B from A
    and the logarithm of the contrast, about its own best fit.  With Z_i the evidence of a pair whose prior
    density is one, and p the prior,

        ln Z = sum ln Z_i + ln p(best) + ln integral of prod N_i

    *Fails when* a frame has several pairs that fit, of which it has named another than most frames; it then
    speaks for one star.
    """
    if not frames:
        return math.nan
    reference = max(frames, key=lambda one: one.pair - one.star)
    offsets = [_regular(one, reference) for one in frames]
    precisions = [np.linalg.inv(covariance) for _, covariance, _ in offsets]
    together = np.linalg.inv(np.sum(precisions, axis=0))
    best = together @ np.sum(
        [w @ position for w, (position, _, _) in zip(precisions, offsets, strict=True)], axis=0
    )
    pair = _log_prior(best, reference) + 0.5 * np.linalg.slogdet(2 * np.pi * together)[1]
    for one, (position, covariance, volume) in zip(frames, offsets, strict=True):
        off = position - best
        pair += one.pair + volume
        pair -= 0.5 * (off @ np.linalg.solve(covariance, off) + np.linalg.slogdet(2 * np.pi * covariance)[1])
    return float(pair - reference.alone - sum(one.star for one in frames))


def _regular(one: SceneEvidence, reference: SceneEvidence) -> tuple[np.ndarray, np.ndarray, float]:
    """Offset of B from A [arcsec] and logarithm of the contrast, their covariance, and a change of volume.

    Which of two stars as bright as each other is A is taken from the reference.
    """
    separation, theta, contrast = one.values
    angle, other = math.radians(theta), math.radians(reference.values[1])
    along = np.array([math.cos(angle), math.sin(angle)])
    slope = np.zeros((3, 3))
    slope[:2, 0], slope[:2, 1] = along, math.radians(separation) * np.array([-along[1], along[0]])
    slope[2, 2] = 1 / contrast
    position = np.array([*separation * along, math.log(contrast)])
    if along @ [math.cos(other), math.sin(other)] < 0:
        position, slope = -position, -slope
    return position, slope @ one.covariance @ slope.T, float(np.linalg.slogdet(slope)[1])


def _log_prior(position: np.ndarray, reference: SceneEvidence) -> float:
    """Logarithm of the prior density of an offset and a logarithmic contrast, of either sign."""
    if abs(position[2]) > math.log(FAINTEST):
        return -math.inf
    square = float(position[:2] @ position[:2])
    return reference.companions - math.log(2 * math.pi * square * math.log(FAINTEST))
