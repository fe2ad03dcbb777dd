"""Results of fits that do not depend on the sign that squares of aberrations must have."""

from __future__ import annotations

import numpy as np

from jitterkit.likelihood import Data
from jitterkit.optics import Optics
from jitterkit.refit.fit import FitOptions
from jitterkit.refit.result import FitResult, Status
from jitterkit.squares import FreeSquares, free_squares

_FEWER = 0.8
"""Share of its variance in the fit below which a value is not better known with squares free, as more free
parameters cannot make it: the blur is an impossible one, and the fit has the errors of a possible one."""


def with_free_squares(fit: FitResult, data: Data, optics: Optics, options: FitOptions) -> FitResult:
    """Return a fit whose jitter does not depend on the sign that squares of aberrations must have.

    Parameters
    ----------
    fit : FitResult
    data : Data
        That were fitted.
    optics : Optics
    options : FitOptions
        That it was fitted with.

    Returns
    -------
    fit : FitResult
        As :func:`freed` has it, by the squares of :func:`squares_of`.
    """
    return freed(fit, squares_of(fit, data, optics, options))


def squares_of(fit: FitResult, data: Data, optics: Optics, options: FitOptions) -> FreeSquares | None:
    """Return what free squares change in a fit; None for an error of the model."""
    if fit.status is not Status.OK or fit.parameters is None or fit.model_error:
        return None
    return free_squares(fit.parameters, fit.names, data, optics, options.hold, options.priors.over)


def freed(fit: FitResult, free: FreeSquares | None) -> FitResult:
    """Return a fit with the values and errors of free squares.

    Those of such aberrations, image and chi-squared stay, and all of a fit that gives no valid scene so.
    """
    if free is None or fit.parameters is None:
        return fit
    covariance, index = fit.covariance.copy(), np.ix_(free.places, free.places)
    beside, variance = fit.off_maximum or (np.zeros(len(fit.names)), np.zeros_like(covariance))
    free = free._replace(change=free.change + beside[free.places])
    covariance[:, free.places] = covariance[free.places] = 0.0
    covariance[index] = free.covariance + variance[index]
    if np.any(np.diag(covariance)[free.places] < _FEWER * np.diag(fit.covariance)[free.places]):
        return fit
    parameters = free.added_to(fit.parameters, fit.names, fit.aberrations)
    return fit.moved(parameters, covariance) if parameters.scene.is_valid() else fit
