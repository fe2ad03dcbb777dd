"""The starting point of the fit of a locus: from second moments; several where there are several maxima."""

from __future__ import annotations

import itertools

import numpy as np

from jitterkit.forward import Parameters, free_parameters
from jitterkit.likelihood import Data
from jitterkit.loci import Locus, PartialShm, Path, principal_axes
from jitterkit.optics.otf import OTF
from jitterkit.refit.fit import FitOptions
from jitterkit.scoring import fisher_scoring

__all__ = ["starting_point"]

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
