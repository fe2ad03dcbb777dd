"""Everything about a motion that an exposure time decides, in one record.

Reach for :func:`assess_motion` with what :func:`~jitterkit.motion.files.read_motion` returned.
:func:`predicted_locus` is the blur of a typical frame under a spectrum, :func:`smeared_locus` under a split
alone (a measured record).  Its second moments are those of the mean over frames; any one frame has its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from jitterkit.loci import Ellipse, Linear, Locus, Mvn, PartialShm, Product, Shm, Smear, Stable, trace_gaps
from jitterkit.loci.base import axis_variances
from jitterkit.motion.budget import REGIMES, Share, line_locus, motion_budget, regime, smooth_locus
from jitterkit.motion.loop import close_loop, follow
from jitterkit.motion.record import Record, measure_exposures, trace_spectrum
from jitterkit.motion.spectrum import Line, PowerSpectrum
from jitterkit.motion.split import Split, motion_between_frames, split_line, split_spectrum

_TYPICAL = 45.0
"""Phase at mid-exposure, degrees, of which a frame's variance is the mean over all phases."""


def predicted_locus(spectrum: PowerSpectrum, exposure: float) -> Locus:
    """Return the locus of a typical frame.

    Parameters
    ----------
    spectrum : PowerSpectrum
    exposure : float
        s.

    Returns
    -------
    locus : Locus
        A product of what is independent: a smear and a normal for random motion and slow lines, a piece of a
        vibration for each line of the medium regime, an arcsine streak for each fast one; an ellipse for
        either where it has two axes.  Its second moments are the mean blur of
        :func:`~jitterkit.motion.split.split_spectrum`.

    Notes
    -----
    *Assumes* random motion to be normal, and lines unrelated in phase.  *Fails when* one frame shall be
    predicted: smears differ from frame to frame in length and direction, pieces of a vibration in phase.
    """
    slow = [line for line in spectrum.lines if regime(line.frequency * exposure) == REGIMES[0]]
    split = split_spectrum(PowerSpectrum(spectrum.frequencies, spectrum.density, tuple(slow)), exposure)
    parts = [_line(line, exposure) for line in spectrum.lines if line not in slow]
    parts = [smeared_locus(split), *parts]
    moving = [part for part in parts if not isinstance(part, Stable)]
    return moving[0] if len(moving) == 1 else Product(*moving) if moving else Stable.of()


def smeared_locus(split: Split) -> Locus:
    """Return the locus of random motion: ``sinc(f.l) exp(-2 pi² f'Σf)``.

    Parameters
    ----------
    split : Split

    Returns
    -------
    locus : Locus
        The smear has its root mean square length along its longer axis; the normal has the jitter, and the
        smear across, so that moments are those of the split.
    """
    major, minor, angle = axis_variances(split.smear)
    length = np.sqrt(12 * max(major - minor, 0.0))
    rest = split.jitter + max(minor, 0.0) * np.array([1.0, 0.0, 1.0])
    if not np.any(split.blur):
        return Stable.of()
    return Smear(Linear.of(length, angle), Mvn(jnp.asarray(rest)))


def _line(line: Line, exposure: float) -> Locus:
    """Return a medium or a fast line; sizes such that moments are those of its split."""
    cycles, name = line.frequency * exposure, line_locus(line, exposure)
    if name == "stable":
        return Stable.of()
    if name == "partial":
        along = line.amplitude >= line.minor
        angle, size = (line.angle, line.amplitude) if along else (line.angle + 90, line.minor)
        return PartialShm.of(2 * size, angle, cycles, _TYPICAL)
    return (Shm if name == "shm" else Ellipse).near(split_line(line, exposure).blur)


@dataclass(frozen=True, eq=False)
class Assessment:
    """A motion as exposures see it.

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
    lost : float
        Share of the variance within an exposure that straight lines between samples lose of smooth motion.
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
    lost: float = 0.0

    @property
    def names(self) -> str:
        """Return the loci of everything together, such as ``smear*shm``; each kind once."""
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
        step, lost = float(np.median(np.diff(motion.t))), _lost_between_samples(left, split, exposure)
        found = (*times, trace_spectrum(left), (), split, before.split(), seen.steps(), smeared_locus(split))
        return Assessment(*found, frames, left_out=seen.planned - frames, step=step, lost=lost)
    remaining = motion if bandwidth is None else close_loop(motion, bandwidth)
    shares, locus = motion_budget(remaining, exposure), predicted_locus(remaining, exposure)
    split, unguided = split_spectrum(remaining, exposure), split_spectrum(motion, exposure)
    steps = motion_between_frames(remaining, exposure, cadence)
    return Assessment(*times, remaining, shares, split, unguided, steps, locus)


def _lost_between_samples(record: Record, split: Split, exposure: float) -> float:
    """Return the share of the blur's variance that straight lines between samples lose of smooth motion.

    The mean square of a straight piece is a sixth of the squared step below that of its ends, which is the
    mean square of smooth motion.  Steps of the smear count as straight.
    """
    steps, moves = np.diff(record.t), np.diff([record.x, record.y], axis=1)
    near = ~np.isin(np.arange(len(steps)), trace_gaps(record.t))
    blur, smear = (float(moments[0] + moments[2]) for moments in (split.blur, split.smear))
    if not blur > 0:
        return 0.0
    weights = steps[near] / steps[near].sum()
    straight = 2 * smear * float(weights @ steps[near] ** 2) / exposure**2
    lost = max(float(weights @ np.sum(moves[:, near] ** 2, axis=0)) / 6 - straight, 0.0)
    return lost / (blur + lost)
