"""An estimate without a refit as one picture of three panels: the kernel, its evidence, what is left.

One call a kind of scene: :func:`plot_estimate` where there is a template, :func:`plot_field` for a field
of stars, :func:`plot_extended` for a scene without stars.  Each returns its three axes;
:func:`~jitterkit.report.plots.png` makes a file of any of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from jitterkit.errors import UndeterminedError
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.kernels import TransferRatio, kernel_transfer, locus_of, transfer_ratio
from jitterkit.loci import Mvn, locus_name
from jitterkit.report.field_plots import plot_differences, plot_scene, plot_spectrum, plot_whiskers
from jitterkit.report.kernel_plots import plot_kernel, plot_kernel_image, plot_transfer
from jitterkit.report.plots import note_in_axes, plot_residual, scale_and_unit, three_panels
from jitterkit.report.words import angle_size, number

Panels = list[Any]
"""Three ``matplotlib.axes.Axes``."""


def plot_estimate(
    estimate: KernelEstimate,
    image: np.ndarray,
    template: np.ndarray,
    model: np.ndarray,
    plate_scale: float,
    *,
    variance: np.ndarray | float,
    mask: np.ndarray | None = None,
) -> Panels:
    """Draw an estimate made with a template: the kernel, the transfer function with its fit, the residual.

    Parameters
    ----------
    estimate : KernelEstimate
    image : (ny, nx) array
        The frame, electrons.
    template, model : (ny, nx) array
        The expected image without jitter, and with the estimate's.  Their brightness is fitted.
    plate_scale : float
        arcsec per pixel.
    variance : (ny, nx) array or float
        Of the frame's noise.
    mask : (ny, nx) bool array, optional
        True where a pixel is unusable.

    Returns
    -------
    axes : list of three matplotlib.axes.Axes
    """
    axes = three_panels()
    used = np.isfinite(image) if mask is None else np.isfinite(image) & ~np.asarray(mask, bool)
    spread = np.where(used, np.maximum(np.broadcast_to(variance, image.shape), np.finfo(float).tiny), 1.0)
    level = np.sum((image * model / spread)[used]) / np.sum((model**2 / spread)[used])
    filled = np.where(used, image, level * model)
    _draw_kernel(estimate, axes[0], plate_scale)
    *_, angle = estimate.axes
    noise = np.where(used, spread, 0.0)
    ratios = _ratios(estimate, filled, template, plate_scale, noise, (angle, (angle + 90) % 180))
    if ratios:
        plot_transfer(ratios, axes[1])
    else:
        note_in_axes(axes[1], "no frequency rises\nabove the noise").set_axis_off()
    residual = np.where(used, (filled - level * model) / np.sqrt(spread), np.nan)
    rms = float(np.sqrt(np.nanmean(residual**2)))
    plot_residual(residual, plate_scale, axes[2], title=f"residual, rms {number(rms, 3)}σ")
    return axes


def plot_field(
    estimate: KernelEstimate,
    x: np.ndarray,
    y: np.ndarray,
    moments: np.ndarray,
    common: np.ndarray,
    shape: tuple[int, int],
    *,
    plate_scale: float | None = None,
) -> Panels:
    """Draw an estimate made from a field of stars: the kernel, every star's, and what they differ by.

    Parameters
    ----------
    estimate : KernelEstimate
        Of the motion that the stars have in common.
    x, y, moments, shape
        As in :func:`plot_whiskers`.
    common : (3,) array
        Mean of the stars' moments, measured as these are.
    plate_scale : float, optional
        arcsec per pixel; None where lengths are in pixels.

    Returns
    -------
    axes : list of three matplotlib.axes.Axes
        The third holds every star's moments about the common ones, as ``(Sxx - Syy)/2`` and ``Sxy``:
        one clump is one blur, a ring or a trail is optics that change over the field.
    """
    axes = three_panels()
    _, unit = scale_and_unit(plate_scale)
    _draw_kernel(estimate, axes[0], plate_scale)
    plot_whiskers(x, y, moments, shape, axes[1], unit=unit)
    plot_differences(moments, common, axes[2], unit=unit)
    return axes


def plot_extended(
    estimate: KernelEstimate,
    image: np.ndarray,
    deblurred: np.ndarray | None = None,
    *,
    plate_scale: float | None = None,
) -> Panels:
    """Draw an estimate made from a scene without stars: the kernel, the spectrum, and the scene.

    Parameters
    ----------
    estimate : KernelEstimate
    image : (ny, nx) array
    deblurred : (ny, nx) array, optional
        From :func:`jitterkit.kernels.deblur`; in its place the image as it is.
    plate_scale : float, optional
        arcsec per pixel; None where lengths are in pixels.

    Returns
    -------
    axes : list of three matplotlib.axes.Axes
    """
    axes = three_panels()
    _draw_kernel(estimate, axes[0], plate_scale)
    plot_spectrum(image, axes[1], plate_scale=plate_scale, locus=estimate.locus)
    shown, title = (image, "as taken") if deblurred is None else (deblurred, "deblurred")
    plot_scene(shown, axes[2], like=image, plate_scale=plate_scale, title=title)
    axes[2].set_ylabel("")
    return axes


def _draw_kernel(estimate: KernelEstimate, ax: Any, plate_scale: float | None) -> None:
    undetected = ", undetected" if estimate.is_undetected else ""
    if estimate.locus is None and estimate.kernel is not None:
        title = f"kernel: {estimate.method}{undetected}"
        plot_kernel_image(estimate.kernel, ax, plate_scale=plate_scale, title=title)
        return
    try:
        locus, remark = locus_of(estimate)
    except UndeterminedError:
        note_in_axes(ax, "no blur:\nno variance is positive").set_axis_off()
        return
    name = "normal with its moments" if estimate.locus is None else locus_name(locus)
    scale, unit = scale_and_unit(plate_scale)
    plot_kernel(locus, ax, plate_scale=scale, title=f"kernel: {name}", unit=unit)
    major, minor, angle = estimate.axes
    sizes = [angle_size(s, 3) if unit == "arcsec" else f"{s:.3g} {unit}" for s in (major, minor)]
    text = f"1σ: {sizes[0]}, {sizes[1]}; {angle:.0f}°" + (" (clipped)" if remark else "") + undetected
    ax.text(0.5, -0.04, text, transform=ax.transAxes, ha="center", va="top", fontsize=9)


def _ratios(estimate, image, template, plate_scale, variance, angles) -> list[TransferRatio]:
    """Along every angle, or nowhere where none rises above the noise."""
    common: Any = {"variance": variance, "transfer": _fit(estimate, plate_scale)}
    try:
        return [transfer_ratio(image, template, plate_scale, angle, **common) for angle in angles]
    except UndeterminedError:
        return []


def _fit(estimate: KernelEstimate, plate_scale: float) -> Callable:
    """Return the transfer function that was fitted; of moments with their signs, unclipped."""
    if estimate.locus is not None:
        return estimate.locus.transfer
    kernel = estimate.kernel
    if kernel is None:
        return Mvn.near(estimate.moments).transfer
    return lambda fx, fy: kernel_transfer(kernel, plate_scale, fx.ravel(), fy.ravel())
