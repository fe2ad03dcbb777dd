"""A motion as a table with units and as sentences for a person.

Reach for :func:`motion_table`, a row a source of motion, and :func:`motion_sentences`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from astropy.table import QTable

from jitterkit.loci import principal_axes
from jitterkit.motion import PARTS, Assessment, Share, critical_frequency
from jitterkit.report.columns import Column, bind
from jitterkit.report.words import angle_size, ellipse_size, number

_SMALL = 0.15
"""Pixels rms of a blur below which a normal serves any symmetric shape: on TOLIMAN the separation of a pair
along it is biased by 0.6 µas (linear) and 0.8 µas (shm) there."""

_LOPSIDED = 10.0
"""µas by which a normal biases a frame at that size that caught a lopsided piece of a motion, as the cube of
the size: 2 to 11 for pieces of a vibration at the worst phase, 7 to 10 rms for random motion.  On the mean
over frames the pieces have 0.7 to 0.9, as a symmetric shape has."""

_PIECES = {"partial", "path", "smear"}
"""Loci of motion whose single frames are lopsided; in a record an mvn may hold such pieces too."""

_FEW = 10
"""Exposures of which a mean says little."""

_LOST = 0.02
"""Share of a blur's variance that is worth a message: 1 % of its size."""

_DECIMALS = 6
"""Of a size in mas; beyond them there is rounding."""


def motion_table(assessed: Assessment) -> QTable:
    """Tabulate the sources of a motion and, last, all together.

    Parameters
    ----------
    assessed : Assessment

    Returns
    -------
    table : QTable
        Ends of the frequencies [Hz], of a line its amplitude [arcsec] and angle [deg], regime, locus, and of
        displacement, smear and jitter one sigma along x and y [mas] and second moments [arcsec²].  A smear's
        rms length is √12 times its sigma.  ``meta`` has exposure, cadence, bandwidth, and the second moments
        of the motion between frames [arcsec²].
    """
    shares, lines = assessed.shares, [*(share.line for share in assessed.shares), None]
    columns: list[tuple[Column, Any]] = [
        (Column("source", kind=str), [*("random" if s.line is None else "line" for s in shares), "all"]),
        (Column("from", "lowest frequency", "Hz"), [*(share.low for share in shares), np.nan]),
        (Column("to", "highest frequency", "Hz"), [*(share.high for share in shares), np.nan]),
        (Column("amplitude", "of a line", "arcsec"), [np.nan if o is None else o.amplitude for o in lines]),
        (Column("angle", "of a line", "deg"), [np.nan if line is None else line.angle for line in lines]),
        (Column("regime", kind=str), [*(share.regime for share in shares), ""]),
        (Column("locus", kind=str), [*(share.locus for share in shares), assessed.names]),
    ]
    for part in PARTS:
        moments = np.array([getattr(split, part) for split in (*(s.split for s in shares), assessed.split)])
        sizes = np.round(1e3 * np.sqrt(np.maximum(moments, 0)), _DECIMALS)
        columns += [(Column(f"{part}_{xy}", "1 sigma", "mas"), sizes[:, k]) for xy, k in (("x", 0), ("y", 2))]
        columns += [
            (Column(f"{part}_{name}", "second moment", "arcsec2"), moments[:, k])
            for k, name in enumerate(("sxx", "sxy", "syy"))
        ]
    names = ("exposure", "cadence", "bandwidth")
    meta: dict[str, Any] = {name: getattr(assessed, name) for name in names}
    return bind(columns, meta | {"between_frames": [float(moment) for moment in assessed.steps]})


def motion_sentences(assessed: Assessment, plate_scale: float) -> list[str]:
    """Say what exposures see of a motion, for pixels of so many arcsec."""
    critical = critical_frequency(assessed.exposure)
    sentences = [f"Exposures of {assessed.exposure:g} s: the critical frequency is {critical:g} Hz."]
    sentences += [_of_share(share, assessed.exposure) for share in assessed.shares]
    if assessed.frames is not None:
        caveat = "; their mean says little" if assessed.frames < _FEW else ""
        sentences.append(f"{assessed.frames} exposures in the trace{caveat}.")
        if assessed.left_out:
            sentences.append(f"{assessed.left_out} more were left out: the trace has gaps in them.")
        if assessed.step is not None and assessed.step > assessed.exposure / 2:
            remedy = "what is faster is not in it. See that its times are in s"
            sentences.append(f"The samples of the trace are {assessed.step:g} s apart: {remedy}.")
        elif assessed.lost > _LOST:
            lost = f"{100 * assessed.lost:.0f} % of the variance within an exposure"
            smooth = f"If it is smooth, that loses {lost}: sample faster, or give lines."
            sentences.append(f"The pointing is taken as straight between samples. {smooth}")
    after, before = assessed.split, assessed.unguided
    if assessed.bandwidth is not None:
        sentences.append(
            f"A loop of {assessed.bandwidth:g} Hz leaves {_rms(after.blur)} of {_rms(before.blur)} of blur, "
            f"and {_rms(after.displacement)} of {_rms(before.displacement)} of displacement (rms)."
        )
    moved = f"the image moves by {_rms(assessed.steps)} rms"
    sentences.append(f"Between frames {assessed.cadence:g} s apart {moved}.")
    major, minor, angle = principal_axes(after.blur)
    size = f", {ellipse_size(major, minor)} rms, the longer axis at {angle:.0f}°" if major > 0 else ""
    sentences.append(f"Blur of a typical frame: {assessed.names}{size}.")
    if 0 < major < _SMALL * plate_scale:
        sentences.append(_of_small(major / plate_scale, assessed))
    return sentences


def _of_small(pixels: float, assessed: Assessment) -> str:
    lopsided = _PIECES if assessed.frames is None else {*_PIECES, "mvn"}
    off = _LOPSIDED * (pixels / _SMALL) ** 3
    if off < 1 or not lopsided & set(assessed.names.split("*")):
        return f"At {pixels:.2g} pixel an image shows second moments and no more of it: mvn will do."
    return (
        f"At {pixels:.2g} pixel an image shows little more than second moments of it: mvn will do on the "
        f"mean over frames, but one that caught a lopsided piece may be off by about {off:.0f} µas."
    )


def _of_share(share: Share, exposure: float) -> str:
    if share.line is None:
        return f"{share.low:.3g} to {share.high:.3g} Hz: {share.regime}; {share.locus}."
    size = " x ".join(number(size, 2) for size in (share.line.amplitude, share.line.minor) if size) or "0"
    cycles = f"{share.low * exposure:.2g} cycles an exposure"
    return f"{share.low:g} Hz, {size} arcsec: {share.regime} ({cycles}); {share.locus}."


def _rms(moments) -> str:
    """Root of the variance in both axes together."""
    return angle_size(round(max(float(moments[0] + moments[2]), 0.0) ** 0.5, 3 + _DECIMALS))
