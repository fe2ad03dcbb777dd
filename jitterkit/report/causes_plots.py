"""The picture of causes that widen an image alike: what each does to it, and how alike that is.

Reach for :func:`plot_causes`; :func:`plot_likeness` draws its matrix on your axes.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jitterkit.forecast.causes import Causes
from jitterkit.report.axes import INK, axes_or_new
from jitterkit.report.words import MINUS

_HALF = 12
"""Pixels about the brightest on each side."""


def plot_causes(causes: Causes) -> Figure:
    """Draw what every cause does to the image beside each other, and below how alike that is.

    Each change is that by as much blur as shows equally strongly, in sigmas of a pixel's photons and on one
    scale, about the brightest pixel: panels that look alike are taken for each other.
    """
    image, slopes = causes.setting.slopes(causes.locus)
    sigma = np.sqrt(np.maximum(image, 1e-6 * image.max()))
    window = _window(image)
    panels = [
        (slopes[cause.name] / sigma / blur)[window]
        for cause, blur in zip(causes.causes, causes.blurs, strict=True)
    ]
    largest = max(float(np.abs(panel).max()) for panel in panels)
    figure = Figure(figsize=(max(2.0 * len(panels), 6.0), 5.8), layout="constrained")
    grid = figure.add_gridspec(2, len(panels), height_ratios=(1.0, 1.7))
    axes = [figure.add_subplot(grid[0, k]) for k in range(len(panels))]
    for ax, cause, panel in zip(axes, causes.causes, panels, strict=True):
        picture = ax.imshow(panel / largest, origin="lower", cmap="RdBu_r", vmin=-1, vmax=1)
        ax.set_title(cause.words.replace(", ", ",\n"), fontsize=8)
        ax.set(xticks=[], yticks=[])
    figure.colorbar(picture, ax=axes, label="change, in sigmas", shrink=0.8, ticks=[-1, 0, 1])
    plot_likeness(causes, figure.add_subplot(grid[1, :]))
    return figure


def plot_likeness(causes: Causes, ax: Axes | None = None) -> Axes:
    """Draw the cosines between the changes that the causes make, the scene refitted to each."""
    ax = axes_or_new(ax, (5.4, 4.4))
    likeness = causes.information.likeness
    labels = [cause.words for cause in causes.causes]
    ax.imshow(likeness, cmap="RdBu_r", vmin=-1, vmax=1)
    for (row, column), value in np.ndenumerate(likeness):
        words = f"{round(value, 2) + 0.0:.2f}".replace("-", MINUS)
        ax.text(column, row, words, ha="center", va="center", fontsize=7,
                color="white" if abs(value) > 0.7 else INK)  # fmt: skip
    ax.set_xticks(range(len(labels)), labels, rotation=25, ha="right", fontsize=8)
    ax.set_yticks(range(len(labels)), labels, fontsize=8)
    ax.tick_params(length=0)
    ax.set_title("cosines between the changes: ±1 is one and the same", fontsize=9)
    return ax


def _window(image: np.ndarray) -> tuple[slice, slice]:
    peak = np.unravel_index(np.argmax(image), image.shape)
    rows, columns = (slice(max(0, int(p) - _HALF), int(p) + _HALF + 1) for p in peak)
    return rows, columns
