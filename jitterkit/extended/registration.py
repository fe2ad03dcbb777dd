"""How far a scene has moved from one frame to the next.

:func:`register` compares two frames, :func:`drifts` a sequence with its first.  scikit-image finds the
shift to the pixel (without its default normalisation, which is wrong on star fields by up to two pixels);
least squares on the transforms' difference, each frequency by what noise leaves of it, does the rest.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage
from scipy.signal.windows import tukey
from skimage.registration import phase_cross_correlation

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.extended.standing import fill, standing_pixels

_STEPS = 20
"""Of the least squares, at most; each divides what is left by ten or more."""

_BAND = 0.4
"""Cycles/pixel: beyond, undersampled frames alias, and aliases move the wrong way."""

_FILLINGS = 3
"""Times that masked pixels are filled from the other frame: each divides by ten or more what filling them
from their neighbours does to the shift."""

_LEAST_ORDER = 3.0
"""Cycles in the frame: below, the window, which does not move with the scene, is part of what is seen."""

_TAPER = 0.5
"""Share of each side that the window tapers."""

_WINDOW_ERROR = 0.003
"""Pixels: what scenes that run out of the frame leave, measured on noise-free photographs."""

_LEAST_CORRELATION = 0.3
"""Of the two frames once aligned: between different scenes, or noise, it stays below 0.1."""

_FARTHEST = 2.0
"""Pixels between the peak of the correlation and the shift by least squares, which starts there."""

_ODD = 7.0
"""Standard deviations of the correlation's asymmetry from which frames differ by more than a shift; between
two images of a scene in white noise they stay below 6.5."""

_MOST_BIAS, _MOST_SHARE = 0.1, 0.05
"""Pixels, and share of the shift, up to which what frames do not share is an error of the shift."""

_LEAST_OVERLAP = 16
"""Smallest side, in pixels, of the area that both frames must show."""


@dataclass(frozen=True, eq=False)
class Drift:
    """A shift of the scene: its place in the image less its place in the reference.

    Attributes
    ----------
    x, y : float
        Arcsec (pixels without a plate scale); +x towards larger columns, +y towards larger rows.
    covariance : (2, 2) array
        Of ``(x, y)``.
    """

    x: float
    y: float
    covariance: np.ndarray

    @property
    def errors(self) -> np.ndarray:
        """Return the standard errors of ``(x, y)``."""
        return np.sqrt(np.diag(self.covariance))


def register(
    reference: np.ndarray, image: np.ndarray, *, mask: np.ndarray | None = None, plate_scale: float = 1.0
) -> Drift:
    """Measure the shift between two frames of the same scene.

    Parameters
    ----------
    reference, image : (ny, nx) arrays
        In the same unit up to a factor; the noise is taken from what the frames do not share.
    mask : (ny, nx) bool array, optional
        True where a pixel of either frame is unusable; it may hold anything, NaN too.
    plate_scale : float
        Arcsec/pixel; without one, a pixel counts as an arcsec.

    Returns
    -------
    drift : Drift

    Raises
    ------
    ConfigurationError
        If the frames are not two images of one shape with finite values outside the mask.
    UndeterminedError
        If the frames have no scene in common, or differ by more than a shift (code ``model_mismatch``): by a
        pattern that stands still, such as a flat field, fringes or a ghost, or by a lopsided blur.

    Notes
    -----
    Pixels, columns and rows that stand out alike in both frames, more sharply than optics allow, do not
    move with the scene and are treated as masked.  Of any other pattern that stands still the frames are not
    freed: it makes their correlation asymmetric about the shift, and what that may do to the shift is part of
    its covariance.

    *Assumes* a pure shift of less than half the frame.  *Fails when* a pattern that stands still is much
    stronger than the scene: then it is taken for it.
    """
    drift, bias = align(reference, image, mask)
    if bias > min(_MOST_BIAS, _MOST_SHARE * np.hypot(drift.x, drift.y)):
        problem = f"The frames differ by more than a shift, which may be off by {bias:.2g} pixels"
        reasons = "a pattern stands still, or the blur is lopsided"
        remedy = "divide by the flat field, mask the pattern, or give frames that are blurred alike"
        raise UndeterminedError(ErrorCode.MODEL_MISMATCH, f"{problem}: {reasons}; {remedy}.")
    covariance = drift.covariance + np.eye(2) * bias**2
    return Drift(drift.x * plate_scale, drift.y * plate_scale, covariance * plate_scale**2)


def align(reference: np.ndarray, image: np.ndarray, mask: np.ndarray | None = None) -> tuple[Drift, float]:
    """Measure a shift as :func:`register` does, of frames that may differ otherwise too.

    Returns
    -------
    drift : Drift
        In pixels; its covariance is that of noise.
    bias : float
        What the shift may be off by because the frames differ otherwise [pixels]; 0 where noise may be all.
    """
    pair = [np.asarray(frame, dtype=float) for frame in (reference, image)]
    if pair[0].shape != pair[1].shape or pair[0].ndim != 2:
        problem = f"Frames to register are images of one shape; got {pair[0].shape} and {pair[1].shape}."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    bad = np.zeros(pair[0].shape, bool) if mask is None else np.asarray(mask, bool)
    if bad.shape != pair[0].shape or bad.all():
        raise ConfigurationError(
            ErrorCode.WRONG_SHAPE if bad.shape != pair[0].shape else ErrorCode.NO_DATA,
            f"The mask of frames {pair[0].shape} has the shape {bad.shape} and leaves {np.sum(~bad)} pixels; "
            "give one of their shape that leaves some.",
        )
    for name, frame in zip(("reference", "image"), pair, strict=True):
        lost = int(np.sum(~np.isfinite(frame[~bad])))
        if lost:
            found = f"The {name} to register has {lost} of {frame.size} pixels that are not finite"
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{found}; mask them, or cut them away.")
    for name, frame in zip(("reference", "image"), pair, strict=True):
        if frame[~bad].std() == 0:
            problem = f"The {name} is constant ({frame[~bad][0]:g} everywhere): there is nothing to register."
            raise UndeterminedError(ErrorCode.NO_SIGNAL, problem)
    bad = bad | standing_pixels(*(fill(frame, bad) for frame in pair))
    one, two = (fill(frame, bad) for frame in pair)
    (x, y), covariance, bias = _shift(one, two)
    for _ in range(_FILLINGS if bad.any() else 0):  # what one frame lacks the other shows
        one, two = (
            np.where(bad, ndimage.shift(other, move, order=3, mode="nearest"), frame)
            for frame, other, move in ((one, two, (-y, -x)), (two, one, (y, x)))
        )
        (x, y), covariance, bias = _shift(one, two)
    return Drift(x, y, covariance), bias


def drifts(
    frames: Iterable[np.ndarray], *, mask: np.ndarray | None = None, plate_scale: float = 1.0
) -> list[Drift]:
    """Measure the shifts of a sequence of frames against its first, which is not in the list."""
    first, *others = frames
    return [register(first, frame, mask=mask, plate_scale=plate_scale) for frame in others]


def _shift(one: np.ndarray, two: np.ndarray) -> tuple[tuple[float, float], np.ndarray, float]:
    """Shift (x, y) of the second frame [pixels], its covariance, and its bias as :func:`align` has it."""
    window = _window(one.shape)
    pair = (_windowed(frame, window) for frame in (one, two))
    whole = -phase_cross_correlation(*pair, normalization=None)[0].astype(int)
    (y, x), covariance, bias = _refine(*_overlap(one, two, whole))
    return (float(x + whole[1]), float(y + whole[0])), covariance, bias


def _windowed(frame: np.ndarray, window: np.ndarray) -> np.ndarray:
    return (frame - np.average(frame, weights=window)) * window


def _overlap(one: np.ndarray, two: np.ndarray, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the parts of two frames that show the same scene, the second moved by whole pixels (y, x)."""
    cuts = [
        [slice(max(0, s), n + min(0, s)) for s, n in zip(sign * shift, one.shape, strict=True)]
        for sign in (-1, 1)
    ]
    return one[tuple(cuts[0])], two[tuple(cuts[1])]


def _refine(one: np.ndarray, two: np.ndarray) -> tuple[tuple[float, float], np.ndarray, float]:
    """Sub-pixel shift (y, x) of the second, the covariance of (x, y), and the bias [pixels]."""
    if min(one.shape) < _LEAST_OVERLAP:
        problem = f"The frames overlap by {min(one.shape)} pixels"
        raise UndeterminedError(ErrorCode.TOO_FEW, f"{problem}; registration needs {_LEAST_OVERLAP} or more.")
    window = _window(one.shape)
    fy, fx = np.meshgrid(fft.fftfreq(one.shape[0]), fft.rfftfreq(one.shape[1]), indexing="ij")
    band = (np.hypot(fx, fy) < _BAND) & (np.hypot(fy * one.shape[0], fx * one.shape[1]) > _LEAST_ORDER)
    band &= (fx > 0) | (fy > 0)  # of a frequency and its negative, one
    a, b = (fft.rfft2(_windowed(frame, window))[band] for frame in (one, two))
    axes, powers = 2 * np.pi * np.stack([fy[band], fx[band]]), (abs(a) ** 2, abs(b) ** 2)
    shift, covariance, cross = _solve(a.conj() * b, axes, np.zeros(2))
    correlation = cross.real.sum() / np.sqrt(powers[0].sum() * powers[1].sum())
    far = float(np.abs(shift).max())
    if not correlation > _LEAST_CORRELATION or far > _FARTHEST:
        found = f"correlation {correlation:.2f}; {_LEAST_CORRELATION:g} is needed"
        if correlation > _LEAST_CORRELATION:
            found = f"two ways to measure the shift differ by {far:.1f} pixels"
            found = f"{found}; at most {_FARTHEST:g} is allowed"
        problem = f"The frames have too little in common to register them ({found})"
        raise UndeterminedError(ErrorCode.MODEL_MISMATCH, f"{problem}; give larger frames of one scene.")
    ties = window.size * (window**4).sum() / (window**2).sum() ** 2  # of neighbouring frequencies
    covariance = ties * covariance + np.eye(2) * _WINDOW_ERROR**2
    bias = _bias(one.shape, band, cross, axes, np.sqrt(powers[0] * powers[1]))
    return (float(shift[0]), float(shift[1])), covariance[::-1, ::-1], bias


def _bias(
    shape: tuple[int, ...], band: np.ndarray, cross: np.ndarray, axes: np.ndarray, power: np.ndarray
) -> float:
    """Bias [pixels] that goes with an asymmetry of the correlation about the shift; 0 where noise makes it.

    A pattern that stands still adds its own peak, ``f`` times as high as the scene's.  Closer than the
    scene's width ``w`` it moves the whole by ``f`` times the shift, and the odd part is 0.6 ``f`` times the
    shift over ``w``.
    """

    def odd_part(weights: np.ndarray | float) -> np.ndarray:
        odd = np.zeros(band.shape, complex)
        odd[band] = 1j * cross.imag * weights
        return np.abs(fft.irfft2(odd, shape))

    # by roots of powers, as the noise of the cross power goes with them
    odd = odd_part((power + np.median(power)) ** -0.5)
    if odd.max() <= _ODD * np.sqrt(np.mean(odd**2)):
        return 0.0
    height, curvature = float(cross.real.sum()), float(np.sum(axes**2 * cross.real)) / 2
    width = np.sqrt(height / curvature) if curvature > 0 else np.inf
    return float(odd_part(1.0).max() * odd.size / (2 * height) * width / 0.6)


def _solve(
    pair: np.ndarray, axes: np.ndarray, shift: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shift (y, x) that makes a weighted cross spectrum real, its covariance, and that spectrum."""
    for _ in range(_STEPS):
        cross = pair * np.exp(1j * shift @ axes)
        # the frames' noises are independent: the cross power is free of their bias
        gain = np.linalg.inv((axes * cross.real) @ axes.T)
        step = -gain @ axes @ cross.imag
        shift = shift + step
        if np.all(np.abs(step) < 1e-6):
            break
    return shift, gain @ ((axes * cross.imag**2) @ axes.T) @ gain, cross


def _window(shape: tuple[int, ...]) -> np.ndarray:
    return np.outer(*(tukey(n + 2, _TAPER)[1:-1] for n in shape))
