"""Axes, angles, units and the sign of the Fourier transform, said once.

* Arrays are ``[y, x]``; the row index grows upwards; pixel centres are integers.
* Positions are offsets from the frame centre ``((nx - 1)/2, (ny - 1)/2)`` in arcsec.
* Every angle in the image plane is in degrees, counter-clockwise from +x.  A *direction* lies in
  [0, 360); an *axis* (a smear has no head or tail) lies in [0, 180).
* ``theta`` is the direction from the brighter star A to the fainter star B.
* A transfer function is ``T(f) = integral of t(r) exp(-2 pi i f.r) dr`` with f in cycles/arcsec, so
  a star displaced by r multiplies the spectrum by ``exp(-2 pi i f.r)``.

Three foreign conventions meet us, each converted at one place: dLux's position angle (from +y towards
+x, pointing from B to A) here, the rows of a TIFF (the first is the top one) in :mod:`jitterkit.frames`, and
Roman's angle of the jitter (from +y towards +x) in :mod:`jitterkit.loci.kernel`.
"""

from __future__ import annotations

import math

import numpy as np

ARCSEC = math.pi / 180.0 / 3600.0
"""One arcsecond in radians."""

FWHM_PER_SIGMA = math.sqrt(8.0 * math.log(2.0))
"""Full width at half maximum of a Gaussian, in standard deviations."""


def offsets(n: int, scale: float) -> np.ndarray:
    """Return the coordinates of ``n`` pixel centres about the middle of their row.

    Parameters
    ----------
    n : int
        Number of pixels.
    scale : float
        Pixel pitch, in any unit.

    Returns
    -------
    offsets : (n,) array
        In the unit of ``scale``; antisymmetric, so their sum is zero.

    Examples
    --------
    >>> offsets(4, 0.5)
    array([-0.75, -0.25,  0.25,  0.75])
    """
    return (np.arange(n) - (n - 1) / 2) * scale


def axis_angle(degrees: float) -> float:
    """Fold an angle into [0, 180), as suits a line without head or tail.

    >>> axis_angle(-10.0), axis_angle(180.0)
    (170.0, 0.0)
    """
    return _fold(degrees, 180.0)


def direction_angle(degrees: float) -> float:
    """Fold an angle into [0, 360).

    >>> direction_angle(-90.0)
    270.0
    """
    return _fold(degrees, 360.0)


def _fold(degrees: float, period: float) -> float:
    folded = float(degrees) % period
    return 0.0 if folded == period else folded  # -1e-20 % 180 rounds up to 180
