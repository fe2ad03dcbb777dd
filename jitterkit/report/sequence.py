"""What the frames of a run show together: their locus, and whether they fit as well as noise allows.

A single frame is often undecided between two loci whose separations differ by a microarcsecond or ten; the
same question asked of many frames is not.  Their evidences multiply. Likewise a misfit that no single frame
shows may bias all of them alike, and then their mean claims more than it knows.
"""

from __future__ import annotations

import json
import math
from array import array
from collections.abc import Iterable
from typing import Any

import numpy as np
from astropy.table import QTable
from scipy.stats import chi2

from jitterkit.report.means import weighted_mean
from jitterkit.report.outputs import FURTHER_STARS
from jitterkit.report.residual_stack import FEWEST, ResidualStack, Structure
from jitterkit.report.words import angle_size, number, with_error

_NEARLY_ALL = 0.95
"""Share of the frames that a locus must have been fitted to."""

_CERTAIN = 0.95
"""Weight above which a run has decided."""

_DISSENT = float(np.log(1e3))
"""By how much a frame's evidence for another locus must be greater, to contradict the run's."""


_CHANCE = 1e-6
"""Chance of the scatter of a run's separations below which it is named."""

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
        ``frames``, the number compared; ``left_out``, the other frames with a locus; ``best``, the locus;
        ``dissent``, how many frames give another locus a thousand times its odds; ``weights`` of all, which
        add to one; ``evidence``, logarithms of the odds against the best; and ``separation`` [arcsec] by
        locus as :func:`weighted_mean` has it, all over the same frames.

    Notes
    -----
    Loci count that nearly all frames were fitted with, and frames that were fitted with all of those.  To
    leave out frames in which a locus had no evidence, or was not tried, would be to choose frames by
    their noise: a locus tried where the others failed would always win.  So do frames that needed no other
    locus than a normal: of a drift that a frame hardly shows, the others look like a vibration.
    *Assumes* one kind of locus for the whole run, with sizes and directions of its own in each frame; where
    frames dissent, it is not so.
    """
    numbers = _numbers(candidates)
    frames = max(map(len, numbers.values()), default=0)
    loci = [name for name, rows in numbers.items() if _fitted(rows).sum() >= _NEARLY_ALL * frames]
    whole = np.all([_fitted(numbers[name]) for name in loci], axis=0) if loci else np.zeros(0, bool)
    if not whole.any() or len(loci) < 2:
        return {"frames": 0, "left_out": frames}
    columns = (np.stack([numbers[name][whole, k] for name in loci], axis=1) for k in range(3))
    evidence, separation, error = columns
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


def describe_loci(loci: dict[str, Any]) -> str:
    """Say what :func:`compare_loci` found, in a sentence; nothing where nothing could be compared."""
    if not loci["frames"]:
        return ""
    best, frames, weights = loci["best"], loci["frames"], loci["weights"]
    if loci["dissent"]:
        said = "The frames do not share one kind of locus"
        rest = f"{loci['dissent']:,} of {frames:,} contradict {best}, which fits them best together"
        return f"{said}: {rest}."
    several = (f"{frames:,} frames together", "show", "are")
    who, show, are = ("The frame", "shows", "is") if frames == 1 else several
    if weights[best] > _CERTAIN:
        return f"{who} {show} {best} (weight {weights[best]:.3f})."
    held = np.cumsum([*weights.values()])
    likely = [*weights][: int(np.searchsorted(held, _CERTAIN)) + 1]
    means = [loci["separation"][name]["mean"] for name in likely]
    shares = ", ".join(f"{name} {weights[name]:.2f}" for name in likely)
    spread = max(means) - min(means)  # NaN of one star
    differs = "" if math.isnan(spread) else f"; the separation differs by {angle_size(spread, 2)}"
    return f"{who} {are} undecided ({shares}){differs}."


def _fitted(rows: np.ndarray) -> np.ndarray:
    """Return which frames' fits with a locus have an evidence."""
    return np.isfinite(rows[:, 0])


def _numbers(candidates: Iterable[str]) -> dict[str, np.ndarray]:
    """Evidence, separation and its error by locus, (frames, 3), of the frames that have a candidate.

    Frames are read one by one: what JSON makes of 60,000 would fill 0.3 GB.
    """
    held: dict[str, array] = {}
    frames = 0
    for text in candidates:
        frame = {one["locus"]: one for one in json.loads(text)} if text else {}
        if not frame:
            continue
        for name in frame.keys() - held.keys():
            held[name] = array("d", _MISSING) * frames
        for name, numbers in held.items():
            one = frame.get(name)
            values = _MISSING if one is None else [one[key] for key in _KEYS]
            numbers.extend(math.nan if value is None else value for value in values)
        frames += 1
    return {name: np.array(numbers).reshape(-1, len(_KEYS)) for name, numbers in sorted(held.items())}


_SURE = 5.0
"""Errors of the mean chi-squared from which the model lacks something."""

_HIDDEN = 0.2
"""Errors of a frame's separation by which an effect biased it, for each root of the chi-squared that it
added: at most, of those of ``scripts/systematics`` that added any.  A wrong plate scale adds none."""


def assess_run_fit(
    chi2_dof: np.ndarray,
    dof: np.ndarray,
    separation_err: np.ndarray,
    stack: ResidualStack | None = None,
    copies: float = 1.0,
) -> dict[str, Any]:
    """Test the chi-squared of all frames of a run together, and whether their residuals have structure.

    Parameters
    ----------
    chi2_dof, dof : (n,) arrays
        Of frames that were fitted.
    separation_err : (n,) array
        arcsec; NaN without a separation.
    stack : ResidualStack, optional
        Of their residuals.
    copies : float
        How often a frame is in the stack, from :func:`~jitterkit.report.residual_stack.count_copies`.

    Returns
    -------
    fit : dict
        ``frames``; ``chi2_dof``, the mean, and its ``error``, by the scatter of the frames or by the law of
        chi-squared, whichever is larger; ``sigmas``, by how many it is above one; ``stack_frames``, those in
        the stack; ``stack_chi2_dof``, chi-squared of the stack over that of a frame; ``structure_sigmas``,
        the significance of structure in it; ``may_hide`` [arcsec], the bias of the separation that effects
        with as large a misfit had, the larger of the two: NaN where neither shows one.

    Notes
    -----
    *Fails when* a misfit is in few of the frames: their own flag ``misfit`` shows that.
    """
    known = np.isfinite(chi2_dof) & (np.asarray(dof) > 0)
    values, dof = np.asarray(chi2_dof, float)[known], np.asarray(dof, float)[known]
    mean, error, sigmas = _mean_chi2(values, dof)
    common = Structure.unknown() if stack is None else stack.structure(copies)
    added = [max(mean - 1, 0.0) * float(dof.mean())] if sigmas > _SURE else []
    added += [common.excess] if common.sigmas > _SURE else []
    errors = np.asarray(separation_err, float)
    errors = errors[np.isfinite(errors)]
    typical = float(np.median(errors)) if len(errors) else math.nan
    return {
        "frames": len(values),
        "chi2_dof": mean,
        "error": error,
        "sigmas": sigmas,
        "stack_frames": 0 if stack is None else round(stack.frames / copies),
        "stack_chi2_dof": common.chi2_dof,
        "structure_sigmas": common.sigmas,
        "may_hide": _HIDDEN * math.sqrt(max(added)) * typical if added else math.nan,
    }


def _mean_chi2(values: np.ndarray, dof: np.ndarray) -> tuple[float, float, float]:
    """Return the mean chi-squared per degree of freedom, its error, and by how many it is above one."""
    if len(values) < FEWEST:
        return math.nan, math.nan, math.nan
    mean, scatter = float(values.mean()), float(values.std(ddof=1)) / math.sqrt(len(values))
    error = max(scatter, math.sqrt(2 / dof.sum()))
    return mean, error, (mean - 1) / error


def describe_scatter(table: QTable, separation: dict[str, Any]) -> str:
    """Return in a sentence that the separations of a run scatter by more than their errors, if they do.

    Parameters
    ----------
    table : QTable
        Of results.
    separation : dict
        Of their summary.
    """
    degrees = separation["n"] - 1
    if degrees < 1 or not chi2.sf(separation["chi2_dof"] * degrees, degrees) < _CHANCE:
        return ""
    values, errors = (np.asarray(table[name], float) for name in ("separation", "separation_err"))
    values = np.where(np.asarray(table["status"]) == "ok", values, np.nan)
    off = np.abs(values - np.nanmedian(values)) / errors
    farthest = table[int(np.nanargmax(off))]
    return (
        f"The frames scatter by {number(separation['chi2_dof'] ** 0.5, 3)} times their errors: the mean "
        f"is known to {angle_size(separation['error_by_scatter'], 2)} only. The farthest from the median is "
        f"{farthest['file']} [{farthest['frame']}]; a frame of another target belongs in another run."
    )


def describe_misfits(separation: dict[str, Any]) -> str:
    """Return in a sentence how many frames have the flag ``misfit``, and the mean of the others."""
    count, others = separation["misfit"], separation["without_misfit"]
    if not count:
        return ""
    if not others["n"]:
        return "All of them have the flag misfit."
    value = with_error(others["mean"], others["error"])
    return f"{count:,} of them have the flag misfit: without these {value} arcsec."


def describe_run_fit(fit: dict[str, Any]) -> str:
    """Return in a few sentences what shows that a run's model lacks something; nothing where nothing does."""
    return " ".join(filter(None, (_describe_misfit(fit), _describe_stars(fit))))


def _describe_stars(fit: dict[str, Any]) -> str:
    """Return what stars the frames show together, what they do to the separation, and what to do."""
    if not (stars := fit.get("further_stars")):
        return ""
    without = fit["without_further_stars"]
    bias, error = (angle_size(without[name], 2) for name in ("bias", "bias_err"))
    mean = with_error(without["mean"], without["error"])
    each = [
        f"{with_error(star['delta_mag'], star['delta_mag_err'])} mag fainter than A, "
        f"{angle_size(star['separation'], 3)} from it ({number(star['sigmas'], 2)} sigmas)"
        for star in stars
    ]
    what = f"a star {each[0]}" if len(each) == 1 else f"{len(each)} stars: {'; '.join(each)}"
    them = "it" if len(each) == 1 else "them"
    return (
        f"Together the frames show {what}, which the fits lack. By {them} the mean separation is off by "
        f"{bias} ± {error}: {mean} arcsec without. Give a copy of {FURTHER_STARS} as stars in [sky] of the "
        f"instrument file and process the frames again to leave {them} out of every frame."
    )


def _describe_misfit(fit: dict[str, Any]) -> str:
    shown = []
    if fit["sigmas"] > _SURE:
        shown.append(
            f"the mean chi-squared per degree of freedom of {fit['frames']:,} frames is "
            f"{number(fit['chi2_dof'], 5)}, {number(fit['sigmas'], 2)} of its errors above one"
        )
    if fit["structure_sigmas"] > _SURE:
        shown.append(
            f"the stacked residual of {fit['stack_frames']:,} frames has structure of "
            f"{number(fit['structure_sigmas'], 2)} sigmas"
        )
    if not shown:
        return ""
    claim = f"The model lacks something: {', and '.join(shown)}."
    if not math.isfinite(fit["may_hide"]):
        return claim
    size = angle_size(fit["may_hide"], 2)
    return f"{claim} Effects that show so much biased the separation by up to {size}."
