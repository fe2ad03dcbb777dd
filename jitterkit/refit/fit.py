"""Refit a frame: every parameter of scene, optics and jitter at once, by maximum likelihood.

The optics are expanded to first order about a state of the aberrations, the likelihood is maximised,
and the optics are expanded again at the maximum, until the error of the linearisation cannot be seen
in the image.
"""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import dataclass, field, replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jitterkit.forward import Parameters, expected_image, free_parameters
from jitterkit.likelihood import MISFIT, POOR, Data, pearson
from jitterkit.linearisation import (
    LINEARISATION_TOLERANCE,
    LOST,
    Expanded,
    linearisation_error,
    relinearised_scoring,
)
from jitterkit.locate import ModelError, allow_for_model, check_model_error
from jitterkit.loci import Locus, Mvn, Path, Streak
from jitterkit.metric import invert_information
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import Optics
from jitterkit.refit.boundary import (
    convergence,
    regularizing_priors,
    with_possible_errors,
)
from jitterkit.refit.contradiction import CONTRADICTED, prior_chance
from jitterkit.refit.damped import damped_scoring
from jitterkit.refit.model_error import differs, with_model_error
from jitterkit.refit.priors import Priors
from jitterkit.refit.result import FitResult, Status
from jitterkit.scoring import fisher_scoring
from jitterkit.scoring_loop import ROUNDING_TOLERANCE, ScoringResult

_CLEARINGS = 3  # times that the fit may move the edge of what comes near the ceiling: once is usual
_USUAL = 1e-4
"""Tolerance of a fit, at and above which the optics are exact to
:data:`~jitterkit.linearisation.LINEARISATION_TOLERANCE`; a smaller one makes them more exact."""
_SEPARATION_PER_SIGMA = 0.1
"""Largest change of the separation, in standard errors, for each sigma of linearisation error: 0.096 in 92
states of eleven telescopes, 0.005 of TOLIMAN's."""
_NAMES_STAR_A = {"separation", "theta", "contrast"}
"""Parameters that say which star is A: where all are held, the scene is not made canonical."""
_VALLEY_STEPS, _VALLEY_TOLERANCE = 100, 0.03
"""Steps and tolerance for a locus with regularizing priors, whose likelihood has long flat valleys: the
step that remains, in standard errors, lies along the valley and moves the separation by less than 0.01 of
its error."""
_CONTRADICTION = (
    "The frame contradicts its prior: look where the prior comes from, or fit without; values and errors "
    "assume that both are right."
)
_ALLOWANCES = 3
"""Times that a fit is repeated with the model error that the one before shows: it biases the first fit."""


@dataclass(frozen=True)
class FitOptions:
    """Hold the choices of a fit: parameters held, priors, tolerance.

    Attributes
    ----------
    hold : collection of str
        Parameters to keep at their starting value: ``("background",)`` where a frame surely has no sky.
    priors : Priors
    tolerance : float
        Length of a step, in standard errors, below which the fit has converged; below 1e-4 the optics are
        more exact in proportion.
    nodes : int or None
        Of the integral over time, in loci that have no formula and are started by name, as
        :func:`~jitterkit.refit.fit_locus` does; None for as many as they have themselves.
    may_be_still : bool
        Whether :func:`~jitterkit.refit.choose.fit_best_locus` may fit no jitter to a frame that shows none.
    model_error : float or "auto"
        Error of the expected light in each pixel, 1 sigma, as a share of it, to be added to the variance; or
        as large as the residual shows (:func:`~jitterkit.locate.allow_for_model`).  Zero leaves what the
        data have.
    rival : float
        Deviance of another reading of the frame.  A fit that settles far above it is given up, unless its
        locus is a path, which gets more knots; a normal, from which others start, is not damped there.
    """

    hold: Collection[str] = ()
    priors: Priors = field(default_factory=Priors)
    tolerance: float = _USUAL
    nodes: int | None = None
    may_be_still: bool = False
    model_error: ModelError = 0.0
    rival: float = np.inf

    def __post_init__(self) -> None:
        """Raise if the model error is not valid."""
        check_model_error(self.model_error)


def convergence_error(tolerance: float, locus: Locus, aberrations: bool) -> float:
    """Return an upper bound on the convergence error of the separation, in standard errors.

    It adds up the tolerance, rounding in 32 bits, the flat valleys of a locus with regularizing priors, and
    the linearisation of the optics where aberrations vary.  (Where a pixel reaches its lower bound, the
    likelihood has a kink, at which 1e-4 may be left.  A frame so faint that steps run out, or that the
    wavefront is damped, may be off by 0.02 of an error.)
    """
    error = max(tolerance, _least_error(locus))
    return error + (_SEPARATION_PER_SIGMA * linearisation_tolerance(error) if aberrations else 0.0)


def linearisation_tolerance(tolerance: float) -> float:
    """Return the largest error of linearised optics for a fit to some tolerance, in sigmas of the image."""
    return LINEARISATION_TOLERANCE * min(1.0, tolerance / _USUAL)


def _least_error(locus: Locus) -> float:
    """Return the least convergence error of any fit with a locus, in standard errors."""
    rounding = ROUNDING_TOLERANCE if jnp.zeros(()).dtype == jnp.float32 else 0.0
    return max(rounding, _VALLEY_TOLERANCE if regularizing_priors(locus) else 0.0)


def fit_frame(
    data: Data,
    optics: Optics,
    start: Parameters,
    otf: OTF | None = None,
    options: FitOptions | None = None,
) -> FitResult:
    """Fit a frame with the locus that ``start`` carries.

    Parameters
    ----------
    data : Data
    optics : Optics
    start : Parameters
        From :func:`jitterkit.locate.locate_binary`, with the locus to fit.
    otf : OTF, optional
        Optics already expanded, about any state.
    options : FitOptions, optional

    Returns
    -------
    result : FitResult
        Its ``crlb`` is the Cramér-Rao bound of this frame; without priors its errors equal it.

    Raises
    ------
    ConfigurationError
        If an option names a parameter that there is not.  A frame that cannot be fitted does not
        raise: its result says so.
    """
    return fit_and_allow(data, optics, start, otf, options)[0]


def fit_and_allow(
    data: Data,
    optics: Optics,
    start: Parameters,
    otf: OTF | None = None,
    options: FitOptions | None = None,
) -> tuple[FitResult, OTF, Data]:
    """Fit a frame as :func:`fit_frame` does, for fits to come.

    Returns
    -------
    result : FitResult
    otf : OTF
        Expanded where the fit ended.
    data : Data
        With the model errors that the fit allowed for.
    """
    options = FitOptions() if options is None else options
    otf = optics.otf(start.aberrations) if otf is None else otf
    result, otf = _fit_and_expand(data, optics, start, otf, options)
    for _ in range(_ALLOWANCES if options.model_error else 0):
        if result.parameters is None:
            break
        allowed = allow_for_model(data, result.parameters, result.image, otf, options.model_error)
        if not differs(allowed, data):
            break
        data, seconds = allowed, result.seconds
        result, otf = _fit_and_expand(data, optics, result.parameters, otf, options)
        result = replace(result, seconds=seconds + result.seconds)
    return result, otf, data


def _fit_and_expand(
    data: Data, optics: Optics, start: Parameters, otf: OTF, options: FitOptions
) -> tuple[FitResult, OTF]:
    """Fit a frame with the variance that its data have."""
    began = time.perf_counter()
    start = start.completed(otf)
    names, free = free_parameters(start, otf, options.hold)
    if int(np.sum(np.asarray(data.used))) <= len(free):
        few = f"{Status.NO_DATA.value}: fewer than the {len(free)} parameters."
        return FitResult(Status.NO_DATA, few), otf
    prior = options.priors.over(names, start.locus)

    valley = _VALLEY_TOLERANCE if regularizing_priors(start.locus) else 0.0
    limits: dict = {
        "max_steps": _VALLEY_STEPS if valley else 50,
        "tolerance": max(valley, options.tolerance),
    }
    max_error = linearisation_tolerance(max(_least_error(start.locus), options.tolerance))
    blind, damped = optics.system.nominal.blind(), False
    # where the sign of a mode is unknown maxima never settle, and in a valley they need not
    patient = bool(set(blind) & set(names)) or valley > 0
    rival = np.inf if isinstance(start.locus, Path) else options.rival

    def is_exact(end: ScoringResult, otf: OTF) -> bool:
        return linearisation_error(optics, end.parameters, otf) < max_error

    def converges(end: ScoringResult, otf: OTF) -> tuple[bool, bool]:
        return convergence(end, names, () if bool(end.converged) else blind, otf.names, is_exact(end, otf))

    def fit_from(data: Data, start: Parameters, otf: OTF) -> Expanded:
        nonlocal damped
        where = data, free, prior
        if damped and (settled := damped_scoring(start, optics, *where, **limits)):
            return settled
        how = limits | {"max_error": max_error, "rival": np.inf if isinstance(start.locus, Mvn) else rival}
        found = relinearised_scoring(start, otf, optics, *where, **how, patient=damped or patient)
        ended = damped or found.end.objective > rival + LOST
        if ended or is_exact(found.end, found.otf) or converges(found.end, found.otf)[0]:
            return found
        settled, at_start = None, fisher_scoring(start, otf, *where, max_steps=0)
        if not (_is_poor(found.end, data) and _is_poor(at_start, data)):
            settled = damped_scoring(start, optics, *where, **limits)
        damped = settled is not None
        if settled or patient or found.is_hopeless:
            return settled or found
        return relinearised_scoring(found.end.parameters, found.otf, optics, *where, **how)

    clear = data.clear(expected_image(start, otf)) if data.trims else data
    end, otf, iterations, *_ = fit_from(clear, start, otf)
    hopeless = not end.converged and (_is_poor(end, clear) or end.objective > rival + LOST)
    image = None
    for _ in range(_CLEARINGS if data.trims and not hopeless else 0):
        image = np.asarray(expected_image(end.parameters, otf))
        changed = data.clear(image)
        if np.array_equal(changed.used, clear.used):
            break
        clear, image = changed, None
        end, otf, more, *_ = fit_from(clear, end.parameters, otf)
        iterations += more
    scene = end.parameters.scene.canonical() if set(names) & _NAMES_STAR_A else end.parameters.scene
    if not eqx.tree_equal(scene, end.parameters.scene):
        # the covariance must be that of the canonical parameters
        canonical = eqx.tree_at(lambda p: p.scene, end.parameters, scene)
        end, otf, more, *_ = fit_from(clear, canonical, otf)
        iterations, image = iterations + more, None
    if image is None:
        image = np.asarray(expected_image(end.parameters, otf))
    end = with_possible_errors(end, clear, otf, names)
    seconds = time.perf_counter() - began
    result = _finalize(clear, otf, end, image, names, iterations, seconds, *converges(end, otf))
    if data.model_variance is not None:
        result = with_model_error(result, clear, otf, free)
    return _flag_prior_conflict(result, options.priors, free, end), otf


def _is_poor(end: ScoringResult, data: Data) -> bool:
    """Return whether a fit is poor where it ended."""
    return float(end.objective) > POOR * int(np.sum(np.asarray(data.used)))


def _finalize(
    data, otf, end: ScoringResult, image, names, iterations, seconds, converged: bool, zero_length: bool
) -> FitResult:
    misfit = pearson(image, data)
    dof = misfit.pixels - len(names)
    covariance, sound = invert_information(end.curvature)
    crlb, _ = invert_information(end.information)
    locus = end.parameters.locus
    least = -np.inf if data.model_variance is None else 0.0  # a model error that is given may be too large
    flags = [] if abs(max(misfit.chi2 - dof, least)) < MISFIT * misfit.spread else ["misfit"]
    flags += [] if sound else ["degenerate"]
    flags += ["jitter_undetected"] if zero_length and isinstance(locus, Streak) else []
    aberrations = otf.varied(end.parameters.scene)
    flags += ["aberrations_held"] if not set(aberrations) <= set(names) else []
    chi2_dof = misfit.chi2 / dof if dof > 0 else np.nan
    status, message = _classify(converged, chi2_dof, sound)
    result = FitResult(
        status,
        message,
        tuple(flags),
        parameters=end.parameters,
        names=names,
        aberrations=aberrations,
        covariance=covariance,
        crlb=np.sqrt(np.diag(crlb)),
        chi2=misfit.chi2,
        dof=dof,
        image=image,
        residual=misfit.residual,
        iterations=iterations,
        seconds=seconds,
        objective=float(end.objective),
    )
    return result.remarked(misfit.correlated_noise(image), "noise_correlated")


def _flag_prior_conflict(
    result: FitResult, priors: Priors, free: tuple[int, ...], end: ScoringResult
) -> FitResult:
    """Return the result, flagged where the frame contradicts the priors that it was fitted with."""
    if priors == Priors():
        return result
    converged = bool(end.converged)
    ended = converged or result.status is Status.OK
    if result.parameters is None or not ended or not np.all(np.isfinite(result.covariance)):
        return result
    score = np.asarray(end.score) if converged else None
    known = (result.parameters, result.names, free, result.covariance, score)
    if prior_chance(priors, *known) >= CONTRADICTED:
        return result
    return result.remarked(_CONTRADICTION, "prior_contradicted")


def _classify(converged: bool, chi2_dof: float, sound: bool) -> tuple[Status, str]:
    if not np.isfinite(chi2_dof) or chi2_dof > POOR:
        return Status.POOR_FIT, f"{Status.POOR_FIT.value}: chi²/dof is {chi2_dof:.4g}."
    if not sound:
        message = "the frame does not determine its parameters: the information is singular."
        return Status.NOT_CONVERGED, message
    if not converged:
        return Status.NOT_CONVERGED, f"{Status.NOT_CONVERGED.value}."
    return Status.OK, f"{Status.OK.value}: chi²/dof is {chi2_dof:.4g}."
