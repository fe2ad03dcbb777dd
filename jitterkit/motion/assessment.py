"""Everything about a motion that an exposure time decides, in one record.

Reach for :func:`assess_motion` with what :func:`~jitterkit.motion.files.read_motion` returned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jitterkit.loci import Locus
from jitterkit.motion.budget import REGIMES, Share, motion_budget, smooth_locus
from jitterkit.motion.loop import close_loop, follow
from jitterkit.motion.prediction import predicted_locus, smeared_locus
from jitterkit.motion.record import Record, measure_exposures, trace_spectrum
from jitterkit.motion.spectrum import PowerSpectrum
from jitterkit.motion.split import Split, motion_between_frames, split_spectrum


@dataclass(frozen=True, eq=False)
class Assessment:
    """What exposures see of a motion.

    Attributes
    ----------
    exposure, cadence : float
        Of a frame, and from the start of one to that of the next, s.
    bandwidth : float or None
        Of a pointing loop, Hz.
    spectrum : PowerSpectrum
        Of what the loop leaves; of a record, Welch's estimate.
    shares : tuple of Share
        Source by source; none of a record.
    split, unguided : Split
        Of the whole, with the loop and without it.
    steps : (3,) array
        Second moments of the motion between frames, arcsec².
    locus : Locus
        Of a typical frame.
    frames : int or None
        Exposures in a record.
    left_out : int
        Exposures in which it has gaps, which were left out.
    step : float or None
        Usual time between samples of a record, s.
    """

    exposure: float
    cadence: float
    bandwidth: float | None
    spectrum: PowerSpectrum
    shares: tuple[Share, ...]
    split: Split
    unguided: Split
    steps: np.ndarray
    locus: Locus
    frames: int | None = None
    left_out: int = 0
    step: float | None = None

    @property
    def names(self) -> str:
        """The loci of everything together, such as ``smear*shm``; each kind once."""
        slow = [share.split for share in self.shares if share.line is None or share.regime == REGIMES[0]]
        smooth = smooth_locus(sum(slow, Split()) if self.shares else self.split)
        lines = [share.locus for share in self.shares if share.line and share.regime != REGIMES[0]]
        return "*".join(name for name in dict.fromkeys([smooth, *lines]) if name != "stable") or "stable"


def assess_motion(
    motion: PowerSpectrum | Record,
    exposure: float,
    *,
    cadence: float | None = None,
    bandwidth: float | None = None,
) -> Assessment:
    """Assess a motion at an exposure time.

    Parameters
    ----------
    motion : PowerSpectrum or Record
        A record is split exposure by exposure, not through its spectrum.
    exposure : float
        s.
    cadence : float, optional
        From the start of one frame to that of the next, s; by default the exposure.
    bandwidth : float, optional
        Of a pointing loop, Hz; by default there is none.

    Returns
    -------
    assessment : Assessment

    Raises
    ------
    ConfigurationError
        If a number is not positive, or a record is too short.
    """
    cadence = exposure if cadence is None else cadence
    times = (exposure, cadence, bandwidth)
    if isinstance(motion, Record):
        left = motion if bandwidth is None else Record(motion.t, *follow(*motion, bandwidth))
        seen, before = (measure_exposures(record, exposure, cadence) for record in (left, motion))
        split, frames = seen.split(), len(seen.starts)
        return Assessment(
            *times,
            trace_spectrum(left),
            (),
            split,
            before.split(),
            seen.steps(),
            smeared_locus(split),
            frames,
            left_out=seen.planned - frames,
            step=float(np.median(np.diff(motion.t))),
        )
    remaining = motion if bandwidth is None else close_loop(motion, bandwidth)
    return Assessment(
        *times,
        remaining,
        motion_budget(remaining, exposure),
        split_spectrum(remaining, exposure),
        split_spectrum(motion, exposure),
        motion_between_frames(remaining, exposure, cadence),
        predicted_locus(remaining, exposure),
    )
