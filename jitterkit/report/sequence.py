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

__all__ = ["compare_loci"]

_NEARLY_ALL = 0.95
"""Share of the frames that a locus must have been fitted to."""


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
        ``weights`` of all, which add to one; ``evidence``, logarithms of the odds against the best; and
        ``separation`` [arcsec] by locus as :func:`weighted_mean` has it, all over the same frames.

    Notes
    -----
    Loci count that nearly all frames were fitted with, and frames that were fitted with all of those.  To
    leave out frames in which a locus had no evidence, or was not tried, would be to choose frames by
    their noise: a locus tried where the others failed would always win.
    *Assumes* one kind of locus for the whole run, with sizes and directions of its own in each frame.
    """
    frames = [{one["locus"]: one for one in json.loads(text)} for text in candidates if text]
    frames = [frame for frame in frames if len(frame) > 1]
    times = Counter(name for frame in frames for name in frame if _fitted(frame[name]))
    loci = [name for name, n in times.items() if n >= _NEARLY_ALL * len(frames)]
    whole = [frame for frame in frames if all(_fitted(frame.get(name)) for name in loci)]
    if not whole or len(loci) < 2:
        return {"frames": 0, "left_out": len(frames)}
    evidence = np.array([[frame[name]["evidence"] for name in loci] for frame in whole]).sum(axis=0)
    odds = evidence - evidence.max()
    weights = np.exp(odds) / np.exp(odds).sum()
    order = np.argsort(-odds, kind="stable")
    return {
        "frames": len(whole),
        "left_out": len(frames) - len(whole),
        "best": loci[order[0]],
        "weights": {loci[i]: float(weights[i]) for i in order},
        "evidence": {loci[i]: float(odds[i]) for i in order},
        "separation": {loci[i]: {"unit": "arcsec", **_mean_separation(whole, loci[i])} for i in order},
    }


def _fitted(candidate: dict[str, Any] | None) -> bool:
    """Whether a locus was tried, and its fit has an evidence."""
    return candidate is not None and candidate["evidence"] is not None


def _mean_separation(frames: list[dict[str, Any]], name: str) -> dict[str, Any]:
    values = np.array([frame[name]["separation"] for frame in frames], float)
    errors = np.array([frame[name]["separation_err"] for frame in frames], float)
    return weighted_mean(values, errors)
