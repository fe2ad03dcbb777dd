"""Pictures of blurs: kernels on pixels, transfer functions, stars of a field, spectra, deblurred scenes.

As in :mod:`~jitterkit.report.plots`, every function takes ``ax=None`` and returns the axes it drew on.
:mod:`~jitterkit.report.estimate_pictures` puts three of them side by side, one call an estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from jitterkit.kernels import TransferRatio, kernel_moments
from jitterkit.loci import Locus, principal_axes
from jitterkit.report.plots import BLUE, INK, RUST, plot_image, stretch
from jitterkit.report.words import angle_size, number

__all__ = [
    "plot_deblurred",
    "plot_differences",
    "plot_kernel_image",
    "plot_scene",
    "plot_spectrum",
    "plot_transfer",
    "plot_whiskers",
    "say",
]

_WHISKER = 0.04
"""Half-length of the median whisker, in widths of the field."""

_SURE = 0.05
"""Standard error of a point that has a say in the picture's scale."""

_FAINTEST = 1e-12
"""Of the greatest power: below, a spectrum holds rounding errors."""


def _alone(ax: Axes | None, size: tuple[float, float]) -> Axes:
    return Figure(figsize=size, layout="constrained").subplots() if ax is None else ax


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
    ax = plot_image(
        kernel, plate_scale, _alone(ax, (4.2, 3.6)), norm=norm, cmap="cividis", label="share", title=title
    )
    major, minor, angle = principal_axes(kernel_moments(kernel, plate_scale or 1.0))
    ax.add_patch(Ellipse((0, 0), 2 * major, 2 * minor, angle=angle, fill=False, ec="white", lw=0.9))
    return ax


def plot_transfer(
    ratios: Sequence[TransferRatio],
    ax: Axes | None = None,
    *,
    unit: str = "arcsec",
    title: str = "transfer function",
) -> Axes:
    """Draw measured transfer functions with their fits.

    Parameters
    ----------
    ratios : sequence of TransferRatio
        One an axis, the major one first.
    ax : matplotlib.axes.Axes, optional
    unit : str
        Of length.
    title : str

    Returns
    -------
    ax : matplotlib.axes.Axes
        Points with error bars and a line each; filled and solid for the first axis, open and dashed for
        the second, so that they differ without their colours.
    """
    ax = _alone(ax, (4.6, 3.4))
    styles: Any = zip(ratios, (RUST, BLUE, INK), ("o", "s", "^"), ("-", "--", ":"), strict=False)
    for i, (ratio, colour, marker, line) in enumerate(styles):
        bars: Any = {
            "fmt": marker,
            "ms": 4,
            "elinewidth": 0.8,
            "color": colour,
            "mfc": "white" if i else colour,
        }
        label = f"along {number(ratio.angle, 3)}°"
        ax.errorbar(ratio.frequency, ratio.measured, ratio.error, label=label, zorder=2, **bars)
        if ratio.fitted is not None:
            ax.plot(ratio.frequency, ratio.fitted, line, color=colour, lw=1.4, zorder=3)
    shown = np.concatenate([r.measured[r.error < _SURE] for r in ratios] + [np.ones(1)])
    low = 0.0 if shown.min() < 0.6 else float(shown.min()) - 0.05  # a small blur is a small dip
    ax.axhline(1, color="0.75", lw=0.8, zorder=1)
    ax.set(xlabel=f"frequency [cycles/{unit}]", ylabel="|M|", title=title)
    ax.set(xlim=(0, None), ylim=(low, min(float(shown.max()) + 0.05, 1.6)))
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(frameon=False, fontsize=8, loc="lower left")
    return ax


def plot_whiskers(
    x: np.ndarray,
    y: np.ndarray,
    moments: np.ndarray,
    shape: tuple[int, int],
    ax: Axes | None = None,
    *,
    unit: str = "arcsec",
    title: str = "stars",
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
    title : str

    Returns
    -------
    ax : matplotlib.axes.Axes
        A whisker of two sigma along each star's major axis within its 1 sigma ellipse, all enlarged alike;
        the bar above the field says by how much.
    """
    ax = _alone(ax, (4.2, 3.6))
    ny, nx = shape
    ax.set(xlim=(-0.5, nx - 0.5), ylim=(-0.5, ny - 0.5), aspect="equal", title=title)
    ax.set(xlabel="x [pixel]", ylabel="y [pixel]")
    x, y, moments = (np.asarray(a, float) for a in (x, y, moments))
    good = np.isfinite(x) & np.isfinite(y) & np.all(np.isfinite(moments), axis=1)
    axes = np.array([principal_axes(m) for m in moments[good]]).reshape(-1, 3)
    typical = float(np.median(axes[:, 0])) if len(axes) else 0.0
    if not typical > 0:
        ax.text(0.5, 0.5, "no star shows a blur", transform=ax.transAxes, ha="center", va="center")
        return ax
    grown = _WHISKER * max(nx, ny) / typical
    _draw_stars(ax, x[good], y[good], grown * axes[:, :2], axes[:, 2])
    size = angle_size(typical, 2) if unit == "arcsec" else f"{typical:.2g} {unit}"
    bar: Any = {"transform": ax.get_xaxis_transform(), "clip_on": False}
    ax.plot([0, grown * typical], [1.03, 1.03], color=INK, lw=1.6, solid_capstyle="butt", **bar)
    ax.text(1.3 * grown * typical, 1.03, f"1σ = {size}", fontsize=8, va="center", **bar)
    return ax


def _draw_stars(ax: Axes, x: np.ndarray, y: np.ndarray, sizes: np.ndarray, angle: np.ndarray) -> None:
    """An ellipse and a whisker a star, from semi-axes (n, 2) in pixels and degrees (n,)."""
    style: Any = {
        "units": "xy",
        "offsets": np.c_[x, y],
        "transOffset": ax.transData,
        "fc": "none",
        "ec": BLUE,
    }
    major, minor = 2 * sizes.T
    ax.add_collection(EllipseCollection(major, minor, angle, lw=0.7, alpha=0.8, **style))
    dx, dy = (sizes[:, 0] * f(np.radians(angle)) for f in (np.cos, np.sin))
    ends = np.stack([x - dx, x + dx]), np.stack([y - dy, y + dy])
    ax.plot(*ends, color=RUST, lw=1.4, solid_capstyle="butt", scalex=False, scaley=False)


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
    scale, unit = (1.0, "pixel") if plate_scale is None else (plate_scale, "arcsec")
    level = np.where(np.isfinite(image), image, np.nanmean(image)) - np.nanmean(image)
    window = np.outer(*(np.hanning(n + 1)[:-1] for n in level.shape))
    power = np.fft.fftshift(np.abs(np.fft.fft2(level * window)) ** 2)
    power = np.log10(np.maximum(power, _FAINTEST * power.max() + np.finfo(float).tiny))
    ax = _alone(ax, (4.2, 3.6))
    limit = 0.5 / scale
    low, high = np.percentile(power, [1, 99.9])
    (down, up), (left, right) = (_edges(n, scale) for n in power.shape)
    extent = (left, right, down, up)
    picture = ax.imshow(power, origin="lower", extent=extent, cmap="viridis", vmin=low, vmax=high)
    ax.figure.colorbar(picture, ax=ax, label="log₁₀ power", shrink=0.86, aspect=24, pad=0.02)
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


def plot_deblurred(
    before: np.ndarray,
    after: np.ndarray,
    axes: Sequence[Axes] | None = None,
    *,
    plate_scale: float | None = None,
    label: str = "electrons",
) -> list[Axes]:
    """Draw an image beside itself without the blur, both on the brightness scale of the first.

    Parameters
    ----------
    before, after : (ny, nx) array
        ``after`` from :func:`jitterkit.kernels.deblur`.
    axes : sequence of two matplotlib.axes.Axes, optional
    plate_scale : float, optional
    label : str
        What the colour bars say.

    Returns
    -------
    axes : list of matplotlib.axes.Axes
    """
    if axes is None:
        axes = list(Figure(figsize=(8.2, 3.6), layout="constrained").subplots(1, 2))
    for ax, image, title in zip(axes, (before, after), ("as taken", "deblurred"), strict=True):
        plot_image(image, plate_scale, ax, norm=stretch(before), label=label, title=title)
    return list(axes)


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
    ax = _alone(ax, (3.8, 3.6))
    sxx, sxy, syy = (np.asarray(moments, float) - common).T
    across = (sxx - syy) / 2
    ax.plot(across, sxy, "o", color=BLUE, ms=4, mew=0, alpha=0.7)
    ax.plot(0, 0, "+", color=RUST, ms=12, mew=1.5)
    reach = 1.1 * float(np.nanmax(np.abs(np.r_[across, sxy, 1e-12])))
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", title="stars less common blur")
    ax.set(xlabel=f"Δ(Sxx − Syy)/2 [{unit}²]", ylabel=f"ΔSxy [{unit}²]")
    ax.spines[["top", "right"]].set_visible(False)
    return ax


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


def say(ax: Axes, text: str) -> Axes:
    """Put a sentence where a picture cannot be drawn."""
    ax.set_axis_off()
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center")
    return ax
