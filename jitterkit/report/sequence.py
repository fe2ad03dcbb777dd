"""Which locus the frames of a run show together.

A single frame is often undecided between two loci whose separations differ by a microarcsecond or ten; the
same question asked of many frames is not.  Their evidences multiply.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np

from jitterkit.report.means import weighted_mean
from jitterkit.report.words import angle_size

__all__ = ["compare_loci", "say_loci"]

_NEARLY_ALL = 0.95
"""Share of the frames that a locus must have been fitted to."""

_CERTAIN = 0.95
"""Weight above which a run has decided."""

_DISSENT = float(np.log(1e3))
"""By how much a frame's evidence for another locus must be greater, to contradict the run's."""


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
    frames = [{one["locus"]: one for one in json.loads(text)} for text in candidates if text]
    frames = [frame for frame in frames if len(frame) > 1]
    times = Counter(name for frame in frames for name in frame if _fitted(frame[name]))
    loci = [name for name, n in times.items() if n >= _NEARLY_ALL * len(frames)]
    whole = [frame for frame in frames if all(_fitted(frame.get(name)) for name in loci)]
    if not whole or len(loci) < 2:
        return {"frames": 0, "left_out": len(frames)}
    evidence = np.array([[frame[name]["evidence"] for name in loci] for frame in whole])
    odds = evidence.sum(axis=0) - evidence.sum(axis=0).max()
    weights = np.exp(odds) / np.exp(odds).sum()
    order = np.argsort(-odds, kind="stable")
    return {
        "frames": len(whole),
        "left_out": len(frames) - len(whole),
        "best": loci[order[0]],
        "dissent": int(np.sum(evidence.max(axis=1) - evidence[:, order[0]] > _DISSENT)),
        "weights": {loci[i]: float(weights[i]) for i in order},
        "evidence": {loci[i]: float(odds[i]) for i in order},
        "separation": {loci[i]: {"unit": "arcsec", **_mean_separation(whole, loci[i])} for i in order},
    }


def say_loci(loci: dict[str, Any]) -> str:
    """What :func:`compare_loci` found, in a sentence; nothing where nothing could be compared."""
    if not loci["frames"]:
        return ""
    best, frames, weights = loci["best"], loci["frames"], loci["weights"]
    if loci["dissent"]:
        return (
            f"The frames do not share one kind of locus: {loci['dissent']} of {frames} contradict {best}, "
            "which fits them best together."
        )
    if weights[best] > _CERTAIN:
        return f"{frames} frames together show {best} (weight {weights[best]:.3f})."
    held = np.cumsum([*weights.values()])
    likely = [*weights][: int(np.searchsorted(held, _CERTAIN)) + 1]
    means = [loci["separation"][name]["mean"] for name in likely]
    shares = ", ".join(f"{name} {weights[name]:.2f}" for name in likely)
    return (
        f"{frames} frames together are undecided ({shares}); the separation differs by "
        f"{angle_size(max(means) - min(means), 2)}."
    )


def _fitted(candidate: dict[str, Any] | None) -> bool:
    """Whether a locus was tried, and its fit has an evidence."""
    return candidate is not None and candidate["evidence"] is not None


def _mean_separation(frames: list[dict[str, Any]], name: str) -> dict[str, Any]:
    values = np.array([frame[name]["separation"] for frame in frames], float)
    errors = np.array([frame[name]["separation_err"] for frame in frames], float)
    return weighted_mean(values, errors)
