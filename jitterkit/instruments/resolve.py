"""Whose word counts about a frame: the one place where all sources meet."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from jitterkit.detectors.knowledge import supplement
from jitterkit.frames.frame import RawFrame
from jitterkit.frames.hidden import with_a_star
from jitterkit.frames.metadata import FIELDS, QUANTITIES, Metadata, Sourced
from jitterkit.frames.scale import VA_INCLUDED
from jitterkit.frames.times import epoch_seconds
from jitterkit.instruments.instrument import Instrument

_MAY_BE_HELD = "the plate scale is the WCS's, which holds it if it was solved with stars"
_MEASURED, _NOMINAL = 0.01, 0.1
"""Relative differences up to which a plate scale, and exposure, bias or a scale by focal length, agree."""


def resolve(raw: RawFrame, instrument: Instrument, overrides: Mapping[str, Any] | None = None) -> RawFrame:
    """Complete what is known about a frame.

    Parameters
    ----------
    raw : RawFrame
        As read: it carries what its header and the TOML beside it say.
    instrument : Instrument
        From an instrument file, whose word counts above the header's, or a preset, whose word counts
        below it.
    overrides : mapping, optional
        From the command line, by field of :class:`~jitterkit.frames.metadata.Metadata`; they count
        above everything.  None changes nothing.

    Returns
    -------
    raw : RawFrame
        The same pixels.  Every number has its source: command line > sidecar > instrument file >
        header > preset > assumed.  A stated error of the plate scale is only kept if it is that of the scale
        which is used.

    Raises
    ------
    ConfigurationError
        If an override is unknown or unbelievable.
    FrameError
        If a mask whose bits nobody explains hides all stars (:func:`~jitterkit.frames.hidden.with_a_star`).
    """
    metadata = raw.metadata.apply("command line", **(overrides or {}))
    known = {name: getattr(metadata, name) for name in FIELDS}
    given = [name for name, one in known.items() if one and one.source.startswith("command line")]
    advice = [re.compile(rf"(give |\()--{name.replace('_', '-')}\b(?!-)") for name in given]
    kept = tuple(text for text in metadata.warnings if not any(one.search(text) for one in advice))
    metadata = replace(metadata, warnings=kept)  # without advice to give a number that was given
    for name in ("plate_scale", "exposure"):
        metadata = supplement(metadata, name, getattr(instrument, name), instrument.source(name))
        metadata = metadata.warn(*_contradiction(name, getattr(raw.metadata, name), getattr(metadata, name)))
    own, used = raw.metadata, metadata.plate_scale
    stated, scale = own.plate_scale_err, own.value("plate_scale", instrument.plate_scale)
    if metadata.plate_scale_err is stated:  # else it was overridden, together with the scale
        if stated is None and instrument.plate_scale_err is not None:
            unit, source = QUANTITIES["plate_scale_err"].unit, instrument.source("plate_scale_err")
            stated, scale = Sourced(instrument.plate_scale_err, unit, source), instrument.plate_scale
        if stated is not None and used is not None:
            is_its = abs(used.value / scale - 1) <= stated.value
            metadata = replace(metadata, plate_scale_err=stated if is_its else None)
            said = f"the plate scale of {used.value:.9g} arcsec/pixel ({used.source}) has no stated error"
            found = f"{stated.value:g} ({stated.source}) is that of {scale:.9g} arcsec/pixel"
            metadata = metadata if is_its else metadata.warn(f"{said}: {found}")
    metadata = _with_corrections(metadata, instrument, raw)
    metadata = instrument.detector.inform(metadata)
    metadata = metadata.warn(*_contradiction("bias", own.bias, metadata.bias))
    return with_a_star(raw.with_metadata(metadata))


def _contradiction(name: str, own: Sourced | None, used: Sourced | None) -> list[str]:
    """Warn of a header's number that an instrument file, which may be of another telescope, overrules."""
    if own is None or used is None or not used.source.startswith("instrument file"):
        return []
    nominal = name in ("exposure", "bias") or "FOCALLEN" in own.source
    if abs(own.value - used.value) <= (_NOMINAL if nominal else _MEASURED) * max(own.value, used.value):
        return []
    found = f"{used.source} = {used.value:g} {used.unit}, which is used"
    return [f"{own.source} = {own.value:g} contradicts {found}"]


def _with_corrections(metadata: Metadata, instrument: Instrument, raw: RawFrame) -> Metadata:
    """Add what the sky does to a separation, once: a scale measured from stars holds some of it already.

    Frames that share a time follow each other without a pause.  A mean time of several is that of none.
    """
    sky, source = instrument.sky, instrument.source("sky")
    scale = "" if metadata.plate_scale is None else metadata.plate_scale.source
    if sky is not None:
        known, index = metadata.time, raw.index if raw.after is None else raw.after
        average, when = known is not None and "-AVG" in known.source, math.nan
        if known is not None and "T" in known.value and not (average and raw.several):
            exposures = index * raw.several + 0.5 * (not average)  # until the middle of this frame's
            when = epoch_seconds(known.value) + exposures * metadata.value("exposure", 0.0)
        solved = scale.startswith("header WCS")
        if math.isnan(when) and (sky.velocity == "earth" or sky.orbit_rate is not None):
            said = "there is no time of day: corrections of [sky] that depend on it are empty"
            metadata = metadata.warn(said)
        factor = sky.va_factor(when) if metadata.va_factor is None else None
        if solved and factor is not None:
            said = f"velocity aberration is not computed: {_MAY_BE_HELD}; give --plate-scale"
            metadata, factor = metadata.warn(said), None
        metadata = metadata.fill(source, va_factor=factor, orbit_change=sky.orbit_change(when))
    known = metadata.va_factor
    if known is None or known.value == 1:
        return metadata
    if not scale.endswith(VA_INCLUDED):
        solved = scale.startswith("header WCS") and known.source.startswith("header")
        said = f"{known.source} is applied, but {_MAY_BE_HELD}; else give --plate-scale"
        return metadata.warn(said) if solved else metadata
    included = f"{known.source} = {known.value:.9g}, which the WCS's scale includes"
    return metadata.override(included, va_factor=1.0)
