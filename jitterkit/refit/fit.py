"""Refit a frame: every parameter of scene, optics and jitter at once, by maximum likelihood.

The optics are expanded to first order about a state of the aberrations, the likelihood is climbed,
and the optics are expanded anew where the climb ended, until that makes no difference.  The end is
a fixed point of the exact model, not of its linearisation.
"""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import dataclass, field

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jitterkit.forward import Parameters, expected_image, free_parameters
from jitterkit.likelihood import Data, pearson
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import FixedOptics, OpticalSystem
from jitterkit.refit.priors import Priors
from jitterkit.refit.result import FitResult, Status
from jitterkit.scene import Binary
from jitterkit.scoring import Climb, climb

__all__ = ["FitOptions", "fit_frame"]

_POOR = 1.5  # chi-squared a degree of freedom beyond which the numbers mean nothing
_MISFIT = 5.0  # standard deviations of chi-squared beyond which the frame is flagged
_EXPANSIONS = 5
_SETTLED = 1.0  # sigmas of the image: what remains of the linearisation is then about 1e-4 of an error

_image = eqx.filter_jit(expected_image)


@dataclass(frozen=True)
class FitOptions:
    """What to fit, and what is known.

    Attributes
    ----------
    hold : collection of str
        Parameters to keep at their starting value.  The background is held at zero by default,
        because a detector's bias is subtracted; free it (``hold=()``) where there is sky.
    priors : Priors
    """

    hold: Collection[str] = ("background",)
    priors: Priors = field(default_factory=Priors)


def fit_frame(
    data: Data,
    optics: OpticalSystem | FixedOptics,
    start: Parameters,
    otf: OTF | None = None,
    options: FitOptions | None = None,
) -> FitResult:
    """Fit a frame with the locus that ``start`` carries.

    Parameters
    ----------
    data : Data
    optics : OpticalSystem or FixedOptics
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
    began = time.perf_counter()
    options = FitOptions() if options is None else options
    otf = optics.otf(start.aberrations) if otf is None else otf
    names, free = free_parameters(start, otf, options.hold)
    if int(np.sum(np.asarray(data.used))) <= len(free):
        return FitResult(Status.NO_DATA, f"{Status.NO_DATA.value}: fewer than the {len(free)} parameters.")
    prior = options.priors.over(names)
    end, otf, iterations = _climb_and_expand(data, optics, start, otf, free, prior)
    if float(end.parameters.scene.contrast) < 1.0:
        exchanged = eqx.tree_at(lambda p: p.scene, end.parameters, _exchange(end.parameters.scene))
        end, otf, more = _climb_and_expand(data, optics, exchanged, otf, free, prior)
        iterations += more
    end = end._replace(parameters=eqx.tree_at(lambda p: p.scene, end.parameters, _tidy(end.parameters.scene)))
    return _conclude(data, otf, end, names, prior, iterations, time.perf_counter() - began)


def _climb_and_expand(data, optics, start, otf, free, prior) -> tuple[Climb, OTF, int]:
    iterations = 0
    for _ in range(_EXPANSIONS):
        end = climb(start, otf, data, free, prior)
        iterations += int(end.iterations)
        start = end.parameters
        if _change_of_optics(end, otf, free) < _SETTLED:
            return end, otf, iterations
        otf = optics.otf(start.aberrations)
    return end._replace(converged=jnp.asarray(False)), otf, iterations


def _change_of_optics(end: Climb, otf: OTF, free: tuple[int, ...]) -> float:
    """How far, in sigmas of the image, the aberrations have left the state the optics are exact at."""
    first = 6 + len(end.parameters.locus.names)
    slots = [(k, i - first) for k, i in enumerate(free) if first <= i < first + len(otf.names)]
    if not slots:
        return 0.0
    rows, modes = (list(s) for s in zip(*slots, strict=True))
    change = np.asarray(end.parameters.aberrations - otf.state)[modes]
    return float(np.sqrt(change @ np.asarray(end.information)[np.ix_(rows, rows)] @ change))


def _exchange(scene: Binary) -> Binary:
    """The same pair with its stars named by brightness."""
    return Binary(scene.separation, scene.theta + 180.0, scene.x, scene.y, scene.flux, 1 / scene.contrast)


def _tidy(scene: Binary) -> Binary:
    """The same pair with a positive separation and its direction in [0, 360)."""
    turn = 180.0 if float(scene.separation) < 0 else 0.0
    theta = (float(scene.theta) + turn) % 360.0
    return Binary(abs(float(scene.separation)), theta, scene.x, scene.y, scene.flux, scene.contrast)


def _conclude(data, otf, end: Climb, names, prior, iterations, seconds) -> FitResult:
    image = np.asarray(_image(end.parameters, otf))
    chi2, residual = pearson(image, data)
    dof = int(np.sum(np.asarray(data.used))) - len(names)
    information = np.asarray(end.information)
    covariance, sound = _invert(information + np.asarray(prior.precision))
    crlb, _ = _invert(information)
    excess = (chi2 / dof - 1) / np.sqrt(2 / dof)
    flags = [] if abs(excess) < _MISFIT else ["misfit"]
    flags += [] if sound else ["degenerate"]
    flags += ["aberrations_held"] if otf.blind() else []
    status, message = _verdict(end, chi2 / dof, sound)
    return FitResult(
        status,
        message,
        tuple(flags),
        parameters=end.parameters,
        names=names,
        covariance=covariance,
        crlb=np.sqrt(np.diag(crlb)),
        chi2=chi2,
        dof=dof,
        image=image,
        residual=residual,
        iterations=iterations,
        seconds=seconds,
        objective=float(end.objective),
    )


def _verdict(end: Climb, chi2_dof: float, sound: bool) -> tuple[Status, str]:
    if not np.isfinite(chi2_dof) or chi2_dof > _POOR:
        return Status.POOR_FIT, f"{Status.POOR_FIT.value}: chi²/dof is {chi2_dof:.4g}."
    if not sound:
        return (
            Status.NOT_CONVERGED,
            "the frame does not determine its parameters: the information is singular.",
        )
    if not bool(end.converged):
        return Status.NOT_CONVERGED, f"{Status.NOT_CONVERGED.value}."
    return Status.OK, f"{Status.OK.value}: chi²/dof is {chi2_dof:.4g}."


def _invert(information: np.ndarray) -> tuple[np.ndarray, bool]:
    """Inverse of an information matrix, in units that make its diagonal one; NaN if it is singular."""
    scale = np.sqrt(np.diag(information))
    sound = bool(np.all(np.isfinite(information)) and np.all(scale > 0))
    if sound:
        unit = information / np.outer(scale, scale)
        values, vectors = np.linalg.eigh(unit)
        sound = bool(values[0] > len(values) * np.finfo(float).eps * values[-1])
    if not sound:
        return np.full_like(information, np.nan), False
    return (vectors / values) @ vectors.T / np.outer(scale, scale), True
