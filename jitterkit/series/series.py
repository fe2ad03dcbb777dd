"""A series of measurements of one number: values, their errors, and when.

Reach for :meth:`Series.of`, which every function of this package takes; it checks the three once, and leaves
missing measurements in their positions, so that what is said of a series can be read beside the frames.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, positive

_SLOTS, _FINE = 1 << 24, 1 << 20
"""The longest grid, of arrays of 128 MiB, and the longest chosen here, which takes a second or two."""


@dataclass(frozen=True, eq=False)
class Series:
    """Measurements in the order given.

    Attributes
    ----------
    values, errors, times : (n,) array
        Errors are one sigma in the values' unit, ones where none are stated.  NaN: missing.
    cadence : float
        From one measurement to the next, in the unit of the times.
    stated : bool
        Whether errors were given.
    """

    values: np.ndarray
    errors: np.ndarray
    times: np.ndarray
    cadence: float
    stated: bool

    @classmethod
    def of(cls, values, errors=None, times=None, *, cadence: float | None = None) -> Series:
        """Check a series.

        Parameters
        ----------
        values : (n,) array
            A value that is not finite is missing; so is one whose error is not finite and positive.
        errors : (n,) array or float, optional
        times : (n,) array, optional
            In any order; else the measurements are ``cadence`` apart.
        cadence : float, optional
            The grid on which means are made.  Where it is not given it is 1, or that of the times, or so
            much that the series has a million steps (nights of frames).  Measurements nearer than that
            count as one, their weighted mean.

        Raises
        ------
        ConfigurationError
            If shapes differ, two measurements or fewer are left, they are all the same, a time is missing, or
            the times span less than two steps of the cadence or more than 16 million.
        """
        y = np.asarray(values, float)
        e = np.ones(y.shape) if errors is None else np.asarray(errors, float)
        step = 1.0 if cadence is None else float(cadence)
        t = step * np.arange(y.size) if times is None else np.asarray(times, float)
        e = np.full(y.shape, float(e)) if e.ndim == 0 else e
        if y.ndim != 1 or e.shape != y.shape or t.shape != y.shape:
            got = f"got {y.shape}, {e.shape} and {t.shape}"
            problem = f"A series has as many values as errors and times; {got}."
            raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
        good = np.isfinite(y) & np.isfinite(e) & (e > 0)
        if good.sum() < 3:
            problem = f"{good.sum()} measurements are no series; give three or more."
            raise ConfigurationError(ErrorCode.TOO_FEW, problem)
        if np.ptp(y[good]) == 0:
            problem = f"All values are {y[good][0]:g}; a series of one value has no scatter."
            raise ConfigurationError(ErrorCode.UNSUPPORTED, problem)
        for row in np.flatnonzero(good & ~np.isfinite(t)):
            problem = f"The time of measurement {row + 1} is {t[row]:g}; give a time to each, or to none."
            raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
        step = _cadence(np.sort(t[good])) if times is not None and cadence is None else step
        positive("cadence", step)
        span = float(np.ptp(t[good]))
        if not 2 * step <= span <= (_SLOTS - 1) * step:
            problem = f"At a cadence of {step:g} the times span {span / step:.3g} steps"
            remedy = "a shorter cadence" if span < 2 * step else f"a cadence of {span / _SLOTS:.2g} or more"
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; give {remedy}.")
        return cls(np.where(good, y, np.nan), np.where(good, e, np.nan), t, step, errors is not None)

    @property
    def good(self) -> np.ndarray:
        """Return which measurements are there, (n,) bool."""
        return np.isfinite(self.values)

    def without(self, flags: np.ndarray) -> Series:
        """Return the series with some measurements missing."""
        return replace(self, values=np.where(flags, np.nan, self.values))

    @property
    def slots(self) -> np.ndarray:
        """Return the position of each measurement that is there on a grid of the cadence."""
        times = self.present[2]
        return np.rint((times - times.min()) / self.cadence).astype(int)

    @property
    def present(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the values, errors and times of the measurements that are there."""
        good = self.good
        return self.values[good], self.errors[good], self.times[good]

    def gridded(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the weights and means on a grid of the cadence, from the first measurement to the last.

        Returns
        -------
        weights, means : (slots,) array
            Inverse variance, zero in an empty slot; the weighted mean there, as an offset from the series'
            median, zero in an empty slot.
        """
        y, e, _ = self.present
        weights, sums = (np.bincount(self.slots, x * e**-2) for x in (np.ones_like(y), y - np.median(y)))
        return weights, np.divide(sums, weights, out=np.zeros_like(sums), where=weights > 0)


def _cadence(times: np.ndarray) -> float:
    """The step of which the gaps between sorted times are multiples, as nearly as may be; never too fine."""
    steps = np.diff(times)
    steps = steps[steps > 0]
    if not len(steps):
        problem = f"All times are {times[0]:g}; give the time of each measurement."
        raise ConfigurationError(ErrorCode.TOO_FEW, problem)
    step = float(steps.sum() / np.rint(steps / np.median(steps)).sum())
    return max(step, float(times[-1] - times[0]) / _FINE)
