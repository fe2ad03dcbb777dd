"""Who contributes what: every source of motion with its regime, its locus and its split.

Reach for :func:`motion_budget`; the command line prints it as a table.  The critical frequency has one cycle
in an exposure.  Well below it every motion is a straight smear; well above, a vibration draws the whole of
its path; about it, a frame catches a piece whose shape is an accident.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from jitterkit.motion.spectrum import Line, PowerSpectrum
from jitterkit.motion.split import Split, check_exposure, split_line, split_spectrum

LOW = 0.2
"""Cycles an exposure up to which smear is 97 % of the blur or more."""

HIGH = 3.0
"""Cycles from which smear is below 4 % of it; where the locus of partial cycles ends."""

REGIMES = ("low", "medium", "high")

_ALONE = 0.97
"""Share of the blur from which smear, or jitter, is all there is: smear's at the end of the low regime."""

_THIN = 1e-3
"""Ratio of the axes below which an ellipse is a streak."""


def critical_frequency(exposure: float) -> float:
    """Return the frequency of one cycle in an exposure [s], Hz."""
    return 1 / check_exposure(exposure)


def regime(cycles: float) -> str:
    """low, medium or high, by the cycles ``f T`` in one exposure.

    >>> [regime(cycles) for cycles in (0.01, 0.7, 6.1)]
    ['low', 'medium', 'high']
    """
    return REGIMES[(cycles > LOW) + (cycles >= HIGH)]


def line_locus(line: Line, exposure: float) -> str:
    """Name of the locus that a line draws in one exposure [s], for ``--locus``."""
    if not np.any(line.moments()):
        return "stable"
    round_ = min(line.amplitude, line.minor) > _THIN * max(line.amplitude, line.minor)
    names = ("linear", "path", "ellipse") if round_ else ("linear", "partial", "shm")
    return names[REGIMES.index(regime(line.frequency * check_exposure(exposure)))]


def smooth_locus(split: Split) -> str:
    """Name of the locus that random motion draws: by its smear's share of the blur."""
    blur, smear = (moments[0] + moments[2] for moments in (split.blur, split.smear))
    if blur <= 0:
        return "stable"
    if smear >= _ALONE * blur:
        return "linear"
    return "mvn" if smear <= (1 - _ALONE) * blur else "smear"


@dataclass(frozen=True, eq=False)
class Share:
    """Hold one source of motion.

    Attributes
    ----------
    low, high : float
        From and to which frequency, Hz; the same for a line.
    regime, locus : str
        Names; the locus is one for ``--locus``.
    split : Split
    line : Line, optional
        None of random motion.
    """

    low: float
    high: float
    regime: str
    locus: str
    split: Split
    line: Line | None = None


def motion_budget(spectrum: PowerSpectrum, exposure: float) -> tuple[Share, ...]:
    """Split every source of motion: the random part by regime, then each line.

    Parameters
    ----------
    spectrum : PowerSpectrum
    exposure : float
        s.

    Returns
    -------
    shares : tuple of Share
        By ascending frequency, random motion first; their splits sum to that of the whole.
    """
    lines = sorted(spectrum.lines, key=lambda line: line.frequency)
    return (*_random(spectrum, check_exposure(exposure)), *(_tone(line, exposure) for line in lines))


def _random(spectrum: PowerSpectrum, exposure: float) -> Iterator[Share]:
    bounds = np.array([0.0, LOW / exposure, HIGH / exposure, np.inf])
    for name, low, high in zip(REGIMES, bounds[:-1], bounds[1:], strict=True):
        part = PowerSpectrum(spectrum.frequencies, spectrum.density).between(low, high)
        if len(part.frequencies) and np.any(part.density):
            split = split_spectrum(part, exposure)
            first, last = part.frequencies[[0, -1]].tolist()
            yield Share(first, last, name, smooth_locus(split), split)


def _tone(line: Line, exposure: float) -> Share:
    f = line.frequency
    return Share(f, f, regime(f * exposure), line_locus(line, exposure), split_line(line, exposure), line)
