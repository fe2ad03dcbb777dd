"""Single pixels that do not belong to a frame's image, left out before the frame is fitted again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from jitterkit.frames import Frame
from jitterkit.likelihood import Data
from jitterkit.locate import Residual, most_outliers
from jitterkit.optics.otf import OTF
from jitterkit.refit.result import FitResult

__all__ = ["OUTLIERS", "Fit", "fit_without_outliers", "left_out"]

OUTLIERS = "outliers_left_out"
"""Flag of a frame of which single pixels were left out."""

_ROUNDS = 3
"""Times that a frame is fitted again without what does not belong: the first fit is bent by it."""

Fit = Callable[[Frame], tuple[FitResult, OTF]]
"""From a frame to its fit, and the optics expanded where that ended."""


def left_out(pixels: int) -> str:
    """Say in a sentence that single pixels were left out; nothing if none were."""
    if not pixels:
        return ""
    which, were = ("1 pixel", "was") if pixels == 1 else (f"{pixels} pixels", "were")
    return f"{which} that stood out alone {were} left out."


def fit_without_outliers(
    frame: Frame, fit: Fit, before: np.ndarray | None = None
) -> tuple[Frame, FitResult, OTF]:
    """Fit a frame, and again without single pixels that do not belong to it, as long as they are few.

    Parameters
    ----------
    frame : Frame
    fit : callable
        From a frame to its fit and the optics expanded there.
    before : (ny, nx) bool array, optional
        Pixels that were left out already.

    Returns
    -------
    frame : Frame
        With those pixels masked.
    result : FitResult
        With the flag :data:`OUTLIERS` and a sentence where there are any.
    otf : OTF
    """
    most, given = most_outliers(~frame.mask), frame.mask
    if before is not None:
        frame = replace(frame, mask=given | before)
    result, otf = fit(frame)
    for _ in range(_ROUNDS):
        mask = frame.mask | _outliers(frame, result, otf)
        if np.array_equal(mask, frame.mask) or np.count_nonzero(mask & ~given) > most:
            break
        frame = replace(frame, mask=mask)
        result, otf = fit(frame)
    pixels = int(np.count_nonzero(frame.mask & ~given))
    if not pixels:
        return frame, result, otf
    message = f"{result.message or result.status.value} {left_out(pixels)}"
    return frame, replace(result, message=message, flags=(*result.flags, OUTLIERS)), otf


def _outliers(frame: Frame, result: FitResult, otf: OTF) -> np.ndarray:
    """Outliers (ny, nx) of what a fit leaves of a frame; none of a frame that could not be fitted."""
    if result.residual is None or result.image is None or result.parameters is None:
        return np.zeros(frame.shape, bool)
    p = result.parameters
    data = Data.of(frame).without(~np.isfinite(result.residual))
    return Residual(data, result.image, otf, p.locus).outliers(float(p.background))
