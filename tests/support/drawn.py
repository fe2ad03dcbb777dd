"""One fitted frame drawn as a run draws it at its end."""

from __future__ import annotations

from jitterkit.frames.frame import Frame
from jitterkit.refit.result import FitResult
from jitterkit.report.pictures import FrameReport, pack_picture, render_pictures
from jitterkit.report.row import Row, make_row


def render_frame(frame: Frame, result: FitResult, row: Row | None = None) -> FrameReport:
    """Draw data, model, residual and kernel of a frame, with its own row where none is given."""
    if row is None:
        row = make_row(result, frame.path, frame.index, metadata=frame.metadata, flags=frame.flags)
    (report,) = render_pictures([(row, pack_picture(frame, result))])
    return report
