"""Declare the motions of ``jitterkit simulate``, and point the telescope while frames are exposed.

A locus has no time.  A drift, a trace and a spectrum have one: the rows of a rolling detector are exposed to
them one after the other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jitterkit.cli.loci import build_locus, refuse_other_motions
from jitterkit.cli.options import Jitter, required
from jitterkit.cli.quantities import parse_number
from jitterkit.cli.runtime import log, naming
from jitterkit.errors import ConfigurationError, ErrorCode, refuse_if

_SLOW = ("linear", "path", "partial", "smear")
"""Loci that a slow motion makes, which matters to a rolling shutter."""


@dataclass(frozen=True)
class Pointing:
    """Hold the jitter of the frames, common to all or frame by frame.

    Parameters
    ----------
    loci : Locus or list of Locus
    positions : (frames, 2) array, optional
        Mean pointing of each frame, arcsec.
    velocity : (2,) tuple, optional
        arcsec/s.
    shutters : Shutter or list of Shutter, optional
        In place of a velocity.
    """

    loci: Any
    positions: Any = None
    velocity: tuple[float, float] | None = None
    shutters: Any = None


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Choose a motion in place of a locus, or beside it.

    Parameters
    ----------
    trace : FILE.csv
        A measured pointing in place of a locus: columns t,x,y in s and arcsec. Every frame gets the same
        exposure of it, the first; --set start=SECONDS for another.
    spectrum : FILE.csv
        A spectrum of the motion in place of a locus: columns f,x,y[,xy] in Hz and arcsec²/Hz, or lines
        frequency,amplitude,angle[,minor] in Hz, arcsec and degrees. One motion is drawn from it; every frame
        gets its own piece of the motion, and its mean position.
    drift : VX,VY
        A uniform drift beside the locus, arcsec/s. The frames follow each other without a gap: each is
        smeared by speed times exposure, and the pair moves on; --x and --y are its middle.
    """

    trace: Path | None = None
    spectrum: Path | None = None
    kind: str | None = None
    drift: str | None = None

    def pointing(self, jitter: Jitter, telescope, frames: int, row_order: int, generator) -> Pointing:
        """Return the pointing of consecutive frames.

        Raises
        ------
        ConfigurationError
            If two motions are given, one that cannot be used, or the kind of a spectrum without one.
        """
        sizes, locus = jitter.size_values(), jitter.locus
        useless = self.kind is not None and self.spectrum is None
        refuse_if(useless, ErrorCode.CONFLICT, "--kind is for a --spectrum; leave it out.")
        if self.spectrum is not None:
            refuse_other_motions("--spectrum", locus, sizes, trace=self.trace, drift=self.drift)
            return shaken(self.spectrum, telescope, frames, row_order, generator, self.kind)
        if self.trace is not None:
            refuse_other_motions("--trace", "stable", (), drift=self.drift)
            return _traced(self.trace, telescope, locus, sizes, row_order)
        if self.drift is not None:
            return _drifting(self.drift, telescope, build_locus(locus, sizes), frames)
        return _resting(build_locus(locus, sizes), locus, telescope.detector)


def _resting(locus, name: str, detector) -> Pointing:
    """Return a locus without a motion; log that all rows of a rolling detector see it at once."""
    if detector.line_time and name in _SLOW:
        remedy = "give --drift, --trace or --spectrum for the detector to roll"
        log(f"The locus {name} has no time, so all rows are exposed at once; {remedy}.")
    return Pointing(locus)


def _drifting(drift: str, telescope, locus, frames: int) -> Pointing:
    """Return a uniform drift ``VX,VY`` through consecutive frames, which also shake by ``locus``.

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


def _traced(path: Path, telescope, locus: str, sizes: dict[str, Any], row_order: int) -> Pointing:
    """Return the measured pointing in a file over one exposure, from its start or ``start``, for every frame.

    A rolling detector begins as early as the rows of the frame permit, unless ``start`` is among the sizes.
    """
    from jitterkit.loci import Stable, Trace, read_trace

    rolls = bool(telescope.detector.line_time)
    exposure = _exposure(telescope, "a --trace to move it") if rolls else telescope.exposure
    refuse_other_motions("--trace", locus, [name for name in sizes if name != "start"])
    with naming(path):
        t, x, y = read_trace(path, log=log)
        if rolls:
            begin = sizes.get("start", t[0] + _wait(telescope))
            return Pointing(Stable.of(), shutters=_following(telescope, (t, x, y), begin, row_order))
        trace = Trace.of(t, x, y, start=sizes.get("start"), exposure=exposure)
    duration = float(t[-1] - t[0])
    if exposure is not None and duration > 1.01 * exposure:  # beyond a sample or two over
        first = "" if "start" in sizes else "the first "
        log(f"{path}: {first}{exposure:g} of {duration:g} s of the trace are used for every frame.")
    return Pointing(trace)


def shaken(
    path: Path, telescope, frames: int, row_order: int, generator, kind: str | None = None
) -> Pointing:
    """Return consecutive pieces of a motion drawn from the spectrum in a file, of bins or a curve (``kind``).

    Raises
    ------
    ConfigurationError
        If the file holds a trace, or the exposure is not known.
    """
    import numpy as np

    from jitterkit.motion import PowerSpectrum, read_motion, simulate_exposures

    motion = read_motion(path, kind=kind, log=log)
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
    positions = means[used] - means[used].mean(axis=0)
    shutters = [_following(telescope, record, exposure * (margin + k), row_order) for k in range(frames)]
    return Pointing([_fast(locus) for locus in loci[used]], positions, shutters=shutters)


def _velocity(text: str) -> tuple[float, float]:
    remedy = "write velocities along x and y in arcsec/s, --drift 0.5,-0.2"
    problem = f"--drift {text} is not understood; {remedy}."
    vx, _, vy = text.partition(",")
    return parse_number(vx, math.isfinite, problem), parse_number(vy, math.isfinite, problem)


def _exposure(telescope, purpose: str) -> float:
    return required(telescope, f"exposure; give it one for {purpose}", telescope.exposure)


def _wait(telescope) -> float:
    """Return the time [s] between the exposures of a frame's central row and its last."""
    return (telescope.shape[0] - 1) / 2 * abs(telescope.detector.line_time or 0.0)


def _following(telescope, record, start: float, row_order: int):
    from jitterkit.shutter import Following

    line_time, (t, x, y) = telescope.detector.line_time * row_order, record
    return Following.of(line_time, t, x, y, start, telescope.exposure, telescope.shape[0])


def _record(loci, means, exposure: float):
    """Return the record ``t, x, y`` of consecutive frames; each begins where the last one ended."""
    import numpy as np

    traces = [_parts(locus)[0] for locus in loci]
    t = [exposure * (k + np.asarray(trace.times[:-1])) for k, trace in enumerate(traces)]
    positions = [np.asarray(trace.positions[:-1]) + mean for trace, mean in zip(traces, means, strict=True)]
    end = np.asarray(traces[-1].positions[-1:]) + means[-1]
    x, y = np.concatenate([*positions, end]).T
    return np.append(np.concatenate(t), exposure * len(traces)), x, y


def _fast(locus):
    """Return the factors of the locus of a shaken frame without its trace."""
    from jitterkit.loci import Product, Stable

    _, *fast = _parts(locus)
    return fast[0] if len(fast) == 1 else Product(*fast) if fast else Stable.of()


def _parts(locus):
    from jitterkit.loci import Product

    return locus.factors() if isinstance(locus, Product) else (locus,)
