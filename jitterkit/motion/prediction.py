"""The locus that a spectrum predicts for a typical frame, as a blur with a transfer function.

Reach for :func:`predicted_locus` with a spectrum, for :func:`smeared_locus` with a split alone (a measured
record).  Its second moments are those of the mean over frames; any one frame has its own smear.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from jitterkit.loci import Ellipse, Linear, Locus, Mvn, PartialShm, Product, Shm, Smear, Stable
from jitterkit.loci.base import axis_variances
from jitterkit.motion.budget import REGIMES, line_locus, regime
from jitterkit.motion.spectrum import Line, PowerSpectrum
from jitterkit.motion.split import Split, split_line, split_spectrum

_TYPICAL = 45.0
"""Phase at mid-exposure, degrees, of which a frame's variance is the mean over all phases."""


def predicted_locus(spectrum: PowerSpectrum, exposure: float) -> Locus:
    """The locus of a typical frame.

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
    """The locus of random motion: ``sinc(f.l) exp(-2 pi² f'Σf)``.

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
    """A medium or a fast line; sizes such that moments are those of its split."""
    cycles, name = line.frequency * exposure, line_locus(line, exposure)
    if name == "stable":
        return Stable.of()
    if name == "partial":
        along = line.amplitude >= line.minor
        angle, size = (line.angle, line.amplitude) if along else (line.angle + 90, line.minor)
        return PartialShm.of(2 * size, angle, cycles, _TYPICAL)
    return (Shm if name == "shm" else Ellipse).near(split_line(line, exposure).blur)
