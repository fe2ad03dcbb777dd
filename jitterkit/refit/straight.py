"""The kurtosis that a straight blur shows, by the fits of a drift and of a vibration."""

from __future__ import annotations

import math
from collections.abc import Mapping

import equinox as eqx
import numpy as np

from jitterkit.forward import expected_image
from jitterkit.likelihood import pearson
from jitterkit.refit.locus_fit import FrameFits
from jitterkit.refit.result import STRAIGHT, FitResult, StraightBlur
from jitterkit.refit.squares import squares_of

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
        By the images of a drift and of a vibration, and by what both leave of the frame; one step of scoring
        is off by a seventh.  None unless both have values.

    Notes
    -----
    Between the images of both fits all is linear: the kurtosis, and where aberrations show by their squares,
    these too, which are free (:mod:`jitterkit.squares`).  Without, a drift behind 18 hexagons was taken for a
    vibration too often, and moments were low by a quarter of an error in every frame: noise that asks for a
    negative square was taken from the shape of the blur.
    """
    pair = [(fits[name], kurtosis) for name, kurtosis in STRAIGHT.items() if name in fits]
    if len(pair) < len(STRAIGHT):
        return None
    (near, here), (far, there) = sorted(pair, key=lambda one: one[0].objective)
    if near.parameters is None or far.parameters is None:
        return None
    change = np.asarray(far.parameters.locus.moments()) - np.asarray(near.parameters.locus.moments())
    excess, unit, free = near.objective - far.objective, there - here, None
    apart = (unit / error) ** 2
    if near.residual is not None and far.residual is not None:
        apart = max(float(np.nansum((near.residual - far.residual) ** 2)), 1e-300)
        free = squares_of(near, frame.data, frame.optics, frame.options)
    if free is None:
        way = (excess + apart) / 2
    else:
        # the images of fits are of first order in aberrations that show by their squares
        images = [_image(fit, frame) for fit in (near, far)]
        close, distant = (pearson(image, frame.data) for image in images)
        toward = eqx.tree_at(lambda data: data.electrons, frame.data, images[1])
        along = squares_of(near, toward, frame.optics, frame.options) or free
        excess += (close.chi2 - near.chi2) - (distant.chi2 - far.chi2)
        apart = float(np.nansum((close.residual - distant.residual) ** 2))
        taken = along.whole @ along.score
        way = (excess + apart) / 2 - along.score @ free.step
        apart -= min(taken @ along.score, (1 - _LEAST) * apart)
        change = change - free.moments @ taken
    # objectives are squares of the distance from what is shown: ``way`` is that, times the way to the far one
    return StraightBlur(here + unit * way / apart, abs(unit) / math.sqrt(apart), change / unit)


def _image(fit: FitResult, frame: FrameFits) -> np.ndarray:
    """Return the image of a fit by optics that are exact where it ended."""
    assert fit.parameters is not None
    otf = frame.optics.otf(np.asarray(fit.parameters.aberrations), derivatives=False)
    return np.asarray(expected_image(fit.parameters, otf))
