"""Values and errors of a normal blur where the frame does not show whether it is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.special
import scipy.stats

from jitterkit.estimators.shape import CumulantStep
from jitterkit.forward import parameter_names, to_vector
from jitterkit.optics.otf import OTF
from jitterkit.refit.boundary import minor_variance
from jitterkit.refit.result import FitResult

_STRAIGHT = (-0.75, 0.75)
"""Excess kurtosis of a blur that may be straight, and its uncertainty: between a normal's and that of SHM."""

_WIDE = 0.75
"""Spread of the excess kurtosis of a wide blur that is not normal: that of an ellipse is two of it away."""

_THIN = (6.0, 0.05)
"""A blur may be straight whose minor variance is within so many errors of none, or below that share of the
major: a straight locus fitted to a wider one has e^-18 of its evidence."""


def of_any_shape(normal: FitResult, step: CumulantStep, otf: OTF) -> FitResult:
    """Return values and errors where the frame does not show the shape of a blur; the image stays.

    Parameters
    ----------
    normal : FitResult
        Of a normal, with the excess kurtosis that the frame shows.
    step : CumulantStep
        From where that fit ended.
    otf : OTF
        Of that fit.

    Returns
    -------
    fit : FitResult
        The fit itself where the frame does not determine its parameters.

    Notes
    -----
    A straight blur has any kurtosis from a normal's to that of SHM.  A wide one is normal, or has another
    kurtosis, equally likely before the frame says which: values are the mean of both by what it says, and the
    covariance holds that of each and what they differ by.
    """
    assert normal.parameters is not None
    straight = may_be_straight(normal)
    change, variance = step.unknown_shape(normal.covariance, *(_STRAIGHT if straight else (0.0, _WIDE)))
    if not np.all(np.isfinite(change)):
        return normal
    if not straight:
        share = _share_of_other_shapes(normal)
        change, variance = share * change, share * (variance + (1 - share) * np.outer(change, change))
    every = parameter_names(normal.parameters, otf.names)
    vector, unravel = to_vector(normal.parameters)
    parameters = unravel(vector.at[np.array([every.index(name) for name in normal.names])].add(change))
    wider = normal.covariance + variance
    return replace(normal, parameters=parameters, covariance=wider, off_maximum=(change, variance))


def _share_of_other_shapes(normal: FitResult) -> float:
    """Return how likely a wide blur has another kurtosis than a normal's, by the kurtosis that it shows."""
    with np.errstate(invalid="ignore"):
        narrow, wide = (
            scipy.stats.norm.logpdf(normal.shape, scale=scale)
            for scale in (normal.shape_err, np.hypot(normal.shape_err, _WIDE))
        )
    return float(scipy.special.expit(np.nan_to_num(wide - narrow)))


def may_be_straight(normal: FitResult) -> bool:
    """Return whether the blur of a fitted normal may be a line, by its minor variance."""
    moments, covariance = normal.moments()
    minor, error = minor_variance(moments, covariance)
    return bool(minor < max(_THIN[0] * error, _THIN[1] * (moments[0] + moments[2] - minor)))
