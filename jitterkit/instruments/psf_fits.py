"""A PSF as poppy, webbpsf and stpsf write it, turned into the effective PSF of an instrument file.

Their images ``OVERSAMP`` and ``OVERDIST`` are values of the light *at points*, several per pixel and
axis (``DET_SAMP``); ``DET_SAMP`` and ``DET_DIST`` are sums of these over a pixel.  Neither is what a pixel
collects: a sum over k x k points is narrower than the pixel by p²/(12 k²) of variance per axis, which a
fit would call jitter.  :func:`effective_psf` completes the integral over the pixel exactly, in the Fourier
domain, because the image is band-limited.

poppy's header: https://poppy-optics.readthedocs.io/en/latest/fitsheaders.html.  Its matrix transform
puts the optical axis in the middle of the array, its FFT on sample n/2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import fft

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames.fits import NamedImage
from jitterkit.instruments.pupils import check_star

_NAMES = ("OVERDIST", "OVERSAMP", "DET_DIST", "DET_SAMP")
"""Images in the order in which they are taken: detector effects before none, points before sums."""

_PITCH = (1e-4, 600.0)
"""Arcsec that a sample of a PSF may be wide: a tenth of the finest pixels, and cameras of the whole sky."""

_ALIASED = 3e-4
"""Contrast beyond the Nyquist frequency up to which an image may be decimated: of the peak, less still."""

_UNDERSAMPLED = 0.02
"""Contrast at the Nyquist frequency from which an image is undersampled: a circular aperture sampled twice
per lambda/D has 0.005 there."""


@dataclass(frozen=True)
class EffectivePsf:
    """A star as the pixels of a detector see it.

    Parameters
    ----------
    pixels : (ny, nx) array
        Each sample is the light of a whole pixel that is centred there.
    hdu : int
        Of the image that it was made of.
    name : str
        Its EXTNAME.
    plate_scale : float
        arcsec per detector pixel.
    oversample : int
        Samples per pixel and axis.
    centre : (float, float)
        Optical axis, ``(x, y)`` in samples from the centre of the first.
    offset : (float, float)
        Centroid of the light from the axis, ``(x, y)`` in arcsec.
    enclosed : float or None
        Share of the star's light in the image; None if the file does not say.
    """

    pixels: np.ndarray
    hdu: int
    name: str
    plate_scale: float
    oversample: int
    centre: tuple[float, float]
    offset: tuple[float, float]
    enclosed: float | None

    @property
    def width(self) -> tuple[int, int]:
        """Return the rows and columns in whole detector pixels."""
        ny, nx = self.pixels.shape
        return ny // self.oversample, nx // self.oversample


def effective_psf(
    path: Path,
    images: Sequence[NamedImage],
    *,
    hdu: int | None = None,
    plate_scale: float | None = None,
    centre: tuple[float, float] | None = None,
    jittered: bool = False,
) -> EffectivePsf:
    """Make an effective PSF of the images of a file.

    Parameters
    ----------
    path : Path
        Named in complaints.
    images : sequence of NamedImage
    hdu : int, optional
        Of the image; by default OVERDIST, OVERSAMP, DET_DIST, DET_SAMP or the first, whichever there is.
    plate_scale : float, optional
        arcsec per detector pixel, where the file does not tell.
    centre : (float, float), optional
        Optical axis, ``(x, y)`` in samples of the file's image from the centre of the first.
    jittered : bool
        Whether a PSF that holds jitter is taken as it is.

    Returns
    -------
    psf : EffectivePsf
        On the fewest samples per pixel that carry it.

    Raises
    ------
    ConfigurationError
        If the file does not tell what is needed, the PSF holds jitter, is undersampled, is no star, or is one
        that :func:`~jitterkit.instruments.pupils.check_star` refuses.
    """
    image = _chosen(path, images, hdu)
    _check(path, image, images[0], jittered)
    pitch = _pitch(path, image)
    binned = image.name.startswith("DET_") or "CALCSAMP" in image.header
    scale, samples = (pitch, 1) if binned else _detector(path, image, images, pitch, plate_scale)
    if plate_scale is not None and abs(scale / plate_scale - 1) > 1e-3:
        problem = f"{path}: HDU {image.hdu} has pixels of {scale:.6g} arcsec (PIXELSCL), not --plate-scale"
        remedy = "leave it out, or choose an oversampled image with --hdu"
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem} {plate_scale:g}; {remedy}.")
    axis = _axis(image, pitch) if centre is None else centre
    rows, columns = np.indices(image.pixels.shape)
    total = image.pixels.sum()
    mean = [float((index * image.pixels).sum() / total) for index in (columns, rows)]
    whole = _collected(image.pixels, _missing(image, binned, samples))
    kept = _fewest(path, image, whole, samples)
    check_star(path, image.pixels)
    step = samples // kept
    thinned = whole[::step, ::step]
    # the share of the light inside the image is its sum, where the light at a pupil is one
    enclosed, kind = float(thinned.sum() * step**2), str(_card(image, images[0], "NORMALIZ") or "").strip()
    is_share = kind.lower() in ("first", "exit_pupil") and enclosed < 1.001
    return EffectivePsf(
        thinned,
        image.hdu,
        image.name,
        scale,
        kept,
        (axis[0] / step, axis[1] / step),
        ((mean[0] - axis[0]) * pitch, (mean[1] - axis[1]) * pitch),
        min(enclosed, 1.0) if is_share else None,
    )


def _chosen(path: Path, images: Sequence[NamedImage], hdu: int | None) -> NamedImage:
    by_name = {image.name: image for image in reversed(images)}
    if hdu is None:
        return next((by_name[name] for name in _NAMES if name in by_name), images[0])
    for image in images:
        if image.hdu == hdu:
            return image
    there = ", ".join(f"{image.hdu} {image.name}".rstrip() for image in images)
    problem = f"{path}: there is no image in HDU {hdu}; choose --hdu from {there}."
    raise ConfigurationError(ErrorCode.NO_IMAGE, problem)


def _check(path: Path, image: NamedImage, primary: NamedImage, jittered: bool) -> None:
    """Refuse what is no single star, and a star that shakes already."""
    pixels = image.pixels
    if pixels.ndim != 2:
        problem = f"{path}: HDU {image.hdu} has the shape {pixels.shape}; write one PSF, not a cube."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    missing = np.count_nonzero(~np.isfinite(pixels))
    if missing or not pixels.sum() > 0:
        total = f"a sum of {np.nansum(pixels):.4g}"
        problem = f"{path}: HDU {image.hdu} has {missing} pixels without a value and {total}"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; a PSF has none, and a positive sum.")
    kind = _card(image, primary, "JITRTYPE")
    if kind is not None and not str(kind).strip().lower().startswith("none") and not jittered:
        size = _card(image, primary, "JITRSIGM")
        detail = f" of {size} arcsec per axis (JITRSIGM)" if size is not None else ""
        problem = f"{path}: the PSF holds jitter already, {str(kind).strip()!r}{detail}"
        found = "so that fits would find only what is beyond it"
        remedy = "compute it with options['jitter'] = None, or allow it with --jittered"
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}, {found}; {remedy}.")


def _card(image: NamedImage, primary: NamedImage, key: str) -> Any:
    """Return a card of the image's header, or of the first image's."""
    return image.header.get(key, primary.header.get(key))


def _pitch(path: Path, image: NamedImage) -> float:
    pitch = image.quantity("plate_scale", "PIXELSCL")
    if pitch is None or not _PITCH[0] <= pitch <= _PITCH[1]:
        cards = ", ".join(f"{key} = {image.header.get(key)!r}" for key in ("PIXELSCL", "PIXUNIT"))
        problem = f"{path}: HDU {image.hdu} does not say how many arcsec a sample is wide ({cards})"
        remedy = "write PIXELSCL into its header, in arcsec or with its unit in PIXUNIT"
        raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem}; {remedy}.")
    return pitch


def _detector(
    path: Path, image: NamedImage, images: Sequence[NamedImage], pitch: float, plate_scale: float | None
) -> tuple[float, int]:
    """Plate scale [arcsec/pixel] and samples per pixel of an image of points."""
    sums = [other for other in images if other.name.startswith("DET_")]
    samples = image.positive("DET_SAMP", "OVERSAMP")
    if plate_scale is not None:
        samples = plate_scale / pitch
    elif sums and sums[0].quantity("plate_scale", "PIXELSCL"):
        samples = _pitch(path, sums[0]) / pitch
    elif not image.name and "FFTTYPE" in image.header:
        # poppy's OpticalSystem.calc_psf writes the oversampling of its wavefront into both cards
        samples = None
    if samples is None:
        problem = f"{path}: HDU {image.hdu} has samples of {pitch:.6g} arcsec (PIXELSCL)"
        remedy = "but does not say how wide a pixel of the detector is; give --plate-scale, in arcsec/pixel"
        raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem} {remedy}.")
    whole = round(samples)
    if whole < 1 or abs(samples / whole - 1) > 1e-3:
        problem = f"{path}: a pixel is {samples:.6g} samples of {pitch:.6g} arcsec (PIXELSCL) wide"
        found = "not a whole number; give another --plate-scale, or compute the PSF for it"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}, {found}.")
    return (pitch * whole if plate_scale is None else plate_scale), whole


def _axis(image: NamedImage, pitch: float) -> tuple[float, float]:
    """Return the optical axis: the middle, or sample n/2 where an FFT computed the image."""
    ny, nx = image.pixels.shape
    diffraction, oversample = image.positive("DIFFLMT"), image.positive("OVERSAMP")
    by_fft = bool(diffraction and oversample and abs(pitch * oversample / diffraction - 1) < 1e-6)
    columns, rows = image.pixels.sum(axis=0), image.pixels.sum(axis=1)
    middle = [float(np.arange(len(light)) @ light / light.sum()) for light in (columns, rows)]
    on_sample = math.hypot(middle[0] - nx // 2, middle[1] - ny // 2) < 0.02
    return (float(nx // 2), float(ny // 2)) if by_fft or on_sample else ((nx - 1) / 2, (ny - 1) / 2)


def _missing(image: NamedImage, binned: bool, samples: int) -> float:
    """Return how wide the part of the pixel is, in samples, over which the image is not yet integrated."""
    if not binned:
        return float(samples)
    summed = image.positive("CALCSAMP")
    if summed is None:
        summed = image.positive("DET_SAMP")
        summed = None if summed == 1 else summed
    return 0.0 if summed is None else 1 / summed


def _collected(pixels: np.ndarray, width: float) -> np.ndarray:
    """Return the image integrated over a square of a width [samples] about each sample."""
    shape = [fft.next_fast_len(n + 2 * math.ceil(width) + 8, real=True) for n in pixels.shape]
    fy, fx = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None, :]
    spectrum = fft.rfft2(pixels, s=shape) * np.sinc(width * fy) * np.sinc(width * fx)
    ny, nx = pixels.shape
    return fft.irfft2(spectrum, s=shape)[:ny, :nx]


def _fewest(path: Path, image: NamedImage, whole: np.ndarray, samples: int) -> int:
    """Fewest samples per pixel, a divisor of those there are, that carry the image without aliasing."""
    fy, fx = np.fft.fftfreq(whole.shape[0])[:, None], np.fft.rfftfreq(whole.shape[1])[None, :]
    reach = np.maximum(np.abs(fy), fx)
    contrast = np.abs(fft.rfft2(image.pixels)) / image.pixels.sum()
    if contrast[reach > 0.48].max(initial=0.0) > _UNDERSAMPLED:
        found = f"the contrast at its Nyquist frequency is {contrast[reach > 0.48].max():.2g}"
        remedy = "compute the PSF with a larger oversample, or choose an oversampled image with --hdu"
        problem = f"{path}: HDU {image.hdu} undersamples the optics: {found}"
        raise ConfigurationError(ErrorCode.SAMPLING, f"{problem}; {remedy}.")
    contrast = np.abs(fft.rfft2(whole)) / whole.sum()
    for kept in (n for n in range(1, samples) if samples % n == 0):
        if contrast[reach > 0.5 * kept / samples].max(initial=0.0) < _ALIASED:
            return kept
    return samples
