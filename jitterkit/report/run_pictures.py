"""The pictures of a whole run on its page, each with the sentence that goes with it.

Reach for :func:`run_pictures`.  What is drawn depends on how many frames there are; the limits stand at the
top with their reasons.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from astropy.table import QTable
from scipy.stats import chi2

from jitterkit.report.jitter_plots import draw_jitter, jittered
from jitterkit.report.means import Clock, fitted, separation_series
from jitterkit.report.plots import plot_residual, png
from jitterkit.report.population_plots import plot_angles, plot_chi2, plot_loci, plot_shapes, plot_sizes
from jitterkit.report.residual_stack import ResidualStack, count_copies
from jitterkit.report.series_plots import plot_allan, plot_pulls, plot_root_n, study_series
from jitterkit.report.time_plots import draw_run, plot_root_n_error, plot_running_mean
from jitterkit.report.words import angle_size, angle_unit, number, suited_time, with_error
from jitterkit.series import Floor, Trend, allan_deviation, block_scatter

_RUNNING = 8
"""Frames from which a mean that grows is drawn, and the jitter with time: a scatter is known to a quarter."""

_MANY = 25
"""Frames from which averages and histograms are drawn.  Of white noise the Allan deviation then has eight
lengths, the longest known within a factor of 2.5 (68 %), and the upper limit of its floor is 3.8 errors of
the mean; of 16 it were six lengths, a factor of 3 and 4.2 errors.  A bar of five frames is good to a half."""

_COUNTED = (
    "The frames' times make no axis (some miss, are shared, or lie in a few heaps), so frames are counted."
)
_FAR = 4
_CLEAR = 1e-3
"""Chance below which a slope is reported."""


@dataclass(frozen=True)
class RunPicture:
    """Hold one picture of the page.

    Attributes
    ----------
    part : {"separation", "averaging", "jitter", "fit"}
        The section that it belongs to.
    alt, caption : str
    wide : bool
        Whether it takes the whole width.
    png : bytes
    """

    part: str
    alt: str
    caption: str
    wide: bool
    png: bytes = field(repr=False)


def run_pictures(
    table: QTable, summary: dict[str, Any], stack: ResidualStack | None = None
) -> list[RunPicture]:
    """Draw what a run of this length can show.

    Parameters
    ----------
    table : QTable
    summary : dict
        From :func:`~jitterkit.report.summary.summarise`.
    stack : ResidualStack, optional
        Of the residuals of all frames.

    Returns
    -------
    pictures : list of RunPicture
        Of fewer than two fitted frames none, of one star none of separations.
    """
    clock = Clock.of(table)
    usable = np.asarray(table["status"]) == "ok"
    pairs = np.isfinite(table["separation"].to_value("arcsec")) & usable
    return [
        *(_averages(table, summary, clock) if pairs.sum() >= 2 else []),
        *(_jitter(table, summary, clock) if jittered(table).sum() >= _RUNNING else []),
        *(_fits(table, usable) if usable.sum() >= _MANY else []),
        *_stacked(stack, table, summary["fit"]),
    ]


def _drawn(part: str, ax: Any, alt: str, caption: str = "", wide: bool = False) -> RunPicture:
    return RunPicture(part, alt, caption, wide, png(ax, 110))


def _averages(table: QTable, summary: dict[str, Any], clock: Clock) -> Iterator[RunPicture]:
    """Yield the separations with time, and what their averages do."""
    good = fitted(table)
    series = separation_series(table, clock) if good.sum() >= _MANY else None
    text = [_COUNTED] if clock.unit == "frame" and any(np.asarray(table["time"]).tolist()) else []
    flags = None
    if series is not None:
        outliers, rest, floor, trend = study_series(series)
        text, flags = text + _describe_trend(trend, clock), outliers.flags
    alt = "Separation of every frame with its error about the weighted mean"
    yield _drawn("separation", draw_run(table, summary, clock, flags)[0], alt, " ".join(text), wide=True)
    if good.sum() >= _RUNNING:
        order = np.flatnonzero(good)[np.argsort(clock.at[good], kind="stable")]
        values, errors = (table[name].to_value("arcsec")[order] for name in ("separation", "separation_err"))
        running = plot_running_mean(values, errors)
        yield _drawn("averaging", running, "Weighted mean of the first N frames", "The mean as it grows.")
        alt = "Error of the weighted mean of the first N frames, against 1/√N"
        gloss = "By the scatter it is larger where frames are off by more than their errors."
        yield _drawn("averaging", plot_root_n_error(values, errors), alt, f"Error of that mean. {gloss}")
    if series is not None:
        unit = clock.unit
        ax = plot_root_n(block_scatter(rest), time_unit=unit)
        gloss = "Above the dashed line they share what does not average."
        caption = f"Scatter of means of neighbouring frames, a slow change included. {gloss}"
        yield _drawn("averaging", ax, "Scatter of block means against their length", caption)
        ax = plot_allan(allan_deviation(rest), floor=floor, time_unit=unit)
        caption = f"Allan deviation. {_describe_floor(floor, unit)}"
        yield _drawn("averaging", ax, "Allan deviation of the separation", caption)
        alt = "Histogram of the residuals about the trend in stated errors"
        yield _drawn("fit", plot_pulls(outliers), alt, _describe_outliers(outliers.flags))


def _describe_trend(trend: Trend, clock: Clock) -> list[str]:
    if not trend.p_value < _CLEAR:
        return []
    per, name = (3600.0, "hour") if clock.unit == "s" else (1000.0, "1000 frames")
    scale, unit = angle_unit(abs(trend.slope) * per)
    slope = with_error(trend.slope * per * scale, trend.slope_error * per * scale)
    change = f"The separation changes by ({slope}){unit} per {name}"
    return [f"{change}: its mean is that of the middle of the run."]


def _describe_floor(floor: Floor, unit: str) -> str:
    if not (floor.detected and floor.floor > 0):
        return f"No floor is seen: it lies below {angle_size(floor.upper, 2)} (95 %)."
    per, name = suited_time(floor.meets * floor.cadence, unit)
    after = number(floor.meets * floor.cadence / per, 2)
    name = "frames" if name == "frame" else name
    return f"Averaging stops at {angle_size(floor.floor, 2)}, which is reached after {after} {name}."


def _describe_outliers(flags: np.ndarray) -> str:
    count = int(flags.sum())
    if not count:
        return "No frame is further off than chance allows."
    these = "1 frame is" if count == 1 else f"{count:,} frames are"
    said = f"{these} further off than chance allows"
    return f"{said}: left out of block means, Allan deviation and trend, counted in the mean."


def _jitter(table: QTable, summary: dict[str, Any], clock: Clock) -> Iterator[RunPicture]:
    """Yield the ellipse with time, and what the kernels were."""
    good, alt = jittered(table), "Jitter ellipse with time: mean ellipses, axes, direction"
    yield _drawn("jitter", draw_jitter(table, clock)[0], alt, wide=True)
    if good.sum() < _MANY:
        return
    major, minor = (table[f"jitter_{axis}"].to_value("arcsec")[good] for axis in ("major", "minor"))
    yield _drawn("jitter", plot_sizes(major, minor), "Histograms of the jitter's axes")
    angles = table["jitter_angle"].to_value("deg")[good]
    if np.isfinite(angles).sum() >= _MANY:
        rose = plot_angles(angles[np.isfinite(angles)], float(summary["theta"]["mean"]))
        yield _drawn("jitter", rose, "Rose of the jitter's directions")
    loci = np.asarray(table["locus"])[good].tolist()
    if len(set(loci)) > 1:
        gloss = "Locus chosen, frame by frame; what the frames say together stands above."
        yield _drawn("jitter", plot_loci(loci), "Frames by the locus chosen", gloss)
    shape, error = (np.asarray(table[name])[good] for name in ("shape", "shape_err"))
    known = np.isfinite(shape) & np.isfinite(error)
    if known.sum() >= _MANY:
        yield _drawn("jitter", plot_shapes(shape[known], error[known]), "Histogram of the excess kurtosis")


def _fits(table: QTable, usable: np.ndarray) -> Iterator[RunPicture]:
    chi2_dof = np.asarray(table["chi2_dof"], float)
    known = usable & np.isfinite(chi2_dof)
    dof = np.asarray(table["dof"]) if "dof" in table.colnames else np.zeros(len(table), int)
    if known.sum() >= _MANY:
        shown, alt = (chi2_dof[known], dof[known]), "Histogram of chi-squared per degree of freedom"
        yield _drawn("fit", plot_chi2(*shown), alt, _describe_tail(*shown))


def plot_stack(stack: ResidualStack | None, fit: dict[str, Any], copies: float = 1.0) -> Any:
    """Draw the stacked residual of a run.

    Parameters
    ----------
    stack : ResidualStack or None
    fit : dict
        From :func:`~jitterkit.report.sequence.assess_run_fit`, with the stack.
    copies : float
        How often a frame is in it.

    Returns
    -------
    ax : matplotlib.axes.Axes or None
        None for too few frames.
    """
    if stack is None or not np.isfinite(fit["structure_sigmas"]):
        return None
    title = f"stacked residual of {fit['stack_frames']:,} frames"
    return plot_residual(stack.sigmas(copies), stack.plate_scale, title=title)


def _stacked(stack: ResidualStack | None, table: QTable, fit: dict[str, Any]) -> Iterator[RunPicture]:
    if (ax := plot_stack(stack, fit, count_copies(table))) is not None:
        significance = number(fit["structure_sigmas"], 2)
        caption = f"Significance of what the frames have in common: {significance} sigmas."
        yield _drawn("fit", ax, "Sum of the residuals of frames, about their stars", caption)


def _describe_tail(chi2_dof: np.ndarray, dof: np.ndarray) -> str:
    """Return how many frames noise alone does not explain."""
    if not np.all(dof > 0):
        return ""
    limit = 1 + _FAR * np.sqrt(2 / dof)
    far, chance = int(np.sum(chi2_dof > limit)), float(np.sum(chi2.sf(limit * dof, dof)))
    said = f"{far:,} of {len(dof):,} frames lie more than {_FAR} sigmas above 1"
    return f"{said}; noise alone would put {number(chance, 1)} there."
