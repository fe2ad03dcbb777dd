"""What each effect that a model leaves out does to the separation of a pair: a budget of systematic errors.

Reach for :func:`systematic_errors`.  To first order, from one frame's information: a change ``δ`` of the
image moves the fit by ``(J'WJ + Λ)⁻¹ J'Wδ``, where ``J`` are the slopes of the image by the free parameters,
``W`` the weights of its pixels and ``Λ`` what is known beforehand.  The rest, ``δ'Wδ`` less what the fit took
up, is added to chi-squared, and would determine a parameter of the effect.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import jax
import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.forecast.bound import expected_data
from jitterkit.forecast.effects import Effect, effects_of
from jitterkit.forecast.modelled import Modelled
from jitterkit.forward import Parameters, free_parameters, image_and_jacobian, to_vector
from jitterkit.instruments import Instrument
from jitterkit.likelihood import known_information, pearson
from jitterkit.likelihood.data import mean_counts, telling
from jitterkit.metric import invert_information
from jitterkit.refit import FitOptions

_DETECTED = 5.0
"""Standard deviations of chi-squared from which an effect shows: as for the frames of a run."""

_ROUNDING = 1e-6
"""Share of a change's own chi-squared below which what a fit leaves of it is curvature and rounding."""


@dataclass(frozen=True)
class SystematicError:
    """Hold the effect of a systematic error on a separation.

    Attributes
    ----------
    name, size, unit
        Of the :class:`~jitterkit.forecast.effects.Effect`.
    fitted : bool
        Whether the fit has parameters that describe the effect.  All else is as if these were held.
    bias : float
        Of the separation, arcsec; rms where the effect is random.
    cost : float
        Error of the separation with the effect free, over that without; infinite where no frame tells it
        apart, NaN where each pixel would need its own parameter.
    chi2 : float
        What it adds to a frame's chi-squared.
    sigmas : float
        The same in standard deviations of a frame's chi-squared.
    frames : float
        After how many frames their mean chi-squared shows it; infinite for never.
    needed : float
        Size at which the bias is at most the target.
    """

    name: str
    size: float
    unit: str
    fitted: bool
    bias: float
    cost: float
    chi2: float
    sigmas: float
    frames: float
    needed: float

    def shown_by(self, night: int) -> str:
        """Return whether one ``frame``, a ``night`` of so many frames or ``nothing`` shows it."""
        return "frame" if self.frames <= 1 else "night" if self.frames <= night else "nothing"


@dataclass(frozen=True)
class FitResponse:
    """Hold the response of a fit of one frame to changes of its image.

    Attributes
    ----------
    names : tuple of str
        Of the free parameters.
    slopes : (p, ny nx) array
        Of the image by them.
    weights : (ny nx) array
        Information of a pixel on its expectation; zero where it does not count.
    known : (p, p) array
        What is known of the parameters beforehand, as information.
    spread : float
        Standard deviation of a frame's chi-squared.
    """

    names: tuple[str, ...]
    slopes: np.ndarray
    weights: np.ndarray
    known: np.ndarray
    spread: float

    @classmethod
    def of(cls, model: Modelled, options: FitOptions | None = None) -> FitResponse:
        """Compute how a fit with some options responds to changes of a modelled frame."""
        options, p, otf = options or FitOptions(), model.parameters, model.otf
        names, free = free_parameters(p, otf, options.hold)
        detector, exposure = model.telescope.detector, model.telescope.exposure or 0.0
        data = expected_data(p, otf, detector, exposure=exposure)
        image, jacobian = image_and_jacobian(p, otf, free)
        vector, unravel = to_vector(p)
        moments = jax.jacfwd(lambda v: unravel(v).locus.moments())(vector)[:, np.array(free, int)]
        known = options.priors.over(names, p.locus).stiffness(moments) + known_information(p, otf, free)
        weights = np.where(telling(image, data), data.weight / mean_counts(image, data), 0.0)
        slopes = np.asarray(jacobian).reshape(len(names), -1)
        return cls(names, slopes, weights.ravel(), np.asarray(known), pearson(image, data).spread)

    def holding(self, names: tuple[str, ...]) -> FitResponse:
        """Return the response of a fit that holds more parameters."""
        kept = [i for i, name in enumerate(self.names) if name not in names]
        free, known = tuple(self.names[i] for i in kept), self.known[np.ix_(kept, kept)]
        return FitResponse(free, self.slopes[kept], self.weights, known, self.spread)

    def covariance(self) -> np.ndarray:
        """Return the covariance (p, p) of the parameters.

        Raises
        ------
        ConfigurationError
            If the frame does not determine them.
        """
        covariance, sound = invert_information(self.slopes * self.weights @ self.slopes.T + self.known)
        if not sound:
            problem = "The frame does not determine its parameters; change flux, contrast or locus."
            raise ConfigurationError(ErrorCode.NOT_CONSTRAINED, problem)
        return covariance


def systematic_errors(
    telescope: Instrument,
    parameters: Parameters,
    options: FitOptions | None = None,
    *,
    sizes: Mapping[str, float] | None = None,
    target: float = 1e-6,
) -> tuple[float, list[SystematicError]]:
    """Compute what the effects that a fit leaves out do to the separation of a pair.

    Parameters
    ----------
    telescope : Instrument
    parameters : Parameters
        Of a pair; the locus it has is the one that is fitted.
    options : FitOptions, optional
        What a fit holds and what it knows beforehand.
    sizes : mapping of name to float, optional
        Of effects, in place of the usual ones.
    target : float
        Bias for which the size is sought, arcsec.

    Returns
    -------
    error : float
        Standard error of the separation of one frame, arcsec.
    errors : list of SystematicError

    Raises
    ------
    ConfigurationError
        If there is no effect of a name, a size is not positive, or a frame does not determine its parameters.

    Notes
    -----
    *Assumes* that effects are small against the resolution and the noise of pixels is that of the model.
    *Fails when* an effect is so large that the image is not linear in it: at some sigmas of chi-squared.
    """
    model = Modelled.of(telescope, parameters)
    response = FitResponse.of(model, options)
    index = response.names.index("separation")
    error = float(np.sqrt(response.covariance()[index, index]))
    return error, [_assess(response, effect, target) for effect in effects_of(model, sizes)]


def _assess(response: FitResponse, effect: Effect, target: float) -> SystematicError:
    fitted = bool(set(effect.hold) & set(response.names))
    response = response.holding(effect.hold)
    covariance, index = response.covariance(), response.names.index("separation")
    weighted = response.slopes * response.weights
    leverage = (covariance @ weighted)[index]
    changes = effect.changes.reshape(len(effect.changes), -1)
    shifts = changes @ leverage
    if effect.per_pixel:
        shifts, cost = leverage * changes[0], math.nan
        taken_up = np.einsum("pi,pq,qi->i", weighted, covariance, weighted, optimize=True)
        chi2 = float(np.sum(changes[0] ** 2 * (response.weights - taken_up)))
    else:
        score, own = weighted @ changes.T, changes * response.weights @ changes.T
        left = own - score.T @ covariance @ score
        left[np.diag_indices_from(left)] *= np.diag(left) > _ROUNDING * np.diag(own)
        chi2, cost = float(np.trace(left)), _cost(shifts, left, covariance[index, index], effect.together)
    several = 1 if effect.together else len(changes)
    sigmas, bias = chi2 / several / response.spread, math.sqrt(shifts @ shifts / several)
    return SystematicError(
        name=effect.name,
        size=effect.size,
        unit=effect.unit,
        fitted=fitted,
        bias=math.copysign(bias, shifts[0]) if len(shifts) == 1 else bias,
        cost=cost,
        chi2=chi2 / several,
        sigmas=sigmas,
        frames=(_DETECTED / sigmas) ** 2 if sigmas > 0 else math.inf,
        needed=effect.size * _share(shifts, effect.opposite, leverage, target * math.sqrt(several)),
    )


def _share(shifts: np.ndarray, opposite: np.ndarray | None, leverage: np.ndarray, target: float) -> float:
    """Return the share of a size at which odd and even parts of its shifts make at most a target together."""
    back = -shifts if opposite is None else opposite.reshape(len(shifts), -1) @ leverage
    odd, even = (float(np.linalg.norm(shifts + sign * back)) / 2 for sign in (-1, 1))
    both = odd + math.sqrt(odd**2 + 4 * even * target)
    return 2 * target / both if both > 0 else math.inf


def _cost(shifts: np.ndarray, left: np.ndarray, variance: float, together: bool) -> float:
    """Error with amplitudes of the changes free over that without: of all, or on average of one."""
    if np.any(np.diag(left) <= 0):
        return math.inf
    if not together:
        return math.sqrt(1 + np.mean(shifts**2 / np.diag(left)) / variance)
    return math.sqrt(1 + shifts @ np.linalg.solve(left, shifts) / variance)
