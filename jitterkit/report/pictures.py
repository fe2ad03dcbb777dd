"""One fitted frame as a picture, made right after the fit so that the frame can be let go.

:func:`render_frame` encodes data, model, residual and kernel side by side; a :class:`Gallery` keeps
the few of a long run that are worth looking at.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames.frame import Frame
from jitterkit.refit.result import FitResult
from jitterkit.report.kernel_plots import plot_kernel
from jitterkit.report.plots import (
    four_panels,
    plot_image,
    plot_residual,
    plot_stars,
    small_png,
    stretch,
)
from jitterkit.report.row import Row, make_row
from jitterkit.report.words import number, printable
from jitterkit.scene import Stars

__all__ = ["MOST_PICTURES", "FrameReport", "Gallery", "render_frame"]

MOST_PICTURES = 24
"""Frames that a report shows."""


@dataclass(frozen=True)
class FrameReport:
    """All that a report keeps of a frame: some text and one encoded picture.

    Attributes
    ----------
    name : str
        As a person would call it, ``"cube.fits[3]"``.
    row : dict
        Its row of the table.
    picture : bytes
        PNG.
    alt : str
        What the picture shows, in words.
    """

    name: str
    row: Row
    picture: bytes = field(repr=False)
    alt: str = ""


def render_frame(frame: Frame, result: FitResult, row: Row | None = None) -> FrameReport:
    """Draw data, model, residual and kernel of a frame.

    Parameters
    ----------
    frame : Frame
    result : FitResult
        Where it has no model, the data stand alone.
    row : dict, optional
        The frame's row, if the caller has one with more in it (position angle, time).

    Returns
    -------
    report : FrameReport
        About 0.06 MB, and free of the arrays it was made from.
    """
    data = np.where(frame.mask, np.nan, frame.electrons)
    axes = four_panels()
    plot_image(data, frame.plate_scale, axes[0], norm=stretch(data), title="data")
    if result.image is None or result.residual is None:
        for ax in axes[1:]:
            ax.set_axis_off()
        shown = "data"
    else:
        _draw_fit(frame, result, axes[1:], data)
        shown = "data, model, residual and jitter kernel"
    if row is None:
        row = make_row(result, frame.path, frame.index, metadata=frame.metadata, flags=frame.flags)
    return FrameReport(printable(frame.name), row, small_png(axes[0]), f"{shown} of {printable(frame.name)}")


def _draw_fit(frame: Frame, result: FitResult, axes: Sequence, data: np.ndarray) -> None:
    plot_image(np.asarray(result.image), frame.plate_scale, axes[0], norm=stretch(data), title="model")
    title = f"residual, χ²/dof = {number(result.chi2_dof, 4)}"
    plot_residual(np.asarray(result.residual), frame.plate_scale, axes[1], title=title)
    for ax in axes[:2]:
        ax.set_ylabel("")
    if result.parameters is not None:
        if frame.plate_scale is not None:
            scene = result.parameters.scene
            plot_stars(*scene.sources()[:2], axes[0], "" if isinstance(scene, Stars) else "AB")
        title = f"kernel: {result.locus}"
        plot_kernel(result.parameters.locus, axes[2], plate_scale=frame.plate_scale, title=title)


class Gallery:
    """The frames of a run that are worth a picture: what failed, and what fits worst.

    Parameters
    ----------
    limit : int
        How many to keep in the end.  Half the places are for frames that failed, half for those
        that were fitted; what one kind leaves free the other takes.

    Notes
    -----
    Holds at most ``2 * limit`` pictures however many it is offered.
    """

    def __init__(self, limit: int = MOST_PICTURES) -> None:
        if limit < 0:
            raise ConfigurationError(
                ErrorCode.OUT_OF_RANGE, f"A gallery cannot show {limit} pictures; give zero or more."
            )
        self.limit = limit
        self._heaps: dict[bool, list[tuple[float, int, FrameReport]]] = {True: [], False: []}
        self._count = 0

    def add(self, report: FrameReport) -> None:
        """Offer a frame; the best-fitting of its kind makes room."""
        usable, misfit = report.row["status"] == "ok", _misfit(report.row["chi2_dof"])
        if not self._admits(usable, misfit):
            return
        heap, item = self._heaps[usable], (misfit, self._count, report)
        self._count += 1
        if len(heap) < self.limit:
            heapq.heappush(heap, item)
        else:
            heapq.heapreplace(heap, item)

    def _admits(self, usable: bool, misfit: float) -> bool:
        heap = self._heaps[usable]
        return len(heap) < self.limit or (self.limit > 0 and misfit > heap[0][0])

    def chosen(self) -> list[FrameReport]:
        """At most ``limit`` frames, failures first, each kind from the worst fit to the best."""
        failed, fitted = self._ranked(usable=False), self._ranked(usable=True)
        failed = failed[: max(self.limit // 2, self.limit - len(fitted))]
        return failed + fitted[: self.limit - len(failed)]

    def _ranked(self, usable: bool) -> list[FrameReport]:
        worst_first = sorted(self._heaps[usable], key=lambda item: (-item[0], item[1]))
        return [report for _, _, report in worst_first]


def _misfit(chi2_dof: float) -> float:
    """Rank of a frame; one without a fit comes last of the failures."""
    return chi2_dof if math.isfinite(chi2_dof) else -math.inf
