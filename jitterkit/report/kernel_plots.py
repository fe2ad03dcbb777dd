"""Pictures of a kernel: as a locus, on its own pixels, and as a transfer function.

Reach for :func:`plot_kernel` for a locus, for :func:`plot_kernel_image` where an estimator has returned
pixels, and for :func:`plot_transfer` to see what the data say at each frequency.  As in
:mod:`~jitterkit.report.plots`, every function takes ``ax=None`` and returns the axes it drew on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial, reduce
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.patches import Ellipse, Rectangle
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve

from jitterkit.kernels import TransferRatio, kernel_moments
from jitterkit.loci import Locus, Product, principal_axes, rasterise
from jitterkit.report.plots import BLUE, INK, OUTLINE, RUST, axes_or_new, finish, note_in_axes, plot_image
from jitterkit.report.words import angle_size, number

_CELLS = 81
"""Of the raster on which a locus is drawn, along a side."""

_SMOOTHING = 1.2
"""Cells; hides the lattice of a locus's points."""

_SURE = 0.05
"""Standard error of a point that has a say in the picture's scale."""


def plot_kernel(
    locus: Locus,
    ax: Axes | None = None,
    *,
    plate_scale: float | None = None,
    title: str = "",
    unit: str = "arcsec",
) -> Axes:
    """Draw where the pointing was during the exposure.

    Parameters
    ----------
    locus : Locus
    ax : matplotlib.axes.Axes, optional
    plate_scale : float, optional
        arcsec per pixel; then a dotted square shows one pixel, where it fits in.
    title : str
    unit : str
        Of the locus's sizes: "pixel" where the image's scale is unknown.

    Returns
    -------
    ax : matplotlib.axes.Axes
        The share of time on a fine raster, a little smoothed; the 1 sigma ellipse of what is drawn,
        so that a streak's is thin but not hidden on it; a bar for the scale.
    """
    ax = axes_or_new(ax, (3.4, 3.6))
    ax.set(xticks=[], yticks=[], title=title, aspect="equal")
    parts = locus.factors() if isinstance(locus, Product) else (locus,)
    points = [np.asarray(part.points(65536)) for part in parts]
    if not all(np.all(np.isfinite(part)) for part in points):
        return note_in_axes(ax, "not finite")
    reach = sum(float(np.abs(part).max()) for part in points)
    half = 1.3 * reach if reach > 1e-9 else (plate_scale or 1.0)
    cell = 2 * half / _CELLS
    rasters = (
        rasterise(part, cell, (_CELLS, _CELLS)) for part in parts
    )  # points of all at once show stripes
    density = gaussian_filter(reduce(partial(fftconvolve, mode="same"), rasters), _SMOOTHING)
    extent = (-half, half, -half, half)
    ax.imshow(density, origin="lower", extent=extent, cmap="cividis", interpolation="bilinear")
    major, minor, angle = principal_axes(locus.moments())
    if reach > 1e-9:
        width, height = (2 * math.hypot(axis, _SMOOTHING * cell) for axis in (major, minor))
        ax.add_patch(Ellipse((0, 0), width, height, angle=angle, **OUTLINE))
    if plate_scale is not None and plate_scale < 1.9 * half:
        corner = (-plate_scale / 2, -plate_scale / 2)
        ax.add_patch(Rectangle(corner, plate_scale, plate_scale, ls=":", **OUTLINE))
    _scale_bar(ax, half, unit)
    return ax


def _scale_bar(ax: Axes, half: float, unit: str) -> None:
    """A bar of a round length, at most two fifths of the width."""
    decade = 10.0 ** math.floor(math.log10(half))
    length = max(m * decade for m in (0.1, 0.2, 0.5, 1, 2, 5) if m * decade <= 0.8 * half)
    left, low = -0.92 * half, -0.9 * half
    ax.plot([left, left + length], [low, low], color="white", lw=2.2, solid_capstyle="butt")
    size = angle_size(length, 1) if unit == "arcsec" else f"{length:g} {unit}"
    ax.text(left, low + 0.04 * half, size, color="white", fontsize=8, va="bottom")


def plot_kernel_image(
    kernel: np.ndarray, ax: Axes | None = None, *, plate_scale: float | None = None, title: str = ""
) -> Axes:
    """Draw a kernel on its own pixels with the 1 sigma ellipse of its moments.

    Parameters
    ----------
    kernel : (ny, nx) array
    ax : matplotlib.axes.Axes, optional
    plate_scale : float, optional
        arcsec per pixel of the kernel; without it the axes count pixels.
    title : str

    Returns
    -------
    ax : matplotlib.axes.Axes
        From the most negative pixel to the peak.
    """
    norm = Normalize(min(float(kernel.min()), 0.0), float(kernel.max()))
    ax = plot_image(kernel, plate_scale, ax, norm=norm, cmap="cividis", label="share", title=title)
    major, minor, angle = principal_axes(kernel_moments(kernel, plate_scale or 1.0))
    ax.add_patch(Ellipse((0, 0), 2 * major, 2 * minor, angle=angle, **OUTLINE))
    return ax


def plot_transfer(ratios: Sequence[TransferRatio], ax: Axes | None = None) -> Axes:
    """Draw measured transfer functions with their fits.

    Parameters
    ----------
    ratios : sequence of TransferRatio
        One an axis, the major one first.
    ax : matplotlib.axes.Axes, optional

    Returns
    -------
    ax : matplotlib.axes.Axes
        Points with error bars and a line each; filled and solid for the first axis, open and dashed for
        the second, so that they differ without their colours.
    """
    ax = axes_or_new(ax, (4.6, 3.4))
    styles: Any = zip(ratios, (RUST, BLUE, INK), ("o", "s", "^"), ("-", "--", ":"), strict=False)
    for i, (ratio, colour, marker, line) in enumerate(styles):
        label, inside = f"along {number(ratio.angle, 3)}°", "white" if i else colour
        bars: Any = {"fmt": marker, "ms": 4, "elinewidth": 0.8, "color": colour, "mfc": inside, "zorder": 2}
        ax.errorbar(ratio.frequency, ratio.measured, ratio.error, label=label, **bars)
        if ratio.fitted is not None:
            ax.plot(ratio.frequency, ratio.fitted, line, color=colour, lw=1.4, zorder=3)
    shown = np.concatenate([r.measured[r.error < _SURE] for r in ratios] + [np.ones(1)])
    low = 0.0 if shown.min() < 0.6 else float(shown.min()) - 0.05  # a small blur is a small dip
    ax.axhline(1, color="0.75", lw=0.8, zorder=1)
    ax.set(xlabel="frequency [cycles/arcsec]", ylabel="|M|", title="transfer function")
    ax.set(xlim=(0, None), ylim=(low, min(float(shown.max()) + 0.05, 1.6)))
    return finish(ax, loc="lower left")
