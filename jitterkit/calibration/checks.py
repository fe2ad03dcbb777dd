"""What cannot be calibration frames: one sentence for each, before anything is computed.

Reach for :func:`check_stacks`.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from jitterkit.calibration.stack import Shot, Stack
from jitterkit.calibration.stack_files import SETTINGS, WITHOUT_BIAS, differ
from jitterkit.errors import ConfigurationError, ErrorCode

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
