"""Which locus the frames of a run show together.

A single frame is often undecided between two loci whose separations differ by a microarcsecond or ten; the
same question asked of many frames is not.  Their evidences multiply.
"""

from __future__ import annotations

import json
import math
from array import array
from collections.abc import Iterable
from typing import Any

import numpy as np

from jitterkit.report.means import weighted_mean
from jitterkit.report.words import angle_size

_NEARLY_ALL = 0.95
"""Share of the frames that a locus must have been fitted to."""

_CERTAIN = 0.95
"""Weight above which a run has decided."""

_DISSENT = float(np.log(1e3))
"""By how much a frame's evidence for another locus must be greater, to contradict the run's."""


_KEYS = ("evidence", "separation", "separation_err")
_MISSING = (math.nan,) * len(_KEYS)


def compare_loci(candidates: Iterable[str]) -> dict[str, Any]:
    """Add up the evidence of frames.

    Parameters
    ----------
    candidates : iterable of str
        The column ``candidates`` of a results table.

    Returns
    -------
    loci : dict
        ``frames``, the number compared; ``left_out``, of those with several candidates; ``best``, the locus;
        ``dissent``, how many frames give another locus a thousand times its odds; ``weights`` of all, which
        add to one; ``evidence``, logarithms of the odds against the best; and ``separation`` [arcsec] by
        locus as :func:`weighted_mean` has it, all over the same frames.

    Notes
    -----
    Loci count that nearly all frames were fitted with, and frames that were fitted with all of those.  To
    leave out frames in which a locus had no evidence, or was not tried, would be to choose frames by
    their noise: a locus tried where the others failed would always win.
    *Assumes* one kind of locus for the whole run, with sizes and directions of its own in each frame; where
    frames dissent, it is not so.
    """
    numbers = _numbers(candidates)
    frames = max(map(len, numbers.values()), default=0)
    loci = [name for name, rows in numbers.items() if _fitted(rows).sum() >= _NEARLY_ALL * frames]
    whole = np.all([_fitted(numbers[name]) for name in loci], axis=0) if loci else np.zeros(0, bool)
    if not whole.any() or len(loci) < 2:
        return {"frames": 0, "left_out": frames}
    evidence, separation, error = (
        np.stack([numbers[name][whole, k] for name in loci], axis=1) for k in range(3)
    )
    odds = evidence.sum(axis=0) - evidence.sum(axis=0).max()
    weights = np.exp(odds) / np.exp(odds).sum()
    order = np.argsort(-odds, kind="stable")
    return {
        "frames": int(whole.sum()),
        "left_out": frames - int(whole.sum()),
        "best": loci[order[0]],
        "dissent": int(np.sum(evidence.max(axis=1) - evidence[:, order[0]] > _DISSENT)),
        "weights": {loci[i]: float(weights[i]) for i in order},
        "evidence": {loci[i]: float(odds[i]) for i in order},
        "separation": {
            loci[i]: {"unit": "arcsec", **weighted_mean(separation[:, i], error[:, i])} for i in order
        },
    }


def say_loci(loci: dict[str, Any]) -> str:
    """What :func:`compare_loci` found, in a sentence; nothing where nothing could be compared."""
    if not loci["frames"]:
        return ""
    best, frames, weights = loci["best"], loci["frames"], loci["weights"]
    if loci["dissent"]:
        return (
            f"The frames do not share one kind of locus: {loci['dissent']:,} of {frames:,} contradict "
            f"{best}, which fits them best together."
        )
    who, show, are = (
        ("The frame", "shows", "is") if frames == 1 else (f"{frames:,} frames together", "show", "are")
    )
    if weights[best] > _CERTAIN:
        return f"{who} {show} {best} (weight {weights[best]:.3f})."
    held = np.cumsum([*weights.values()])
    likely = [*weights][: int(np.searchsorted(held, _CERTAIN)) + 1]
    means = [loci["separation"][name]["mean"] for name in likely]
    shares = ", ".join(f"{name} {weights[name]:.2f}" for name in likely)
    return (
        f"{who} {are} undecided ({shares}); the separation differs by "
        f"{angle_size(max(means) - min(means), 2)}."
    )


def _fitted(rows: np.ndarray) -> np.ndarray:
    """Which frames' fits with a locus have an evidence."""
    return np.isfinite(rows[:, 0])


def _numbers(candidates: Iterable[str]) -> dict[str, np.ndarray]:
    """Evidence, separation and its error by locus, (frames, 3), of the frames that have several candidates.

    Frames are read one by one: what JSON makes of 60,000 would fill 0.3 GB.
    """
    held: dict[str, array] = {}
    frames = 0
    for text in candidates:
        frame = {one["locus"]: one for one in json.loads(text)} if text else {}
        if len(frame) < 2:
            continue
        for name in frame.keys() - held.keys():
            held[name] = array("d", _MISSING) * frames
        for name, numbers in held.items():
            one = frame.get(name)
            numbers.extend(_MISSING if one is None else (_number(one[key]) for key in _KEYS))
        frames += 1
    return {name: np.array(numbers).reshape(-1, len(_KEYS)) for name, numbers in sorted(held.items())}


def _number(value: float | None) -> float:
    return math.nan if value is None else value
