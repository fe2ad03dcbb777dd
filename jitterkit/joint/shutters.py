"""The rolling shutters of a sequence: the timing of the rows, and the motion during them."""

from __future__ import annotations

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames import Frame
from jitterkit.joint.records import Records
from jitterkit.joint.result import Rows
from jitterkit.joint.velocity import (
    motion_unknown,
    smear_allowed,
    velocity_between_frames,
    velocity_from_trace,
)
from jitterkit.optics.grid import Grid
from jitterkit.shutter import Drifting, with_enough_nodes

__all__ = ["Shutters"]

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
        self.exposure, self.line_time = frame.exposure or 0.0, frame.metadata.value("line_time", 0.0)
        rolls = self.line_time and self.rolling
        return Drifting(self.line_time, velocity, self._nodes) if rolls else None

    def velocities(self, records: Records) -> np.ndarray:
        """Return the velocity of the image in every frame (n, 2), arcsec/s; zero where unknown.

        A frame whose own blur is too small for the motion between frames was at rest, and moved between the
        exposures.
        """
        times = np.array([record.time for record in records])
        if self.telemetry is not None:
            velocities = velocity_from_trace(self.telemetry, times, self.exposure)
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
        return np.hypot(*velocities.T) * self.exposure > allowed

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
        unknown = 0.0
        if self.rolling and self.telemetry is None:
            times, positions = zip(*((record.time, record.position) for record in records), strict=True)
            unknown = max(motion_unknown(times, positions), self._excluded_speed)
        leverage = abs(self.line_time * separation) / self.grid.plate_scale
        return Rows(self.line_time, self.rolling, leverage, unknown)
