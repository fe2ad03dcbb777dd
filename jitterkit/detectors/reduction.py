"""From the numbers of a file to electrons, with what is to be thought of each pixel.

The steps of :mod:`jitterkit.detectors.readout` backwards: bias, gain, non-linearity, coupling, dark
current; and beside the counts their noise, the level at which they end and who is masked why.
:meth:`jitterkit.detectors.Detector.calibrate` divides by the flat last.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from jitterkit.detectors import response
from jitterkit.detectors.characteristics import Characteristics
from jitterkit.detectors.file_variance import GUESSED
from jitterkit.detectors.knowledge import ASSUMED, SAME, WELL_MARGIN, ceiling, own, piece
from jitterkit.frames import Metadata, RawFrame

_ROUNDING = 1e-12
"""By this share a charge may miss the level of a full well and still be at it."""

_PROOF = 1.5
"""Times the largest reading of a converter: division by a flat lifts a clipped pixel by less."""

Values = np.ndarray | float


@dataclass(frozen=True)
class Counts:
    """Counts before the flat, the variance that the scene does not make, and where they end."""

    electrons: np.ndarray
    variance: Values
    ceiling: Values
    full: np.ndarray
    unknown: np.ndarray


def of_adu(detector: Characteristics, raw: RawFrame, metadata: Metadata) -> Counts:
    """Return the counts of a frame in ADU, by the detector's numbers and the frame's."""
    gain, where = metadata.value("gain"), (raw.name, raw.origin, raw.shape)
    bias = piece("bias", own(detector, "bias", metadata), *where)
    # A well that is full is read rightly: with coupling it shows a lower reading than the well's, beside an
    # empty neighbour, so that it is looked for in the charge.
    clips, well = metadata.value("saturation", math.inf), math.inf
    ending, level = ceiling(detector, metadata)
    if detector.full_well is not None and math.isclose(clips, level, rel_tol=SAME):  # nobody else's level
        well = detector.full_well
        if ending == "full_well":
            clips = min(detector.largest, detector.saturation or math.inf)
    charge, steepness = _linear(detector, np.asarray((raw.data - bias) * gain))
    if raw.variance is None:
        noise = piece("read_noise", own(detector, "read_noise", metadata), *where)
        variance = (noise**2 + gain**2 / 12) / steepness**2
    else:
        variance = raw.variance / np.square(steepness)
    clipped = raw.data >= clips
    unknown = np.zeros(raw.shape, dtype=bool)
    if detector.coupling or detector.brighter_fatter:
        # what a pixel without a reading has given to its neighbours, or taken, is not known
        missing = raw.mask | clipped
        unknown = response.beside(missing) & ~missing
    if detector.coupling:
        charge = response.decouple(charge, detector.coupling)
        variance = response.decoupled_variance(variance, detector.coupling)
    current = detector.dark_current
    current = 0.0 if current is None else piece("dark_current", current, *where)
    dark = current * metadata.value("exposure", 0.0)  # where nobody knows the exposure, a flag says so
    brim = well - np.minimum(WELL_MARGIN * np.sqrt(variance), well / 2)
    if detector.brighter_fatter:
        well = min(well, response.BORDER / detector.brighter_fatter)
        brim = np.minimum(brim, well)
    top = np.minimum(brim, _linear(detector, np.asarray((clips - bias) * gain))[0])
    full = clipped | (charge >= brim * (1 - _ROUNDING))
    if detector.brighter_fatter:
        unknown |= response.beside(full) & ~full
        charge = response.narrow(np.minimum(charge, well), detector.brighter_fatter)
    return Counts(
        electrons=charge - dark,
        variance=variance + dark,
        ceiling=top - dark,
        full=full,
        unknown=unknown | (dark >= top),  # a pixel that is full in the dark
    )


def of_electrons(detector: Characteristics, raw: RawFrame, metadata: Metadata) -> Counts:
    """Take electrons as they are: another program has calibrated them."""
    # a header gives the saturation level in the unit of its own pixels
    known, variance, level = metadata.saturation, raw.variance, math.inf
    if known is not None and known.source.startswith(("header", "sidecar", "pixels")):
        level = float(known.value)
    elif known is not None:
        level = float(_linear(detector, (known.value - metadata.value("bias")) * metadata.value("gain"))[0])
    if variance is None:
        noise = own(detector, "read_noise", metadata)
        variance = np.square(piece("read_noise", noise, raw.name, raw.origin, raw.shape))
    return Counts(raw.data, variance, level, raw.data >= level, np.zeros(raw.shape, dtype=bool))


def _linear(detector: Characteristics, measured: np.ndarray) -> tuple[np.ndarray, Values]:
    """Charge of what was measured, and the slope of the law there."""
    if detector.nonlinearity is None or detector.full_well is None:
        return measured, 1.0
    charge = response.collected(measured, detector.nonlinearity, detector.full_well)
    return charge, response.slope(charge, detector.nonlinearity, detector.full_well)


def disproved(detector: Characteristics, raw: RawFrame, metadata: Metadata) -> dict[str, Any]:
    """Return the converter's bits and the full well, by name, that readings far above them prove wrong.

    They come from another camera then, or the gain is wrong: a header of a frame in electrons may have one
    from after it was converted.
    """
    good = raw.data[~raw.mask]
    if detector.bits is None or not good.size:
        return {}
    bias, gain, well = metadata.value("bias"), metadata.value("gain"), detector.full_well
    charge = float((good.max() - bias) * gain if raw.unit == "adu" else good.max())
    if charge <= _PROOF * (detector.largest - bias) * gain:
        return {}
    holds = well is None or detector.nonlinearity is not None or charge <= _PROOF * well
    return {"bits": None} if holds else {"bits": None, "full_well": None}


def flags(
    detector: Characteristics, raw: RawFrame, metadata: Metadata, saturated: bool, beyond: bool
) -> tuple[str, ...]:
    """Return what a reader of the results should know of a frame; see :meth:`Detector.calibrate`."""
    converted = raw.unit == "adu"
    needed = ASSUMED if converted else ("read_noise",)
    found = [f"{name}_assumed" for name in needed if getattr(metadata, name).source.startswith(GUESSED)]
    beyond = beyond or (converted and bool(np.any((raw.data > detector.largest) & ~raw.mask)))
    dark = detector.dark_current is not None and bool(np.any(detector.dark_current))
    undated = converted and dark and metadata.exposure is None
    conditions = {"saturated": saturated, "above_adc_range": beyond, "dark_not_subtracted": undated}
    return (*found, *(word for word, holds in conditions.items() if holds))
