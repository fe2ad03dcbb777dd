"""Pixels that do not belong to a frame's image, left out before the frame is fitted again.

Reach for :func:`fit_without_outliers`: ``process`` and ``sequence`` both fit a frame by it.  Pixels are found
in the residual of the fit and not in the image: there the tail of a jittered star is explained, which a
filter of the image would eat.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from jitterkit.forward import background_of
from jitterkit.frames import Frame
from jitterkit.known_light import KnownLight, without_light
from jitterkit.likelihood import Data
from jitterkit.linearisation import LINEARISATION_TOLERANCE
from jitterkit.locate import ModelError, Residual, allow_for_model, most_outliers
from jitterkit.optics.otf import OTF
from jitterkit.refit.result import FitResult, Status

OUTLIERS = "outliers_left_out"
"""Flag of a frame of which single pixels were left out."""

_ROUNDS = 3
"""Times that a frame is fitted again without what is no part of its model: the first fit is bent by it."""

_SEED, _TRACK = 8.0, 3.0
"""Sigmas from which a pixel starts a track (one in 1e15 of normal noise does), and continues one."""

_SHARE = 0.1
"""Of the excess of a poor fit's chi-squared, in pixels without which a frame is fitted again.  They bend
a fit about themselves, but what no scene describes has a few of them too."""

_MOST = 0.01
"""Share of the pixels above which it is the model that does not fit."""


@dataclass(frozen=True)
class Fitted:
    """A fit of a frame.

    Attributes
    ----------
    result : FitResult
    otf : OTF
        Of the frame, by which a star is distinguished from a pixel.
    left_out : int
        Pixels that do not belong to the image, and that the search for its stars left out by itself.
    """

    result: FitResult
    otf: OTF
    left_out: int = 0

    def residual(self, frame: Frame, model_error: ModelError = 0.0) -> Residual | None:
        """Return what the fit leaves of a frame; None for one that could not be fitted."""
        p, image, residual = self.result.parameters, self.result.image, self.result.residual
        if residual is None or image is None or p is None:
            return None
        data = Data.of(frame).without(~np.isfinite(residual))
        return Residual(allow_for_model(data, p, image, self.otf, model_error), image, self.otf, p.locus)


Fit = Callable[[Frame], Fitted]


def left_out(pixels: int) -> str:
    """Say in a sentence that single pixels were left out; nothing if none were."""
    if not pixels:
        return ""
    which, were = ("1 pixel", "was") if pixels == 1 else (f"{pixels} pixels", "were")
    return f"{which} that stood out alone {were} left out."


def fit_without_outliers(
    frame: Frame,
    fit: Fit,
    *,
    known: np.ndarray | None = None,
    known_light: KnownLight | None = None,
    rays: bool = False,
    model_error: ModelError = 0.0,
) -> tuple[Frame, Fitted]:
    """Fit a frame, and again without pixels that do not belong to it, as long as they are few.

    Parameters
    ----------
    frame : Frame
    fit : callable
        From a frame to its fit.
    known : (ny, nx) bool array, optional
        Pixels that were left out already.
    known_light : KnownLight, optional
        What to take out of the frame, by its first fit.
    rays : bool
        Whether to leave out the tracks of cosmic rays too (:func:`find_rays`), which
        are not counted among the few.
    model_error : float or "auto"
        As for :class:`~jitterkit.refit.FitOptions`.

    Returns
    -------
    frame : Frame
        With those pixels masked, and flagged with what they are.
    fitted : Fitted
        Its result has the flag :data:`OUTLIERS` and a sentence where single pixels were left out.
    """
    most, outliers = most_outliers(~frame.mask), 0
    if known is not None:
        frame, outliers = _masked(frame, known, OUTLIERS), int(np.count_nonzero(known & ~frame.mask))
    fitted = fit(frame)
    if known_light is not None:
        frame, fitted = _without_known_light(frame, fitted, fit, known_light)
    for _ in range(_ROUNDS):
        residual = fitted.residual(frame, model_error)
        if residual is None:
            break
        hit = find_rays(fitted.result.residual) if rays else np.zeros(frame.shape, bool)
        if hit.any():
            frame = _masked(frame, hit, "rays_masked")
        else:
            assert fitted.result.parameters is not None
            hit = residual.outliers(background_of(fitted.result.parameters, residual.otf.grid))
            found = outliers + int(hit.sum())
            if found == outliers or found + fitted.left_out > most or not _may_matter(hit, fitted.result):
                break
            frame, outliers = _masked(frame, hit, OUTLIERS), found
        fitted = fit(frame)
    remarked = fitted.result.remarked(left_out(outliers + fitted.left_out), OUTLIERS)
    return frame, replace(fitted, result=remarked)


def _may_matter(hit: np.ndarray, result: FitResult) -> bool:
    """Return whether a fit without some pixels may be better than poor, if it is poor with them."""
    assert result.residual is not None
    squares = np.nan_to_num(result.residual) ** 2
    excess = max(float(squares.sum()) - result.dof, 0.0)
    return result.status is not Status.POOR_FIT or float(squares[hit].sum()) > _SHARE * excess


def _without_known_light(whole: Frame, fitted: Fitted, fit: Fit, known: KnownLight) -> tuple[Frame, Fitted]:
    """Take known light out of a frame and fit it again, until the new fit knows of the same light."""
    frame, removed = whole, np.zeros(whole.shape)
    for _ in range(_ROUNDS):
        p, image = fitted.result.parameters, fitted.result.image
        if p is None or image is None:
            break
        light = known.of_frame(whole, p, fitted.otf)
        noise = np.maximum(image, 0.0) + whole.read_variance
        seen = ~whole.mask & (noise > 0)
        if np.sum((light - removed)[seen] ** 2 / noise[seen]) < LINEARISATION_TOLERANCE**2:
            break
        frame, removed = without_light(whole, light), light
        fitted = fit(frame)
    return frame, fitted


def _masked(frame: Frame, pixels: np.ndarray, flag: str) -> Frame:
    """Return a frame with some pixels (ny, nx) masked more, and what they are as a flag."""
    flags = (*frame.flags, flag) if pixels.any() else frame.flags
    return replace(frame, mask=frame.mask | pixels, flags=tuple(dict.fromkeys(flags)))


def find_rays(residual) -> np.ndarray:
    """Find the pixels that cosmic rays have hit: one, or a track of them.

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
