"""Stacks from files: every frame is looked at once, and frames of one exposure are put together.

Reach for :func:`open_stacks`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from jitterkit.calibration.stack import Shot, Stack, look
from jitterkit.errors import ConfigurationError, ErrorCode, FrameError
from jitterkit.frames import RawFrame, find_files, open_frames

_SAME_EXPOSURE = 1e-6
"""Relative; exposures nearer than that are one."""


def open_stacks(kind: str, paths: Iterable[str | Path], exposure: float | None = None) -> tuple[Stack, ...]:
    """Look at frames of one kind and group them by their exposure.

    Parameters
    ----------
    kind : {"bias", "dark", "flat"}
        Biases are one stack, whatever exposure their headers say.
    paths : iterable of str or Path
        FITS or TIFF files, or directories of them; all frames of a cube count.
    exposure : float, optional
        Of all of them [s], whatever their headers say.

    Returns
    -------
    stacks : tuple of Stack
        The shortest exposure first.

    Raises
    ------
    FrameError
        If a file cannot be read, a frame has another shape than the first, or is in electrons.
    ConfigurationError
        If a dark or flat has no exposure, or an exposure has one frame only.
    """
    shots: list[Shot] = []
    unusable: np.ndarray | None = None
    dtypes = set()
    for path in find_files(paths):
        with open_frames(path) as file:
            dtypes.add(file.dtype)
            for raw in file:
                _check(raw, kind, unusable)
                unusable = raw.mask if unusable is None else unusable | raw.mask
                shots.append(_seen(raw, kind, exposure))
    if unusable is None:
        raise ConfigurationError(ErrorCode.NO_IMAGE, f"there is no {kind} frame; name files that hold some.")
    dtype = np.result_type(*dtypes)
    groups = _grouped(shots)
    for group in groups:
        if len(group) < 2:
            at = "" if group[0].exposure is None else f" of {group[0].exposure:g} s"
            raise ConfigurationError(
                ErrorCode.TOO_FEW,
                f"{group[0].path}: there is one {kind} frame{at}; give at least two, better ten or more, so "
                "that their noise is seen.",
            )
    ny, nx = unusable.shape
    return tuple(Stack(kind, group, (ny, nx), dtype, group[0].exposure, unusable) for group in groups)


def _check(raw: RawFrame, kind: str, earlier: np.ndarray | None) -> None:
    where = raw.path or raw.name
    if raw.unit != "adu":
        raise FrameError(
            ErrorCode.UNKNOWN_UNIT,
            where,
            f"is in {raw.unit}",
            f"give the {kind} frames as they were read, in ADU",
        )
    if earlier is not None and raw.shape != earlier.shape:
        (ny, nx), (rows, columns) = raw.shape, earlier.shape
        problem = f"has {nx} x {ny} pixels, the {kind} frames before it {columns} x {rows}"
        raise FrameError(ErrorCode.WRONG_SHAPE, where, problem, "give frames of one size")


def _seen(raw: RawFrame, kind: str, exposure: float | None) -> Shot:
    seconds = None if kind == "bias" else exposure
    if kind != "bias" and seconds is None:
        seconds = raw.metadata.value("exposure")
        if seconds is None:
            raise ConfigurationError(
                ErrorCode.MISSING_VALUE,
                f"{raw.path}: the {kind} frame does not say its exposure; give --exposure in s.",
            )
    shot = look(raw.name, raw.data, seconds)
    return replace(shot, gain=raw.metadata.value("gain"), path=raw.path, index=raw.index)


def _grouped(shots: list[Shot]) -> list[tuple[Shot, ...]]:
    """Shots by exposure, rising; those of one exposure in the order they came."""
    groups: list[list[Shot]] = []
    for shot in sorted(shots, key=lambda shot: shot.exposure or 0.0):
        before = groups[-1][0].exposure or 0.0 if groups else None
        if before is not None and (shot.exposure or 0.0) <= before * (1 + _SAME_EXPOSURE):
            groups[-1].append(shot)
        else:
            groups.append([shot])
    return [tuple(group) for group in groups]
