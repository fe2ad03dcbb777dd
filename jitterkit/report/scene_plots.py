"""Pictures of a scene without stars: its power spectrum, and itself with and without the blur.

Reach for :func:`plot_spectrum` to see the nulls from which a blind estimate is made, and for
:func:`plot_scene` to draw the scene in grey.  As in :mod:`~jitterkit.report.plots`, both take ``ax=None``
and return the axes they drew on.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize

from jitterkit.loci import Locus
from jitterkit.report.axes import axes_or_new, colour_bar, scale_and_unit
from jitterkit.report.plots import plot_image

_FAINTEST = 1e-12
"""Of the greatest power: below, a spectrum holds rounding errors."""


def plot_spectrum(
    image: np.ndarray,
    ax: Axes | None = None,
    *,
    plate_scale: float | None = None,
    locus: Locus | None = None,
    title: str = "power spectrum",
) -> Axes:
    """Draw an image's log power spectrum with the nulls that a blur would cut into it.

    Parameters
    ----------
    image : (ny, nx) array
        NaN is taken as the mean.
    ax : matplotlib.axes.Axes, optional
    plate_scale : float, optional
        arcsec per pixel; without it frequencies count cycles per pixel.
    locus : Locus, optional
        In the unit of the plate scale.  Dashed lines where its transfer function changes sign.
    title : str

    Returns
    -------
    ax : matplotlib.axes.Axes
        Zero frequency in the middle, both axes up to the Nyquist frequency.
    """
    scale, unit = scale_and_unit(plate_scale)
    level = np.where(np.isfinite(image), image, np.nanmean(image)) - np.nanmean(image)
    window = np.outer(*(np.hanning(n + 1)[:-1] for n in level.shape))
    power = np.fft.fftshift(np.abs(np.fft.fft2(level * window)) ** 2)
    power = np.log10(np.maximum(power, _FAINTEST * power.max() + np.finfo(float).tiny))
    ax = axes_or_new(ax, (4.2, 3.6))
    limit = 0.5 / scale
    low, high = np.percentile(power, [1, 99.9])
    (down, up), (left, right) = (_edges(n, scale) for n in power.shape)
    extent = (left, right, down, up)
    picture = ax.imshow(power, origin="lower", extent=extent, cmap="viridis", vmin=low, vmax=high)
    colour_bar(picture, ax, "log₁₀ power")
    ax.set(xlabel=f"fx [cycles/{unit}]", ylabel="fy", title=title, aspect="equal")
    if locus is not None:
        _draw_nulls(ax, locus, limit)
    return ax


def _edges(n: int, scale: float) -> tuple[float, float]:
    """Outer edges of ``n`` shifted frequencies, whose zero is a sample."""
    f = np.fft.fftshift(np.fft.fftfreq(n, scale))
    return float(f[0] - 0.5 / n / scale), float(f[-1] + 0.5 / n / scale)


def _draw_nulls(ax: Axes, locus: Locus, limit: float) -> None:
    f = np.linspace(-limit, limit, 257)
    transfer = np.asarray(locus.transfer(f[None, :], f[:, None])) * np.ones((f.size, f.size))
    if np.isrealobj(transfer) and transfer.min() < 0:  # a lopsided path has no nulls, only lows
        ax.contour(f, f, transfer, levels=[0.0], colors="white", linewidths=0.9, linestyles="dashed")


def plot_scene(
    image: np.ndarray,
    ax: Axes | None = None,
    *,
    like: np.ndarray | None = None,
    plate_scale: float | None = None,
    label: str = "brightness",
    title: str = "",
) -> Axes:
    """Draw a scene without stars in grey, on the scale of another image (``like``) where one is given."""
    scene = image if like is None else like
    low, high = (float(v) for v in np.nanpercentile(scene, [0.5, 99.5]))
    norm = Normalize(low, high if high > low else low + 1)
    return plot_image(image, plate_scale, ax, norm=norm, cmap="gray", label=label, title=title)
