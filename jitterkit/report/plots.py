"""Pictures of frames, on your axes or on their own.

Every function takes ``ax=None`` and returns the axes it drew on; their ``figure`` is a plain matplotlib
figure that no global state knows, so nothing needs closing and threads may draw at once.  Reach for
:func:`plot_image` for anything on a frame's pixels, for :func:`axes_or_new`, with which a function of
this package begins, and for :func:`note_in_axes` where there is nothing to draw; the neighbours
``kernel_plots``, ``time_plots`` and ``field_plots`` draw what was measured.  Only these and this module
import matplotlib.  The colours survive print in grey and the common kinds of colour blindness:
*viridis* and *cividis* rise steadily in brightness; the two ends of the residual's red and blue also
differ in place and sign on the colour bar.
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
from matplotlib.ticker import MaxNLocator
from PIL import Image
from scipy.spatial import cKDTree

from jitterkit.report.words import angle_unit, short_number

BLUE, RUST, INK = "#1f4e79", "#b3421f", "#222222"
OUTLINE: Any = {"fill": False, "ec": "white", "lw": 0.9}
"""Of a patch on a dark kernel."""

ABOVE: Any = {"loc": "lower left", "bbox_to_anchor": (0, 1.0), "borderaxespad": 0.2, "columnspacing": 1.3}
"""Of a legend in one line above its axes."""


def axes_or_new(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """Return the axes given, or those of a new figure of so many inches that no global state knows."""
    return Figure(figsize=size, layout="constrained").subplots() if ax is None else ax


def panels(size: tuple[float, float], rows: int, columns: int, **layout: Any) -> list[Axes]:
    """Return the axes of a new figure of so many inches, row by row; ``layout`` as for its ``subplots``."""
    figure = Figure(figsize=size, layout="constrained")
    return figure.subplots(rows, columns, squeeze=False, **layout).ravel().tolist()


def scale_and_unit(plate_scale: float | None) -> tuple[float, str]:
    """Size of a pixel and the unit it is in: the plate scale [arcsec], or one pixel where there is none."""
    return (1.0, "pixel") if plate_scale is None else (plate_scale, "arcsec")


def suited_angle(sizes: np.ndarray) -> tuple[float, str]:
    """Return how many of the unit that suits the middle one of some sizes make an arcsecond, and its name."""
    factor, unit = angle_unit(float(np.median(sizes)))
    return factor, unit.strip().replace("″", "arcsec")


_APART = 0.1
"""Share of a colour bar by which two ticks differ at least: their labels have half of it."""


def colour_bar(picture: Any, ax: Axes, label: str, extend: str = "neither") -> None:
    """Put a colour bar beside a picture; ``extend`` says which ends are pointed."""
    ax.figure.colorbar(picture, ax=ax, label=label, extend=extend, shrink=0.86, aspect=24, pad=0.02)
    _set_ticks(picture)


def _set_ticks(picture: Any) -> None:
    """Put ticks on the colour bar of a stretched picture; matplotlib's cover each other about zero."""
    if isinstance(picture.norm, AsinhNorm):
        ticks = _round_numbers(picture.norm)
        picture.colorbar.set_ticks(ticks, labels=[short_number(tick) for tick in ticks])
        picture.colorbar.minorticks_off()


def _round_numbers(norm: Normalize) -> list[float]:
    """Return numbers on a scale that lie apart from each other: zero, powers of ten, and what is between."""
    low, high = float(norm.vmin or 0.0), float(norm.vmax or 0.0)
    decades = 10.0 ** (np.floor(np.log10(max(-low, high))) - np.arange(6))
    powers = [sign * factor * decade for factor in (1, 2, 5) for decade in decades for sign in (1, -1)]
    kept: list[float] = []
    for tick in (0.0, *powers, *MaxNLocator(4).tick_values(low, high)):
        if low <= tick <= high and all(abs(norm(tick) - norm(other)) > _APART for other in kept):
            kept.append(float(tick))
    return sorted(kept)


def finish(ax: Axes, **legend: Any) -> Axes:
    """Hide the upper and the right spine, and explain what has a label in a legend."""
    ax.spines[["top", "right"]].set_visible(False)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(**{"facecolor": "white", "edgecolor": "none", "fontsize": 8} | legend)
    return ax


def note_in_axes(ax: Axes, text: str) -> Axes:
    """Put a sentence in the middle of axes, where there is nothing to draw."""
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center")
    return ax


RESIDUAL_LIMIT = 5.0
_MAPS = ("viridis", "cividis", "RdBu_r")
_COARSE = 400
"""Pixels a side up to which an image is drawn with square pixels; smoothing them would treble the file."""


def png(ax: Axes, dpi: float = 130.0) -> bytes:
    """Encode the figure of some axes as PNG."""
    figure: Any = ax.figure
    buffer = io.BytesIO()
    FigureCanvasAgg(figure).print_figure(buffer, format="png", dpi=dpi, facecolor="white")
    return buffer.getvalue()


def small_png(ax: Axes) -> bytes:
    """Encode the figure of some axes in the colours of this module alone, at a sixth of the size.

    Notes
    -----
    Every pixel takes the nearest of 64 steps of each colour map and of grey: a step of a residual is
    0.16 sigma.  A palette chosen by the picture's own colours would lose the rare ones, which are the ends
    of the scale.
    """
    figure: Any = ax.figure
    figure.set(dpi=130.0, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return _in_few_colours(np.asarray(canvas.buffer_rgba()))


def _in_few_colours(rgba: np.ndarray) -> bytes:
    """Encode an image (ny, nx, 4) in the palette.

    Apart from the drawing, in which exceptions keep the arrays of all callers until garbage is collected.
    """
    pixels = rgba[..., :3].astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    indices = np.zeros(1 << 24, np.uint8)  # to sort the pixels instead takes several times as long
    indices[pixels] = 1
    colours = np.flatnonzero(indices)
    rgb = np.stack([colours >> 16, colours >> 8 & 255, colours & 255], axis=1)
    palette = _palette()
    indices[colours] = cKDTree(palette).query(rgb)[1]
    small = Image.fromarray(indices[pixels], "P")
    small.putpalette(palette.astype(np.uint8).ravel().tolist())
    buffer = io.BytesIO()
    small.save(buffer, "png")
    return buffer.getvalue()


def _palette() -> np.ndarray:
    """256 colours, (256, 3) int."""
    steps = np.linspace(0, 1, 64)
    maps = [colormaps[name](steps)[:, :3] for name in (*_MAPS, "gray")]
    return np.rint(255 * np.concatenate(maps)).astype(np.int64)


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
    drawn: Any = {"interpolation": "nearest" if max(image.shape) <= _COARSE else "auto"}
    drawn |= {"cmap": colours, "norm": norm or stretch(image)}
    picture = ax.imshow(image, origin="lower", extent=extent, **drawn)
    colour_bar(picture, ax, label, "both" if label.startswith("residual") else "neither")
    ax.set(xlabel=f"x [{unit}]", ylabel=f"y [{unit}]", title=title)
    return ax


def change_image(ax: Axes, image: np.ndarray, norm: Normalize | None = None) -> None:
    """Draw another image, of the same shape, on the axes of :func:`plot_image`."""
    ax.images[0].set_data(image)
    if norm is not None:
        ax.images[0].set_norm(norm)
        _set_ticks(ax.images[0])


def plot_residual(
    residual: np.ndarray, plate_scale: float | None = None, ax: Axes | None = None, *, title: str = "residual"
) -> Axes:
    """Draw ``(data - model)/sigma`` from -5 (blue: the model is too bright) to +5 (red)."""
    norm = Normalize(-RESIDUAL_LIMIT, RESIDUAL_LIMIT)
    return plot_image(residual, plate_scale, ax, norm=norm, cmap="RdBu_r", label="residual [σ]", title=title)


def plot_stars(x: Any, y: Any, ax: Axes, letters: str = "AB") -> Axes:
    """Mark fitted stars with open circles: the first by letters, the others by their numbers in the table."""
    width = abs(np.subtract(*ax.get_xlim()))
    x, y = np.asarray(x), np.asarray(y)
    names = [*letters, *map(str, range(len(letters) + 1, len(x) + 1))][: len(x)]
    for letter, at_x, at_y in zip(names, x, y, strict=True):
        style: Any = {"color": "white", "fontsize": 8, "ha": "left", "va": "bottom", "clip_on": True}
        ax.plot(at_x, at_y, "o", ms=7, mfc="none", mec="white", mew=0.8, scalex=False, scaley=False)
        ax.text(at_x + 0.025 * width, at_y + 0.015 * width, letter, **style)
    return ax


def four_panels() -> list[Axes]:
    """Four axes in a row: three images with their colour bars and a kernel."""
    figure = Figure(figsize=(11.4, 2.75))  # a run draws a hundred; a constrained layout takes longer than all
    around = {"left": 0.06, "right": 0.99, "bottom": 0.16, "top": 0.9, "wspace": 0.27}
    return list(figure.subplots(1, 4, width_ratios=(1, 1, 1, 0.78), gridspec_kw=around))


def three_panels() -> list[Axes]:
    """Three axes in a row: a kernel, what it was read from, and what is left."""
    return panels((11.4, 3.4), 1, 3, width_ratios=(0.9, 1.1, 1.1))
