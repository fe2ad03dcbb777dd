"""What an engineer knows of a telescope's motion: a power spectrum in two axes, and lines beside it.

Reach for :class:`PowerSpectrum`; :func:`~jitterkit.motion.files.read_motion` reads one, and
:func:`~jitterkit.motion.record.trace_spectrum` makes one of a measured record.  :func:`panel_integrals`
integrates one against weights that oscillate many times between its rows.  The range is cut into panels over
which neither weights nor densities change much: at every row, every octave and every cycle of the weights.
In each, Gauss and Legendre's rule.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import moments_on_axis

_SLACK = 1e-9
"""By which rounding may carry a cross spectrum over the most that it can be."""

_FARTHEST = 1e15
"""arcsec: no angle is as large, and its square can be computed with."""


@dataclass(frozen=True)
class Line:
    """A vibration at one frequency, of unknown phase.

    Parameters
    ----------
    frequency : float
        Hz.
    amplitude : float
        Zero to peak, arcsec; the variance is half its square.
    angle : float
        Of its axis, degrees counter-clockwise from +x.
    minor : float
        Amplitude across, a quarter of a cycle later, arcsec: then the pointing runs round an ellipse.

    Raises
    ------
    ConfigurationError
        If a value is impossible.
    """

    frequency: float
    amplitude: float
    angle: float = 0.0
    minor: float = 0.0

    def __post_init__(self) -> None:
        rules = {"frequency": self.frequency > 0}
        rules |= {name: 0 <= getattr(self, name) <= _FARTHEST for name in ("amplitude", "minor")}
        for name, value in (("angle", self.angle), *((name, getattr(self, name)) for name in rules)):
            if not (np.isfinite(value) and rules.get(name, True)):
                remedy = f"amplitudes of 0 to {_FARTHEST:g} arcsec, and an angle in degrees"
                problem = f"A line's {name} is {value:g}; give a positive frequency in Hz, {remedy}."
                raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)

    def moments(self) -> np.ndarray:
        """Return the second moments ``(Sxx, Sxy, Syy)`` over whole cycles, arcsec²."""
        return moments_on_axis([self.amplitude**2 / 2, 0.0, self.minor**2 / 2], -self.angle)


@dataclass(frozen=True, eq=False)
class PowerSpectrum:
    """The motion's power: one-sided densities at some frequencies, and lines.

    Parameters
    ----------
    frequencies : (n,) array
        Hz, ascending, two or more, or none where there are only lines.
    density : (n, 3) array
        One-sided power spectral density of x, real part of the cross spectrum of x and y, density of y;
        arcsec²/Hz.
    lines : tuple of Line
        Beside the densities, not in them.

    Raises
    ------
    ConfigurationError
        If frequencies do not ascend, a density is negative or not finite, or the cross spectrum is larger
        than the root of the product of the two.

    Notes
    -----
    Between two rows each density is a power law, a straight line on a log-log plot, as spectra are drawn
    and specified; straight on plain axes where either end is zero.  The correlation of the axes is straight
    in frequency.  Outside the rows there is nothing.
    """

    frequencies: np.ndarray = field(default_factory=lambda: np.zeros(0))
    density: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    lines: tuple[Line, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequencies", np.asarray(self.frequencies, float))
        object.__setattr__(self, "density", np.asarray(self.density, float))
        object.__setattr__(self, "lines", tuple(self.lines))
        _check(self.frequencies, self.density)

    @property
    def highest(self) -> float:
        """Return the highest frequency in it, Hz; zero if it is empty."""
        return max([*self.frequencies[-1:], *(line.frequency for line in self.lines)], default=0.0)

    def at(self, frequencies) -> np.ndarray:
        """Return the densities ``(m, 3)`` at given frequencies, arcsec²/Hz; zero outside the rows."""
        f = np.asarray(frequencies, float)
        if not len(self.frequencies):
            return np.zeros((*f.shape, 3))
        row = np.clip(np.searchsorted(self.frequencies, f, side="right") - 1, 0, len(self.frequencies) - 2)
        ends = self.frequencies[row], self.frequencies[row + 1]
        share = (f - ends[0]) / (ends[1] - ends[0])
        x, y = (_between(f, ends, share, self.density[row, k], self.density[row + 1, k]) for k in (0, 2))
        correlation = _correlation(self.density)
        cross = correlation[row] * (1 - share) + correlation[row + 1] * share
        inside = (f >= self.frequencies[0]) & (f <= self.frequencies[-1])
        return np.where(inside[..., None], np.stack([x, cross * np.sqrt(x * y), y], axis=-1), 0.0)

    def between(self, low: float, high: float) -> PowerSpectrum:
        """Return what lies from one frequency to another [Hz], a line at the upper end not included."""
        lines = tuple(line for line in self.lines if low <= line.frequency < high)
        ends = np.clip([low, high], *self.frequencies[[0, -1]]) if len(self.frequencies) else np.zeros(2)
        if ends[0] >= ends[1]:
            return PowerSpectrum(lines=lines)
        inner = self.frequencies[(self.frequencies > ends[0]) & (self.frequencies < ends[1])]
        return replace(self.resampled(np.concatenate([ends[:1], inner, ends[1:]])), lines=lines)

    def resampled(self, frequencies) -> PowerSpectrum:
        """Return a spectrum with other rows."""
        return replace(self, frequencies=frequencies, density=self.at(frequencies))


def _between(f, ends, share, first, second) -> np.ndarray:
    """Return a power law between two values, or a straight line where there is none."""
    law = (first > 0) & (second > 0) & (ends[0] > 0)
    safe = [np.where(law, value, 1.0) for value in (ends[0], first, second)]
    steps = np.log(np.where(law, f, 1.0) / safe[0]) / np.log(np.where(law, ends[1] / safe[0], 2.0))
    straight = np.maximum(first + (second - first) * share, 0)
    return np.where(law, safe[1] * (safe[2] / safe[1]) ** steps, straight)


def _correlation(density: np.ndarray) -> np.ndarray:
    most = np.sqrt(density[:, 0] * density[:, 2])
    return np.clip(density[:, 1] / np.where(most > 0, most, 1.0), -1, 1)


def _check(frequencies: np.ndarray, density: np.ndarray) -> None:
    n = len(frequencies)
    if n == 1 or frequencies.shape != (n,) or density.shape != (n, 3):
        problem = "A spectrum has densities (n, 3) at two frequencies or more, or none"
        got = f"got {density.shape} at {frequencies.shape}"
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, f"{problem}; {got}.")
    bad = ~np.isfinite(frequencies) | (frequencies < 0) | (np.diff(frequencies, prepend=-1) <= 0)
    for row in np.flatnonzero(bad):
        code = ErrorCode.MALFORMED if 0 <= frequencies[row] < np.inf else ErrorCode.OUT_OF_RANGE
        problem = f"The frequency of row {row + 1} is {frequencies[row]:g} Hz"
        raise ConfigurationError(code, f"{problem}; give them ascending, none negative.")
    axes = density[:, [0, 2]]
    bad = ~np.isfinite(density).all(axis=1) | ((axes < 0) | (axes > _FARTHEST**2)).any(axis=1)
    for row in np.flatnonzero(bad):
        values = f"the densities x, y are {density[row, 0]:g}, {density[row, 2]:g}"
        problem = f"At {frequencies[row]:g} Hz {values}; give arcsec²/Hz, 0 to {_FARTHEST**2:g}."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    most = np.sqrt(density[:, 0] * density[:, 2])
    for row in np.flatnonzero(np.abs(density[:, 1]) > most * (1 + _SLACK)):
        problem = f"At {frequencies[row]:g} Hz the cross spectrum is {density[row, 1]:g}"
        limit = f"more than the root of the product of x and y, {most[row]:g}"
        message = f"{problem}, {limit}; give its real part in arcsec²/Hz."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, message)


_NODES = 12
"""A panel: over an octave of f^-4, or a cycle of sinc², exact to 1e-12."""

_OCTAVES = 60
"""Below the last row; a first row at zero is straight, and what is left of it is 1e-18 of the range."""

_MOST = 1e5
"""Cycles with panels of their own; beyond, displacement and smear are below 1e-10 of a tone."""

_BLOCK = 1 << 16
"""Panels at a time, to bound the memory."""


def panel_integrals(
    spectrum: PowerSpectrum,
    weights: Callable[[np.ndarray], np.ndarray] | None = None,
    period: float = 0.0,
    edges=(),
) -> tuple[np.ndarray, np.ndarray]:
    """Integrate the densities of a spectrum, weighted, piece by piece.

    Parameters
    ----------
    spectrum : PowerSpectrum
        Its lines have no part in this.
    weights : callable, optional
        From frequencies (m,) to weights (k, m); by default one.
    period : float
        In time, of the fastest oscillation of the weights, s: the exposure, or the cadence.
    edges : (e,) array, optional
        Frequencies where a panel shall end, Hz.

    Returns
    -------
    ends : (p + 1,) array
        Of the panels, Hz.
    integrals : (p, k, 3) array
        Over each panel, of x, xy and y; arcsec².

    Notes
    -----
    For the interpolated spectrum this is exact to about 1e-11 up to 1e5 cycles an exposure; what is faster is
    jitter, to 1e-10 of itself.  What a coarse table leaves open is the interpolation.
    """
    ends = _panels(spectrum.frequencies, period, np.asarray(edges, float))
    nodes, weight = np.polynomial.legendre.leggauss(_NODES)
    blocks = []
    for start in range(0, len(ends) - 1, _BLOCK):
        low, high = ends[:-1][start : start + _BLOCK], ends[1:][start : start + _BLOCK]
        f = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * nodes
        share = np.ones((1, f.size)) if weights is None else weights(f.ravel())
        share = share.reshape(len(share), *f.shape) * (weight * (high - low)[:, None] / 2)
        blocks.append(np.einsum("kpn,pnc->pkc", share, spectrum.at(f)))
    return ends, np.concatenate(blocks) if blocks else np.zeros((0, 1, 3))


def _panels(rows: np.ndarray, period: float, edges: np.ndarray) -> np.ndarray:
    """Ends of panels: rows, octaves, cycles, and what else is asked for within the rows."""
    if not len(rows):
        return np.zeros(0)
    low, high = rows[[0, -1]]
    octaves = high * 2.0 ** -np.arange(_OCTAVES)
    last = min(high * period, _MOST)
    cycles = np.arange(np.ceil(low * period), last + 1) / period if period > 0 else np.zeros(0)
    ends = np.unique(np.concatenate([rows, octaves, cycles, edges]))
    return ends[(ends >= low) & (ends <= high)]
