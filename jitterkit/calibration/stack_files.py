"""Calibration frames in files: opened, looked at once, and grouped by exposure; what their headers say.

Reach for :func:`open_stacks`.  :data:`SETTINGS` are the cards that frames of one camera have alike.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from jitterkit.calibration.stack import Shot, Stack, look
from jitterkit.errors import ConfigurationError, ErrorCode, FrameError
from jitterkit.frames import FrameFile, RawFrame, find_files, open_frames
from jitterkit.frames.reader import Duplicates
from jitterkit.frames.window import WINDOW_CARDS

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
        If a file cannot be read or holds images of several detectors, or a frame has another shape than the
        first, is in electrons, is of another kind by its header, or has the pixels of an earlier one and is
        no saturated flat.
    ConfigurationError
        If a dark or flat has no exposure, or an exposure has one frame only.
    """
    shots: list[Shot] = []
    unusable: np.ndarray | None = None
    dtypes, known = set(), Duplicates()
    for path in find_files(paths):
        with open_frames(path) as file:
            dtypes.add(file.dtype)
            for raw in file:
                _check(raw, kind, unusable, file.hdu)
                unusable = raw.mask if unusable is None else unusable | raw.mask
                shots.append(shot := _seen(raw, kind, exposure, file))
                where = str(path.with_name(raw.name))
                digest = "" if kind == "flat" and shot.saturated else shot.digest  # full pixels are alike
                if first := known.original(digest, where):
                    problem = f"has the pixels of {first}, and copies have no noise between them"
                    remedy = f"leave it out of the {kind} frames"
                    raise FrameError(ErrorCode.DUPLICATE, where, problem, remedy)
    if unusable is None:
        raise ConfigurationError(ErrorCode.NO_IMAGE, f"there is no {kind} frame; name files that hold some.")
    groups = _grouped(shots)
    for group in groups:
        if len(group) < 2:
            at = "" if group[0].exposure is None else f" of {group[0].exposure:g} s"
            problem = f"{group[0].path}: there is one {kind} frame{at}"
            remedy = "give at least two, better ten or more, so that their noise is seen"
            raise ConfigurationError(ErrorCode.TOO_FEW, f"{problem}; {remedy}.")
    shape, dtype = (unusable.shape[0], unusable.shape[1]), np.result_type(*dtypes)
    return tuple(Stack(kind, tuple(g), shape, dtype, g[0].exposure, unusable) for g in groups)


def _check(raw: RawFrame, kind: str, earlier: np.ndarray | None, hdu: int | None) -> None:
    where = raw.path or raw.name
    if raw.hdu != hdu:
        problem = f"holds images of several detectors (HDU {hdu} and HDU {raw.hdu})"
        raise FrameError(ErrorCode.UNSUPPORTED, where, problem, "write each detector into files of its own")
    if raw.unit != "adu":
        remedy = f"give the {kind} frames as they were read, in ADU"
        raise FrameError(ErrorCode.UNKNOWN_UNIT, where, f"is in {raw.unit}", remedy)
    if earlier is not None and raw.shape != earlier.shape:
        (ny, nx), (rows, columns) = raw.shape, earlier.shape
        problem = f"has {nx} x {ny} pixels, the {kind} frames before it {columns} x {rows}"
        raise FrameError(ErrorCode.WRONG_SHAPE, where, problem, "give frames of one size")


def _seen(raw: RawFrame, kind: str, exposure: float | None, file: FrameFile) -> Shot:
    unlike = check_kind(raw, kind, file.text)
    seconds = None if kind == "bias" else exposure
    if kind != "bias" and seconds is None:
        seconds = raw.metadata.value("exposure")
        if seconds is None:
            problem = f"{raw.path}: the {kind} frame does not say its exposure; give --exposure in s."
            raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
    if kind == "flat" and seconds is not None and not seconds > 0:
        problem = f"{raw.path}: the flat frame has an exposure of {seconds:g} s; give --exposure in s."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    shot, known = look(raw.name, raw.data, seconds), raw.metadata
    shot = replace(shot, path=raw.path, index=raw.index, gain=known.value("gain"))
    settings = {card: said for card in (*SETTINGS, TEMPERATURE, FILTER) if (said := file.text(card))}
    if known.bias is not None and "was subtracted" in known.bias.source:
        settings[WITHOUT_BIAS] = known.bias.source
    return replace(shot, warnings=(*known.warnings, *unlike), settings=settings)


def _grouped(shots: list[Shot]) -> list[list[Shot]]:
    """Shots by exposure, rising; those of one exposure in the order they came."""
    groups: list[list[Shot]] = []
    longest = -1.0  # of the group
    for shot in sorted(shots, key=lambda shot: shot.exposure or 0.0):
        if (seconds := shot.exposure or 0.0) > longest:
            groups.append([])
            longest = seconds * (1 + _SAME_EXPOSURE)
        groups[-1].append(shot)
    return groups


_KIND_CARDS = (
    "IMAGETYP", "OBSTYPE", "FRAME", "FRAMETYP", "IMTYPE", "EXP_TYPE", "VIMTYPE", "ESO DPR TYPE",
)  # fmt: skip

_KINDS: Mapping[str, str] = {
    "dark": r"flat[ _-]?dark|dark[ _-]?flat|dark",
    "bias": r"bias|zero|offset",
    "flat": r"flat|twilight",
    "light": r"light|object|science|target",
}
"""What the text of such a card says of a kind; the first that matches counts."""

_UNEXPOSED = 1.0
"""Seconds below which a dark may stand for a bias frame: many cameras take none of zero."""

SETTINGS = (
    "INSTRUME", "DETNAM", "XBINNING", "YBINNING", "CCDSUM", "BINNING", "GAIN", "OFFSET", "BLKLEVEL",
    "READOUTM", "READMODE", "RDMODE", *WINDOW_CARDS,
)  # fmt: skip
"""Cards that are alike in frames of one camera at one setting."""

TEMPERATURE, FILTER = "CCD-TEMP", "FILTER"

WITHOUT_BIAS = "without bias"
"""Setting of a frame whose header says that its bias was subtracted: the card."""


def check_kind(raw: RawFrame, kind: str, text: Callable[[str], str]) -> tuple[str, ...]:
    """Refuse a frame that its header calls a calibration frame of another kind.

    Parameters
    ----------
    raw : RawFrame
    kind : {"bias", "dark", "flat"}
        What it is given as.
    text : callable
        Returns the text of a card, empty where there is none.

    Returns
    -------
    warnings : tuple of str
        One if the header calls it a light frame, as programs call any frame.

    Raises
    ------
    FrameError
    """
    card, said = next(((card, text(card)) for card in _KIND_CARDS if text(card)), ("", ""))
    other = next((name for name, pattern in _KINDS.items() if re.search(pattern, said, re.I)), kind)
    unexposed = (raw.metadata.value("exposure") or 0.0) < _UNEXPOSED
    if other == kind or (kind == "bias" and other == "dark" and unexposed):
        return ()
    name = f"{card} = {said!r}"
    if other == "light":
        return (f"{name} says that they are not {kind} frames",)
    problem = f"is given as a {kind} frame, and is none by {name}"
    remedy = f"leave it out of the {kind} frames, or correct {card}"
    raise FrameError(ErrorCode.WRONG_INSTRUMENT, raw.path or raw.name, problem, remedy)


def differ(one: str, other: str) -> bool:
    """Return whether two texts of a card differ, and not only in how a number or a case is written.

    >>> differ("1", "1.0"), differ("1 1", "1x1"), differ("High Gain", "Low Gain")
    (False, False, True)
    """
    a, b = (re.split(r"[\s,x]+", text.strip().lower()) for text in (one, other))
    return len(a) != len(b) or any(_unlike(*pair) for pair in zip(a, b, strict=True))


def _unlike(one: str, other: str) -> bool:
    try:
        a, b = float(one), float(other)
    except ValueError:
        return one != other
    return abs(a - b) > (0 if a.is_integer() and b.is_integer() else 1e-3) * max(abs(a), abs(b))
