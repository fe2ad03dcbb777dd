"""Tables of a measured power spectrum: bins that hold power, and lines that stand out of them.

Reach for :func:`recognise_rows`, which tells a table of bins from the points of a drawn curve, and for
:func:`spectrum_of_bins`.
"""

from __future__ import annotations

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import axis_variances
from jitterkit.motion.spectrum import Line, PowerSpectrum, panel_integrals

KINDS = ("bins", "curve")
"""What the rows of a table of densities may be."""

_UNIFORM = 0.3
"""Of a step, by which the rows of a uniform table may lie off, rounded as they were printed."""

_BANDS = 10.5
"""Rows a decade from which uniform ratios are taken for bins, less 1: third octaves have ten."""

_SOME, _MANY = 8, 16
"""Uniform rows that make a table of bins; rows of any other spacing up to which they are a drawn curve."""

_ALIKE = 0.01
"""Share by which the power of both readings may differ for the choice not to matter."""

_NEAR, _FAR = 4, 20
"""Rows beside a line from which the background is taken: the main lobe of any usual window ends before."""

_STANDS_OUT = 30.0
"""Ratio to the background from which a row is a line.  The rows of a single periodogram, which scatter most,
reach it once in 1e9."""

_LOBE, _FALLEN, _NARROW = 8, 3.0, 4
"""Rows on either side that a line's lobe may have, ratio to the background at which it ends, and rows above
half its height: what is wider than a window's lobe is a resonance, and no line."""

_MISSING = 2.5
"""Of the longer step beside it, from which a step is a gap in the table."""

_PIECE = 4
"""Uniform rows at least between two gaps of a table that is uniform but for them: a drawn curve has single
rows beyond one."""

_GAP = 1e-12
"""Share of a frequency over which one bin changes to the next."""


def recognise_rows(frequencies: np.ndarray, density: np.ndarray) -> str:
    """Tell whether the rows of a table are bins of a measured spectrum or points of a drawn curve.

    Parameters
    ----------
    frequencies : (n,) array
        Hz, ascending and positive.
    density : (n, 3) array
        As in :class:`~jitterkit.motion.spectrum.PowerSpectrum`.

    Returns
    -------
    kind : str
        ``bins`` for 8 rows or more at equal steps, or at equal ratios of ten a decade or closer, and for 16
        or more at equal steps but for gaps; ``curve`` for fewer than 16 rows at other steps, or where the
        power is the same either way.

    Raises
    ------
    ConfigurationError
        If it cannot be determined and the power differs by more than 1 %.
    """
    n = len(frequencies)
    linear = _is_uniform(frequencies)
    if n >= _SOME and (linear or _is_banded(frequencies)):
        return "bins"
    if _rows_apart(frequencies) is not None:
        return "bins"
    if n < 4 or (n < _MANY and not linear):
        return "curve"
    powers = [
        float(panel_integrals(spectrum)[1].sum(axis=(0, 1))[[0, 2]].sum())
        for spectrum in (_steps(frequencies, density), PowerSpectrum(frequencies, density))
    ]
    if abs(powers[0] - powers[1]) <= _ALIKE * max(powers):
        return "curve"
    rows = f"{n} rows from {frequencies[0]:g} to {frequencies[-1]:g} Hz"
    bins = f"bins of a measured spectrum ({powers[0]:.3g} arcsec² in all)"
    problem = f"{rows} may be {bins} or points of a drawn curve ({powers[1]:.3g} arcsec²)"
    raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem}; give --kind bins or --kind curve.")


def spectrum_of_bins(frequencies: np.ndarray, density: np.ndarray) -> PowerSpectrum:
    """Make a spectrum of the bins of a measured one, such as Welch's.

    Parameters
    ----------
    frequencies : (n,) array
        Middles of the bins, Hz, ascending and positive.
    density : (n, 3) array
        As in :class:`~jitterkit.motion.spectrum.PowerSpectrum`.

    Returns
    -------
    spectrum : PowerSpectrum
        The density is constant within a bin, so that the power is the sum of densities times widths; where
        rows are missing there is none.  Rows
        that stand out by a factor of 30 and no wider than a window's lobe are lines, of the power they have
        above their surroundings; the rest stays in the bins.
    """
    left, lines = _without_lines(frequencies, np.diff(_edges(frequencies))[:, 0], density)
    return _steps(frequencies, left, lines)


def _steps(frequencies: np.ndarray, density: np.ndarray, lines: tuple[Line, ...] = ()) -> PowerSpectrum:
    """Return densities that are constant within a bin, and zero in gaps."""
    edges = _edges(frequencies)
    ends = np.stack([edges[:, 0], edges[:, 1] * (1 - _GAP)], axis=1).ravel()
    rows = np.repeat(density, 2, axis=0)
    gaps = 2 * np.flatnonzero(edges[1:, 0] > edges[:-1, 1] * (1 + _GAP)) + 2
    around = np.stack([ends[gaps - 1] * (1 + _GAP), ends[gaps] * (1 - _GAP)], axis=1).ravel()
    return PowerSpectrum(
        np.insert(ends, np.repeat(gaps, 2), around), np.insert(rows, np.repeat(gaps, 2), 0, axis=0), lines
    )


def gaps_between(frequencies: np.ndarray) -> np.ndarray:
    """Return the rows (g,) after which rows are missing: the next is further than the steps on both sides.

    Only where most steps are like their neighbours: other tables have no gaps.
    """
    steps, apart = np.diff(frequencies), _rows_apart(frequencies)
    if apart is not None:
        return np.flatnonzero(apart > 1)
    if len(steps) < _SOME or np.median(np.abs(np.diff(np.log(steps)))) > np.log(1 + _UNIFORM):
        return np.zeros(0, int)
    beside = np.pad(steps, 1, mode="reflect")
    return np.flatnonzero(steps > _MISSING * np.maximum(beside[:-2], beside[2:]))


def _edges(frequencies: np.ndarray) -> np.ndarray:
    """Lower and upper edges (n, 2) of bins.

    Half-way between the rows, on the scale on which these are uniform; beside a gap as on the other side.
    """
    apart = np.ones(len(frequencies) - 1) if _is_uniform(frequencies) else _rows_apart(frequencies)
    if apart is not None:
        places = np.concatenate([[0.0], np.cumsum(apart)])
        step = (frequencies[-1] - frequencies[0]) / places[-1]
        edges = frequencies[0] + step * (places[:, None] + [-0.5, 0.5])
        return np.maximum(edges, 0.0)
    ratios = _is_banded(frequencies)
    f = np.log(frequencies) if ratios else frequencies
    half, gaps = np.diff(f) / 2, np.zeros(0, int) if ratios else gaps_between(f)
    below, above = np.append(half[:1], half), np.append(half, half[-1:])
    below[gaps + 1], above[gaps] = above[gaps + 1], below[gaps]
    edges = np.stack([f - below, f + above], axis=1)
    return np.exp(edges) if ratios else np.maximum(edges, 0.0)


def _is_uniform(values: np.ndarray) -> bool:
    line = np.linspace(values[0], values[-1], len(values))
    return bool(np.all(np.abs(values - line) <= _UNIFORM * (line[1] - line[0])))


def _rows_apart(frequencies: np.ndarray) -> np.ndarray | None:
    """Return how many rows (n - 1,) of a uniform table lie between its own where others are missing, from 1.

    None where the table is not uniform but for gaps, or lacks more rows than it has.
    """
    steps = np.diff(frequencies)
    if len(frequencies) < _MANY:
        return None
    near = np.abs(steps / np.median(steps) - 1) < 0.5  # rounded in print, so that their mean is better
    apart = np.rint(steps / steps[near].mean())
    step = (frequencies[-1] - frequencies[0]) / max(apart.sum(), 1.0)
    off = frequencies - frequencies[0] - step * np.concatenate([[0.0], np.cumsum(apart)])
    pieces = np.diff(np.flatnonzero(np.pad(apart, 1, constant_values=2.0) > 1))
    alike = np.all(np.abs(off) <= _UNIFORM * step) and apart.min() == 1 and pieces.min() >= _PIECE
    return apart if alike and apart.sum() < 2 * len(frequencies) else None  # most rows are there


def _is_banded(frequencies: np.ndarray) -> bool:
    """Return whether rows are at equal ratios, close enough for bins."""
    decades = np.log10(frequencies[-1] / frequencies[0])
    return _is_uniform(np.log(frequencies)) and len(frequencies) - 1 >= (_BANDS - 1) * decades


def _without_lines(
    frequencies: np.ndarray, widths: np.ndarray, density: np.ndarray
) -> tuple[np.ndarray, tuple[Line, ...]]:
    """Return the densities without the lines in them, and these."""
    power = density[:, 0] + density[:, 2]
    around, lines, left = _background(power), [], density.copy()
    free = np.ones(len(power), bool)
    for peak in np.flatnonzero(power > _STANDS_OUT * around)[::-1]:
        rows = _lobe(power, int(peak), around[peak], free)
        wide = np.sum(power[rows] > power[peak] / 2) > _NARROW
        if not free[peak] or power[peak] < power[rows].max() or wide:
            continue
        free[rows] = False
        share = np.clip(1 - around[peak] / power[rows], 0, 1)[:, None]
        part = share * density[rows] * widths[rows, None]
        left[rows] *= 1 - share
        major, minor, angle = axis_variances(part.sum(axis=0))
        middle = np.average(frequencies[rows], weights=part[:, 0] + part[:, 2])
        lines.append(Line(float(middle), (2 * major) ** 0.5, angle, (2 * max(minor, 0.0)) ** 0.5))
    return left, tuple(lines[::-1])


def _background(power: np.ndarray) -> np.ndarray:
    """Median (n,) of the rows on the louder side, so that a slope is no line; infinite if a side has none."""
    padded = np.concatenate([np.full(_FAR, np.nan), power, np.full(_FAR, np.nan)])
    windows = np.lib.stride_tricks.sliding_window_view(padded, _FAR - _NEAR + 1)
    sides = [windows[: len(power)], windows[_FAR + _NEAR :][: len(power)]]
    both = [np.full(len(power), np.inf) for _ in sides]
    for median, side in zip(both, sides, strict=True):
        known = np.isfinite(side).any(axis=1)
        median[known] = np.nanmedian(side[known], axis=1)
    return np.maximum(*both)


def _lobe(power: np.ndarray, peak: int, around: float, free: np.ndarray) -> np.ndarray:
    """Return the rows of a line about its peak."""
    high = (power > _FALLEN * around) & free
    first = last = peak
    while first > max(peak - _LOBE, 0) and high[first - 1]:
        first -= 1
    while last < min(peak + _LOBE, len(power) - 1) and high[last + 1]:
        last += 1
    return np.arange(first, last + 1)
