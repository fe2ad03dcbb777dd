"""Calibration frames in files: opened, looked at once, and grouped by exposure; what their headers say.

Reach for :func:`open_stacks`; :func:`check_stacks` says what cannot be calibration frames, in one sentence
each, before anything is computed.  :data:`SETTINGS` are the cards that frames of one camera have alike.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from jitterkit.calibration.stack import Shot, Stack, look
from jitterkit.errors import ConfigurationError, ErrorCode, FrameError
from jitterkit.frames import FrameFile, RawFrame, find_files, open_frames
from jitterkit.frames.reader import Duplicates

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
    "READOUTM", "READMODE", "RDMODE",
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
    return abs(a - b) > 1e-3 * max(abs(a), abs(b))


_ODD = 10.0
"""Scatters of the pixels by which the level of a frame may differ from that of its stack."""

_SAME_LIGHT = 0.15
"""Relative difference of brightness up to which two flats of one exposure are of one level of light: lamps
change by less, and who turns one up turns it further."""

_SAME_GAIN = 1e-3
"""Relative."""


def check_stacks(bias: Stack | None, darks: Sequence[Stack], flats: Sequence[Stack]) -> None:
    """Refuse stacks that do not belong together, and frames that do not belong to their stack.

    Raises
    ------
    ConfigurationError
        With the file, the value and the remedy.
    """
    stacks = [stack for stack in (bias, *darks, *flats) if stack is not None]
    if not stacks:
        problem = "there are neither bias nor dark nor flat frames; give some."
        raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
    for stack in stacks[1:]:
        if stack.shape != stacks[0].shape:
            (ny, nx), (rows, columns) = stack.shape, stacks[0].shape
            problem = f"has {nx} x {ny} pixels, the {stacks[0].kind} frames {columns} x {rows}"
            raise _refusal(ErrorCode.WRONG_SHAPE, stack.shots[0], problem, "give frames of one size")
    shots = [shot for stack in stacks for shot in stack.shots]
    known = [shot for shot in shots if shot.gain is not None]
    for shot in known:
        if shot.gain and known[0].gain and abs(shot.gain / known[0].gain - 1) > _SAME_GAIN:
            problem = f"says a gain of {shot.gain:g} e-/ADU, {_file(known[0])} one of {known[0].gain:g}"
            remedy = "calibrate each setting of the camera by itself"
            raise _refusal(ErrorCode.WRONG_INSTRUMENT, shot, problem, remedy)
    _check_settings(shots)
    for stack in stacks:
        if len(stack) < 2:
            problem = f"there is one {stack.name} frame; give at least two."
            raise ConfigurationError(ErrorCode.TOO_FEW, problem)
        scatter = float(np.median([shot.scatter for shot in stack.shots]))
        for shot in stack.shots if stack.kind != "flat" else ():
            if abs(shot.level - stack.level) > _ODD * scatter:
                theirs = f"that of the {stack.name} frames {stack.level:.5g} ± {scatter:.2g}"
                problem = f"its level is {shot.level:.5g} ADU, {theirs}"
                remedy = "take it out, or put it where it belongs"
                raise _refusal(ErrorCode.WRONG_INSTRUMENT, shot, problem, remedy)
    if bias is not None:
        _check_against(bias, darks, flats)


def _check_settings(shots: Sequence[Shot]) -> None:
    for card in SETTINGS:
        known = [shot for shot in shots if card in shot.settings]
        for shot in known[1:]:
            here, there = shot.settings[card], known[0].settings[card]
            if differ(here, there):
                problem = f"says {card} = {here!r}, {_file(known[0])} {there!r}"
                remedy = "calibrate each camera, and each setting of it, by itself"
                raise _refusal(ErrorCode.WRONG_INSTRUMENT, shot, problem, remedy)


def _check_against(bias: Stack, darks: Sequence[Stack], flats: Sequence[Stack]) -> None:
    scatter = float(np.median([shot.scatter for shot in bias.shots]))
    for stack in (*darks, *flats):
        reduced = next((shot for shot in stack.shots if WITHOUT_BIAS in shot.settings), None)
        if reduced is not None and abs(bias.level) > scatter:
            problem = f"lacks the bias of {bias.level:.5g} ADU ({reduced.settings[WITHOUT_BIAS]} 0)"
            remedy = f"give the {stack.kind} frames as they were read"
            raise _refusal(ErrorCode.WRONG_INSTRUMENT, reduced, problem, remedy)
        if stack.level < bias.level - _ODD * scatter:
            where = f"at {stack.level:.5g} ADU, below the bias of {bias.level:.5g}"
            problem = f"the {stack.name} frames lie {where}"
            remedy = "check which are which, and that they are of one setting"
            raise _refusal(ErrorCode.WRONG_INSTRUMENT, stack.shots[0], problem, remedy)


def split_by_light(stack: Stack, pedestal: float) -> list[Stack]:
    """Split flats of one exposure where the lamp was turned up or down, the dimmest first.

    Parameters
    ----------
    stack : Stack
    pedestal : float
        Bias [ADU].

    Returns
    -------
    stacks : list of Stack

    Raises
    ------
    ConfigurationError
        If a frame stands alone, or holds no light.
    """
    order = sorted(range(len(stack)), key=lambda i: stack.shots[i].level)
    groups: list[list[int]] = [[order[0]]]
    for before, i in pairwise(order):
        low, high = (stack.shots[k].level - pedestal for k in (before, i))
        slack = 2 * stack.shots[i].scatter / 256
        if high > low + abs(low) * _SAME_LIGHT + slack:
            groups.append([i])
        else:
            groups[-1].append(i)
    for group in groups:
        shot = stack.shots[group[0]]
        if shot.level - pedestal <= shot.scatter / 16:
            problem = f"holds no light ({shot.level:.5g} ADU, the bias is {pedestal:.5g})"
            raise _refusal(ErrorCode.NO_SIGNAL, shot, problem, "leave it out of the flats")
        if len(group) < 2:
            others = stack.take(i for i in range(len(stack)) if i != group[0])
            beside = f"(the others have {others.level:.5g})"
            problem = f"is the only {stack.name} frame of {shot.level:.5g} ADU {beside}"
            raise _refusal(ErrorCode.TOO_FEW, shot, problem, "leave it out, or give two or more")
    return [stack.take(sorted(group)) for group in groups]


def _refusal(code: ErrorCode, shot: Shot, problem: str, remedy: str) -> ConfigurationError:
    """Return an error that names the file of a frame."""
    return ConfigurationError(code, f"{_file(shot)}: {problem}; {remedy}.")


def _file(shot: Shot) -> str:
    return shot.name if shot.path is None else str(shot.path)
