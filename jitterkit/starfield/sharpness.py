"""Whether a reference is sharp enough to say anything: as sharp as the frame, or trailed itself.

All is told from the difference of the stars' adaptive moments, whose
noise has mean zero: a PSF with noise in it, fitted to stars, asks for a little blur that smooths it.
"""

from __future__ import annotations

import numpy as np

from jitterkit.kernel_estimate import is_detected
from jitterkit.loci import axis_variances, covariance_on_axis
from jitterkit.starfield.psf import Psf

TOLERATED = 0.25
"""Share of the blur's larger variance that may be missing across it: a trail's length, widened or not,
is then right to 5 %; stars sharper by 0.45 of it gave 5 % too little, by 1.4 of it 6 %, and where nothing
is left of the trail it is invented."""

_ROUND, _CERTAIN = 1.1, 5.0
"""Ratio of a reference's variances along and across up to which it is round, and sigma of what is not:
optics make ellipticities of a few percent."""


def is_blurred(excess: np.ndarray, covariance: np.ndarray) -> bool:
    """Whether the frame's stars differ from the reference's by more than noise."""
    return is_detected(excess, covariance)


def elongation(psf: Psf) -> tuple[float, float] | None:
    """Length [pixels] of a line that makes round stars as long as the reference's, and its axis [deg].

    None where the reference's stars are round within their errors, or nearly so.
    """
    major, minor, axis = axis_variances(psf.moments)
    own = covariance_on_axis(psf.covariance, axis)
    error = np.sqrt(own[0, 0] + own[2, 2] - 2 * own[0, 2])
    if major < _ROUND * minor or major - minor < _CERTAIN * error:
        return None
    return float(np.sqrt(12 * (major - minor))), axis
