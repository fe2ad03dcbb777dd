"""Kernels as FITS files that other tools read: :func:`write_kernel` and :func:`read_kernel`.

One file serves four: photutils and dLux take its array (odd sides, sums to one), stpsf takes it as
``options["jitter"] = "custom"`` with ``options["jitter_kernel"]``, on the pixels of its oversampled image
(``oversample`` here as there), and GalSim reads the file as an ``InterpolatedImage`` with its scale.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, FrameError, UndeterminedError
from jitterkit.frames import write_fits
from jitterkit.frames.fits import read_image
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.kernels.image import kernel_moments, locus_of
from jitterkit.loci import Locus, Mvn, jitter_cards, locus_name

Cards = dict[str, tuple[Any, str]]


class StoredKernel(NamedTuple):
    """A kernel as a file holds it.

    Attributes
    ----------
    kernel : (ny, nx) array
        Odd sides; sums to one.
    plate_scale : float or None
        arcsec per pixel *of the kernel*; None where the file does not say.
    cards : mapping
        The header.
    """

    kernel: np.ndarray
    plate_scale: float | None
    cards: Mapping[str, Any]


def kernel_cards(
    kernel: np.ndarray,
    *,
    plate_scale: float,
    estimate: KernelEstimate | Locus | None = None,
    oversample: int = 1,
) -> Cards:
    """Return the header cards of a kernel, in the names that other programs read.

    Parameters
    ----------
    kernel : (ny, nx) array
    plate_scale : float
        Of the detector, arcsec per pixel.
    estimate : KernelEstimate or Locus, optional
        What the kernel was drawn from.  The moments are the kernel's own without it, and where the
        kernel itself is what was measured.
    oversample : int
        Kernel pixels per detector pixel.

    Returns
    -------
    cards : dict
        Keyword to ``(value, comment)``.

    Notes
    -----
    ``PIXELSCL`` and ``OVERSAMP`` are poppy's; ``GS_WCS`` and ``GS_SCALE`` are what GalSim's
    ``readFromFitsHeader`` looks for; the rest is in :func:`jitterkit.loci.jitter_cards`.  A blur that is not
    known to be jitter has no amplitudes of it, and ``JITRTYPE`` says so.
    """
    pixel = plate_scale / oversample
    if estimate is None or _is_on_pixels(estimate):
        moments = kernel_moments(kernel, pixel)
    else:
        moments = np.asarray(estimate.moments() if isinstance(estimate, Locus) else estimate.moments)
    cards: Cards = {
        "PIXELSCL": (pixel, "[arcsec/pixel] of this kernel"),
        "OVERSAMP": (oversample, "kernel pixels per detector pixel"),
        "GS_WCS": ("PixelScale", "GalSim's name for a plain scale"),
        "GS_SCALE": (pixel, "[arcsec/pixel] for GalSim"),
    }
    if _undetermined(estimate):
        cards["JITRTYPE"], of = ("Blur that is not known to be jitter", "see COMMENT"), "blur"
    else:
        cards, of = cards | jitter_cards(moments, normal=_is_normal(estimate)), "pointing"
    for axis, value in zip(("SXX", "SXY", "SYY"), moments, strict=True):
        cards[axis] = (float(value), f"[arcsec2] second moment of the {of}")
    if estimate is not None:
        cards |= _origin(estimate)
    return cards


def write_kernel(
    path: str | Path,
    kernel: np.ndarray,
    *,
    plate_scale: float,
    estimate: KernelEstimate | Locus | None = None,
    oversample: int = 1,
    remark: str = "",
    rows: str = "",
    overwrite: bool = False,
) -> Path:
    """Write a kernel as a FITS image with the cards that other tools read.

    Parameters
    ----------
    path : str or Path
    kernel : (ny, nx) array
        From :func:`jitterkit.kernels.kernel_image`.  Written as float64 with a sum of one.
    plate_scale, estimate, oversample
        As in :func:`kernel_cards`.
    remark : str
        For the header, as a comment.
    rows : {"", "BOTTOM-UP", "TOP-DOWN"}
        Order of the file's rows, as in :func:`in_rows`.  The header's moments and angles are those with y
        upwards, whatever the order.
    overwrite : bool
        Whether a file of that name may be replaced.

    Returns
    -------
    path : Path

    Raises
    ------
    ConfigurationError
        If it is no kernel: even sides, a value that is not finite, no positive sum.
    FrameError
        If the file exists and ``overwrite`` is False, or cannot be written.
    """
    kernel = np.asarray(kernel, float)
    if fault := _fault(kernel):
        code, problem = fault
        message = f"This is no kernel: it {problem}; give odd sides, finite values and a positive sum."
        raise ConfigurationError(code, message)
    cards = kernel_cards(kernel, plate_scale=plate_scale, estimate=estimate, oversample=oversample)
    array, order = in_rows(kernel / kernel.sum(), rows)
    remarks = "\n".join(filter(None, (_undetermined(estimate), remark)))
    cards |= order | ({"COMMENT": (remarks, "")} if remarks else {})
    return write_fits(path, array, header=cards, overwrite=overwrite)


def in_rows(array: np.ndarray, rows: str) -> tuple[np.ndarray, Cards]:
    """Put an image in an order of rows, with the card that says so.

    Parameters
    ----------
    array : (ny, nx) array
        Row index upwards.
    rows : {"", "BOTTOM-UP", "TOP-DOWN"}
        "TOP-DOWN" puts the top row first; "" changes nothing and says nothing.

    Returns
    -------
    array : (ny, nx) array
    cards : dict
        ``ROWORDER``, which capture software and jitterkit read.
    """
    if not rows:
        return array, {}
    return array[::-1] if rows == "TOP-DOWN" else array, {"ROWORDER": (rows, "which row is the first")}


def read_kernel(path: str | Path) -> StoredKernel:
    """Read a kernel that this or another tool wrote.

    Parameters
    ----------
    path : str or Path
        A FITS file; its first image.  Its scale is ``PIXELSCL``, or else ``GS_SCALE`` or ``PIXSCALE``.

    Returns
    -------
    stored : StoredKernel
        ``kernel, plate_scale, cards = read_kernel(path)``.  Divided by its sum, whatever that was, and row
        index upwards, whatever its ROWORDER.

    Raises
    ------
    FrameError
        If the file cannot be read, or holds no kernel.
    """
    kernel, header = read_image(Path(path))
    if fault := _fault(kernel):
        code, problem = fault
        raise FrameError(code, path, problem, "a kernel has odd sides, finite values and a positive sum")
    named = [header.get(name) for name in ("PIXELSCL", "GS_SCALE", "PIXSCALE")]
    scales = [float(s) for s in named if isinstance(s, int | float) and math.isfinite(s) and s > 0]
    return StoredKernel(kernel / kernel.sum(), scales[0] if scales else None, header)


def _fault(kernel: np.ndarray) -> tuple[ErrorCode, str] | None:
    """Return the code and the reason why an array is not a kernel, or None if it is one."""
    if kernel.ndim != 2 or 0 in kernel.shape:
        return ErrorCode.WRONG_SHAPE, f"has shape {kernel.shape}, not (ny, nx)"
    if kernel.shape[0] % 2 == 0 or kernel.shape[1] % 2 == 0:
        return ErrorCode.WRONG_SHAPE, f"has an even side in {kernel.shape}, so that no pixel is its centre"
    if not np.all(np.isfinite(kernel)):
        bad = int(np.sum(~np.isfinite(kernel)))
        return ErrorCode.OUT_OF_RANGE, f"is not finite in {bad} of its {kernel.size} pixels"
    return None if kernel.sum() > 0 else (ErrorCode.OUT_OF_RANGE, f"sums to {kernel.sum():.3g}")


def _is_on_pixels(estimate: KernelEstimate | Locus) -> bool:
    """Return whether an array of pixels was measured."""
    return isinstance(estimate, KernelEstimate) and estimate.locus is None and estimate.kernel is not None


def _undetermined(estimate: KernelEstimate | Locus | None) -> str:
    """Say why the blur is not known to be jitter; empty where it is."""
    return estimate.undetermined if isinstance(estimate, KernelEstimate) else ""


def _is_normal(estimate: KernelEstimate | Locus | None) -> bool:
    drawn = estimate.locus if isinstance(estimate, KernelEstimate) else estimate
    moments_only = isinstance(estimate, KernelEstimate) and estimate.kernel is None and drawn is None
    return isinstance(drawn, Mvn) or moments_only


def _origin(estimate: KernelEstimate | Locus) -> Cards:
    """Return the cards of a kernel's origin and of its accuracy."""
    if isinstance(estimate, Locus):
        return {"LOCUS": (locus_name(estimate), "jitter locus")}
    cards: Cards = {"METHOD": (estimate.method, "estimator")}
    if estimate.source:
        cards["SOURCE"] = (estimate.source, "data it was made from")
    if estimate.locus is not None:
        cards["LOCUS"] = (locus_name(estimate.locus), "jitter locus")
    if _is_on_pixels(estimate):  # the errors are of other moments
        return cards
    for axis, value in zip(("SXX", "SXY", "SYY"), estimate.errors, strict=True):
        cards[f"{axis}_ERR"] = (float(value), "[arcsec2] standard error")
    if estimate.kernel is None:
        try:
            remark = locus_of(estimate)[1]
        except UndeterminedError:
            remark = "no axis has a positive variance"
        cards |= {"REMARK": (remark, "")} if remark else {}
    return cards
