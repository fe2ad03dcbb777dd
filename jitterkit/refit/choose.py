"""Choose the locus of a frame's jitter, no finer than the frame can tell.

A normal density is fitted first: its signed moments are regular at zero jitter, and while a blur is
small against the resolution its moments are all that an image shows.  A streak replaces it only where
the data ask for one.  Between the two lies a range where a streak is no longer a normal but a single
frame cannot tell: on TOLIMAN the separation is then off by 0.7 µas (linear) or 2.0 µas (SHM) at 0.2
arcsec and by 9 or 27 µas at 0.375 arcsec, the same way in every frame.

``stable`` is never chosen: free moments cost next to nothing (0.02 % of the error on TOLIMAN), whereas
leaving jitter out that is merely undetected biases the separation of every frame the same way.
"""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from jitterkit.forward import Parameters
from jitterkit.likelihood import Data
from jitterkit.loci import LOCI, Locus, locus_class
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import FixedOptics, OpticalSystem
from jitterkit.refit.fit import FitOptions, fit_frame
from jitterkit.refit.result import Candidate, FitResult

__all__ = ["fit_best_locus", "fit_locus"]

_DECISIVE = 4.0
"""Deviance by which a streak, with a parameter less, must beat the normal."""

_THIN = 9.0
"""Chi-squared of the minor axis's variance below which a streak is thought of."""

_DETECTED = 11.34
"""99 % point of chi-squared with three degrees of freedom: jitter is there at all."""


def fit_locus(
    name: str,
    data: Data,
    optics: OpticalSystem | FixedOptics,
    start: Parameters,
    moments,
    otf: OTF | None = None,
    options: FitOptions | None = None,
) -> FitResult:
    """Fit a frame with one locus, started from second moments.

    Parameters
    ----------
    name : str
        A name in ``LOCI``.
    data, optics, start, otf, options
        As for :func:`jitterkit.refit.fit.fit_frame`; the start's own locus is replaced.
    moments : (3,) array
        ``(Sxx, Sxy, Syy)`` to start from, arcsec²: those of a kernel estimate.
    """
    locus: Locus = locus_class(name).near(jnp.asarray(moments))
    start = Parameters(start.scene, locus, start.aberrations, start.background)
    return replace(fit_frame(data, optics, start, otf, options), locus=name)


def fit_best_locus(
    data: Data,
    optics: OpticalSystem | FixedOptics,
    start: Parameters,
    moments,
    otf: OTF | None = None,
    options: FitOptions | None = None,
) -> FitResult:
    """Fit a frame with the simplest locus that describes it.

    Parameters
    ----------
    data, optics, start, moments, otf, options
        As for :func:`fit_locus`.

    Returns
    -------
    result : FitResult
        With the candidates tried and their weights, and the flag ``jitter_undetected`` where the
        frame shows no jitter.  A prior on the jitter is one on a normal: no streak is then tried.
    """
    normal = fit_locus("mvn", data, optics, start, moments, otf, options)
    if normal.parameters is None or not np.all(np.isfinite(normal.covariance)):
        return normal
    tried = [normal]
    told = options is not None and options.priors.on_locus()
    if _detected(normal) and _is_thin(normal) and not told:
        tried += [
            fit_locus(name, data, optics, normal.parameters, normal.moments()[0], otf, options)
            for name in LOCI
            if name not in ("stable", "mvn")
        ]
    best = min(tried, key=lambda fit: fit.objective + (_DECISIVE if fit is not normal else 0.0))
    best = replace(best, candidates=_weigh(tried), seconds=sum(fit.seconds for fit in tried))
    return best if _detected(normal) else replace(best, flags=(*best.flags, "jitter_undetected"))


def _detected(normal: FitResult) -> bool:
    moments, covariance = normal.moments()
    return bool(moments @ np.linalg.solve(covariance, moments) > _DETECTED)


def _is_thin(normal: FitResult) -> bool:
    """Whether the minor axis's variance is compatible with none."""
    moments, covariance = normal.moments()
    angle = 0.5 * np.arctan2(2 * moments[1], moments[0] - moments[2])
    across = np.array([np.sin(angle) ** 2, -2 * np.sin(angle) * np.cos(angle), np.cos(angle) ** 2])
    return bool((across @ moments) ** 2 < _THIN * (across @ covariance @ across) or across @ moments < 0)


def _weigh(tried: list[FitResult]) -> tuple[Candidate, ...]:
    """Akaike weights of the candidates that could be fitted."""
    fits = [(fit, fit.parameters) for fit in tried if fit.parameters is not None]
    cost = np.array([fit.objective + 2 * len(fit.names) for fit, _ in fits])
    weights = np.exp(-0.5 * (cost - cost.min()))
    return tuple(
        Candidate(fit.locus, fit.objective, float(w), float(parameters.binary.separation))
        for (fit, parameters), w in zip(fits, weights / weights.sum(), strict=True)
    )
