"""Every locus fitted with every other: the paper's cross-fit, for any set of loci.

Reach for :func:`cross_fit`.  Beside the rows that fit one locus to all data stand two that choose one:
``auto`` chooses for a whole sequence of frames with the same jitter, by the evidence of all of them, and
``auto, a frame`` for each frame by its own.

Thousands of noisy frames are fitted on the same draws by :func:`linearised_draws`: a scoring step is linear
in the data, so that from a noise-free fit all frames are fitted by one matrix product.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from jitterkit.detectors import Detector
from jitterkit.errors import JitterkitError
from jitterkit.forecast.crossfit import CrossFit, noise_free_fit
from jitterkit.forward import Parameters
from jitterkit.likelihood import Data
from jitterkit.loci import Locus
from jitterkit.optics.system import Optics
from jitterkit.refit import FitOptions
from jitterkit.refit.evidence import log_evidence

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
    exposure: float = 0.0,
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
    exposure : float
        s, for a dark current.

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
    truth, seen = float(still.binary.separation), (optics, detector, otf, options)
    for name, loci in columns.items():
        settings: list[tuple[list[CrossFit], Draws]] = []
        for locus in loci:
            frame = still.with_locus(locus)
            fits = [noise_free_fit(frame, row, *seen, exposure=exposure) for row in named]
            for other in (one for one in CANDIDATES if choosing and one not in named):
                with suppress(JitterkitError):
                    fits.append(noise_free_fit(frame, other, *seen, exposure=exposure))
            settings.append((fits, linearised_draws(fits, draws, rng)))
        for row in rows:
            yield _panel(name, row, settings, truth)


def _panel(data: str, row: str, settings: list[tuple[list[CrossFit], Draws]], truth: float) -> Panel:
    offsets, chosen, numbers = [], [], []
    for fits, drawn in settings:
        if row == AUTO_FRAME:
            often = np.bincount(np.argmax(drawn.evidence, axis=0), minlength=len(fits))
            index, found = int(np.argmax(often)), drawn.by_frame()
            numbers.append((np.nan, np.nan, np.nan))
        else:
            index = drawn.loci.index(drawn.by_sequence()[0] if row == AUTO else row)
            fit, found = fits[index], drawn.separations[index]
            numbers.append((fit.bias, fit.error, fit.misfit))
        offsets.append(found - truth)
        chosen.append(drawn.loci[index])
    bias, error, misfit = np.array(numbers).T
    return Panel(data, row, np.array(offsets), bias, error, misfit, tuple(chosen))


_CHUNK = 250
"""Frames drawn at once: 30 MB of a 128 x 128 frame."""

_THREADS = 2


class Draws(NamedTuple):
    """Noisy frames of one truth, each fitted with several loci.

    Attributes
    ----------
    loci : tuple of str
    separations : (len(loci), n) array
        arcsec; NaN where a fit did not settle.
    evidence : (len(loci), n) array
        Logarithm of the evidence for each locus, up to a constant of the frame; minus infinity for one
        without (``stable``).
    """

    loci: tuple[str, ...]
    separations: np.ndarray
    evidence: np.ndarray

    def by_frame(self) -> np.ndarray:
        """Return the separations (n,) with the locus that each frame's own evidence chooses."""
        best = np.argmax(self.evidence, axis=0)
        return self.separations[best, np.arange(len(best))]

    def by_sequence(self) -> tuple[str, np.ndarray]:
        """The locus that the evidence of all frames together chooses, and the separations (n,) with it.

        *Assumes* that the frames share one jitter, as the frames of a short sequence do.
        """
        best = int(np.argmax(self.evidence.sum(axis=1)))
        return self.loci[best], self.separations[best]


def linearised_draws(fits: Sequence[CrossFit], draws: int, rng: np.random.Generator) -> Draws:
    """Fit noisy frames by one step from noise-free fits.

    Parameters
    ----------
    fits : sequence of CrossFit
        Of one truth: each frame is drawn once, and fitted with every locus.
    draws : int
    rng : numpy.random.Generator

    Returns
    -------
    draws : Draws

    Notes
    -----
    With ``g`` the score that the noise makes at a noise-free fit and ``C`` the response there, the step is
    ``C g``, and the log-posterior gains ``g'Cg/2``.  What this leaves out is measured by
    ``scripts/reproduce_paper`` on the same frames.  The products are in single precision, which is a
    millionth of the separation's error.
    """
    data = fits[0].data
    centre = np.asarray(data.electrons).ravel()
    scores = [fit.slopes.reshape(len(fit.slopes), -1) for fit in fits]
    # about the first: what a frame's evidence has in common for all loci says nothing
    used, weight = np.asarray(data.used), np.asarray(data.weight)
    logs = [np.where(used, weight * np.log(fit.mean / fits[0].mean), 0.0).ravel() for fit in fits]
    rows = np.concatenate([*scores, logs]).astype(np.float32)
    ends = np.cumsum([len(score) for score in scores])

    def fitted(job: tuple[np.random.Generator, int]) -> np.ndarray:
        noise = (noisy_frames(data, *job).reshape(job[1], -1) - centre).astype(np.float32)
        *responses, shares = np.split((rows @ noise.T).astype(float), ends)
        found = []
        for fit, score, log in zip(fits, responses, shares, strict=True):
            step = fit.response @ score
            separation = fit.fit.of_scene("separation") + step[fit.fit.names.index("separation")]
            found.append([separation, log_evidence(fit.fit) + log + np.sum(score * step, axis=0) / 2])
        return np.array(found)

    with ThreadPoolExecutor(_THREADS) as pool:
        every = np.concatenate(list(pool.map(fitted, chunks_of(draws, rng))), axis=2)
    return Draws(tuple(fit.fit.locus for fit in fits), every[:, 0], every[:, 1])


def chunks_of(draws: int, rng: np.random.Generator) -> list[tuple[np.random.Generator, int]]:
    """Return chunks of frames with generators of their own, so that threads do not share one."""
    sizes = [min(_CHUNK, draws - first) for first in range(0, draws, _CHUNK)]
    return list(zip(rng.spawn(len(sizes)), sizes, strict=True))


def noisy_frames(data: Data, rng: np.random.Generator, draws: int) -> np.ndarray:
    """Draw noisy frames (draws, ny, nx) of an expected one: photons, and what the detector adds to them."""
    weight, variance = np.asarray(data.weight), np.asarray(data.read_variance)
    expected = weight * np.maximum(np.asarray(data.electrons), 0.0)
    frames = rng.poisson(expected, (draws, *expected.shape)).astype(float)
    if np.any(variance > 0):
        frames += np.sqrt(variance) * rng.standard_normal(frames.shape)
    return frames / weight
