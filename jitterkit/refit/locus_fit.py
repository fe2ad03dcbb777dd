"""Fit a frame with one locus, whatever the signs of its aberrations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jitterkit.forward import Parameters
from jitterkit.likelihood import Data
from jitterkit.locate import Start, polished, with_best_signs
from jitterkit.loci import locus_class
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import Optics
from jitterkit.refit.fit import FitOptions, fit_and_allow
from jitterkit.refit.result import FitResult, Status
from jitterkit.refit.starts import starting_point

__all__ = ["NORMAL", "FrameFits", "fit_locus", "is_better"]

NORMAL = "mvn"
"""Name of the locus that a search fits, so that its signs have been tried."""


def fit_locus(
    name: str,
    data: Data,
    optics: Optics,
    start: Parameters,
    moments,
    otf: OTF | None = None,
    options: FitOptions | None = None,
    *,
    sure: bool = False,
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
    sure : bool
        Whether the signs of the start's aberrations are known, by frames before; or else others are tried.

    Notes
    -----
    What a small blur does not show of a locus is held by the weak priors of
    :func:`jitterkit.refit.boundary.regularizing_priors`.
    """
    frame = FrameFits(data, optics, options or FitOptions(), sure)
    fit, _, frame = frame.fit(name, start, moments, otf)
    better = None if name == NORMAL else frame.other_signs(fit)
    if better is None:
        return fit
    retry, *_ = frame.fit(name, better.parameters, fit.moments()[0], better.otf)
    return retry if is_better(retry, fit) else fit


@dataclass(frozen=True)
class FrameFits:
    """Hold the arguments common to all fits of one frame.

    Attributes
    ----------
    data : Data
    optics : Optics
    options : FitOptions
    sure : bool
        As for :func:`fit_locus`.
    """

    data: Data
    optics: Optics
    options: FitOptions
    sure: bool

    def fit(self, name: str, start: Parameters, moments, otf: OTF | None) -> tuple[FitResult, OTF, FrameFits]:
        """Fit one locus.

        Returns
        -------
        fit : FitResult
        otf : OTF
            Expanded where the fit ended.
        frame : FrameFits
            What later fits share: the model errors that this one allowed for.
        """
        otf = self.optics.otf(start.aberrations) if otf is None else otf
        begin = starting_point(locus_class(name), moments, start, otf, self.data, self.options)
        fit, otf, data = fit_and_allow(self.data, self.optics, begin, otf, self.options)
        others = replace(self, data=data, options=replace(self.options, model_error=0.0))
        return replace(fit, locus=name), otf, others

    def other_signs(self, fit: FitResult) -> Start | None:
        """Find the start of a better fit, with other signs of aberrations; None where there is none.

        A normal that is not the blur's shape may have ended at another maximum than the locus that is.
        """
        priors, hold = self.options.priors, self.options.hold
        has_priors = bool(priors.terms or priors.if_free)  # they may say the signs
        if self.sure or has_priors or fit.parameters is None or not np.all(np.isfinite(fit.covariance)):
            return None
        state, locus = fit.parameters.aberrations, fit.parameters.locus
        where = self.data, self.optics, self.optics.otf(state), fit.parameters.scene, locus, hold
        start = polished(*where)
        better = with_best_signs(start, self.data, self.optics, hold)
        return None if better is start else better


def is_better(retry: FitResult, before: FitResult) -> bool:
    """Return whether a second fit is sound, and higher than the first."""
    return retry.status is Status.OK and retry.objective < before.objective
