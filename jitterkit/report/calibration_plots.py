"""The picture of a calibration: photon transfer, linearity, dark current and response.

Reach for :func:`plot_calibration`, a page of what was measured; each panel is a function of its own.  As in
:mod:`~jitterkit.report.plots`, every function takes ``ax=None`` and returns the axes it drew on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from jitterkit.calibration import Calibration, MeasuredMap
from jitterkit.report.plots import BLUE, INK, RUST, axes_or_new, finish, note_in_axes, panels
from jitterkit.report.words import with_error

_SIZE = (5.2, 3.7)
"""Inches, of axes of their own."""

_BINS, _ALL = 120, "all pixels, those beyond in the last bar"
_HEADROOM, _BELOW = 12, 0.78
"""Times the fullest bar, for the words above; share of the axes that lines take below them."""

_POINTS: Any = {"fmt": "o", "ms": 5, "color": BLUE, "mfc": "w", "mew": 1.3, "elinewidth": 1.0, "zorder": 3}


def plot_calibration(calibration: Calibration) -> list[Axes]:
    """Draw what was measured on a new figure, two panels a row.

    Parameters
    ----------
    calibration : Calibration

    Returns
    -------
    axes : list of matplotlib.axes.Axes
        Of the panels there are: photon transfer, linearity, dark current, response, read noise.
    """
    draws: list[Callable[..., Axes]] = []
    if calibration.transfer is not None:
        draws += [plot_transfer, plot_linearity]
    if calibration.dark_current is not None:
        draws.append(plot_dark)
    if calibration.flat is not None:
        draws.append(plot_response)
    if (calibration.read_noise is not None and len(draws) % 2 == 1) or not draws:
        draws.append(plot_read_noise)
    rows = (len(draws) + 1) // 2
    width, columns = (10.4, 2) if len(draws) > 1 else (5.4, 1)
    grid = panels((width, 3.7 * rows), rows, columns)
    for spare in grid[len(draws) :]:
        spare.set_axis_off()
    return [draw(calibration, ax) for draw, ax in zip(draws, grid, strict=False)]


def plot_transfer(calibration: Calibration, ax: Axes | None = None) -> Axes:
    """Draw variance against signal with the line fitted, and the variance over the pixels of one frame.

    Both axes are logarithmic: read noise is level, photon noise rises by one decade a decade, the response of
    the pixels by two.
    """
    ax = axes_or_new(ax, _SIZE)
    transfer, (prnu, _) = calibration.transfer, calibration.prnu
    if transfer is None:
        return note_in_axes(ax, "no flats")
    lit = [level for level in transfer.levels if level.exposure > 0 and level.signal > 0]
    used = [level for level in lit if not level.saturated]
    spatial = [level for level in used if level.spatial_variance > 0]
    signals = [level.signal for level in lit]
    at = np.geomspace(min(signals) / 30, max(signals) * 2, 300)
    line = transfer.variance(at)
    text = with_error(transfer.gain, transfer.gain_error)
    ax.plot(at, line, color=INK, lw=1.4, label=f"gain {text} e-/ADU")
    x, y, errors = ([getattr(o, name) for o in used] for name in ("signal", "variance", "variance_error"))
    ax.errorbar(x, y, errors, label="frame to frame", **_POINTS)
    if spatial and prnu > 0:
        text = f"with PRNU of {100 * prnu:.2g} %"
        ax.plot(at, line + (prnu * at) ** 2, color=RUST, lw=1.1, ls="--", label=text)
        x, y = ([getattr(level, name) for level in spatial] for name in ("signal", "spatial_variance"))
        ax.plot(x, y, "^", ms=5.5, color=RUST, mfc="none", mew=1.2, label="pixel to pixel")
    for number, level in enumerate(level for level in lit if level.saturated):
        ax.axvline(level.signal, color="0.55", lw=1.1, ls=":", label="" if number else "saturated")
    top = float(line[-1] + (prnu * at[-1]) ** 2) if prnu > 0 else float(line[-1])
    ax.set(xscale="log", yscale="log", xlim=(at[0], at[-1]), ylim=(float(line[0]) / 3, 2 * top))
    ax.set(xlabel="signal above bias [ADU]", ylabel="variance [ADU²]", title="photon transfer")
    return _finish(ax, loc="upper left")


def plot_linearity(calibration: Calibration, ax: Axes | None = None) -> Axes:
    """Draw by how many per cent the signal departs from a straight line through the dim levels."""
    ax = axes_or_new(ax, _SIZE)
    linearity = None if calibration.transfer is None else calibration.transfer.linearity
    ax.set_title("linearity")
    if linearity is None:
        ax.set_axis_off()
        return note_in_axes(ax, "linearity takes three exposure times")
    ax.axhline(0, color="0.6", lw=0.9)
    off, errors = 100 * linearity.residuals, 100 * linearity.residual_errors
    ax.errorbar(linearity.signals, off, errors, label="levels", **_POINTS)
    charge = np.linspace(0, linearity.signals.max() * 1.08, 200)[1:]
    if linearity.coefficients:
        law = linearity.measured(charge)
        count = len(linearity.coefficients)
        label = f"law, {count} coefficient{'s' * (count > 1)}"
        ax.plot(law, 100 * (law / charge - 1), color=INK, lw=1.4, label=label)
    else:
        ax.plot([], [], " ", label="no bend is significant")
    around = off + np.outer((-1, 1), errors)
    low, high = min(float(around.min()), 0.0), max(float(around.max()), 0.0)
    margin = 0.2 * (high - low)
    ax.set(xlim=(0, charge[-1]), ylim=(low - margin, high + margin))
    ax.set(xlabel="signal above bias [ADU]", ylabel="off the line [%]")
    return _finish(ax, loc="best")


def plot_dark(calibration: Calibration, ax: Axes | None = None) -> Axes:
    """Draw how many pixels have which dark current, and where the hot ones begin."""
    ax = axes_or_new(ax, _SIZE)
    measured, limit = calibration.dark_current, calibration.hot_limit
    if measured is None or limit is None:
        return note_in_axes(ax, "no dark frames")
    low, middle = np.percentile(measured.values, (0.01, 50))
    _histogram(ax, measured.values, float(low), limit + 0.6 * (limit - float(middle)), label=_ALL)
    hot = f"hot above {limit:.3g} e-/s: {calibration.count('hot')}"
    ax.axvline(limit, ymax=_BELOW, color=RUST, lw=1.2, ls="--", label=hot)
    _mark_number(ax, measured, "mean of the good")
    ax.set(xlabel="dark current [e-/s]", title="dark current")
    return _finish(ax, loc="upper right")


def plot_response(calibration: Calibration, ax: Axes | None = None) -> Axes:
    """Draw how many pixels have which response, with and without what is smooth over the frame."""
    ax = axes_or_new(ax, _SIZE)
    flat, local = calibration.flat, calibration.local
    if flat is None or local is None:
        return note_in_axes(ax, "no flats")
    good = calibration.bad == 0
    low, high = np.percentile(flat.values[good], (0.01, 99.99))
    margin = 0.15 * (high - low)
    low, high = float(low - margin), float(high + margin)
    if not calibration.settings.smooth:
        _histogram(ax, flat.values[good], low, high, label="as it is")
    prnu, error = calibration.prnu
    counts, edges = np.histogram(local.values[good], _BINS, (low, high))
    text = f"locally: PRNU {with_error(100 * prnu, 100 * error)} %"
    ax.stairs(counts, edges, color=RUST, lw=1.4, label=text)
    ax.plot([], [], " ", label=f"dead: {calibration.count('dead')}")
    ax.set_ylim(0.7, _HEADROOM * float(counts.max()))
    ax.set(yscale="log", ylabel="pixels", xlim=(low, high), xlabel="relative response", title="response")
    return _finish(ax, loc="upper left")


def plot_read_noise(calibration: Calibration, ax: Axes | None = None) -> Axes:
    """Draw how many pixels have which read noise."""
    ax = axes_or_new(ax, _SIZE)
    measured = calibration.read_noise
    if measured is None:
        return note_in_axes(ax, "no bias frames")
    high = max(float(np.percentile(measured.values, 99.9)), 2 * measured.number)
    _histogram(ax, measured.values, 0.0, high, label=_ALL)
    _mark_number(ax, measured, "root mean square")
    ax.set(xlabel="read noise [e-]", title="read noise")
    return _finish(ax, loc="upper right")


def _histogram(ax: Axes, values: np.ndarray, low: float, high: float, label: str) -> None:
    counts, edges = np.histogram(np.clip(values, low, high), _BINS, (low, high))
    ax.stairs(counts, edges, fill=True, color=BLUE, alpha=0.75, label=label)
    top = _HEADROOM * float(counts.max())
    ax.set(yscale="log", ylim=(0.7, top), xlim=(low, high), ylabel="pixels")


def _mark_number(ax: Axes, measured: MeasuredMap, words: str) -> None:
    text = f"{words} {with_error(measured.number, measured.number_error)} {measured.unit}"
    ax.axvline(measured.number, ymax=_BELOW, color=INK, lw=1.2, label=text)


def _finish(ax: Axes, loc: Any) -> Axes:
    ax.xaxis.set_minor_formatter(NullFormatter())
    return finish(ax, loc=loc)
