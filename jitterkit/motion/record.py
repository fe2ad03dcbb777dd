"""A measured record of the pointing, cut into exposures: what each of them saw.

Reach for :func:`measure_exposures`; nothing is assumed there but that the pointing is straight between two
samples.  :func:`trace_spectrum` is for pictures, and for simulating more of the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import signal

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci import trace_gaps
from jitterkit.motion.bins import spectrum_of_bins
from jitterkit.motion.spectrum import PowerSpectrum
from jitterkit.motion.split import Split, check_cadence

_SEGMENTS = 8
"""Of a record, for its spectrum: overlapping by half they are 15, and a density is good to about a third."""


_MOST_EXPOSURES = 10_000_000
"""A year of exposures of 3 s; more do not fit into the memory."""

_FEWEST = 4
"""Samples that have two frequencies beside zero."""


class Record(NamedTuple):
    """Pointing at given times: ``t`` [s], ascending, ``x`` and ``y`` [arcsec], all (n,)."""

    t: np.ndarray
    x: np.ndarray
    y: np.ndarray


@dataclass(frozen=True, eq=False)
class Exposures:
    """Motion within each of a row of exposures.

    Attributes
    ----------
    starts : (n,) array
        s.
    means : (n, 2) array
        Mean pointing, arcsec.
    smears : (n, 2) array
        Smear vector from the beginning to the end, arcsec: 12 times the mean of pointing times time, in
        exposures from the middle.
    jitters : (n, 3) array
        Second moments about the smear, arcsec².
    numbers : (n,) int array
        Places in the row of exposures, from 0; those are missing in which the record has a gap.
    planned : int
        Exposures in the row, with those that are missing.
    """

    starts: np.ndarray
    means: np.ndarray
    smears: np.ndarray
    jitters: np.ndarray
    numbers: np.ndarray
    planned: int

    def split(self) -> Split:
        """Return the mean over the exposures, for comparison with that of a spectrum.

        The displacement is about the mean of the record: what is slower than that is not in it.
        """
        about = self.means - self.means.mean(axis=0)
        share = len(about) / max(len(about) - 1, 1)
        smear = _squares(self.smears).mean(axis=0) / 12
        return Split(share * _squares(about).mean(axis=0), smear, self.jitters.mean(axis=0))

    def steps(self) -> np.ndarray:
        """Second moments (3,) of the motion from one exposure to the next, arcsec²; zero without a pair."""
        steps = _squares(np.diff(self.means, axis=0)[np.diff(self.numbers) == 1])
        return steps.mean(axis=0) if len(steps) else np.zeros(3)


def measure_exposures(record: Record, exposure: float, cadence: float | None = None) -> Exposures:
    """Split a record exposure by exposure, exactly for pointing that is straight between the samples.

    Parameters
    ----------
    record : Record
    exposure : float
        s.
    cadence : float, optional
        From the start of one exposure to that of the next, s; by default they follow without a gap.

    Returns
    -------
    exposures : Exposures
        As many as the record holds, without those in which it has a gap
        (:func:`~jitterkit.loci.trace_gaps`).

    Raises
    ------
    ConfigurationError
        If it holds none, or exposures overlap.
    """
    cadence = check_cadence(exposure, exposure if cadence is None else cadence)
    t, positions = np.asarray(record.t, float) - record.t[0], np.stack([record.x, record.y], axis=1)
    count = int(np.floor((t[-1] - exposure) / cadence * (1 + 1e-12) + 1e-9)) + 1
    if count < 1:
        problem = f"The trace lasts {t[-1]:g} s and holds no exposure of {exposure:g} s"
        remedy = "give a longer trace or a shorter exposure"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; {remedy}.")
    if count > _MOST_EXPOSURES:
        problem = f"The trace lasts {t[-1]:g} s, {count:.3g} exposures of {exposure:g} s"
        remedy = "check the unit of its times, or give a part of it"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; {remedy}.")
    starts = cadence * np.arange(count)
    numbers = np.flatnonzero(_is_covered(t, starts, exposure))
    if not len(numbers):
        gaps = f"{len(trace_gaps(t))} gaps, the longest of {np.diff(t).max():g} s"
        problem = f"The trace has {gaps}, and all of its {count} exposures of {exposure:g} s have one"
        remedy = "give a better trace or a shorter exposure"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; {remedy}.")
    middle = positions.mean(axis=0)
    means, smears, jitters = (v[numbers] for v in _project(t, positions - middle, starts, exposure))
    return Exposures(starts[numbers] + record.t[0], means + middle, smears, jitters, numbers, count)


def _is_covered(t: np.ndarray, starts: np.ndarray, exposure: float) -> np.ndarray:
    """Return which exposures (n,) are without a gap."""
    gaps, slack = trace_gaps(t), 1e-9 * exposure
    after = np.searchsorted(t[gaps + 1], starts + slack, side="right")  # the first gap that ends later
    begin = np.append(t[gaps], np.inf)[after]
    return begin >= starts + exposure - slack


def trace_spectrum(record: Record, segments: int = _SEGMENTS) -> PowerSpectrum:
    """Welch's estimate of the spectrum of a record.

    Parameters
    ----------
    record : Record
        Times that are not equally spaced are made so by straight lines; of a record with gaps the longest
        piece is used.
    segments : int
        Into which it is cut, under Hann's window; more are smoother and begin at a higher frequency.

    Returns
    -------
    spectrum : PowerSpectrum
        Of bins; a vibration that stands out of them is a line.  Empty where a record of two or three samples
        has no two frequencies.

    Notes
    -----
    *Fails when* most of the power is slower than a segment: it leaks upwards.  :func:`measure_exposures` does
    not need a spectrum.
    """
    piece = max(np.split(np.arange(len(record.t)), trace_gaps(record.t) + 1), key=len)
    n, times = len(piece), record.t[piece] - record.t[piece[0]]
    if n < _FEWEST:
        return PowerSpectrum()
    t = np.linspace(0.0, times[-1], n)
    x, y = (np.interp(t, times, values[piece]) for values in (record.x, record.y))
    options = {"fs": (n - 1) / (t[-1] - t[0]), "nperseg": max(n // segments, min(n, 16))}
    f, xx = signal.welch(x, **options)
    _, yy = signal.welch(y, **options)
    _, xy = signal.csd(x, y, **options)
    # the row at zero has lost the mean of its segment
    return spectrum_of_bins(f[1:], np.stack([xx, xy.real, yy], axis=1)[1:])


def _project(t, positions, starts, exposure) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means, smear vectors and second moments about them, from exact integrals over the straight pieces."""
    ends = np.unique(np.concatenate([t, starts, starts + exposure]).clip(t[0], t[-1]))
    middles = (ends[1:] + ends[:-1]) / 2
    index = np.clip(np.searchsorted(starts, middles, side="right") - 1, 0, None)
    index = np.where(middles < starts[index] + exposure, index, len(starts))  # of no exposure: dropped below
    held = index < len(starts)
    index, first, last = index[held], ends[:-1][held], ends[1:][held]
    share = (last - first) / exposure
    u, v = ((edge - starts[index]) / exposure - 0.5 for edge in (first, last))
    a, b = (np.stack([np.interp(edge, t, axis) for axis in positions.T], axis=1) for edge in (first, last))

    def total(values: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(index, share * column, len(starts)) for column in values.T], axis=1)

    means = total((a + b) / 2)
    smears = 12 * total((a * (2 * u + v)[:, None] + b * (u + 2 * v)[:, None]) / 6)
    a, b = (end - means[index] - smears[index] * at[:, None] for end, at in ((a, u), (b, v)))
    return means, smears, total((_squares(a) + _squares(b) + _squares(a + b)) / 6)


def _squares(vectors: np.ndarray) -> np.ndarray:
    x, y = vectors.T
    return np.stack([x * x, x * y, y * y], axis=1)
