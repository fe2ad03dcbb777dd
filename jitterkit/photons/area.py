"""Collecting areas, in cm²: of a pupil, and of an annulus by its diameters.

Reach for :func:`collecting_area`.
"""

from __future__ import annotations

import math

import numpy as np

from jitterkit.errors import ConfigurationError
from jitterkit.optics.pupil import Pupil

__all__ = ["annulus_area", "collecting_area"]

_CM2 = 1e4
"""In a square metre."""


def collecting_area(pupil: Pupil) -> float:
    """Area of a pupil, weighted by the share of the photons that it passes, cm².

    Notes
    -----
    *Assumes* that the transmission is of the amplitude, so that its square counts.  Samples cut by a hard
    edge hold the share of their area that is clear, whose square is too small: TOLIMAN's 256 samples lose
    0.5 % by it.
    """
    return float(np.sum(np.asarray(pupil.transmission) ** 2) * pupil.pitch**2 * _CM2)


def annulus_area(diameter: float, obscuration: float = 0.0) -> float:
    """Area of a circle of a diameter without one of another, cm².

    Parameters
    ----------
    diameter, obscuration : float
        m, ``0 <= obscuration < diameter``.

    Examples
    --------
    >>> round(annulus_area(0.125, 0.032), 2)  # TOLIMAN
    114.68

    Raises
    ------
    ConfigurationError
        If the diameters are out of order.
    """
    if not 0 <= obscuration < diameter:
        raise ConfigurationError(
            f"The obscuration must lie between 0 and the diameter of {diameter} m, got {obscuration} m."
        )
    return math.pi / 4 * (diameter**2 - obscuration**2) * _CM2
