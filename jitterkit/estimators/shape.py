"""When a blur's shape is asked for, and when it is believed: one rule for every estimator that knows it.

The excess kurtosis enters an image by the square of the blur.  While the blur is small it is unknown
and does no harm; once the frame tells it, leaving it out biases the moments.  Both borders are set by
errors, not by the value found, so that no frame is picked by its noise.
"""

from __future__ import annotations

import numpy as np

from jitterkit.kernel_estimate import significance

__all__ = ["is_decisive", "is_detected"]

_DETECTED = 16.27
"""Chi-squared, three degrees of freedom, that no jitter at all exceeds in one frame of a thousand."""

_DECISIVE = 1.2
"""Error of the excess kurtosis that equals a drift's own: there the bias of the moments with the shape
held at a normal's is what their variance grows by with the shape free, and beyond it is more."""


def is_detected(moments: np.ndarray, covariance: np.ndarray) -> bool:
    """Whether moments (3,) with their covariance (3, 3) are beyond what no jitter would give."""
    return significance(moments, covariance) > _DETECTED


def is_decisive(shape_err: float) -> bool:
    """Whether a shape is known so well that the moments must not be taken for a normal's."""
    return bool(shape_err < _DECISIVE)
