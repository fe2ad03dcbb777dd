"""A measured path: what a gyroscope, a star tracker or a finite-element model says the pointing did.

It has no coordinates to fit.  Multiply it by a normal for what its sensor missed:
``Product(Trace.of(t, x, y), Mvn.of(0.02))``.
"""

from __future__ import annotations

import math
import pathlib
import warnings
from collections.abc import Callable
from typing import ClassVar, Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.integrate import cumulative_simpson

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import Locus, principal_axes
from jitterkit.loci.csv_table import (
    assumed_units,
    csv_rows,
    heading,
    refuse_half_stated,
    refuse_unit_in_comment,
    row_numbers,
    unit_factor,
)
from jitterkit.loci.missing import MISSING_WORDS, without_missing
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
        _check(t, x, y)
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


def is_trace(cells: list[str]) -> bool:
    """Return whether a line is the header of a trace."""
    return heading(cells[0])[0] in ("t", "time")


def read_trace(
    path: str | pathlib.Path, rates: str | None = None, log: Callable[[str], None] | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Read a record of the pointing from a CSV table.

    Parameters
    ----------
    path : str or Path
        A line ``t,x,y`` and then numbers: seconds, ascending, and arcsec, unless a unit in brackets follows
        the name: ``t [ms],x [mas],y [mas]``.  Rates ``t,wx,wy``, in arcsec/s without a unit, are integrated,
        as are columns whose unit is one of a rate.  Empty lines and lines that begin with ``#`` are skipped.
    rates : str, optional
        Unit of rates whose header does not say that they are, or in what unit: ``deg/s``.
    log : callable, optional
        Called with sentences on rates that were integrated, and on samples without a value, of which Python
        warns without it.

    Returns
    -------
    t, x, y : (n,) arrays
        For :meth:`Trace.of`; s and arcsec.

    Raises
    ------
    ConfigurationError
        If the file is not such a table; the message names the file, the line and the column.

    Notes
    -----
    Rates are integrated by Simpson's rule.  How far the pointing went in a gap is not known: each piece
    between gaps has its own mean as zero.  Samples without a value (empty, NaN, or a number that
    stands for it: :func:`~jitterkit.loci.missing.without_missing`) are left out.
    """
    path = pathlib.Path(path)
    cells = csv_rows(path, "give a CSV of t,x,y")
    try:
        factors, integrate = _columns(cells[0][1] if cells else [], rates)
        if not rates:
            refuse_unit_in_comment(path, cells[0][1])
        table = np.array([row_numbers(row, _COLUMNS, MISSING_WORDS) for row in cells[1:]]).reshape(-1, 3)
        table, sentences = without_missing(table, _COLUMNS)
        if len(table) < 2:
            table = np.array([row_numbers(row, _COLUMNS) for row in cells[1:]]).reshape(-1, 3)
        t, x, y = (table * factors).T
        _check(t, x, y)
        if not integrate:
            _refuse_wrapped(t, x, y)
    except ConfigurationError as error:
        raise ConfigurationError(error.code, f"{path}: {error}") from None
    for sentence in sentences:
        (log or warnings.warn)(f"{path}: {sentence}")
    if log is not None and not rates:
        of_angle = "arcsec/s" if integrate else "arcsec"
        for sentence in assumed_units(cells[0][1], ("s", of_angle, of_angle)):
            log(sentence)
    if integrate:
        x, y = _integral(t, np.stack([x, y], axis=1)).T
        if log is not None:
            log("The trace holds rates, which were integrated.")
    return t, x, y


def _refuse_wrapped(t: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
    """Raise ConfigurationError for angles that go on at 0 behind 360 degrees."""
    for name, values in (("x", x), ("y", y)):
        jumps = np.flatnonzero(np.abs(np.diff(values)) > _HALF_TURN)
        if jumps.size:
            problem = f"{name} jumps by more than half a turn after {t[jumps[0]]:g} s"
            message = f"{problem}; unwrap the angles, or check the unit."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, message)


_HALF_TURN = 180 * 3600
"""Arcsec."""


def _columns(cells: list[str], rates: str | None) -> tuple[list[float], bool]:
    """Return the factors to s, arcsec and arcsec or arcsec/s; and whether the columns are rates."""
    names, units = zip(*map(heading, cells), strict=True) if cells else ((), ())
    named_rates = names[1:] == ("wx", "wy")
    if not cells or not is_trace(cells) or not (named_rates or names[1:] == ("x", "y")):
        raise ConfigurationError(
            ErrorCode.MALFORMED,
            f"begins with {','.join(cells) or 'nothing'!r}; its first line must be t,x,y (s, arcsec, arcsec) "
            "or, for rates, t,wx,wy (s, arcsec/s, arcsec/s).",
        )
    refuse_half_stated(cells[1:], units[1:])
    found = [
        unit_factor(name, unit or rates or ("arcsec/s" if named_rates else "arcsec"), "arcsec/s", "arcsec")
        for name, unit in zip(names[1:], units[1:], strict=True)
    ]
    kinds = {kind for _, kind in found}
    if rates and units[1] and unit_factor("rates", rates, "arcsec/s", "arcsec") != found[0]:
        problem = f"The rates are given in {rates}, and the header says {cells[1]}"
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}; leave one of them out.")
    if len(kinds) > 1 or (kinds == {"arcsec"} and (named_rates or rates)):
        problem = f"The columns {cells[1]} and {cells[2]} are not two angles or two rates"
        remedy = "give both units alike, and a rate's unit, such as deg/s, for rates"
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}; {remedy}.")
    time, _ = unit_factor("t", units[0] or "s", "s")
    return [time, *(factor for factor, _ in found)], kinds == {"arcsec/s"}


def _integral(t: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Integrals (n, 2) of rates, piece by piece between gaps, each about its mean."""
    angles = []
    for piece in np.split(np.arange(len(t)), trace_gaps(t) + 1):
        angle = cumulative_simpson(rates[piece], x=t[piece], axis=0, initial=0)
        duration = t[piece[-1]] - t[piece[0]]
        mean = np.trapezoid(angle, t[piece], axis=0) / duration if duration > 0 else angle[0]
        angles.append(angle - mean)
    return np.concatenate(angles)


_BRIDGED = 0.1
"""Share of an exposure over which a gap is bridged: it changes second moments by as much at most."""

_COLUMNS = ("t", "x", "y")

_GAP, _USUAL, _PATH = 3.5, 0.8, 10
"""Usual steps to a gap, so that two lost samples in a row are bridged; quantile of the steps that is the
usual one; and steps of a path that somebody drew, in which there are no gaps."""


def _check(t: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
    alike = t.ndim == 1 and t.shape == x.shape == y.shape
    if not alike or len(t) < 2:
        problem = f"A trace needs two samples or more of t, x and y; got {t.shape}, {x.shape} and {y.shape}."
        raise ConfigurationError(ErrorCode.TOO_FEW if alike else ErrorCode.WRONG_SHAPE, problem)
    for name, values in zip(_COLUMNS, (t, x, y), strict=True):
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
