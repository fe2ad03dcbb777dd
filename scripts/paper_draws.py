"""Noisy frames of a cross-fit, fitted in full: what one scoring step leaves out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jitterkit.forecast import CrossFit
from jitterkit.forecast.study import Draws, chunks_of, noisy_frames
from jitterkit.likelihood import Data
from jitterkit.optics.system import Optics
from jitterkit.refit import FitOptions, Status, fit_best_locus, fit_locus
from jitterkit.refit.evidence import log_evidence

_FITTED = (Status.OK, Status.POOR_FIT)
"""Ends of a full refit that count: a wrong locus is a poor fit, and its separation is what is asked for."""


def refitted_draws(
    fits: Sequence[CrossFit],
    optics: Optics,
    draws: int,
    rng: np.random.Generator,
    *,
    auto: bool = False,
    options: FitOptions | None = None,
) -> Draws:
    """Fit noisy frames in full, each starting from the noise-free fit.

    Parameters
    ----------
    fits, draws, rng
        As for :func:`jitterkit.forecast.linearised_draws`: the same frames, where ``draws`` and the
        generator are the same.
    optics : Optics
    auto : bool
        Add a row fitted with the locus that each frame chooses, as ``process`` would.
    options : FitOptions, optional

    Returns
    -------
    draws : Draws
    """
    starts = [fit.fit.parameters for fit in fits if fit.fit.parameters is not None]
    otfs = [optics.otf(start.aberrations) for start in starts]
    expected, truth = fits[0].data, fits[0].truth
    nominal = optics.otf(truth.aberrations)
    columns = []
    for job in chunks_of(draws, rng):
        for electrons in noisy_frames(expected, *job):
            data = Data(electrons, expected.read_variance, expected.used, response=expected.response)
            results = [
                fit_locus(fit.fit.locus, data, optics, start, start.locus.moments(), otf, options)
                for fit, start, otf in zip(fits, starts, otfs, strict=True)
            ]
            if auto:
                moments = truth.locus.moments()
                results.append(fit_best_locus(data, optics, truth, moments, nominal, options))
            usable = [r.of_scene("separation") if r.status in _FITTED else np.nan for r in results]
            columns.append([usable, [log_evidence(r) for r in results]])
    separations, evidence = np.transpose(columns, (1, 2, 0))
    names = tuple(fit.fit.locus for fit in fits)
    return Draws((*names, "auto") if auto else names, separations, evidence)
