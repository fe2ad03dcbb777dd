"""A pointing loop: the fine tip/tilt stage that follows slow motion and leaves the fast.

:func:`close_loop` is for a spectrum, :func:`follow` for a measured record.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import accumulate

import numpy as np

from jitterkit.errors import positive
from jitterkit.motion.spectrum import Line, PowerSpectrum

_PER_OCTAVE = 64
"""Rows that the product of density and rejection is given: a power law between them to 2e-5."""

_OCTAVES = 20
"""Below the last row and the bandwidth."""


def loop_rejection(frequencies, bandwidth: float) -> np.ndarray:
    """Return the share of the power that a first-order integrator leaves.

    Parameters
    ----------
    frequencies : array
        Hz.
    bandwidth : float
        Hz, where half the power is left.

    Returns
    -------
    rejection : array
        ``f² / (f² + bandwidth²)``.

    Notes
    -----
    *Assumes* no delay, and a sensor without noise.  *Fails when* the loop is pushed to a tenth of its
    sampling rate or beyond: a real one then amplifies motion just above its bandwidth.

    >>> loop_rejection([0.0, 2.0], 2.0)
    array([0. , 0.5])
    """
    f, bandwidth = np.asarray(frequencies, float), positive("bandwidth", bandwidth, "Hz")
    return f**2 / (f**2 + bandwidth**2)


def close_loop(spectrum: PowerSpectrum, bandwidth: float) -> PowerSpectrum:
    """Return what a loop of a given bandwidth [Hz] leaves of a spectrum; rows are added where it bends it."""
    lines = tuple(_left(line, float(loop_rejection(line.frequency, bandwidth))) for line in spectrum.lines)
    if not len(spectrum.frequencies):
        return replace(spectrum, lines=lines)
    low, high = spectrum.frequencies[[0, -1]]
    steps = np.arange(-_OCTAVES * _PER_OCTAVE, 1) / _PER_OCTAVE
    grid = np.concatenate([spectrum.frequencies, high * 2.0**steps, bandwidth * 2.0**steps])
    dense = spectrum.resampled(np.unique(grid[(grid >= low) & (grid <= high)]))
    left = dense.density * loop_rejection(dense.frequencies, bandwidth)[:, None]
    return replace(dense, density=left, lines=lines)


def follow(t, x, y, bandwidth: float) -> tuple[np.ndarray, np.ndarray]:
    """Return what a loop leaves of a record that is straight between its samples.

    Parameters
    ----------
    t : (n,) array
        s, ascending.
    x, y : (n,) array
        Pointing, arcsec.
    bandwidth : float
        Hz.

    Returns
    -------
    x, y : (n,) array
        At the same times, exactly; the loop is on target at the first.

    Notes
    -----
    *Fails when* the samples are further apart than a tenth of ``1 / bandwidth``: the rest bends between them.
    """
    loop_rejection(0.0, bandwidth)
    turns = 2 * np.pi * bandwidth * np.diff(np.asarray(t, float))
    kept, caught = np.exp(-turns), -np.expm1(-turns) / turns
    moved = caught * np.diff(np.asarray(x, float) + 1j * np.asarray(y, float))
    steps = zip(kept.tolist(), moved.tolist(), strict=True)
    left = np.array(list(accumulate(steps, lambda last, step: step[0] * last + step[1], initial=0j)))
    return left.real, left.imag


def _left(line: Line, rejection: float) -> Line:
    root = rejection**0.5
    return replace(line, amplitude=root * line.amplitude, minor=root * line.minor)
