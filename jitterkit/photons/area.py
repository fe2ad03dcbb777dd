"""Collecting areas, in cm²: of a pupil, and of an annulus by its diameters.

Reach for :func:`collecting_area`.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import maximum_filter

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.optics.pupil import Pupil

_CM2 = 1e4
"""In a square metre."""


def collecting_area(pupil: Pupil) -> float:
    """Area of a pupil, weighted by the share of the photons that it passes, cm².

    Notes
    -----
    The transmission ``t`` is of the amplitude, and a grey pupil passes the sum of ``t²``.  A sample that a
    hard edge cuts holds the share of it that is clear, and passes that: of a pupil with hard edges the sum
    of ``t`` counts (that of ``t²`` is 0.5 % too small for TOLIMAN's 256 samples).  A pupil is taken for
    hard-edged if each of its samples is clear or opaque, or touches one that is, corners included.

    *Fails when* a grey rim is a sample or two wide: it is taken for an edge.
    """
    transmission = np.asarray(pupil.transmission)
    decided = np.isclose(transmission, 0) | np.isclose(transmission, 1)
    hard = np.all(maximum_filter(decided, 3))
    return float(np.sum(transmission if hard else transmission**2) * pupil.pitch**2 * _CM2)


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
        problem = f"The obscuration must lie between 0 and the diameter of {diameter} m, got {obscuration} m."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    return math.pi / 4 * (diameter**2 - obscuration**2) * _CM2
