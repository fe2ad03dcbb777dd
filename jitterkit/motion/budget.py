"""Who contributes what: every source of motion with its regime, its locus and its split.

Reach for :func:`motion_budget`; the command line prints it as a table.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from jitterkit.motion.regime import HIGH, LOW, REGIMES, line_locus, regime, smooth_locus
from jitterkit.motion.spectrum import Line, PowerSpectrum
from jitterkit.motion.split import Split, check_exposure, split_line, split_spectrum


@dataclass(frozen=True, eq=False)
class Share:
    """One source of motion.

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
