"""The shutter of a simulated frame: rolling, where the detector rolls and the pointing moves."""

from __future__ import annotations

import numpy as np

from jitterkit.detectors import Detector
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.shutter import Drifting


def line_time_of(detector: Detector, row_order: int) -> float | None:
    """Time [s] from a row's exposure to that of the row above it in memory; None where nobody says."""
    return None if detector.line_time is None else detector.line_time * row_order


def drifting_shutter(detector: Detector, velocity, row_order: int = 1) -> Drifting | None:
    """Return the shutter of a detector under a uniform drift.

    Parameters
    ----------
    detector : Detector
    velocity : (2,) array or None
        Of the image along x and y, arcsec/s.
    row_order : {1, -1}
        Whether the rows of the file will be those in memory, or turned over, as a TIFF's are.

    Returns
    -------
    shutter : Drifting or None
        None, which is a global shutter, where the detector has one or nothing drifts.

    Raises
    ------
    ConfigurationError
        If the velocity is not two finite numbers.
    """
    if velocity is None:
        return None
    if (shape := np.shape(velocity)) != (2,) or not np.all(np.isfinite(velocity)):
        code = ErrorCode.OUT_OF_RANGE if shape == (2,) else ErrorCode.WRONG_SHAPE
        raise ConfigurationError(code, f"velocity = {velocity} is not a drift; give (vx, vy) in arcsec/s.")
    line_time = line_time_of(detector, row_order)
    return Drifting(line_time, velocity) if line_time and np.any(velocity) else None
