"""Pictures of frames, kernels and separations, on your axes or on their own.

Every function takes ``ax=None`` and returns the axes it drew on; their ``figure`` is a plain
matplotlib figure that no global state knows, so nothing needs closing and threads may draw at once.
Only this module and :mod:`~jitterkit.report.kernel_plots` import matplotlib.  The colours survive print
in grey and the common kinds of colour blindness: *viridis* and *cividis* rise steadily in brightness, and
the two ends of the residual's red and blue also differ in place and sign on the colour bar.
"""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
from astropy.table import QTable
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import AsinhNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle
from matplotlib.ticker import MaxNLocator
from scipy.ndimage import gaussian_filter

from jitterkit.loci import Locus, principal_axes, rasterise
from jitterkit.report.words import angle_size, angle_unit, number

__all__ = [
    "four_panels",
    "plot_image",
    "plot_kernel",
    "plot_residual",
    "plot_separations",
    "plot_stars",
    "png",
    "stretch",
    "three_panels",
]

BLUE, RUST, INK = "#1f4e79", "#b3421f", "#222222"
RESIDUAL_LIMIT = 5.0
KERNEL_CELLS = 81
KERNEL_SMOOTHING = 1.2  # cells; hides the lattice of a locus's points
MANY, BLOCKS = 300, 40  # points beyond which error bars turn into a haze, and how many means replace them


def _axes(ax: Axes | None, size: tuple[float, float]) -> Axes:
    return Figure(figsize=size, layout="constrained").subplots() if ax is None else ax


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
    ax = _axes(ax, (4.2, 3.6))
    ny, nx = image.shape
    scale, unit = (1.0, "pixel") if plate_scale is None else (plate_scale, "arcsec")
    extent = (-nx * scale / 2, nx * scale / 2, -ny * scale / 2, ny * scale / 2)
    colours = colormaps[cmap].with_extremes(bad="0.6")
    picture = ax.imshow(image, origin="lower", extent=extent, cmap=colours, norm=norm or stretch(image))
    ends = "both" if label.startswith("residual") else "neither"
    ax.figure.colorbar(picture, ax=ax, label=label, extend=ends, shrink=0.86, aspect=24, pad=0.02)
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
    ax = _axes(ax, (3.4, 3.6))
    ax.set(xticks=[], yticks=[], title=title, aspect="equal")
    points = np.asarray(locus.points(65536))
    if not np.all(np.isfinite(points)):
        ax.text(0.5, 0.5, "not finite", transform=ax.transAxes, ha="center", va="center")
        return ax
    reach = float(np.abs(points).max())
    half = 1.3 * reach if reach > 1e-9 else (plate_scale or 1.0)
    cell = 2 * half / KERNEL_CELLS
    density = gaussian_filter(rasterise(locus, cell, (KERNEL_CELLS, KERNEL_CELLS)), KERNEL_SMOOTHING)
    extent = (-half, half, -half, half)
    ax.imshow(density, origin="lower", extent=extent, cmap="cividis", interpolation="bilinear")
    major, minor, angle = principal_axes(locus.moments())
    if reach > 1e-9:
        width, height = (2 * math.hypot(axis, KERNEL_SMOOTHING * cell) for axis in (major, minor))
        ax.add_patch(Ellipse((0, 0), width, height, angle=angle, fill=False, ec="white", lw=0.9))
    if plate_scale is not None and plate_scale < 1.9 * half:
        corner = (-plate_scale / 2, -plate_scale / 2)
        ax.add_patch(Rectangle(corner, plate_scale, plate_scale, fill=False, ec="white", lw=0.9, ls=":"))
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


def plot_separations(table: QTable, ax: Axes | None = None, summary: dict[str, Any] | None = None) -> Axes:
    """Draw every frame's separation with its error about their weighted mean.

    Parameters
    ----------
    table : QTable
        Results, in the order to draw.
    ax : matplotlib.axes.Axes, optional
    summary : dict, optional
        From :func:`~jitterkit.report.summary.summarise`, for the mean and its 1 sigma band.

    Returns
    -------
    ax : matplotlib.axes.Axes
        Frames that failed are crosses along the lower edge.
    """
    ax = _axes(ax, (9.6, 3.4))
    values, errors = (table[name].to_value("arcsec") for name in ("separation", "separation_err"))
    good = (np.asarray(table["status"]) == "ok") & np.isfinite(values)
    frame = np.arange(len(table)) + 1
    centre, mean_error = _mean(summary, values[good])
    factor, unit = _unit_of(errors[good])
    if good.any():
        draw = _draw_frames if good.sum() <= MANY else _draw_many_frames
        draw(ax, frame[good], (values[good] - centre) * factor, errors[good] * factor)
        ax.set_ylabel(f"separation − {number(centre, 7)}″ [{unit}]")
    else:
        ax.text(0.5, 0.5, "no frame was fitted", transform=ax.transAxes, ha="center", va="center")
        ax.set_yticks([])
    if math.isfinite(mean_error):
        band = mean_error * factor
        ax.axhspan(-band, band, color=RUST, alpha=0.22, lw=0, zorder=1)
        ax.axhline(0, color=RUST, lw=1.2, zorder=4, label=f"weighted mean ± {angle_size(mean_error, 2)}")
    if not good.all():
        _draw_failures(ax, frame[~good])
    ax.set(xlabel="frame", xlim=(0.4, max(len(table), 1) + 0.6))
    ax.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    ax.spines[["top", "right"]].set_visible(False)
    if ax.get_legend_handles_labels()[0]:
        above: Any = {"loc": "lower left", "bbox_to_anchor": (0, 1.0), "borderaxespad": 0.2}
        ax.legend(ncols=4, frameon=False, fontsize=9, **above)
    return ax


def _draw_frames(ax: Axes, frame: np.ndarray, values: np.ndarray, errors: np.ndarray) -> None:
    label = f"{len(frame)} frames"
    ax.errorbar(frame, values, errors, fmt="o", color=BLUE, ms=4.5, elinewidth=0.9, zorder=2, label=label)


def _draw_many_frames(ax: Axes, frame: np.ndarray, values: np.ndarray, errors: np.ndarray) -> None:
    """Points without bars, which would be a haze, under the weighted means of consecutive blocks."""
    faint = max(0.04, min(0.5, 500 / len(frame)))
    ax.plot(frame, values, ".", color=BLUE, ms=3, mew=0, alpha=faint, zorder=2)
    blocks = [b for b in np.array_split(np.flatnonzero(errors > 0), BLOCKS) if len(b)]  # NaN is not > 0
    if not blocks:
        return
    weights = [errors[block] ** -2 for block in blocks]
    means = [np.average(values[block], weights=w) for block, w in zip(blocks, weights, strict=True)]
    bars = [np.sum(w) ** -0.5 for w in weights]
    label = f"{len(frame)} frames, means of {len(blocks[0])}"
    centres = [np.mean(frame[block]) for block in blocks]
    ax.errorbar(centres, means, bars, fmt="o", color=INK, ms=3.5, elinewidth=1.1, zorder=3, label=label)


def _draw_failures(ax: Axes, frame: np.ndarray) -> None:
    many = len(frame) > MANY
    style: Any = {"marker": "|", "ms": 4, "mew": 0.3} if many else {"marker": "x", "ms": 5, "mew": 1.2}
    style |= {"color": INK, "ls": "", "clip_on": False, "zorder": 4, "label": f"{len(frame)} failed"}
    ax.plot(frame, np.full(len(frame), 0.03), transform=ax.get_xaxis_transform(), **style)


def _mean(summary: dict[str, Any] | None, values: np.ndarray) -> tuple[float, float]:
    """Weighted mean and its error; the median without an error where there is no summary."""
    if summary is not None and math.isfinite(summary["separation"]["mean"]):
        return summary["separation"]["mean"], summary["separation"]["error"]
    return (float(np.median(values)) if len(values) else 0.0), math.nan


def _unit_of(errors: np.ndarray) -> tuple[float, str]:
    """How many of the unit in which errors [arcsec] have few digits make an arcsecond, and its name."""
    finite = errors[np.isfinite(errors)]
    factor, unit = angle_unit(float(np.median(finite)) if finite.size else 1.0)
    return factor, unit.strip().replace("″", "arcsec")


def four_panels() -> list[Axes]:
    """Four axes in a row: three images with their colour bars and a kernel."""
    figure = Figure(figsize=(11.4, 2.75), layout="constrained")
    return list(figure.subplots(1, 4, width_ratios=(1, 1, 1, 0.95)))


def three_panels() -> list[Axes]:
    """Three axes in a row: a kernel, what it was read from, and what is left."""
    figure = Figure(figsize=(11.4, 3.4), layout="constrained")
    return list(figure.subplots(1, 3, width_ratios=(0.9, 1.1, 1.1)))
