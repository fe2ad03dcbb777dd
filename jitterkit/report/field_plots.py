"""Pictures of a field of stars, with the blur of each where it stands, and of a scene without stars.

Reach for :func:`plot_whiskers`, a map of the field, to see whether the blur is the same everywhere, and
for :func:`plot_differences` to see what is not.  :func:`plot_spectrum` shows the nulls from which a
blind estimate is made, and :func:`plot_scene` draws a scene in grey.  As in
:mod:`~jitterkit.report.plots`, all take ``ax=None`` and return the axes they drew on.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import Normalize

from jitterkit.loci import Locus, principal_axes
from jitterkit.report.plots import (
    BLUE,
    INK,
    RUST,
    axes_or_new,
    colour_bar,
    finish,
    note_in_axes,
    plot_image,
    scale_and_unit,
)
from jitterkit.report.words import angle_size

_WHISKER = 0.04
"""Half-length of the median whisker, in widths of the field."""


def plot_whiskers(
    x: np.ndarray,
    y: np.ndarray,
    moments: np.ndarray,
    shape: tuple[int, int],
    ax: Axes | None = None,
    *,
    unit: str = "arcsec",
) -> Axes:
    """Draw the blur of every star of a field where the star is.

    Parameters
    ----------
    x, y : (n,) array
        Pixels from the centre of the first.
    moments : (n, 3) array
        ``(Sxx, Sxy, Syy)`` of each, in ``unit²``; stars with a value that is not finite are left out.
    shape : (int, int)
        Of the frame, ``(ny, nx)``.
    ax : matplotlib.axes.Axes, optional
    unit : str
        Of length.

    Returns
    -------
    ax : matplotlib.axes.Axes
        A whisker of two sigma along each star's major axis within its 1 sigma ellipse, all enlarged alike;
        the bar above the field says by how much.
    """
    ax = axes_or_new(ax, (4.2, 3.6))
    ny, nx = shape
    ax.set(xlim=(-0.5, nx - 0.5), ylim=(-0.5, ny - 0.5), aspect="equal", title="stars")
    ax.set(xlabel="x [pixel]", ylabel="y [pixel]")
    x, y, moments = (np.asarray(a, float) for a in (x, y, moments))
    good = np.isfinite(x) & np.isfinite(y) & np.all(np.isfinite(moments), axis=1)
    axes = np.array([principal_axes(m) for m in moments[good]]).reshape(-1, 3)
    typical = float(np.median(axes[:, 0])) if len(axes) else 0.0
    if not typical > 0:
        return note_in_axes(ax, "no star shows a blur")
    grown = _WHISKER * max(nx, ny) / typical
    _draw_stars(ax, x[good], y[good], grown * axes[:, :2], axes[:, 2])
    size = angle_size(typical, 2) if unit == "arcsec" else f"{typical:.2g} {unit}"
    bar: Any = {"transform": ax.get_xaxis_transform(), "clip_on": False}
    ax.plot([0, grown * typical], [1.03, 1.03], color=INK, lw=1.6, solid_capstyle="butt", **bar)
    ax.text(1.3 * grown * typical, 1.03, f"1σ = {size}", fontsize=8, va="center", **bar)
    return ax


def _draw_stars(ax: Axes, x: np.ndarray, y: np.ndarray, sizes: np.ndarray, angle: np.ndarray) -> None:
    """An ellipse and a whisker a star, from semi-axes (n, 2) in pixels and degrees (n,)."""
    where: Any = {"units": "xy", "offsets": np.c_[x, y], "transOffset": ax.transData}
    major, minor = 2 * sizes.T
    ax.add_collection(EllipseCollection(major, minor, angle, fc="none", ec=BLUE, lw=0.7, alpha=0.8, **where))
    dx, dy = (sizes[:, 0] * f(np.radians(angle)) for f in (np.cos, np.sin))
    ends = np.stack([x - dx, x + dx]), np.stack([y - dy, y + dy])
    ax.plot(*ends, color=RUST, lw=1.4, solid_capstyle="butt", scalex=False, scaley=False)


def plot_differences(
    moments: np.ndarray, common: np.ndarray, ax: Axes | None = None, *, unit: str = "arcsec"
) -> Axes:
    """Draw how the stars of a field differ from the blur they share.

    Parameters
    ----------
    moments : (n, 3) array
        ``(Sxx, Sxy, Syy)`` of each star, in ``unit²``.
    common : (3,) array
        Of the shared blur; the cross.
    ax : matplotlib.axes.Axes, optional
    unit : str
        Of length.

    Returns
    -------
    ax : matplotlib.axes.Axes
        ``(Sxx - Syy)/2`` and ``Sxy``: one clump is one blur; a ring or a trail is optics that change over
        the field.
    """
    ax = axes_or_new(ax, (3.8, 3.6))
    sxx, sxy, syy = (np.asarray(moments, float) - common).T
    across = (sxx - syy) / 2
    ax.plot(across, sxy, "o", color=BLUE, ms=4, mew=0, alpha=0.7)
    ax.plot(0, 0, "+", color=RUST, ms=12, mew=1.5)
    reach = 1.1 * float(np.nanmax(np.abs(np.r_[across, sxy, 1e-12])))
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", title="stars less common blur")
    ax.set(xlabel=f"Δ(Sxx − Syy)/2 [{unit}²]", ylabel=f"ΔSxy [{unit}²]")
    return finish(ax)


_FAINTEST = 1e-12
"""Of the greatest power: below, a spectrum holds rounding errors."""


def plot_spectrum(
    image: np.ndarray,
    ax: Axes | None = None,
    *,
    plate_scale: float | None = None,
    locus: Locus | None = None,
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
    ax.set(xlabel=f"fx [cycles/{unit}]", ylabel="fy", title="power spectrum", aspect="equal")
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
    title: str = "",
) -> Axes:
    """Draw a scene without stars in grey, on the scale of another image (``like``) where one is given."""
    scene = image if like is None else like
    low, high = (float(v) for v in np.nanpercentile(scene, [0.5, 99.5]))
    norm = Normalize(low, high if high > low else low + 1)
    return plot_image(image, plate_scale, ax, norm=norm, cmap="gray", label="brightness", title=title)
