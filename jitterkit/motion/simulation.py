"""Pointing drawn from a spectrum, and the loci of frames taken meanwhile.

Reach for :func:`simulate_pointing` for a record, and for :func:`simulate_exposures` to shake a telescope
frame by frame.
"""

from __future__ import annotations

import numpy as np
from scipy.fft import irfft, next_fast_len

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci import Ellipse, Locus, Mvn, Product, Shm, Trace
from jitterkit.loci.base import turned
from jitterkit.motion.budget import line_locus
from jitterkit.motion.record import Record, measure_exposures
from jitterkit.motion.spectrum import PowerSpectrum, panel_integrals
from jitterkit.motion.split import check_exposure

_PER_OCTAVE, _OCTAVES = 4, 20
"""Tones that stand for what is slower than the record, and how far down they go."""

_CYCLES, _STEPS = 32.0, 1024
"""Cycles of a frame that are drawn, by so many steps: straight lines cost the fastest 0.6 % of variance."""


def simulate_pointing(
    spectrum: PowerSpectrum, duration: float, step: float, rng: np.random.Generator
) -> Record:
    """Draw a record of the pointing.

    Parameters
    ----------
    spectrum : PowerSpectrum
    duration, step : float
        s; whole steps are made.
    rng : numpy.random.Generator

    Returns
    -------
    record : Record
        From time 0; normal, with the spectrum's densities and cross spectrum, and lines of random phases.

    Raises
    ------
    ConfigurationError
        If duration or step are not positive, or a line is too fast for the step.

    Notes
    -----
    Harmonics of twice the duration, so that the end knows nothing of the beginning, each with the power of
    its own band; what is slower is drawn as tones at four an octave, down by twenty octaves.  Densities above
    half the sampling rate are left out, not folded back.
    """
    n = max(round(check_exposure(duration) / check_exposure(step)), 1)
    for line in spectrum.lines:
        if line.frequency * step > 0.5:
            problem = f"A line at {line.frequency:g} Hz does not show at a step of {step:g} s"
            remedy = f"give one below {0.5 / line.frequency:g} s"
            raise ConfigurationError(ErrorCode.SAMPLING, f"{problem}; {remedy}.")
    t = step * np.arange(n + 1)
    positions = _random(spectrum, n, step, rng)
    for line in spectrum.lines:
        phase = 2 * np.pi * line.frequency * t + rng.uniform(0, 2 * np.pi)
        positions += turned(line.amplitude * np.cos(phase), line.minor * np.sin(phase), line.angle)
    return Record(t, *positions.T)


def simulate_exposures(
    spectrum: PowerSpectrum, exposure: float, frames: int, rng: np.random.Generator
) -> tuple[list[Locus], np.ndarray]:
    """Take consecutive frames of one simulated record.

    Parameters
    ----------
    spectrum : PowerSpectrum
    exposure : float
        s.
    frames : int
    rng : numpy.random.Generator

    Returns
    -------
    loci : list of Locus
        A trace each; times what is faster than 32 cycles an exposure, where there is any: a normal for random
        motion, and for lines an arcsine streak or an ellipse.  Every locus is centred.
    means : (frames, 2) array
        Where the pointing stood meanwhile, about its mean over all frames, arcsec.
    """
    limit = _CYCLES / check_exposure(exposure)
    t, x, y = simulate_pointing(spectrum.between(0.0, limit), frames * exposure, exposure / _STEPS, rng)
    fast = _fast(spectrum.between(limit, np.inf), exposure)
    pieces = (slice(_STEPS * k, _STEPS * (k + 1) + 1) for k in range(frames))
    traces = (Trace.of(t[: _STEPS + 1], x[piece], y[piece]) for piece in pieces)
    means = measure_exposures(Record(t, x, y), exposure).means[:frames]
    return [Product(trace, *fast) if fast else trace for trace in traces], means - means.mean(axis=0)


def _fast(spectrum: PowerSpectrum, exposure: float) -> list[Locus]:
    """Return what is too fast to be drawn, as a blur."""
    _, integrals = panel_integrals(spectrum)
    moments = integrals.sum(axis=(0, 1))
    normal = [Mvn.near(moments)] if np.any(moments) else []
    kinds = (Ellipse if line_locus(line, exposure) == "ellipse" else Shm for line in spectrum.lines)
    return [*normal, *(kind.near(line.moments()) for kind, line in zip(kinds, spectrum.lines, strict=True))]


def _random(spectrum: PowerSpectrum, n: int, step: float, rng: np.random.Generator) -> np.ndarray:
    """Return the normal motion (n + 1, 2) at equal steps."""
    positions = np.zeros((n + 1, 2))
    if not len(spectrum.frequencies):
        return positions
    size = next_fast_len(2 * (n + 1), real=True)
    width = 1 / (size * step)
    harmonics = np.arange(1, (size - 1) // 2 + 1)
    slow = width / 2 * 2.0 ** (np.arange(-_OCTAVES * _PER_OCTAVE, 1) / _PER_OCTAVE)
    powers = _powers(spectrum, np.concatenate([slow, (harmonics + 0.5) * width]))
    amplitudes = _draws(powers, rng)
    t = step * np.arange(n + 1)
    for f, both in zip(np.sqrt(slow[1:] * slow[:-1]), amplitudes, strict=False):
        if np.any(both):
            positions += np.real(both * np.exp(2j * np.pi * f * t)[:, None])
    waves = np.zeros((size // 2 + 1, 2), complex)
    waves[harmonics] = size / 2 * amplitudes[len(slow) - 1 :]
    return positions + irfft(waves, size, axis=0)[: n + 1]


def _powers(spectrum: PowerSpectrum, bounds: np.ndarray) -> np.ndarray:
    """Return the second moments (b, 3) of the bands between ascending bounds."""
    ends, integrals = panel_integrals(spectrum, edges=bounds)
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(integrals[:, 0], axis=0)])
    return np.diff(np.stack([np.interp(bounds, ends, column) for column in total.T], axis=1), axis=0)


def _draws(powers: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the complex amplitudes (b, 2) of normal motion with given second moments a band."""
    real, imaginary = rng.standard_normal((2, len(powers), 2))
    one = real + 1j * imaginary
    xx, xy, yy = np.maximum(powers[:, 0], 0), powers[:, 1], np.maximum(powers[:, 2], 0)
    slope = xy / np.where(xx > 0, xx, 1.0)
    rest = np.sqrt(np.maximum(yy - slope * xy, 0))
    x = np.sqrt(xx) * one[:, 0]
    return np.stack([x, slope * x + rest * one[:, 1]], axis=1)
