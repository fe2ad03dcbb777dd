"""Header cards that tell other tools of a blur: poppy's and stpsf's ``JITR*``, Roman's ``JITTER_*``."""

from __future__ import annotations

import math
from typing import Any

from jitterkit.conventions import axis_angle
from jitterkit.loci.base import principal_axes

_ROUND = 0.01
"""Share by which the axes of a normal may differ that is called round."""


def jitter_cards(moments, *, normal: bool = False) -> dict[str, tuple[Any, str]]:
    """Cards for a blur of given second moments.

    Parameters
    ----------
    moments : (3,) array
        ``(Sxx, Sxy, Syy)``, arcsec².
    normal : bool
        Whether it is a normal density.

    Returns
    -------
    cards : dict
        Keyword to ``(value, comment)``.

    Notes
    -----
    ``JITRTYPE`` and ``JITRSIGM`` [arcsec, per axis] are poppy's: its Gaussian is round, so every other blur
    is stpsf's "Custom jitter kernel" and has no ``JITRSIGM``.  ``JITTER_MAJOR``, ``JITTER_MINOR`` [mas, 1
    sigma] and ``JITTER_POSITION_ANGLE`` are Roman's.  Its pipeline (romancal, ``psf.add_jitter``) turns that
    angle from +y towards +x of the detector: 90 degrees less ours, which stands in ``JTRANGLE``.
    """
    major, minor, angle = principal_axes(moments)
    cards: dict[str, tuple[Any, str]] = {"JITRTYPE": ("Custom jitter kernel", "type of jitter")}
    if normal and minor > (1 - _ROUND) * major:
        sigma = math.hypot(major, minor) / math.sqrt(2)
        cards["JITRTYPE"] = ("Gaussian convolution", "type of jitter")
        cards["JITRSIGM"] = (sigma, "[arcsec] sigma of the jitter, per axis")
    cards["JITTER_MAJOR"] = (1e3 * major, "[mas] 1 sigma, major axis")
    cards["JITTER_MINOR"] = (1e3 * minor, "[mas] 1 sigma, minor axis")
    cards["JITTER_POSITION_ANGLE"] = (axis_angle(90 - angle), "[deg] from +y to +x")
    cards["JTRANGLE"] = (angle, "[deg] major axis, ccw from +x")
    return cards
