"""The celestial coordinates of a header, or none, with what was odd about them."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from astropy.wcs import WCS

__all__ = ["celestial_wcs"]

SCALE_KEYS = ("CD1_1", "CD1_2", "CDELT1", "PC1_1")


def celestial_wcs(header: Any) -> tuple[WCS | None, list[str]]:
    """Build the celestial part of a header's WCS.

    Parameters
    ----------
    header : astropy.io.fits.Header

    Returns
    -------
    wcs : astropy.wcs.WCS or None
        Two axes, 0-based through ``pixel_to_world_values``; None where the header has no celestial
        axes, no scale, or one that cannot be inverted.
    warnings : list of str
        Why a WCS that seemed to be there is not used, or what was mended in it.
    """
    if not str(header.get("CTYPE1", "")).strip():
        return None, []
    if not any(header.get(key) for key in SCALE_KEYS):
        return None, ["the WCS has no CD, PC or CDELT, so it has no scale and is ignored"]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            wcs = WCS(header)
            celestial = wcs.celestial if wcs.has_celestial else None
        except Exception as error:  # wcslib raises a dozen kinds, none of them fatal to the image
            return None, [f"the WCS cannot be used ({' '.join(str(error).split())[:120]}) and is ignored"]
    if celestial is not None and not abs(np.linalg.det(celestial.pixel_scale_matrix)) > 0:
        return None, ["the WCS cannot be inverted and is ignored"]
    messages = [" ".join(str(w.message).split())[:160] for w in caught]
    messages = [m for m in messages if "datfix" not in m]  # dates are not its business here
    return celestial, list(dict.fromkeys(messages)) if celestial is not None else []
