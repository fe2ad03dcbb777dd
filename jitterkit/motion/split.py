"""A spectrum seen by one exposure after the other: displacement, smear and jitter, in both axes.

Over one exposure every motion is a sum of Legendre polynomials of time: the zeroth is where the image stands
(displacement), the first a straight smear, the rest jitter.  :func:`part_weights` gives the share of each in
the variance of a tone of random phase, by its cycles ``f T`` in one exposure; :func:`difference_weight` what
moves from one frame to another.

Reach for :func:`split_spectrum`.  A :class:`Split` holds second moments; :attr:`Split.blur`, smear and jitter
together, is what widens the image, and displacement what moves it from frame to frame.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.special import spherical_jn

from jitterkit.errors import ConfigurationError, ErrorCode, positive
from jitterkit.motion.spectrum import Line, PowerSpectrum, panel_integrals

PARTS = ("displacement", "smear", "jitter")

_LAST = 8
"""Of the terms that make the jitter of a slow tone; at z = 1 what follows is 1e-17 of the sum."""


def legendre_weight(n: int, cycles) -> np.ndarray:
    """Return the share of a tone's variance in the n-th Legendre term of an exposure.

    Parameters
    ----------
    n : int
    cycles : array
        ``f T``, frequency times exposure.

    Returns
    -------
    weight : array
        ``(2 n + 1) j_n(pi f T)²``; over all n they sum to one.

    Notes
    -----
    The mean over a random phase of the squared projection of ``sqrt(2) cos(2 pi f t + phase)`` on the
    normalised polynomial (Pittelkau & McKinley 2016).

    >>> legendre_weight(0, [0.0, 1.0]).round(12)
    array([1., 0.])
    """
    return (2 * n + 1) * spherical_jn(n, np.pi * np.asarray(cycles, float)) ** 2


def part_weights(cycles) -> np.ndarray:
    """Shares of a tone's variance in displacement, smear and jitter.

    Parameters
    ----------
    cycles : (m,) array
        ``f T``.

    Returns
    -------
    weights : (3, m) array
        In the order of :data:`PARTS`; they sum to one.

    Notes
    -----
    Jitter goes as ``(pi f T)⁴ / 45`` for slow tones.  There it is summed from its own terms: one minus the
    other two would lose it to rounding.
    """
    cycles = np.asarray(cycles, float)
    displacement, smear = legendre_weight(0, cycles), legendre_weight(1, cycles)
    slow = np.where(np.pi * cycles < 1, cycles, 0.0)
    terms = sum(legendre_weight(n, slow) for n in range(2, _LAST + 1))
    jitter = np.where(np.pi * cycles < 1, terms, 1 - displacement - smear)
    return np.stack([displacement, smear, jitter])


def difference_weight(frequencies, exposure: float, cadence: float) -> np.ndarray:
    """Return the variance of the motion between two frames, per variance of a tone.

    Parameters
    ----------
    frequencies : (m,) array
        Hz.
    exposure, cadence : float
        Of a frame, and from the start of one to the start of the other, s.

    Returns
    -------
    weight : (m,) array
        ``4 sin²(pi f cadence) sinc²(f exposure)``, up to 4: the frames may lie at opposite ends of the swing.
    """
    frequencies = np.asarray(frequencies, float)
    return 4 * np.sin(np.pi * frequencies * cadence) ** 2 * legendre_weight(0, frequencies * exposure)


_PER_DECADE = 40
"""Frequencies at least of a cumulative split, down ten decades, so that it is smooth to look at."""


@dataclass(frozen=True, eq=False)
class Split:
    """Mean second moments ``(Sxx, Sxy, Syy)`` of the pointing over many exposures, arcsec².

    Attributes
    ----------
    displacement : (3,) array
        Of the frames' mean pointings.
    smear : (3,) array
        Of the straight part of the motion within a frame: of smear vectors ``l`` the mean of ``l l' / 12``.
    jitter : (3,) array
        Of the rest within a frame.
    """

    displacement: np.ndarray = field(default_factory=lambda: np.zeros(3))
    smear: np.ndarray = field(default_factory=lambda: np.zeros(3))
    jitter: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @property
    def blur(self) -> np.ndarray:
        """Return the moments of everything within a frame."""
        return self.smear + self.jitter

    def __add__(self, other: Split) -> Split:
        """Add two independent motions."""
        return Split(*(getattr(self, part) + getattr(other, part) for part in PARTS))


def split_line(line: Line, exposure: float) -> Split:
    """Split a line by its cycles in one exposure [s]."""
    shares = part_weights(np.array([line.frequency * check_exposure(exposure)]))[:, 0]
    return Split(*(share * line.moments() for share in shares))


def split_spectrum(spectrum: PowerSpectrum, exposure: float) -> Split:
    """Split a spectrum, its lines included.

    Parameters
    ----------
    spectrum : PowerSpectrum
    exposure : float
        s.

    Returns
    -------
    split : Split
        The parts sum to the variance of the motion.

    Raises
    ------
    ConfigurationError
        If the exposure is not positive.
    """
    _, integrals = panel_integrals(spectrum, _parts(exposure), exposure)
    start = Split(*integrals.sum(axis=0)) if len(integrals) else Split()
    return sum((split_line(line, exposure) for line in spectrum.lines), start)


def cumulative_split(spectrum: PowerSpectrum, exposure: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the split of all motion up to a frequency, at frequencies close enough to draw it.

    Parameters
    ----------
    spectrum, exposure
        As in :func:`split_spectrum`.

    Returns
    -------
    frequencies : (n,) array
        Hz, ascending; a line has two, before and after.
    moments : (n, 3, 3) array
        By part (displacement, smear, jitter) and moment (Sxx, Sxy, Syy), arcsec².
    """
    tones = sorted(spectrum.lines, key=lambda line: line.frequency)
    positions = np.array([line.frequency for line in tones])
    steady = spectrum.highest * 10.0 ** (-np.arange(10 * _PER_DECADE) / _PER_DECADE)
    ends, integrals = panel_integrals(spectrum, _parts(exposure), exposure, [*positions, *steady])
    steps = [[getattr(split_line(line, exposure), part) for part in PARTS] for line in tones]
    f = np.concatenate([ends, positions, positions])
    change = np.zeros((len(f), 3, 3))
    change[1 : len(ends)] = integrals
    change[len(ends) + len(positions) :] = np.reshape(steps, (-1, 3, 3))
    order = np.argsort(f, kind="stable")
    return f[order], np.cumsum(change[order], axis=0)


def motion_between_frames(spectrum: PowerSpectrum, exposure: float, cadence: float) -> np.ndarray:
    """Second moments (3,) of the motion from a frame to the one that starts a cadence [s] later, arcsec²."""
    check_cadence(exposure, cadence)

    def weights(f: np.ndarray) -> np.ndarray:
        return difference_weight(f, exposure, cadence)[None]

    _, integrals = panel_integrals(spectrum, weights, max(exposure, cadence))
    tones = (weights(np.array([line.frequency])).item() * line.moments() for line in spectrum.lines)
    return integrals.sum(axis=(0, 1)) + sum(tones, np.zeros(3))


def check_exposure(exposure: float) -> float:
    """Refuse what is no length of time."""
    return positive("exposure", exposure, "s")


def check_cadence(exposure: float, cadence: float) -> float:
    """Refuse exposures that overlap."""
    if not check_exposure(exposure) <= cadence < np.inf:
        problem = f"Exposures of {exposure:g} s cannot follow every {cadence:g} s; give a longer cadence."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    return cadence


def _parts(exposure: float):
    check_exposure(exposure)
    return lambda f: part_weights(f * exposure)
