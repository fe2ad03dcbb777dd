"""Pictures of a motion: its spectrum, what an exposure makes of it, and the blur that follows.

Reach for :func:`plot_motion`, a page of four panels; each panel is a function of its own.  As in
:mod:`~jitterkit.report.plots`, every function takes ``ax=None`` and returns the axes it drew on.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from scipy.ndimage import gaussian_filter

from jitterkit.loci import Locus, Product, principal_axes
from jitterkit.motion import PARTS, Assessment, PowerSpectrum, Split, cumulative_split, part_weights
from jitterkit.report.kernel_plots import plot_kernel_image
from jitterkit.report.plots import BLUE, INK, RUST, axes_or_new, finish, note_in_axes, panels
from jitterkit.report.words import number

_STYLES: dict[str, dict[str, Any]] = {
    "displacement": {"color": "0.55", "ls": "--"},
    "smear": {"color": BLUE, "ls": "-"},
    "jitter": {"color": RUST, "ls": "-."},
}
"""Of the three parts, so that they differ without their colours."""

_DECADES = 8
"""Of a density that are shown, down from its peak."""

_DECIMALS = 6
"""Of a size in mas; beyond them there is rounding."""

_POINTS, _DRAWS, _CELLS = 4096, 1_000_000, 81
"""Of each motion, of all together, and of the raster they are drawn on along a side."""

_REACH = 0.02
"""A transfer function is drawn until a normal of its moments has fallen to that along the longer axis."""


def plot_motion(assessed: Assessment, title: str = "") -> list[Axes]:
    """Draw a motion on one page.

    Parameters
    ----------
    assessed : Assessment
    title : str

    Returns
    -------
    axes : list of matplotlib.axes.Axes
        Spectrum, budget, locus, transfer function.  The budget of a record is that of its exposures, not of
        its spectrum.
    """
    spectrum, exposure, measured = assessed.spectrum, assessed.exposure, assessed.frames is not None
    axes = panels((10, 7.4), 2, 2)
    axes[0].figure.suptitle(title)
    plot_motion_spectrum(spectrum, exposure, axes[0], estimated=measured)
    if measured:
        plot_parts(assessed.split, axes[1])
    else:
        plot_budget(spectrum, exposure, axes[1])
    plot_pointing(assessed.locus, axes[2])
    plot_locus_transfer(assessed.locus, axes[3])
    return axes


def plot_motion_spectrum(
    spectrum: PowerSpectrum, exposure: float, ax: Axes | None = None, *, estimated: bool = False
) -> Axes:
    """Draw densities and lines, under the shares of displacement, smear and jitter.

    Parameters
    ----------
    spectrum : PowerSpectrum
    exposure : float
        s.
    ax : matplotlib.axes.Axes, optional
    estimated : bool
        Whether it is Welch's estimate, which knows nothing slower than a segment of the record; the title
        says so.

    Returns
    -------
    ax : matplotlib.axes.Axes
        Densities on the left, a line as its variance spread over the critical frequency ``1/T``; the shares
        on the right.
    """
    ax = axes_or_new(ax, (5.6, 4.0))
    f, density = spectrum.frequencies, np.where(spectrum.density > 0, spectrum.density, np.nan)
    peaks = np.array([np.sum(line.moments()[[0, 2]]) * exposure for line in spectrum.lines])
    for column, name, style in ((0, "x", "-"), (2, "y", ":")):
        if np.any(density[:, column] > 0):
            ax.plot(f[f > 0], density[f > 0, column], style, color=INK, lw=1.3, label=f"density of {name}")
    if np.any(peaks > 0):
        positions = np.array([line.frequency for line in spectrum.lines])[peaks > 0]
        ax.vlines(positions, 0, peaks[peaks > 0], color=INK, lw=1.1)
        ax.plot(positions, peaks[peaks > 0], "o", color=INK, ms=4, label="lines: variance × T")
    shown = np.concatenate([peaks, density[:, 0], density[:, 2]])
    shown = shown[shown > 0]
    low, high = _range(spectrum, exposure)
    ax.set(xscale="log", xlim=(low, high), xlabel="frequency [Hz]", ylabel="density [arcsec²/Hz]")
    ax.set_title(_estimate(spectrum) if estimated else f"spectrum, and what {exposure:g} s makes of it")
    if len(shown):
        top = shown.max()
        ax.set(yscale="log", ylim=(max(shown.min() / 3, top * 10.0**-_DECADES), top * 10))
    else:
        ax.set_yticks([])
    _draw_weights(ax, np.geomspace(low, high, 2000), exposure)
    return ax


def plot_budget(spectrum: PowerSpectrum, exposure: float, ax: Axes | None = None) -> Axes:
    """Draw how displacement, smear and jitter add up with frequency.

    Parameters
    ----------
    spectrum, exposure, ax
        As for :func:`plot_motion_spectrum`.

    Returns
    -------
    ax : matplotlib.axes.Axes
        Root of the variance in both axes together of all motion up to a frequency, mas.
    """
    ax = axes_or_new(ax, (5.6, 4.0))
    f, moments = cumulative_split(spectrum, exposure)
    low, high = _range(spectrum, exposure)
    rms = 1e3 * np.sqrt(np.maximum(moments[:, :, 0] + moments[:, :, 2], 0))
    positions = np.concatenate([[low], f, [high]])
    for k, part in enumerate(PARTS):
        size = np.concatenate([[0.0], rms[:, k], rms[-1:, k]])
        label = f"{part}: {number(rms[-1, k], 3)} mas"
        ax.plot(positions, size, label=label, lw=1.6, **_STYLES[part])
    ax.axvline(1 / exposure, color="0.75", lw=0.8, zorder=1)
    ax.set(xscale="log", xlim=(low, high), ylim=(0, 1.35 * max(rms[-1].max(), 1e-6)))
    ax.set(xlabel="frequency [Hz]", ylabel="rms up to there [mas]", title="budget")
    return finish(ax, loc="upper left")


def plot_parts(split: Split, ax: Axes | None = None) -> Axes:
    """Draw displacement, smear and jitter as they were measured.

    Parameters
    ----------
    split : Split
        Of a record's exposures.
    ax : matplotlib.axes.Axes, optional

    Returns
    -------
    ax : matplotlib.axes.Axes
        A bar a part: root of the variance in both axes together, mas.
    """
    ax = axes_or_new(ax, (5.6, 4.0))
    moments = np.array([getattr(split, part) for part in PARTS])
    rms = np.round(1e3 * np.sqrt(np.maximum(moments[:, 0] + moments[:, 2], 0)), _DECIMALS)
    bars = ax.bar(PARTS, rms, 0.6, color=[_STYLES[part]["color"] for part in PARTS])
    ax.bar_label(bars, [f"{number(size, 3)} mas" for size in rms], padding=3)
    ax.set(ylim=(0, 1.2 * max(rms.max(), 1e-6)), ylabel="rms [mas]", title="budget of the exposures")
    return finish(ax)


def plot_pointing(locus: Locus, ax: Axes | None = None) -> Axes:
    """Draw where a locus of several motions lingers.

    Parameters
    ----------
    locus : Locus
    ax : matplotlib.axes.Axes, optional

    Returns
    -------
    ax : matplotlib.axes.Axes
        Shares of the time on a fine raster, from draws of each motion on its own.
    """
    ax = axes_or_new(ax, (5.6, 4.0))
    rng = np.random.default_rng(0)
    parts = locus.factors() if isinstance(locus, Product) else (locus,)
    positions = np.zeros((_DRAWS, 2))
    for part in parts:
        points = np.asarray(part.points(_POINTS))
        positions += points[rng.integers(0, len(points), _DRAWS)]
    reach = 1.2 * float(np.percentile(np.abs(positions).max(axis=1), 99.9))
    if reach <= 0:
        return note_in_axes(ax, "no blur")
    shares, _, _ = np.histogram2d(positions[:, 1], positions[:, 0], _CELLS, [[-reach, reach]] * 2)
    smooth = gaussian_filter(shares / _DRAWS, 1.0)
    return plot_kernel_image(smooth, ax, plate_scale=2 * reach / _CELLS, title="a typical frame's pointing")


def plot_locus_transfer(locus: Locus, ax: Axes | None = None) -> Axes:
    """Draw the transfer function of a locus along the principal axes of its second moments.

    Parameters
    ----------
    locus : Locus
    ax : matplotlib.axes.Axes, optional

    Returns
    -------
    ax : matplotlib.axes.Axes
    """
    ax = axes_or_new(ax, (5.6, 4.0))
    major, minor, angle = principal_axes(locus.moments())
    if major <= 0:
        return note_in_axes(ax, "no blur")
    # a normal falls to e^-x at f = sqrt(x / 2) / (pi sigma)
    reach = np.sqrt(-np.log(_REACH) / 2) / (np.pi * major)
    f = np.linspace(0, reach, 400)
    axes = (("longer", angle, major, RUST, "-"), ("shorter", angle + 90, minor, BLUE, "--"))
    for name, axis, size, colour, style in axes:
        c, s = np.cos(np.radians(axis)), np.sin(np.radians(axis))
        label = f"{name} axis, {number(axis % 180, 3)}°: {number(1e3 * size, 3)} mas rms"
        ax.plot(f, np.abs(np.asarray(locus.transfer(f * c, f * s))), style, color=colour, lw=1.6, label=label)
    ax.set(xlabel="frequency [cycles/arcsec]", ylabel="|M|", title="a typical frame's transfer function")
    ax.set(xlim=(0, reach), ylim=(0, 1.25), yticks=np.linspace(0, 1, 6))
    return finish(ax, loc="upper right")


def _draw_weights(ax: Axes, f: np.ndarray, exposure: float) -> None:
    """The shares of a tone on axes of their own, and one legend for both."""
    right = ax.twinx()
    for part, weight in zip(PARTS, part_weights(f * exposure), strict=True):
        right.plot(f, weight, lw=1.2, label=part, **_STYLES[part])
    right.set(ylim=(0, 1.45), ylabel="share of a tone", yticks=[0, 0.25, 0.5, 0.75, 1])
    right.axvline(1 / exposure, color="0.75", lw=0.8, zorder=1)
    handles = [both for axes in (ax, right) for both in zip(*axes.get_legend_handles_labels(), strict=True)]
    right.legend(*zip(*handles, strict=True), frameon=False, fontsize=8, ncols=2, loc="upper center")


def _estimate(spectrum: PowerSpectrum) -> str:
    """Return what Welch's estimate shows, for a title."""
    slowest = spectrum.frequencies[:1].tolist()
    return f"Welch's estimate: nothing below {slowest[0]:.2g} Hz" if slowest else "too short for a spectrum"


def _range(spectrum: PowerSpectrum, exposure: float) -> tuple[float, float]:
    """Return the frequencies to show: all there are, and a decade about the critical one."""
    f = [*spectrum.frequencies[spectrum.frequencies > 0], *(line.frequency for line in spectrum.lines)]
    critical = [0.3 / exposure, 3 / exposure]
    return min(f + critical) / 1.5, max(f + critical) * 1.5
