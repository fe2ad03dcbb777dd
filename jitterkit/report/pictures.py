"""One fitted frame as a picture: data, model, residual and kernel side by side.

A run keeps :func:`pack_picture` of a few frames and draws the worst of them at its end with
:func:`render_pictures`; :func:`choose_pictures` says which.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, printable
from jitterkit.frames.frame import Frame
from jitterkit.loci import LOCI, Locus, locus_name
from jitterkit.refit.result import FitResult
from jitterkit.report import plots
from jitterkit.report.kernel_plots import plot_kernel
from jitterkit.report.row import Row
from jitterkit.report.words import number
from jitterkit.scene import Stars

MOST_PICTURES = 24
"""Frames that a report shows."""


@dataclass(frozen=True)
class FrameReport:
    """Hold a frame for a report: some text and one encoded picture.

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


@dataclass(frozen=True, eq=False)
class _Picture:
    """Arrays to draw of a frame: images (ny, nx), masked pixels NaN; the scale in arcsec per pixel."""

    name: str
    plate_scale: float | None
    data: np.ndarray
    model: np.ndarray | None = None
    residual: np.ndarray | None = None
    chi2_dof: float = math.nan
    stars: np.ndarray | None = None
    letters: str = ""
    locus: Locus | None = None
    locus_name: str = ""


def pack_picture(frame: Frame, result: FitResult) -> bytes:
    """Return what a picture is drawn from, compressed: about 0.15 MB for a frame of 128 x 128 pixels."""
    p, scale = result.parameters, frame.plate_scale
    header = {"name": printable(frame.name), "plate_scale": scale, "kind": ""}
    arrays: dict[str, Any] = {"data": np.where(frame.mask, np.nan, frame.electrons)}
    if result.image is not None and result.residual is not None:
        arrays |= {"model": result.image, "residual": result.residual}
        header["chi2_dof"] = result.chi2_dof
        if p is not None:
            letters = "" if isinstance(p.scene, Stars) else "AB"
            header |= {"letters": letters, "locus_name": result.locus, "kind": locus_name(p.locus)}
            if scale is not None:
                arrays["stars"] = p.scene.sources()[:2]
    arrays = {name: np.asarray(array, np.float32) for name, array in arrays.items()}
    if p is not None and header["kind"] in LOCI:
        arrays["coords"] = np.asarray(p.locus.coords)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, text=np.array(json.dumps(header)), **arrays)
    return buffer.getvalue()


def render_pictures(packed: Iterable[tuple[Row, bytes]]) -> Iterator[FrameReport]:
    """Draw what :func:`pack_picture` packed of frames, given with their rows, one after the other."""
    panels = None
    for row, data in packed:
        picture = _unpack(data)
        if panels is None or not panels.suit(picture):
            panels = _Panels(picture)
        yield panels.draw(picture, row)


def _unpack(packed: bytes) -> _Picture:
    with np.load(io.BytesIO(packed), allow_pickle=False) as arrays:
        found = {name: arrays[name] for name in arrays.files}
    header = json.loads(str(found.pop("text")))
    kind, coords = header.pop("kind"), found.pop("coords", None)
    # not all kinds are built from their coordinates alone
    locus = None if coords is None else LOCI[kind].near(np.array([1.0, 0.0, 1.0])).at(coords)
    return _Picture(**header, **found, locus=locus)


def choose_pictures(rows: Sequence[Row], limit: int = MOST_PICTURES) -> list[int]:
    """Choose the frames of a run that are worth a picture: what failed, and what fits worst.

    Parameters
    ----------
    rows : sequence of dict
    limit : int
        How many to choose.  Half are frames that failed, half those that were fitted; what one kind leaves
        free the other takes.

    Returns
    -------
    indices : list of int
        Failures first, each kind from the worst fit to the best; one without a fit comes last of its kind,
        and ties stay in order.
    """
    if limit < 0:
        problem = f"A report cannot show {limit} pictures; give zero or more."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    misfits = [row["chi2_dof"] if math.isfinite(row["chi2_dof"]) else -math.inf for row in rows]
    ordered = sorted(range(len(rows)), key=lambda i: -misfits[i])
    fitted = [i for i in ordered if rows[i]["status"] == "ok"]
    failed = [i for i in ordered if rows[i]["status"] != "ok"]
    failed = failed[: max(limit // 2, limit - len(fitted))]
    return failed + fitted[: limit - len(failed)]


class _Panels:
    """Four panels for pictures of frames of one shape and scale: to make axes takes longer than to draw."""

    def __init__(self, picture: _Picture) -> None:
        self._like, self._axes = self._kind(picture), plots.four_panels()
        data, model, residual, kernel = self._axes
        plots.plot_image(picture.data, picture.plate_scale, data, title="data")
        if picture.model is None or picture.residual is None:
            for ax in (model, residual, kernel):
                ax.set_axis_off()
            return
        plots.plot_image(picture.model, picture.plate_scale, model, title="model")
        plots.plot_residual(picture.residual, picture.plate_scale, residual)
        for ax in (model, residual):
            ax.set_ylabel("")
        for ax in (data, model):
            ax.set_title(ax.get_title(), y=1.0)  # where it is anyway; to find that place takes a while

    def suit(self, picture: _Picture) -> bool:
        """Return whether a picture can be drawn on these panels."""
        return self._kind(picture) == self._like

    def draw(self, picture: _Picture, row: Row) -> FrameReport:
        """Draw a picture in place of the one before."""
        data, model, residual, kernel = self._axes
        plots.change_image(data, picture.data, plots.stretch(picture.data))
        shown = "data"
        if picture.model is not None and picture.residual is not None:
            shown = "data, model, residual and jitter kernel"
            plots.change_image(model, picture.model, plots.stretch(picture.model))
            plots.change_image(residual, picture.residual)
            residual.set_title(f"residual, χ²/dof = {number(picture.chi2_dof, 4)}", y=1.0)
            for mark in (*model.lines, *model.texts):
                mark.remove()
            if picture.stars is not None:
                x, y = picture.stars
                plots.plot_stars(x, y, model, picture.letters)
            kernel.clear()
            kernel.set_axis_off()
            if picture.locus is not None:
                kernel.set_axis_on()
                title = f"kernel: {picture.locus_name}"
                plot_kernel(picture.locus, kernel, plate_scale=picture.plate_scale, title=title)
        return FrameReport(picture.name, row, plots.small_png(data), f"{shown} of {picture.name}")

    def _kind(self, picture: _Picture) -> tuple:
        return picture.data.shape, picture.plate_scale, picture.model is None or picture.residual is None
