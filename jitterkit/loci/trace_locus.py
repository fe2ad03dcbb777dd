"""A measured path: what a gyroscope, a star tracker or a finite-element model says the pointing did.

It has no coordinates to fit.  Multiply it by a normal for what its sensor missed:
``Product(Trace.of(t, x, y), Mvn.of(0.02))``.
"""

from __future__ import annotations

import math
from typing import ClassVar, Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import Locus, principal_axes
from jitterkit.loci.special import exact_to, gauss_legendre, mean_phasor

_NODES, _IN_ALL = 3, 64
"""Nodes between two samples at least, and in a whole trace."""


class Trace(Locus):
    """The pointing at given times, straight between them.

    Attributes
    ----------
    coords : (0,) array
    times : (n,) array
        Ascending from 0 to 1, in exposures.
    positions : (n, 2) array
        Offsets x and y from the mean over the exposure, arcsec.

    Notes
    -----
    Each straight piece is integrated with three nodes in time (more in a trace of few samples).  A piece
    that turns the phase by ``d = 2 pi |f| step`` is off by ``5e-7 d**6`` of its share: 5e-7 where a sample
    moves by a sixth of the finest period, 1e-11 where by a fortieth.  *Fails when* the sampling is slower
    than the motion: what happens between two samples is not in the trace.
    """

    coords: Float[Array, " k"]
    times: Float[Array, " n"]
    positions: Float[Array, "n 2"]
    names: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def of(cls, t, x, y, start: float | None = None, exposure: float | None = None) -> Self:
        """Build from a record of the pointing.

        Parameters
        ----------
        t : (n,) array
            Times in seconds, ascending, at any intervals.
        x, y : (n,) array
            Pointing in arcsec; a common offset does not matter.
        start : float, optional
            When the exposure begins; by default with the record.
        exposure : float, optional
            Its length in seconds; by default to the end of the record.

        Raises
        ------
        ConfigurationError
            If the times do not ascend, a number is not finite, fewer than two samples lie in the exposure, or
            the record does not cover it or has a gap (:func:`trace_gaps`) over more than a tenth of it.
        """
        t, x, y = (np.asarray(v, float) for v in (t, x, y))
        check_trace(t, x, y)
        begin = t[0] if start is None else start
        end = t[-1] if exposure is None else begin + exposure
        inside = (t > begin) & (t < end)
        if np.count_nonzero((t >= begin) & (t <= end)) < 2:
            raise ConfigurationError(
                ErrorCode.TOO_FEW,
                f"Fewer than two samples of the trace lie in the exposure from {begin:g} to {end:g} s; "
                f"the trace runs from {t[0]:g} to {t[-1]:g} s. Give an exposure within it, or a finer trace.",
            )
        slack = 1e-9 * (end - begin)  # an exposure may end with the record, to rounding
        if begin < t[0] - slack or end > t[-1] + slack:
            raise ConfigurationError(
                ErrorCode.OUT_OF_RANGE,
                f"The trace runs from {t[0]:g} to {t[-1]:g} s and does not cover the exposure from {begin:g} "
                f"to {end:g} s; shorten the exposure or give a longer trace.",
            )
        begin, end = max(begin, t[0]), min(end, t[-1])
        for gap in trace_gaps(t):
            if min(end, t[gap + 1]) - max(begin, t[gap]) > _BRIDGED * (end - begin):
                raise ConfigurationError(
                    ErrorCode.OUT_OF_RANGE,
                    f"The trace has no samples from {t[gap]:g} to {t[gap + 1]:g} s, in the exposure from "
                    f"{begin:g} to {end:g} s; give a trace without this gap, or another exposure.",
                )
        times = np.concatenate([[begin], t[inside], [end]])
        positions = np.stack([np.interp(times, t, x), np.interp(times, t, y)], axis=1)
        times = (times - begin) / (end - begin)
        positions -= np.diff(times) @ (positions[1:] + positions[:-1]) / 2
        return cls(jnp.zeros(0), jnp.asarray(times), jnp.asarray(positions))

    @classmethod
    def near(cls, moments) -> Self:
        problem = "A trace does not follow from second moments; build it from its samples."
        raise ConfigurationError(ErrorCode.UNSUPPORTED, problem)

    def transfer(self, fx, fy):
        positions, weights = self._nodes()
        return mean_phasor(positions[:, 0], positions[:, 1], weights, fx, fy)

    def moments(self):
        positions, weights = self._nodes()
        x, y = positions.T
        return jnp.stack([x * x, x * y, y * y]) @ weights

    def exact_to(self) -> float:
        lengths = np.hypot(*np.diff(np.asarray(self.positions), axis=0).T)
        longest, power = lengths.max(), 2 * self._order  # by which an error grows with its piece's length
        if not longest > 0:
            return math.inf
        mean = np.diff(np.asarray(self.times)) @ (lengths / longest) ** power
        return exact_to(float(longest * mean ** (1 / power)), self._order)

    def describe(self) -> dict[str, float]:
        """Return ``sigma_major``, ``sigma_minor`` [arcsec] and ``angle`` [deg] of its moments."""
        major, minor, angle = principal_axes(self.moments())
        return {"sigma_major": major, "sigma_minor": minor, "angle": angle}

    def points(self, n: int) -> np.ndarray:
        at, times, positions = (np.arange(n) + 0.5) / n, np.asarray(self.times), np.asarray(self.positions)
        return np.stack([np.interp(at, times, positions[:, axis]) for axis in (0, 1)], axis=1)

    @property
    def _order(self) -> int:
        """Return the nodes in every piece."""
        return max(_NODES, -(-_IN_ALL // (len(self.times) - 1)))

    def _nodes(self):
        """Return the offsets (m, 2) at the nodes of every piece, and their weights (m,)."""
        s, w = gauss_legendre(self._order)
        middle, step = (self.positions[1:] + self.positions[:-1]) / 2, jnp.diff(self.positions, axis=0)
        positions = middle[:, None] + s[:, None] * step[:, None]
        return positions.reshape(-1, 2), (jnp.diff(self.times)[:, None] * w).ravel()


def trace_gaps(t) -> np.ndarray:
    """Find the gaps in a record.

    Parameters
    ----------
    t : (n,) array
        Times in seconds, ascending.

    Returns
    -------
    gaps : (g,) int array
        Samples after which there is a gap: the next is more than 3.5 usual steps away, four steps in five
        being no longer than the usual one.  None in a path of ten pieces or fewer.
    """
    steps = np.diff(np.asarray(t, float))
    if len(steps) <= _PATH:
        return np.zeros(0, int)
    return np.flatnonzero(steps > _GAP * np.quantile(steps, _USUAL, method="lower"))


_BRIDGED = 0.1
"""Share of an exposure over which a gap is bridged: it changes second moments by as much at most."""

COLUMNS = ("t", "x", "y")
"""Columns of a trace."""

_GAP, _USUAL, _PATH = 3.5, 0.8, 10
"""Usual steps to a gap, so that two lost samples in a row are bridged; quantile of the steps that is the
usual one; and steps of a path that somebody drew, in which there are no gaps."""


def check_trace(t: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
    """Refuse a trace that is too short, not finite, or whose times do not ascend."""
    alike = t.ndim == 1 and t.shape == x.shape == y.shape
    if not alike or len(t) < 2:
        problem = f"A trace needs two samples or more of t, x and y; got {t.shape}, {x.shape} and {y.shape}."
        raise ConfigurationError(ErrorCode.TOO_FEW if alike else ErrorCode.WRONG_SHAPE, problem)
    for name, values in zip(COLUMNS, (t, x, y), strict=True):
        if not np.all(np.isfinite(values)):
            raise ConfigurationError(
                ErrorCode.OUT_OF_RANGE,
                f"The trace's {name} is {values[~np.isfinite(values)][0]} at sample "
                f"{np.flatnonzero(~np.isfinite(values))[0]}; give finite numbers.",
            )
    falls = np.flatnonzero(np.diff(t) <= 0)
    if falls.size:
        k = int(falls[0])
        raise ConfigurationError(
            ErrorCode.MALFORMED,
            f"The trace's times must ascend, but sample {k + 1} is at {t[k + 1]:g} s after {t[k]:g} s; "
            "sort it, and keep one sample a time.",
        )
