"""Every locus fitted with every other: the paper's cross-fit, for any set of loci.

Reach for :func:`cross_fit`.  Beside the rows that fit one locus to all data stand two that choose one:
``auto`` chooses for a whole sequence of frames with the same jitter, by the evidence of all of them, and
``auto, a frame`` for each frame by its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jitterkit.detectors import Detector
from jitterkit.errors import JitterkitError
from jitterkit.forecast.crossfit import CrossFit, noise_free_fit
from jitterkit.forecast.ensemble import Draws, linearised_draws
from jitterkit.forward import Parameters
from jitterkit.loci import Locus
from jitterkit.optics.system import Optics
from jitterkit.refit import FitOptions

AUTO, AUTO_FRAME = "auto", "auto, a frame"

CANDIDATES = ("mvn", "linear", "shm", "ellipse", "partial", "path")
"""Loci among which ``auto`` chooses."""


class Panel(NamedTuple):
    """Data of one kind of jitter, in several settings, fitted with one locus.

    Attributes
    ----------
    data, fitted : str
    offsets : (k, n) array
        Fitted less true separation of n noisy frames in each of k settings, arcsec.
    bias : (k,) array
        The same without noise; of ``auto`` that of the locus it chose, of ``auto, a frame`` NaN.
    error : (k,) array
        What the fits believe, arcsec; likewise.
    misfit : (k,) array
        Chi-squared that a wrong locus adds to a frame; likewise.
    chosen : tuple of str
        The locus fitted in each setting; of ``auto, a frame`` the one most frames chose.
    """

    data: str
    fitted: str
    offsets: np.ndarray
    bias: np.ndarray
    error: np.ndarray
    misfit: np.ndarray
    chosen: tuple[str, ...]

    @property
    def worst(self) -> float:
        """Return the largest noise-free bias of a setting, in standard errors of the mean of its draws."""
        errors = self.offsets.std(axis=1, ddof=1) / np.sqrt(self.offsets.shape[1])
        return float(np.max(np.abs(self.bias) / errors))

    @property
    def mean(self) -> tuple[float, float]:
        """Return the mean offset over all settings and draws, and its standard error, arcsec."""
        spread = float(np.sqrt(np.mean(np.var(self.offsets, axis=1, ddof=1))))
        return float(self.offsets.mean()), spread / float(np.sqrt(self.offsets.size))


def cross_fit(
    columns: Mapping[str, Sequence[Locus]],
    rows: Sequence[str],
    still: Parameters,
    optics: Optics,
    draws: int,
    rng: np.random.Generator,
    detector: Detector | None = None,
    options: FitOptions | None = None,
) -> Iterator[Panel]:
    """Fit data of several kinds with several loci, one step a frame.

    Parameters
    ----------
    columns : mapping of name to loci
        Kinds of jitter, each in several settings.
    rows : sequence of str
        Names of loci to fit, ``auto`` and ``auto, a frame``.
    still : Parameters
        Scene and optics.
    optics : Optics
    draws : int
        Noisy frames of each setting; the rows of a column see the same ones.
    rng : numpy.random.Generator
    detector : Detector, optional
    options : FitOptions, optional

    Yields
    ------
    panel : Panel
        Column by column, its rows in order.

    Raises
    ------
    JitterkitError
        If a row's locus cannot be fitted; a candidate of ``auto`` that cannot is left out.
    """
    choosing = bool({AUTO, AUTO_FRAME} & set(rows))
    named = [row for row in rows if row not in (AUTO, AUTO_FRAME)]
    otf = optics.otf(still.aberrations)
    truth = float(still.binary.separation)
    for name, loci in columns.items():
        settings: list[tuple[list[CrossFit], Draws]] = []
        for locus in loci:
            frame = still.with_locus(locus)
            where = frame, optics, detector, otf, options
            fits = [_fitted(row, *where) for row in named]
            if choosing:
                others = [one for one in CANDIDATES if one not in named]
                fits += [f for f in (_tried(one, *where) for one in others) if f]
            settings.append((fits, linearised_draws(fits, draws, rng)))
        for row in rows:
            yield _panel(name, row, settings, truth)


def _fitted(locus: str, frame: Parameters, optics, detector, otf, options) -> CrossFit:
    return noise_free_fit(frame, locus, optics, detector, otf, options)


def _tried(locus: str, *where) -> CrossFit | None:
    try:
        return _fitted(locus, *where)
    except JitterkitError:
        return None


def _panel(data: str, row: str, settings: list[tuple[list[CrossFit], Draws]], truth: float) -> Panel:
    offsets, chosen, numbers = [], [], []
    for fits, drawn in settings:
        if row == AUTO_FRAME:
            offsets.append(drawn.by_frame() - truth)
            often = np.bincount(np.argmax(drawn.evidence, axis=0), minlength=len(fits))
            chosen.append(drawn.loci[int(np.argmax(often))])
            numbers.append((np.nan, np.nan, np.nan))
            continue
        name = drawn.by_sequence()[0] if row == AUTO else row
        fit = fits[drawn.loci.index(name)]
        offsets.append(drawn.separations[drawn.loci.index(name)] - truth)
        chosen.append(name)
        numbers.append((fit.bias, fit.error, fit.misfit))
    bias, error, misfit = np.array(numbers).T
    return Panel(data, row, np.array(offsets), bias, error, misfit, tuple(chosen))
