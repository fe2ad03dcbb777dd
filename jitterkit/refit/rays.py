"""Cosmic rays: what stands out of a fitted frame, one pixel or a track of them.

They are looked for in the residual of the fit and not in the image: there the tail of a jittered star is
explained, which a filter of the image would eat.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

__all__ = ["find_rays"]

_SEED, _TRACK = 8.0, 3.0
"""Sigmas from which a pixel starts a track (one in 1e15 of normal noise does), and continues one."""

_MOST = 0.01
"""Share of the pixels above which it is the model that does not fit."""


def find_rays(residual) -> np.ndarray:
    """Find the pixels that cosmic rays have hit.

    Parameters
    ----------
    residual : (ny, nx) array
        ``(data - image)/sigma`` of a fit; NaN where a pixel does not count.

    Returns
    -------
    hit : (ny, nx) bool array
        Bright outliers and what is joined to them, over edges or corners.  Nothing where there are so many
        that the model is to blame.

    Notes
    -----
    *Fails when* a ray leaves less than eight sigmas in every pixel: on the core of a bright star it hides.
    """
    bright = np.nan_to_num(np.asarray(residual), nan=0.0)
    tracks, _ = ndimage.label(bright > _TRACK, structure=np.ones((3, 3)))
    seeds = np.unique(tracks[bright > _SEED])
    hit = np.isin(tracks, seeds[seeds > 0])
    return hit if hit.mean() <= _MOST else np.zeros_like(hit)
