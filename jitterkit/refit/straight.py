"""The kurtosis that a straight blur shows, by the fits of a drift and of a vibration."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from jitterkit.refit.locus_fit import FrameFits
from jitterkit.refit.result import STRAIGHT, FitResult, StraightBlur
from jitterkit.refit.squares import freed, squares_of

_LEAST = 0.01
"""Share of the squared distance of two images that free squares leave at least: the rest is rounding."""


def straight_blur(fits: Mapping[str, FitResult], error: float, frame: FrameFits) -> StraightBlur | None:
    """Return the kurtosis of a straight blur that a frame shows, and how the moments go with it.

    Parameters
    ----------
    fits : mapping
        By the names of their loci.
    error : float
        Of the kurtosis, where a fit has no image to tell it.
    frame : FrameFits
        That was fitted.

    Returns
    -------
    straight : StraightBlur or None
        By how far the images of a drift and of a vibration are apart, and by what both leave of the frame;
        one step of scoring is off by a seventh.  None unless both have values.

    Notes
    -----
    Aberrations that show by their squares have free ones in both (:mod:`jitterkit.squares`).  Without, a
    drift behind 18 hexagons was taken for a vibration too often, and moments were low by a quarter of an
    error in every frame: noise that asks for a negative square was taken from the shape of the blur.
    """
    one, other = (fits.get(name) for name in STRAIGHT)
    if one is None or other is None or one.parameters is None or other.parameters is None:
        return None
    drift, vibration = STRAIGHT.values()
    excess = one.objective - other.objective
    if one.residual is not None and other.residual is not None:
        apart = float(np.nansum((one.residual - other.residual) ** 2))
        by_one, by_other = (squares_of(f, frame.data, frame.optics, frame.options) for f in (one, other))
        if by_one is not None and by_other is not None:
            one, other = freed(one, by_one), freed(other, by_other)
            excess -= by_one.gain - by_other.gain
            apart -= min(by_one.shared_gain(by_other), (1 - _LEAST) * apart)
        error = (drift - vibration) / math.sqrt(max(apart, 1e-300))
    moments = [np.asarray(fit.parameters.locus.moments()) for fit in (one, other) if fit.parameters]
    # objectives are squares of the distance from what is shown
    shown = (drift + vibration - excess * error**2 / (drift - vibration)) / 2
    return StraightBlur(shown, error, np.subtract(*moments) / (drift - vibration))
