"""The velocity of the image during each exposure: from the positions in frames, or from telemetry.

One blurred frame does not show the sign of its motion; the frames before and after do.  A rolling shutter
needs it: :class:`Shutters` has the timing of the rows of a sequence, and the motion during them.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames import Frame
from jitterkit.joint.records import Records
from jitterkit.joint.result import Rows
from jitterkit.loci import trace_gaps
from jitterkit.optics.grid import Grid
from jitterkit.shutter import Drifting, with_enough_nodes


def velocity_between_frames(times, positions) -> np.ndarray:
    """Return the velocity of the image from its positions in frames.

    Parameters
    ----------
    times : (n,) array
        Middles of the exposures, s, ascending; NaN for frames without a position.
    positions : (n, 2) array
        arcsec, on the detector as a whole.

    Returns
    -------
    velocity : (n, 2) array
        arcsec/s, by differences over both neighbours (one at the ends); NaN where a frame has no position,
        zero where it is alone.

    Notes
    -----
    *Fails when* the pointing turns round between frames: a vibration near or above half the frame rate, for
    which only telemetry serves.
    """
    times, positions = np.asarray(times, float), np.asarray(positions, float)
    known = np.isfinite(times) & np.all(np.isfinite(positions), axis=1)
    velocity = np.full(positions.shape, np.nan)
    t, p = times[known], positions[known]
    if len(t) < 2:
        velocity[known] = 0.0
        return velocity
    before, after = np.maximum(np.arange(len(t)) - 1, 0), np.minimum(np.arange(len(t)) + 1, len(t) - 1)
    velocity[known] = (p[after] - p[before]) / (t[after] - t[before])[:, None]
    return velocity


def motion_unknown(times, positions) -> float:
    """Estimate the error of velocities within frames that come from the motion between them.

    Parameters
    ----------
    times, positions
        As for :func:`velocity_between_frames`.

    Returns
    -------
    error : float
        Standard error of one component, arcsec/s, by how much the path bends from frame to frame: exact where
        the image jumps about at random, too large for a smooth curve.  NaN of fewer than three frames.
    """
    times, positions = np.asarray(times, float), np.asarray(positions, float)
    known = np.isfinite(times) & np.all(np.isfinite(positions), axis=1)
    t, p = times[known], positions[known]
    if len(t) < 3:
        return float("nan")
    step = np.diff(t)[:, None]
    bend = np.diff(np.diff(p, axis=0) / step, axis=0)  # of white positions of rms s: s sqrt(6) over the step
    return float(np.sqrt(np.mean(bend**2) / 12))


def smear_allowed(moments, errors, velocity) -> float:
    """Return the longest smear along a motion that a frame's blur allows.

    Parameters
    ----------
    moments, errors : (3,) arrays
        ``(Sxx, Sxy, Syy)`` of the frame's jitter and their errors, arcsec².
    velocity : (2,) array
        Gives the direction.

    Returns
    -------
    length : float
        arcsec: that of a streak whose variance is the blur's, and three of its errors.  Infinite where
        nothing is known.
    """
    speed = float(np.hypot(*velocity))
    if speed == 0 or not np.all(np.isfinite(moments)):
        return float("inf")
    ux, uy = np.asarray(velocity) / speed
    weights = np.array([ux * ux, 2 * ux * uy, uy * uy])
    variance = weights @ np.asarray(moments) + 3 * np.sqrt(np.nansum((weights * np.asarray(errors)) ** 2))
    return float(np.sqrt(12 * max(variance, 0.0)))


def velocity_from_trace(trace, times, exposures) -> np.ndarray:
    """Return the velocity of the image during exposures, from a measured pointing.

    Parameters
    ----------
    trace : ((m,), (m,), (m,)) arrays
        Times in s, ascending, and pointing along x and y, arcsec.
    times : (n,) array
        Middles of the exposures on the trace's clock, s.
    exposures : (n,) array or float
        Their lengths, s.

    Returns
    -------
    velocity : (n, 2) array
        arcsec/s: the change from the beginning of each exposure to its end over its length, which is what the
        rows of a rolling shutter see to first order; zero where the time is NaN.

    Raises
    ------
    ConfigurationError
        If the trace does not cover the exposures, or has a gap in one, or these have no length.
    """
    times = np.asarray(times, float)
    exposures = np.broadcast_to(np.asarray(exposures, float), times.shape)
    if not np.all(exposures[np.isfinite(times)] > 0):
        problem = "The frames do not say how long they were exposed; give --exposure, in s."
        raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
    t, x, y = (np.asarray(v, float) for v in trace)
    begin, end = times - exposures / 2, times + exposures / 2
    slack = 1e-6 * np.nanmax(exposures)
    if np.nanmin(begin) < t[0] - slack or np.nanmax(end) > t[-1] + slack:
        raise ConfigurationError(
            ErrorCode.OUT_OF_RANGE,
            f"The telemetry runs from {t[0]:g} to {t[-1]:g} s, but the frames are exposed from "
            f"{np.nanmin(begin):g} to {np.nanmax(end):g} s after the first one began; give a longer record, "
            "on that clock.",
        )
    for gap in trace_gaps(t):
        if np.any((begin < t[gap + 1] - slack) & (end > t[gap] + slack)):
            problem = f"The telemetry has a gap from {t[gap]:g} to {t[gap + 1]:g} s"
            found = "in which a frame is exposed; leave out the frame, or the telemetry"
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}, {found}.")
    ends = [np.interp(end, t, axis) - np.interp(begin, t, axis) for axis in (x, y)]
    return np.nan_to_num(np.stack(ends, axis=1) / exposures[:, None])


def unexplained_by_trace(trace, times, positions, exposures) -> float:
    """Return the velocity between frames that a measured pointing does not have.

    Parameters
    ----------
    trace, times, exposures
        As for :func:`velocity_from_trace`.
    positions : (n, 2) array
        Of the image in the frames, arcsec.

    Returns
    -------
    velocity : float
        rms of one component, arcsec/s; zero of one frame.
    """
    t, *axes = (np.asarray(v, float) for v in trace)
    integral = make_interp_spline(t, np.column_stack(axes), k=1).antiderivative()
    times, half = np.asarray(times, float), np.broadcast_to(exposures, np.shape(times)) / 2
    pointing = (integral(times + half) - integral(times - half)) / (2 * half[:, None])
    return float(np.sqrt(np.nanmean(velocity_between_frames(times, positions - pointing) ** 2)))


STILL = np.zeros(2)
"""arcsec/s: of a frame whose motion is not known yet."""


class Shutters:
    """The rolling shutter of each frame, where the frames say that they have one.

    Parameters
    ----------
    grid : Grid
        Of the frames.
    rolling : bool
        Whether to model it.
    telemetry : ((m,), (m,), (m,)) arrays or None
        Pointing measured otherwise: s and arcsec.
    """

    def __init__(self, grid: Grid, rolling: bool, telemetry) -> None:
        self.grid, self.rolling, self.telemetry = grid, rolling, telemetry
        self.exposure, self.line_time = 0.0, 0.0
        self._nodes, self._excluded_speed = 2, 0.0

    def of(self, frame: Frame, velocity: np.ndarray = STILL) -> Drifting | None:
        """Return the shutter of a frame; None where all rows were exposed at once, or are modelled so."""
        line_time = frame.metadata.value("line_time", 0.0)
        self.exposure, self.line_time = frame.exposure or 0.0, line_time or self.line_time
        return Drifting(line_time, velocity, self._nodes) if line_time and self.rolling else None

    def velocities(self, records: Records) -> np.ndarray:
        """Return the velocity of the image in every frame (n, 2), arcsec/s; zero where unknown.

        A frame whose own blur is too small for the motion between frames was at rest, and moved between the
        exposures.
        """
        times, exposures = np.array([(record.time, record.exposure) for record in records]).T
        if self.telemetry is not None:
            fitted = np.array([record.has_summary for record in records])
            velocities = velocity_from_trace(self.telemetry, np.where(fitted, times, np.nan), exposures)
            self._check_telemetry(records, velocities)
        else:
            positions = np.array([record.position for record in records])
            found = np.nan_to_num(velocity_between_frames(times, positions))
            too_fast = self._too_fast(records, found)
            self._excluded_speed = float(np.sqrt(np.mean(np.where(too_fast[:, None], found, 0.0) ** 2)))
            velocities = np.where(too_fast[:, None], 0.0, found)
        if self.line_time and self.rolling:
            fastest = velocities[np.argmax(np.hypot(*velocities.T))]
            drift = Drifting(self.line_time, fastest, self._nodes)
            self._nodes = with_enough_nodes(drift, self.grid.shape[0], self.grid.nyquist).nodes
        return velocities

    def _too_fast(self, records: Records, velocities: np.ndarray) -> np.ndarray:
        """Return which frames (n,) have a blur too small for a velocity."""
        pairs = zip(records, velocities, strict=True)
        allowed = np.array([smear_allowed(r.moments, r.moment_errors, v) for r, v in pairs])
        return np.hypot(*velocities.T) * [record.exposure for record in records] > allowed

    def _check_telemetry(self, records: Records, velocities: np.ndarray) -> None:
        """Raise if most of the frames contradict the telemetry."""
        too_fast = self._too_fast(records, velocities)
        if np.mean(too_fast) > 0.5:
            speed = float(np.median(np.hypot(*velocities[too_fast].T)))
            raise ConfigurationError(
                ErrorCode.IMPLAUSIBLE,
                f"The telemetry moves the image by {speed:.3g} arcsec/s, but the blur of "
                f"{too_fast.sum()} of {len(too_fast)} frames is too small; check its clock, unit and axes.",
            )

    def rows(self, records: Records, separation: float) -> Rows | None:
        """Return the effect of the rolling shutter on a separation [arcsec], and how well it is corrected."""
        if not self.line_time:
            return None
        unknown, by_telemetry = 0.0, self.telemetry is not None
        known = [(one.time, one.position, one.exposure) for one in records if one.has_summary]
        times, positions, exposures = zip(*known, strict=True)
        if self.rolling and by_telemetry:
            unknown = unexplained_by_trace(self.telemetry, times, positions, exposures)
        elif self.rolling:
            unknown = max(motion_unknown(times, positions), self._excluded_speed)
        leverage = abs(self.line_time * separation) / self.grid.plate_scale
        return Rows(self.line_time, self.rolling, leverage, unknown, by_telemetry)
