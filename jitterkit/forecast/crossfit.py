"""What a wrong model of the jitter does: the expected image of one locus fitted with another.

What is wrong with the separation then is the bias, exact to the convergence of the fit: no noise has to be
averaged away.  The fit also tells how each of its numbers answers to one more electron in each pixel, which
is all that :mod:`jitterkit.forecast.study` needs to fit thousands of noisy frames at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jitterkit.detectors import Detector
from jitterkit.errors import ErrorCode, JitterkitError
from jitterkit.forecast.bound import expected_data
from jitterkit.forward import Parameters, free_parameters, image_and_jacobian, to_vector
from jitterkit.likelihood import Data, normal_equations
from jitterkit.metric import invert_information
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import Optics
from jitterkit.refit import FitOptions, FitResult, fit_frame, fit_locus

_RESTARTS, _CONVERGED = 20, 1e-4
"""A locus that is far from right (chi-squared thousands) converges slowly, because the expected information
is then not the curvature: it is started again where it ended, until it moves by less than this share of the
error."""


_WRONG, _STEP = 30.0, 0.1
"""Chi-squared of a frame from which the curvature of a wrong locus is computed (at 300 its scatter is 0.1 %
more than by the expected information), and the share of an error that is stepped for it."""


@dataclass(frozen=True)
class CrossFit:
    """A locus fitted to the expected image of another.

    Attributes
    ----------
    truth : Parameters
    fit : FitResult
        Of the expected image, without noise.
    data : Data
        The expected image.
    mean : (ny, nx) array
        What the likelihood expects at the fit, what the read noise adds to it included.
    slopes : (p, ny, nx) array
        Change of the score for one more electron in a pixel; zero where masked.
    response : (p, p) array
        Change of the parameters for a score: the inverse curvature of the posterior of the expected image.
        It is the fit's covariance where the locus is right; where it is wrong, the curvature is not the
        expected information, and frames scatter by more than the fit believes.
    """

    truth: Parameters
    fit: FitResult
    data: Data
    mean: np.ndarray
    slopes: np.ndarray
    response: np.ndarray

    @property
    def bias(self) -> float:
        """Fitted separation less the true one, arcsec, without noise."""
        return self.fit.of_scene("separation") - float(self.truth.binary.separation)

    @property
    def error(self) -> float:
        """Return the error of the separation that the fit believes it has, arcsec."""
        return self.fit.error("separation")

    @property
    def leverage(self) -> np.ndarray:
        """Change of the fitted separation for one more electron in a pixel (ny, nx)."""
        return np.tensordot(self.response[self.fit.names.index("separation")], self.slopes, 1)

    @property
    def scatter(self) -> float:
        """Standard deviation of the separation over noisy frames, arcsec: that of its linear response."""
        variance = np.asarray((self.data.electrons + self.data.offset) / self.data.weight)
        return float(np.sqrt(np.sum(self.leverage**2 * variance)))

    @property
    def misfit(self) -> float:
        """Return chi-squared that the wrong locus adds to a frame; its noise is about ``sqrt(2 pixels)``."""
        return self.fit.chi2


def noise_free_fit(
    truth: Parameters,
    locus: str,
    optics: Optics,
    detector: Detector | None = None,
    otf: OTF | None = None,
    options: FitOptions | None = None,
    *,
    exposure: float = 0.0,
) -> CrossFit:
    """Fit the image expected of one locus with another.

    Parameters
    ----------
    truth : Parameters
        The scene, optics and jitter that the frame is of.
    locus : str
        Name of the locus to fit; it starts from the true second moments.
    optics : Optics
    detector : Detector, optional
        As for :func:`jitterkit.forecast.forecast`.
    otf : OTF, optional
        Expanded at the true aberrations, where it is at hand.
    options : FitOptions, optional
    exposure : float
        s, for a dark current.

    Returns
    -------
    crossfit : CrossFit

    Raises
    ------
    JitterkitError
        If the fit does not settle; the message has its sentence.
    """
    otf = optics.otf(truth.aberrations) if otf is None else otf
    options, truth = FitOptions() if options is None else options, truth.completed(otf)
    data = expected_data(truth, otf, detector, exposure=exposure)
    fit = fit_locus(locus, data, optics, truth, np.asarray(truth.locus.moments()), otf, options)
    for _ in range(_RESTARTS):
        if fit.parameters is None or not np.all(np.isfinite(fit.covariance)):
            code = ErrorCode(fit.reason) if fit.parameters is None else ErrorCode.NOT_CONSTRAINED
            raise JitterkitError(code, f"{locus} cannot be fitted to this jitter: {fit.message}")
        otf, before = optics.otf(fit.parameters.aberrations), fit
        fit = replace(fit_frame(data, optics, fit.parameters, otf, options), locus=locus)
        moved = abs(fit.of_scene("separation") - before.of_scene("separation"))
        if moved < _CONVERGED * before.error("separation"):
            return _respond(truth, fit, optics, otf, data, options)
    problem = f"{locus} does not settle on this jitter; the separation still moves by {moved:.2g} arcsec."
    raise JitterkitError(ErrorCode.NOT_CONVERGED, problem)


def _respond(
    truth: Parameters, fit: FitResult, optics, otf: OTF, data: Data, options: FitOptions
) -> CrossFit:
    assert fit.parameters is not None
    _, free = free_parameters(fit.parameters, otf, options.hold)
    image, jacobian = (np.asarray(a) for a in image_and_jacobian(fit.parameters, otf, free))
    mean = image + np.asarray(data.offset)
    slopes = np.where(np.asarray(data.used), jacobian * np.asarray(data.weight) / mean, 0.0)
    response = _response(fit, optics, otf, data, free) if fit.chi2 > _WRONG else fit.covariance
    return CrossFit(truth, fit, data, mean, slopes, response)


def _response(fit: FitResult, optics, otf: OTF, data: Data, free: tuple[int, ...]) -> np.ndarray:
    """Inverse curvature at a fit, by differences of the score over a tenth of an error, optics exact."""
    assert fit.parameters is not None
    vector, unravel = to_vector(fit.parameters)
    information = np.asarray(normal_equations(fit.parameters, otf, data, free).information)

    def score(values) -> np.ndarray:
        parameters = unravel(values)
        moved = optics.otf(parameters.aberrations)
        return np.asarray(normal_equations(parameters, moved, data, free).score)

    rows = []
    for i, name in zip(free, fit.names, strict=True):
        step = _STEP * fit.error(name)
        rows.append((score(vector.at[i].add(-step)) - score(vector.at[i].add(step))) / (2 * step))
    curvature = (np.array(rows) + np.transpose(rows)) / 2
    priors = np.linalg.inv(fit.covariance) - information
    inverse, sound = invert_information(curvature + priors)
    return inverse if sound else fit.covariance
