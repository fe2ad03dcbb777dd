"""Results of fits that do not depend on the sign that squares of aberrations must have."""

from __future__ import annotations

import math
from collections.abc import Mapping

import equinox as eqx
import numpy as np

from jitterkit.forward import expected_image, parameter_names, to_vector
from jitterkit.likelihood import Data, known_information, pearson
from jitterkit.optics import Optics
from jitterkit.refit.fit import FitOptions
from jitterkit.refit.locus_fit import FrameFits
from jitterkit.refit.result import STRAIGHT, TOLD, FitResult, Status, StraightBlur
from jitterkit.squares import free_squares

_LEAST = 0.01
"""Share of the squared distance of two images that free squares leave at least: the rest is rounding."""

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
        Values and errors of all but such aberrations by :func:`~jitterkit.squares.free_squares`; they, image
        and chi-squared stay.  The fit itself where that does not apply or gives no valid scene, and where an
        error of the model was allowed for.
    """
    if fit.status is not Status.OK or fit.parameters is None or fit.model_error:
        return fit
    free = free_squares(fit.parameters, fit.names, data, optics, options.hold, options.priors.over)
    if free is None:
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
    settings = frame.optics, frame.options.hold, frame.options.priors.over
    apart = (unit / error) ** 2
    if near.residual is not None and far.residual is not None:
        moved, stiffness, on_moments = _known(near, far, frame)
        known = moved @ (stiffness * moved) + change @ on_moments @ change
        apart = max(float(np.nansum((near.residual - far.residual) ** 2)) + known, 1e-300)
        unsure = abs(unit) > TOLD / 2 * math.sqrt(apart)  # free squares may double the error
        if unsure and near.status is Status.OK and not near.model_error:
            free = free_squares(near.parameters, near.names, frame.data, *settings)
    if free is None:
        way = (excess + apart) / 2
    else:
        # the images of fits are of first order in aberrations that show by their squares
        images = [_image(fit, frame) for fit in (near, far)]
        close, distant = (pearson(image, frame.data) for image in images)
        scores = [
            free.score_of(eqx.tree_at(lambda data: data.electrons, frame.data, image)) for image in images
        ]
        of_priors = dict(zip(near.names, stiffness * moved, strict=True))
        along = scores[1] - scores[0] + [of_priors.get(name, 0.0) for name in free.names]
        along = along + free.moments.T @ on_moments @ change
        excess += (close.chi2 - near.chi2) - (distant.chi2 - far.chi2)
        apart = float(np.nansum((close.residual - distant.residual) ** 2)) + known
        taken = free.whole @ along
        way = (excess + apart) / 2 - along @ free.step
        apart -= min(taken @ along, (1 - _LEAST) * apart)
        change = change - free.moments @ taken
    # objectives are squares of the distance from what is shown: ``way`` is that, times the way to the far one
    return StraightBlur(here + unit * way / apart, abs(unit) / math.sqrt(apart), change / unit)


def _known(near: FitResult, far: FitResult, frame: FrameFits) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return changes of parameters (p,) from one fit to another, and what is known beforehand of them.

    As the inverse of variances (p,), and of the covariance (3, 3) of the moments.
    """
    otf, p, q = frame.optics.nominal, near.parameters, far.parameters
    assert p is not None
    assert q is not None
    here, there = (
        dict(zip(parameter_names(x, otf.names), np.asarray(to_vector(x)[0]), strict=True)) for x in (p, q)
    )
    moved = np.array([there.get(name, here[name]) - here[name] for name in near.names])
    prior, places = frame.options.priors.over(near.names), [list(here).index(name) for name in near.names]
    stiffness = np.diag(prior.precision) + np.diag(known_information(p, otf, tuple(places)))
    return moved, stiffness, np.asarray(prior.moments_precision)


def _image(fit: FitResult, frame: FrameFits) -> np.ndarray:
    """Return the image of a fit by optics that are exact where it ended."""
    assert fit.parameters is not None
    otf = frame.optics.otf(np.asarray(fit.parameters.aberrations), derivatives=False)
    return np.asarray(expected_image(fit.parameters, otf))
