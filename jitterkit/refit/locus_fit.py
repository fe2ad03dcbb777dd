"""Fit a frame with one locus, whatever the signs of its aberrations.

:func:`starting_point` is where the fit begins: at second moments, the best of several where there are several
maxima.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from jitterkit.forward import Parameters, free_parameters
from jitterkit.likelihood import Data
from jitterkit.locate import Start, polished, with_best_signs
from jitterkit.loci import Locus, PartialShm, Path, locus_class, principal_axes
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import Optics
from jitterkit.refit.fit import FitOptions, fit_and_allow
from jitterkit.refit.result import FitResult, Status
from jitterkit.refit.weigh import weight_of_evidence
from jitterkit.scoring import fisher_scoring

_CYCLES, _PHASES = (0.5, 1.2), (-40.0, 40.0)
"""Of a partial vibration: before and after its first whole cycle, lopsided either way."""

_TRIAL_STEPS = 4
"""Steps after which the maxima are compared."""


def starting_point(
    kind: type[Locus], moments, start: Parameters, otf: OTF, data: Data, options: FitOptions
) -> Parameters:
    """Return the best point to start a locus from.

    Parameters
    ----------
    kind : type
    moments : (3,) array
        Second moments ``(Sxx, Sxy, Syy)`` to start from, arcsec².
    start : Parameters
        Its scene, aberrations and background are kept.
    otf, data, options
        As for the fit to come.

    Returns
    -------
    start : Parameters
        Of several starts, the one from which a few steps reach the smallest deviance.
    """
    if kind is PartialShm:
        loci = [_partial(moments, cycles, phase) for cycles, phase in itertools.product(_CYCLES, _PHASES)]
    else:
        first = kind.near(np.asarray(moments))
        loci = [first, first.at(-first.coords)] if kind is Path else [first]  # a path bends either way
    if options.nodes is not None:
        loci = [locus.sampled(options.nodes) for locus in loci]
    starts = [start.with_locus(locus) for locus in loci]
    if len(starts) == 1:
        return starts[0]
    names, free = free_parameters(starts[0], otf, options.hold)
    priors = options.priors
    ends = [
        fisher_scoring(s, otf, data, free, priors.over(names, s.locus), max_steps=_TRIAL_STEPS)
        for s in starts
    ]
    deviances = [float(end.objective) for end in ends]
    return starts[int(np.nanargmin(deviances))] if np.any(np.isfinite(deviances)) else starts[0]


def _partial(moments, cycles: float, phase: float) -> Locus:
    """A partial vibration as long as the moments say."""
    major, _, angle = principal_axes(moments)
    unit = PartialShm.of(1.0, angle, cycles, phase)
    size = principal_axes(unit.moments())[0]
    return PartialShm.of(major / size, angle, cycles, phase)


_MOST_KNOTS = 8
"""Of a path.  Walks of 40 steps, 0.3 by 0.15 of a resolution rms and of 2e5 electrons, took six or eight."""

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

    def finest_path(self, path: FitResult, otf: OTF) -> tuple[FitResult, OTF]:
        """Let the path of a fit pass two more positions at a time, as long as the evidence grows.

        Returns
        -------
        path : FitResult
            The fit itself where that gains nothing.
        otf : OTF
            Expanded where it ended.
        """
        while (start := path.parameters) is not None:
            locus = start.locus
            if not isinstance(locus, Path) or locus.knots >= _MOST_KNOTS:
                break
            begin = start.with_locus(locus.finer(locus.knots + 2))
            try:
                finer, there, _ = fit_and_allow(self.data, self.optics, begin, otf, self.options)
            except (ArithmeticError, ValueError, np.linalg.LinAlgError):
                break
            finer = replace(finer, locus=path.locus, shape=path.shape, shape_err=path.shape_err)
            if not weight_of_evidence(finer) > weight_of_evidence(path):
                break
            path, otf = finer, there
        return path, otf

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
