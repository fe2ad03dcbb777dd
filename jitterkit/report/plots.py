"""Pictures of frames, on your axes or on their own.

Every function takes ``ax=None`` and returns the axes it drew on; their ``figure`` is a plain
matplotlib figure that no global state knows, so nothing needs closing and threads may draw at once.
Reach for :func:`plot_image` for anything on a frame's pixels; the neighbours ``kernel_plots``,
``separation_plots``, ``field_plots`` and ``scene_plots`` draw what was measured.  Only these, this module and
:mod:`~jitterkit.report.axes` import matplotlib.  *viridis* and *cividis* rise
steadily in brightness; the two ends of the residual's red and blue also differ in place and sign on the
colour bar.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import AsinhNorm, Normalize
from matplotlib.figure import Figure

from jitterkit.report.axes import axes_or_new, colour_bar, scale_and_unit

__all__ = [
    "four_panels",
    "plot_image",
    "plot_residual",
    "plot_stars",
    "png",
    "stretch",
    "three_panels",
]

RESIDUAL_LIMIT = 5.0


def png(ax: Axes, dpi: float = 130.0) -> bytes:
    """Encode the figure of some axes as PNG."""
    figure: Any = ax.figure
    buffer = io.BytesIO()
    FigureCanvasAgg(figure).print_figure(buffer, format="png", dpi=dpi, facecolor="white")
    return buffer.getvalue()


def stretch(image: np.ndarray) -> Normalize:
    """Scale that shows the wings of a star and the noise as well as the core.

    Parameters
    ----------
    image : (ny, nx) array
        NaN is left out.

    Returns
    -------
    norm : AsinhNorm
        From the faintest percent to the brightest pixel; linear below twice the image's typical
        deviation from its median, logarithmic above.
    """
    finite = image[np.isfinite(image)]
    low, high = (float(np.percentile(finite, 1)), float(finite.max())) if finite.size else (0.0, 1.0)
    if not high > low:
        low, high = low - 0.5, low + 0.5
    noise = 1.4826 * float(np.median(np.abs(finite - np.median(finite)))) if finite.size else 1.0
    return AsinhNorm(max(2 * noise, 2e-4 * (high - low)), vmin=low, vmax=high)


def plot_image(
    image: np.ndarray,
    plate_scale: float | None = None,
    ax: Axes | None = None,
    *,
    norm: Normalize | None = None,
    cmap: str = "viridis",
    label: str = "electrons",
    title: str = "",
) -> Axes:
    """Draw a frame or a model.

    Parameters
    ----------
    image : (ny, nx) array
        NaN is drawn in grey.
    plate_scale : float, optional
        arcsec per pixel; without it the axes count pixels.
    ax : matplotlib.axes.Axes, optional
    norm : Normalize, optional
        By default :func:`stretch`; hand the data's to the model's, and they can be compared.
    cmap, label, title : str
        Colours, what the colour bar says, and the heading.

    Returns
    -------
    ax : matplotlib.axes.Axes
        Offsets from the frame's centre, row index upwards.
    """
    ax = axes_or_new(ax, (4.2, 3.6))
    ny, nx = image.shape
    scale, unit = scale_and_unit(plate_scale)
    extent = (-nx * scale / 2, nx * scale / 2, -ny * scale / 2, ny * scale / 2)
    colours = colormaps[cmap].with_extremes(bad="0.6")
    picture = ax.imshow(image, origin="lower", extent=extent, cmap=colours, norm=norm or stretch(image))
    colour_bar(picture, ax, label, "both" if label.startswith("residual") else "neither")
    ax.set(xlabel=f"x [{unit}]", ylabel=f"y [{unit}]", title=title)
    return ax


def plot_residual(
    residual: np.ndarray, plate_scale: float | None = None, ax: Axes | None = None, *, title: str = "residual"
) -> Axes:
    """Draw ``(data - model)/sigma`` from -5 (blue: the model is too bright) to +5 (red)."""
    norm = Normalize(-RESIDUAL_LIMIT, RESIDUAL_LIMIT)
    return plot_image(residual, plate_scale, ax, norm=norm, cmap="RdBu_r", label="residual [σ]", title=title)


def plot_stars(x: Any, y: Any, ax: Axes) -> Axes:
    """Mark fitted stars with open circles and their letters, A first."""
    width = abs(np.subtract(*ax.get_xlim()))
    for letter, at_x, at_y in zip("AB", np.asarray(x), np.asarray(y), strict=False):
        style: Any = {"color": "white", "fontsize": 8, "ha": "left", "va": "bottom", "clip_on": True}
        ax.plot(at_x, at_y, "o", ms=7, mfc="none", mec="white", mew=0.8, scalex=False, scaley=False)
        ax.text(at_x + 0.025 * width, at_y + 0.015 * width, letter, **style)
    return ax


def four_panels() -> list[Axes]:
    """Four axes in a row: three images with their colour bars and a kernel."""
    figure = Figure(figsize=(11.4, 2.75), layout="constrained")
    return list(figure.subplots(1, 4, width_ratios=(1, 1, 1, 0.95)))


def three_panels() -> list[Axes]:
    """Three axes in a row: a kernel, what it was read from, and what is left."""
    figure = Figure(figsize=(11.4, 3.4), layout="constrained")
    return list(figure.subplots(1, 3, width_ratios=(0.9, 1.1, 1.1)))
