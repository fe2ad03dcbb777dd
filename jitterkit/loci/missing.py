"""Samples of a record that stand for a missing value: -999, 1e30, a reading at its limit, the last value.

Reach for :func:`without_missing`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

MISSING_WORDS = ("", "nan", "na", "n/a", "null", "none", "-", "--")
"""Cells of a table without a value, in lower case."""

_NO_ANGLE = 1e15
"""No angle or rate is as large, in any unit; programs write 1e30 or the largest number of all."""

_NINES = re.compile(r"-?99+(\.9*0*)?")
_LIMITS = {-(2.0**bits) for bits in (7, 15, 31)} | {2.0**bits - 1 for bits in (7, 8, 15, 16, 31, 32)}
"""Ends of what integers hold."""

_FAR = 5.0
"""Distance to the nearest other value [standard deviations of the others]; neighbours in the tails of normal
noise are closer, even of 10⁶ samples."""

_SHARE_OF_CODES, _SHARE_OF_OTHERS = 0.5, 0.1
"""Largest share of the samples, for a usual code and for others: another value that is more frequent may be
one of two positions between which the pointing jumps."""

_FEWEST = 11
"""Samples from which a value that is no usual code may stand for none; fewer are a path somebody drew."""

_OUTLYING, _SHARE_OF_OUTLIERS = 20.0, 0.01
"""Standard deviations from the median beyond which samples are said to be outliers, and their largest share,
where one is always allowed: no vibration or drift has so few so far out."""

_BY_CHANCE = 1e-6
"""Chance of a run of equal samples below which it does not belong to the motion around it."""

_MOST_LOOKED_AT = 50
"""Of the values that may stand for a missing one, so many are looked at, those farthest from others first."""


def without_missing(table: np.ndarray, columns: Sequence[str]) -> tuple[np.ndarray, list[str]]:
    """Leave out the samples of a record that have no value.

    Parameters
    ----------
    table : (n, m) array
        Times in the first column; NaN where a cell has no value.
    columns : sequence of str
        Their names.

    Returns
    -------
    table : (k, m) array
        The rows that have a value in every column.
    said : list of str
        What was left out, and what was not although it may stand for a missing value; a sentence each.

    Notes
    -----
    A value stands for a missing one if it occurs at least twice, equal in all digits, and no other sample is
    within five standard deviations of it: motion passes the places between, and noise does not repeat itself.
    The deviation is half the range of the middle 68 % of the others.  A value that is no usual code (nines,
    the limit of an integer) must take at most a tenth of more than ten samples.  Outliers are motion; a
    sentence says so.  No angle is beyond 1e15.  A sensor that loses its target may repeat
    its last value: a run of equal samples that those outside of it make improbable counts as motion, and a
    sentence says so.
    """
    keep = np.isfinite(table).all(axis=1)
    sentences = [f"{(~keep).sum()} samples of the trace have no value and count as gaps."] * bool(
        (~keep).any()
    )
    for name, values in zip(columns[1:], table.T[1:], strict=True):
        while (found := _code(values[keep])) is not None:
            code, count = found
            if count == 1 and abs(code) < _NO_ANGLE:
                sentence = f"{name} is {code:g} in one sample, far from all others"
                sentences.append(
                    f"{sentence}, which counts as motion: if it stands for no value, leave it out."
                )
                break
            keep &= values != code
            sentences.append(
                f"{name} is {code:g} in {count} samples, far from all others: they count as gaps."
            )
        else:
            if (outliers := _outliers(values[keep])).size:
                share = f"{len(outliers)} of {len(values[keep])} samples, the farthest {outliers[-1]:g}"
                sentences.append(f"{name} has outliers, {share}: they count as motion; leave out errors.")
        if (run := _held(values[keep])) is not None:
            first, last = table[keep, 0][[run.start, run.stop - 1]]
            sentence = f"{name} does not change from t = {first:g} to {last:g}, which counts as motion"
            sentences.append(f"{sentence}: if the sensor held its last value, leave these samples out.")
    return table[keep], sentences


def _outliers(values: np.ndarray) -> np.ndarray:
    """Return the values far from all others that are not known to stand for none, the farthest last."""
    if len(values) < _FEWEST:
        return np.zeros(0)
    low, middle, high = np.quantile(values, [0.16, 0.5, 0.84])
    distance = np.abs(values - middle)
    far = np.flatnonzero(distance > _OUTLYING * (high - low) / 2)
    if high == low or far.size > max(1, _SHARE_OF_OUTLIERS * len(values)):
        return np.zeros(0)
    return values[far[np.argsort(distance[far])]]


def _held(values: np.ndarray) -> slice | None:
    """Return the longest run of equal samples, if those outside of it do not repeat themselves so often."""
    edges = np.flatnonzero(np.diff(values, prepend=np.nan, append=np.nan) != 0)
    lengths = np.diff(edges)
    if len(lengths) < _FEWEST:
        return None
    longest, others = int(lengths.argmax()), len(values) - lengths.max()
    repeats = (others - (len(lengths) - 1) + 1) / (others + 1)
    improbable = len(values) * repeats ** (lengths[longest] - 1) < _BY_CHANCE
    return slice(int(edges[longest]), int(edges[longest + 1])) if improbable else None


def _code(values: np.ndarray) -> tuple[float, int] | None:
    """Return a value that stands for a missing one, and how often it occurs; one that is repeated first."""
    positions, counts = np.unique(values, return_counts=True)
    steps = np.diff(positions, prepend=-np.inf, append=np.inf)
    apart = np.minimum(steps[1:], steps[:-1])
    for single in (False, True):
        group = np.flatnonzero((counts == 1) == single)
        for k in group[np.argsort(-apart[group])][:_MOST_LOOKED_AT]:
            if _is_missing(values, float(positions[k]), int(counts[k]), float(apart[k])):
                return float(positions[k]), int(counts[k])
    return None


def _is_missing(values: np.ndarray, value: float, count: int, apart: float) -> bool:
    """Return whether a value that is so far from any other may stand for a missing one."""
    if abs(value) >= _NO_ANGLE:
        return True
    others = values[values != value]
    if not others.size:
        return False
    low, high = np.quantile(others, [0.16, 0.84])
    far = apart >= _FAR * (high - low) / 2
    if value in _LIMITS or _NINES.fullmatch(f"{value:.9g}"):
        return bool(far) and count <= _SHARE_OF_CODES * len(values)
    moving = high > low and len(values) >= _FEWEST
    return bool(far) and moving and 1 < count <= _SHARE_OF_OTHERS * len(values)
