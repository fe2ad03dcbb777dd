"""Thousands of noisy frames fitted with wrong and right loci, on the same draws.

Reach for :func:`linearised_draws`: a scoring step is linear in the data, so that from a noise-free fit all
frames are fitted by one matrix product.  :func:`refitted_draws` fits the very same frames in full, to measure
what the step leaves out.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from jitterkit.forecast.crossfit import CrossFit
from jitterkit.forward import Parameters
from jitterkit.likelihood import Data
from jitterkit.optics.system import Optics
from jitterkit.refit import FitOptions, Status, fit_best_locus, fit_locus
from jitterkit.refit.evidence import log_evidence

_CHUNK = 250
"""Frames drawn at once: 30 MB of a 128 x 128 frame."""

_THREADS = 2

_FITTED = (Status.OK, Status.POOR_FIT)
"""Ends of a full refit that count: a wrong locus is a poor fit, and its separation is what is asked for."""


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
    :func:`refitted_draws` on the same frames: give it a generator in the same state.  The products are in
    single precision, which is a millionth of the separation's error.
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
        noise = (_frames(data, *job).reshape(job[1], -1) - centre).astype(np.float32)
        *responses, shares = np.split((rows @ noise.T).astype(float), ends)
        found = []
        for fit, score, log in zip(fits, responses, shares, strict=True):
            step = fit.response @ score
            separation = fit.fit.of_scene("separation") + step[fit.fit.names.index("separation")]
            found.append([separation, log_evidence(fit.fit) + log + np.sum(score * step, axis=0) / 2])
        return np.array(found)

    with ThreadPoolExecutor(_THREADS) as pool:
        every = np.concatenate(list(pool.map(fitted, _jobs(draws, rng))), axis=2)
    return Draws(tuple(fit.fit.locus for fit in fits), every[:, 0], every[:, 1])


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
        As for :func:`linearised_draws`: the same frames, where ``draws`` and the generator are the same.
    optics : Optics
    auto : bool
        Add a row fitted with the locus that each frame chooses, as ``process`` would.
    options : FitOptions, optional

    Returns
    -------
    draws : Draws
    """
    otfs = [optics.otf(_fitted(fit).aberrations) for fit in fits]
    expected, truth = fits[0].data, fits[0].truth
    nominal = optics.otf(truth.aberrations)
    columns = []
    for job in _jobs(draws, rng):
        for electrons in _frames(expected, *job):
            data = Data(electrons, expected.read_variance, expected.used, response=expected.response)
            results = [_refit(fit, data, optics, otf, options) for fit, otf in zip(fits, otfs, strict=True)]
            if auto:
                moments = truth.locus.moments()
                results.append(fit_best_locus(data, optics, truth, moments, nominal, options))
            usable = [r.of_scene("separation") if r.status in _FITTED else np.nan for r in results]
            columns.append([usable, [log_evidence(r) for r in results]])
    separations, evidence = np.transpose(columns, (1, 2, 0))
    names = tuple(fit.fit.locus for fit in fits)
    return Draws((*names, "auto") if auto else names, separations, evidence)


def _refit(fit: CrossFit, data: Data, optics, otf, options):
    start = _fitted(fit)
    return fit_locus(fit.fit.locus, data, optics, start, start.locus.moments(), otf, options)


def _fitted(fit: CrossFit) -> Parameters:
    assert fit.fit.parameters is not None
    return fit.fit.parameters


def _jobs(draws: int, rng: np.random.Generator) -> list[tuple[np.random.Generator, int]]:
    """Generators of their own for chunks of frames, so that threads do not share one."""
    sizes = [min(_CHUNK, draws - first) for first in range(0, draws, _CHUNK)]
    return list(zip(rng.spawn(len(sizes)), sizes, strict=True))


def _frames(data: Data, rng: np.random.Generator, draws: int) -> np.ndarray:
    """Noisy frames (draws, ny, nx) of an expected one: photons, and what the detector adds to them."""
    weight, variance = np.asarray(data.weight), np.asarray(data.read_variance)
    expected = weight * np.maximum(np.asarray(data.electrons), 0.0)
    frames = rng.poisson(expected, (draws, *expected.shape)).astype(float)
    if np.any(variance > 0):
        frames += np.sqrt(variance) * rng.standard_normal(frames.shape)
    return frames / weight
