"""How the telescope points while ``jitterkit simulate`` exposes frames: drifting, traced, or shaken.

A locus has no time.  A drift, a trace and a spectrum do, and where the detector rolls its rows are exposed
to them one after the other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jitterkit.cli.loci import trace_of
from jitterkit.cli.runtime import say

__all__ = ["Pointing", "drifting", "resting", "shaken", "traced"]

_SLOW = ("linear", "path", "partial", "smear")
"""Loci that a slow motion makes, which matters to a rolling shutter."""


@dataclass(frozen=True)
class Pointing:
    """The jitter of the frames, common to all or frame by frame.

    Parameters
    ----------
    loci : Locus or list of Locus
    places : (frames, 2) array, optional
        Where the pointing stands meanwhile, arcsec.
    velocity : (2,) tuple, optional
        arcsec/s.
    shutters : Shutter or list of Shutter, optional
        In place of a velocity.
    """

    loci: Any
    places: Any = None
    velocity: tuple[float, float] | None = None
    shutters: Any = None


def resting(locus, name: str, detector) -> Pointing:
    """A locus by itself; a rolling detector is told of what it does not say."""
    if detector.line_time and name in _SLOW:
        say(
            f"The locus {name} does not say when the pointing was where, so all rows are exposed at once; "
            "give --drift, --trace or --spectrum for the detector to roll."
        )
    return Pointing(locus)


def drifting(drift: str, telescope, locus, frames: int) -> Pointing:
    """A uniform drift ``VX,VY`` through consecutive frames, about ``locus``: each is smeared by its share.

    Raises
    ------
    ConfigurationError
        If it is not two finite numbers, or the exposure is not known.
    """
    import numpy as np

    from jitterkit.loci import Linear, Mvn, Product, Smear, Stable

    vx, vy = _velocity(drift)
    exposure = _exposure(telescope, "a --drift to move it")
    streak = Linear.of(exposure * np.hypot(vx, vy), np.degrees(np.arctan2(vy, vx)))
    steps = exposure * (np.arange(frames) - (frames - 1) / 2)
    product = Smear if isinstance(locus, Mvn) else Product
    both = streak if isinstance(locus, Stable) else product(streak, locus)
    return Pointing(both, np.outer(steps, (vx, vy)), (vx, vy))


def traced(path: Path, telescope, locus: str, sizes: dict[str, Any], row_order: int) -> Pointing:
    """The measured pointing in a file, the same for every frame.

    A detector that rolls begins as early as the rows of the frame let it, if not told when.
    """
    if not telescope.detector.line_time:
        return Pointing(trace_of(path, telescope.exposure, locus, sizes))
    from jitterkit.errors import ConfigurationError
    from jitterkit.loci import Stable, read_trace

    exposure = _exposure(telescope, "a --trace to move it")
    if not set(sizes) <= {"start"} or locus != "stable":
        trace_of(path, exposure, locus, sizes)  # refuses
    t, x, y = read_trace(path)
    begin = sizes.get("start", t[0] + _wait(telescope))
    try:
        return Pointing(Stable.of(), shutters=_following(telescope, (t, x, y), begin, row_order))
    except ConfigurationError as error:
        raise ConfigurationError(error.code, f"{path}: {error}") from None


def shaken(
    path: Path, telescope, frames: int, row_order: int, generator, kind: str | None = None
) -> Pointing:
    """Consecutive frames in a motion drawn from the spectrum in a file, of bins or a curve (``kind``).

    Raises
    ------
    ConfigurationError
        If the file holds a trace, or the exposure is not known.
    """
    import numpy as np

    from jitterkit.errors import ConfigurationError, ErrorCode
    from jitterkit.motion import PowerSpectrum, read_motion, simulate_exposures

    motion = read_motion(path, kind=kind, tell=say)
    if not isinstance(motion, PowerSpectrum):
        raise ConfigurationError(ErrorCode.UNSUPPORTED, f"{path} is a trace; give it by --trace.")
    exposure = _exposure(telescope, "a --spectrum to shake it")
    # the rows at the ends of a frame are exposed while its neighbours are
    margin = int(np.ceil(_wait(telescope) / exposure))
    loci, means = simulate_exposures(motion, exposure, frames + 2 * margin, generator)
    if not margin:
        return Pointing(loci, means)
    record = _record(loci, means, exposure)
    used = slice(margin, margin + frames)
    places = means[used] - means[used].mean(axis=0)
    shutters = [_following(telescope, record, exposure * (margin + k), row_order) for k in range(frames)]
    return Pointing([_fast(locus) for locus in loci[used]], places, shutters=shutters)


def _velocity(text: str) -> tuple[float, float]:
    from jitterkit.errors import ConfigurationError, ErrorCode

    code = ErrorCode.OUT_OF_RANGE
    try:
        vx, vy = (float(value) for value in text.split(","))
    except ValueError:
        code, vx, vy = ErrorCode.MALFORMED, math.nan, math.nan
    if not math.isfinite(vx) or not math.isfinite(vy):
        raise ConfigurationError(
            code,
            f"--drift {text} is not understood; write velocities along x and y in arcsec/s, --drift "
            "0.5,-0.2.",
        )
    return vx, vy


def _exposure(telescope, purpose: str) -> float:
    from jitterkit.errors import ConfigurationError, ErrorCode

    if telescope.exposure is None:
        raise ConfigurationError(
            ErrorCode.MISSING_VALUE,
            f"The instrument {telescope.name!r} has no exposure; give it one for {purpose}.",
        )
    return telescope.exposure


def _wait(telescope) -> float:
    """Time [s] between the exposures of a frame's central row and its last."""
    return (telescope.shape[0] - 1) / 2 * abs(telescope.detector.line_time or 0.0)


def _following(telescope, record, start: float, row_order: int):
    from jitterkit.shutter import Following

    line_time, (t, x, y) = telescope.detector.line_time * row_order, record
    return Following.of(line_time, t, x, y, start, telescope.exposure, telescope.shape[0])


def _record(loci, means, exposure: float):
    """The record ``t, x, y`` of which consecutive frames are the pieces; each begins where the last ended."""
    import numpy as np

    traces = [_parts(locus)[0] for locus in loci]
    t = [exposure * (k + np.asarray(trace.times[:-1])) for k, trace in enumerate(traces)]
    places = [np.asarray(trace.places[:-1]) + mean for trace, mean in zip(traces, means, strict=True)]
    end = np.asarray(traces[-1].places[-1:]) + means[-1]
    x, y = np.concatenate([*places, end]).T
    return np.append(np.concatenate(t), exposure * len(traces)), x, y


def _fast(locus):
    """What a locus of a shaken frame has beside its trace."""
    from jitterkit.loci import Product, Stable

    _, *fast = _parts(locus)
    return fast[0] if len(fast) == 1 else Product(*fast) if fast else Stable.of()


def _parts(locus):
    from jitterkit.loci import Product

    return locus.factors() if isinstance(locus, Product) else (locus,)
