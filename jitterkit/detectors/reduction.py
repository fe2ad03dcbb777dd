"""From the numbers of a file to electrons, with what is to be thought of each pixel.

The steps of :mod:`jitterkit.detectors.readout` backwards: bias, gain, non-linearity, coupling, dark
current, flat; and beside the counts their noise, the level at which they end and who is masked why.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from jitterkit.detectors.characteristics import Characteristics, piece
from jitterkit.detectors.file_variance import (
    GUESSED,
    NORMALISED,
    in_counts,
    is_normalised,
    with_read_variance,
)
from jitterkit.detectors.knowledge import ASSUMED, WELL_MARGIN, ceiling, inform, own, sets_saturation
from jitterkit.detectors.response import (
    BORDER,
    beside,
    collected,
    decouple,
    decoupled_variance,
    narrow,
    slope,
)
from jitterkit.frames.frame import Frame, RawFrame
from jitterkit.frames.metadata import Metadata

_ROUNDING = 1e-12
"""By this share a charge may miss the level of a full well and still be at it."""

_PROOF = 1.5
"""Times the largest reading of a converter: division by a flat lifts a clipped pixel by less."""

Values = np.ndarray | float


@dataclass(frozen=True)
class _Counts:
    """Counts before the flat, the variance that the scene does not make, and where they end."""

    electrons: np.ndarray
    variance: Values
    ceiling: Values
    full: np.ndarray
    unknown: np.ndarray


def reduce(detector: Characteristics, raw: RawFrame) -> Frame:
    """Turn a frame as it was read into electrons; see :meth:`Detector.calibrate`."""
    normalised, whole = is_normalised(raw), detector
    raw = in_counts(raw)
    metadata = inform(detector, raw.metadata)
    raw = raw.with_metadata(replace(raw.metadata, bad_bits=metadata.bad_bits))
    if raw.variance is not None:
        raw = with_read_variance(raw, metadata)
        metadata = inform(detector, raw.metadata)
    detector = _believed(detector, raw, metadata)
    beyond = detector is not whole
    metadata = inform(detector, raw.metadata) if beyond else metadata
    counts = (_of_adu if raw.unit == "adu" else _of_electrons)(detector, raw, metadata)
    response = _piece(detector, "flat", raw) if raw.unit == "adu" else 1.0
    bad = counts.unknown | np.asarray(_piece(detector, "flat", raw) <= 0)
    if detector.bad_pixels is not None:
        bad = bad | np.asarray(_piece(detector, "bad_pixels", raw), dtype=bool)
    response = np.where(response > 0, response, 1.0) if np.ndim(response) else response
    full = counts.full & ~raw.mask
    return Frame(
        electrons=counts.electrons / response,
        read_variance=np.asarray(counts.variance),
        mask=raw.mask | counts.full | bad,
        exposure=metadata.value("exposure"),
        plate_scale=metadata.value("plate_scale"),
        metadata=metadata,
        path=raw.path,
        index=raw.index,
        origin=raw.origin,
        several=raw.several,
        saturated=int(np.sum(full)),
        flags=(*_flags(whole, raw, metadata, bool(np.any(full)), beyond), *[NORMALISED] * normalised),
        response=response,
        ceiling=counts.ceiling / response,
        full=full & ~bad,
    )


def _of_adu(detector: Characteristics, raw: RawFrame, metadata: Metadata) -> _Counts:
    gain = metadata.value("gain")
    bias = _own(detector, "bias", raw, metadata)
    clips, well = _ends(detector, metadata)
    charge, steepness = _linear(detector, np.asarray((raw.data - bias) * gain))
    if raw.variance is None:
        variance = (_own(detector, "read_noise", raw, metadata) ** 2 + gain**2 / 12) / steepness**2
    else:
        variance = raw.variance / np.square(steepness)
    clipped = raw.data >= clips
    unknown = np.zeros(raw.shape, dtype=bool)
    if detector.coupling or detector.brighter_fatter:
        # what a pixel without a reading has given to its neighbours, or taken, is not known
        missing = raw.mask | clipped
        unknown = beside(missing) & ~missing
    if detector.coupling:
        charge = decouple(charge, detector.coupling)
        variance = decoupled_variance(variance, detector.coupling)
    current = 0.0 if detector.dark_current is None else _piece(detector, "dark_current", raw)
    dark = current * metadata.value("exposure", 0.0)  # where nobody knows the exposure, a flag says so
    brim = well - np.minimum(WELL_MARGIN * np.sqrt(variance), well / 2)
    if detector.brighter_fatter:
        well = min(well, BORDER / detector.brighter_fatter)
        brim = np.minimum(brim, well)
    top = np.minimum(brim, _linear(detector, np.asarray((clips - bias) * gain))[0])
    full = clipped | (charge >= brim * (1 - _ROUNDING))
    if detector.brighter_fatter:
        unknown |= beside(full) & ~full
        charge = narrow(np.minimum(charge, well), detector.brighter_fatter)
    return _Counts(
        electrons=charge - dark,
        variance=variance + dark,
        ceiling=top - dark,
        full=full,
        unknown=unknown | (dark >= top),  # a pixel that is full in the dark
    )


def _of_electrons(detector: Characteristics, raw: RawFrame, metadata: Metadata) -> _Counts:
    """Take electrons as they are: another program has calibrated them."""
    level = _in_electrons(detector, metadata)
    variance = raw.variance
    if variance is None:
        variance = np.square(_own(detector, "read_noise", raw, metadata))
    return _Counts(raw.data, variance, level, raw.data >= level, np.zeros(raw.shape, dtype=bool))


def _ends(detector: Characteristics, metadata: Metadata) -> tuple[float, float]:
    """Return the ADU from which readings are not to be trusted, and the charge of a full well, e-.

    A well that is full is read rightly: with coupling it shows a lower reading than the well's, beside an
    empty neighbour, so that it is looked for in the charge.
    """
    saturation = metadata.value("saturation", math.inf)
    if detector.full_well is None or not sets_saturation(detector, metadata):
        return saturation, math.inf
    by_well = ceiling(detector, metadata)[0] == "full_well"
    others = min(detector.largest, detector.saturation or math.inf)
    return (others if by_well else saturation), detector.full_well


def _linear(detector: Characteristics, measured: np.ndarray) -> tuple[np.ndarray, Values]:
    """Charge of what was measured, and the slope of the law there."""
    if detector.nonlinearity is None or detector.full_well is None:
        return measured, 1.0
    charge = collected(measured, detector.nonlinearity, detector.full_well)
    return charge, slope(charge, detector.nonlinearity, detector.full_well)


def _own(detector: Characteristics, name: str, raw: RawFrame, metadata: Metadata) -> Values:
    return piece(name, own(detector, name, metadata), raw.name, raw.origin, raw.shape)


def _piece(detector: Characteristics, name: str, raw: RawFrame) -> Values:
    values = getattr(detector, name)
    return 1.0 if values is None else piece(name, values, raw.name, raw.origin, raw.shape)


def _believed(detector: Characteristics, raw: RawFrame, metadata: Metadata) -> Characteristics:
    """Return the detector, without the converter and the full well that readings far above them prove wrong.

    They come from another camera then, or the gain is wrong: a header of a frame in electrons may have one
    from after it was converted.
    """
    good = raw.data[~raw.mask]
    if detector.bits is None or not good.size:
        return detector
    bias, gain, well = metadata.value("bias"), metadata.value("gain"), detector.full_well
    charge = float((good.max() - bias) * gain if raw.unit == "adu" else good.max())
    if charge <= _PROOF * (detector.largest - bias) * gain:
        return detector
    holds = well is None or detector.nonlinearity is not None or charge <= _PROOF * well
    return replace(detector, bits=None, full_well=well if holds else None)


def _flags(
    detector: Characteristics, raw: RawFrame, metadata: Metadata, saturated: bool, beyond: bool
) -> tuple[str, ...]:
    converted = raw.unit == "adu"
    needed = ASSUMED if converted else ("read_noise",)
    flags = [f"{name}_assumed" for name in needed if getattr(metadata, name).source.startswith(GUESSED)]
    beyond = beyond or (converted and bool(np.any((raw.data > detector.largest) & ~raw.mask)))
    dark = detector.dark_current is not None and bool(np.any(detector.dark_current))
    undated = converted and dark and metadata.exposure is None
    conditions = {"saturated": saturated, "above_adc_range": beyond, "dark_not_subtracted": undated}
    return (*flags, *(word for word, holds in conditions.items() if holds))


def _in_electrons(detector: Characteristics, metadata: Metadata) -> float:
    """Return the saturation level, e-; a header gives it in the unit of its own pixels."""
    saturation = metadata.saturation
    if saturation is None:
        return math.inf
    if saturation.source.startswith(("header", "sidecar")):
        return float(saturation.value)
    return float(_linear(detector, (saturation.value - metadata.value("bias")) * metadata.value("gain"))[0])
