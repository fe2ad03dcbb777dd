"""Pictures of a motion: its spectrum, what an exposure makes of it, and the blur that follows.

Reach for :func:`plot_motion`, a page of four panels; each panel is a function of its own.  As in
:mod:`~jitterkit.report.plots`, every function takes ``ax=None`` and returns the axes it drew on.
:func:`plot_arcsine` is the paper's check of its appendix B.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.ndimage import gaussian_filter

from jitterkit.loci import Locus, Product, principal_axes
from jitterkit.motion import PARTS, PowerSpectrum, arcsine_shares, cumulative_split, part_weights
from jitterkit.report.axes import BLUE, INK, RUST, axes_or_new, say
from jitterkit.report.kernel_plots import plot_kernel_image
from jitterkit.report.words import number

__all__ = [
    "plot_arcsine",
    "plot_budget",
    "plot_locus_transfer",
    "plot_motion",
    "plot_motion_spectrum",
    "plot_pointing",
]

_STYLES: dict[str, dict[str, Any]] = {
    "displacement": {"color": "0.55", "ls": "--"},
    "smear": {"color": BLUE, "ls": "-"},
    "jitter": {"color": RUST, "ls": "-."},
}
"""Of the three parts, so that they differ without their colours."""

_DECADES = 8
"""Of a density that are shown, down from its peak."""

_POINTS, _DRAWS, _CELLS = 4096, 1_000_000, 81
"""Of each motion, of all together, and of the raster they are drawn on along a side."""

_REACH = 0.02
"""A transfer function is drawn until a normal of its moments has fallen to that along the longer axis."""


def plot_motion(spectrum: PowerSpectrum, exposure: float, locus: Locus, title: str = "") -> list[Axes]:
    """Draw a motion on one page.

    Parameters
    ----------
    spectrum : PowerSpectrum
    exposure : float
        s.
    locus : Locus
        Predicted for a typical frame.
    title : str

    Returns
    -------
    axes : list of matplotlib.axes.Axes
        Spectrum, budget, locus, transfer function.
    """
    figure = Figure(figsize=(10, 7.4), layout="constrained")
    figure.suptitle(title)
    axes = list(figure.subplots(2, 2).ravel())
    plot_motion_spectrum(spectrum, exposure, axes[0])
    plot_budget(spectrum, exposure, axes[1])
    plot_pointing(locus, axes[2])
    plot_locus_transfer(locus, axes[3])
    return axes


def plot_motion_spectrum(spectrum: PowerSpectrum, exposure: float, ax: Axes | None = None) -> Axes:
    """Draw densities and lines, under the shares of displacement, smear and jitter.

    Parameters
    ----------
    spectrum : PowerSpectrum
    exposure : float
        s.
    ax : matplotlib.axes.Axes, optional

    Returns
    -------
    ax : matplotlib.axes.Axes
        Densities on the left, a line as its variance spread over the critical frequency ``1/T``; the shares
        on the right.
    """
    ax = axes_or_new(ax, (5.6, 4.0))
    f, density = spectrum.frequencies, spectrum.density
    peaks = np.array([np.sum(line.moments()[[0, 2]]) * exposure for line in spectrum.lines])
    for column, name, style in ((0, "x", "-"), (2, "y", ":")):
        if len(f):
            ax.plot(f[f > 0], density[f > 0, column], style, color=INK, lw=1.3, label=f"density of {name}")
    if len(peaks):
        places = [line.frequency for line in spectrum.lines]
        ax.vlines(places, 0, peaks, color=INK, lw=1.1)
        ax.plot(places, peaks, "o", color=INK, ms=4, label="lines: variance × T")
    top = max([*peaks, *density[:, [0, 2]].ravel(), 0.0])
    low, high = _range(spectrum, exposure)
    ax.set(xscale="log", yscale="log", xlim=(low, high), xlabel="frequency [Hz]")
    ax.set(ylabel="density [arcsec²/Hz]", title=f"spectrum, and what {exposure:g} s makes of it")
    if top > 0:
        least = min([*peaks[peaks > 0], *density[:, [0, 2]][density[:, [0, 2]] > 0]])
        ax.set_ylim(max(least / 3, top * 10.0**-_DECADES), top * 10)
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
    places = np.concatenate([[low], f, [high]])
    for k, part in enumerate(PARTS):
        size = np.concatenate([[0.0], rms[:, k], rms[-1:, k]])
        label = f"{part}: {number(rms[-1, k], 3)} mas"
        ax.plot(places, size, label=label, lw=1.6, **_STYLES[part])
    ax.axvline(1 / exposure, color="0.75", lw=0.8, zorder=1)
    ax.set(xscale="log", xlim=(low, high), ylim=(0, 1.35 * max(rms[-1].max(), 1e-6)))
    ax.set(xlabel="frequency [Hz]", ylabel="rms up to there [mas]", title="budget")
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(frameon=False, fontsize=8, loc="upper left")
    return ax


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
    places = np.zeros((_DRAWS, 2))
    for part in parts:
        points = np.asarray(part.points(_POINTS))
        places += points[rng.integers(0, len(points), _DRAWS)]
    reach = 1.2 * float(np.percentile(np.abs(places).max(axis=1), 99.9))
    if reach <= 0:
        return say(ax, "no blur")
    shares, _, _ = np.histogram2d(places[:, 1], places[:, 0], _CELLS, [[-reach, reach]] * 2)
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
        return say(ax, "no blur")
    # a normal falls to e^-x at f = sqrt(x / 2) / (pi sigma)
    reach = np.sqrt(-np.log(_REACH) / 2) / (np.pi * major)
    f = np.linspace(0, reach, 400)
    for name, turn, style in (("longer", 0, "-"), ("shorter", 90, "--")):
        c, s = np.cos(np.radians(angle + turn)), np.sin(np.radians(angle + turn))
        size = 1e3 * (major, minor)[turn > 0]
        label = f"{name} axis, {number((angle + turn) % 180, 3)}°: {number(size, 3)} mas rms"
        modulus = np.abs(np.asarray(locus.transfer(f * c, f * s)))
        ax.plot(f, modulus, style, color=RUST if turn == 0 else BLUE, lw=1.6, label=label)
    ax.set(
        xlabel="frequency [cycles/arcsec]",
        ylabel="|M|",
        xlim=(0, reach),
        ylim=(0, 1.25),
        yticks=np.linspace(0, 1, 6),
    )
    ax.set_title("a typical frame's transfer function")
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(frameon=False, fontsize=8, loc="upper right")
    return ax


def plot_arcsine(
    rng: np.random.Generator, amplitude: float = 1.0, draws: int = 100_000, ax: Axes | None = None
) -> Axes:
    """Draw the histogram of a vibration at random times against its density (the paper's appendix B).

    Parameters
    ----------
    rng : numpy.random.Generator
    amplitude : float
        Zero to peak.
    draws : int
    ax : matplotlib.axes.Axes, optional

    Returns
    -------
    ax : matplotlib.axes.Axes
        The histogram filled, the exact mean of the density over each cell as points.
    """
    ax = axes_or_new(ax, (5.6, 4.0))
    edges = amplitude * np.linspace(-1, 1, 61)
    counts, _ = np.histogram(amplitude * np.sin(rng.uniform(-np.pi / 2, np.pi / 2, draws)), edges)
    width = np.diff(edges)
    ax.stairs(counts / draws / width, edges, fill=True, color="0.8", label=f"{draws:,} random times")
    law: Any = {"color": RUST, "ms": 4, "label": "arcsine law, over each cell"}
    ax.plot((edges[1:] + edges[:-1]) / 2, arcsine_shares(edges, amplitude) / width, "o", **law)
    ax.set(xlabel="place [amplitude's unit]", ylabel="density [1/unit]", ylim=(0, None))
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(frameon=False, fontsize=8, loc="upper center")
    return ax


def _draw_weights(ax: Axes, f: np.ndarray, exposure: float) -> None:
    """The shares of a tone on axes of their own, and one legend for both."""
    right = ax.twinx()
    for part, weight in zip(PARTS, part_weights(f * exposure), strict=True):
        right.plot(f, weight, lw=1.2, label=part, **_STYLES[part])
    right.set(ylim=(0, 1.45), ylabel="share of a tone", yticks=[0, 0.25, 0.5, 0.75, 1])
    right.axvline(1 / exposure, color="0.75", lw=0.8, zorder=1)
    handles = [both for axes in (ax, right) for both in zip(*axes.get_legend_handles_labels(), strict=True)]
    right.legend(*zip(*handles, strict=True), frameon=False, fontsize=8, ncols=2, loc="upper center")


def _range(spectrum: PowerSpectrum, exposure: float) -> tuple[float, float]:
    """Frequencies to show: all there are, and a decade about the critical one."""
    f = [*spectrum.frequencies[spectrum.frequencies > 0], *(line.frequency for line in spectrum.lines)]
    critical = [0.3 / exposure, 3 / exposure]
    return min(f + critical) / 1.5, max(f + critical) * 1.5
