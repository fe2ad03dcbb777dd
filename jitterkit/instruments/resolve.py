"""Whose word counts about a frame: the one place where all sources meet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from jitterkit.detectors.knowledge import supplement
from jitterkit.frames.frame import RawFrame
from jitterkit.frames.metadata import QUANTITIES, Known, Metadata
from jitterkit.instruments.instrument import Instrument

__all__ = ["resolve"]


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
    """
    metadata = raw.metadata.apply("command line", **(overrides or {}))
    for name in ("plate_scale", "exposure"):
        metadata = supplement(metadata, name, getattr(instrument, name), instrument.source(name))
    metadata = _with_scale_error(metadata, raw.metadata, instrument)
    return raw.with_metadata(instrument.detector.inform(metadata))


def _with_scale_error(metadata: Metadata, own: Metadata, instrument: Instrument) -> Metadata:
    """Add the error that a frame's own metadata or else the instrument states of its plate scale."""
    stated, scale = own.plate_scale_err, own.value("plate_scale", instrument.plate_scale)
    if metadata.plate_scale_err is not stated:  # overridden together with the scale
        return metadata
    if stated is None and instrument.plate_scale_err is not None:
        unit, source = QUANTITIES["plate_scale_err"].unit, instrument.source("plate_scale_err")
        stated, scale = Known(instrument.plate_scale_err, unit, source), instrument.plate_scale
    if stated is None:
        return metadata
    used = metadata.known()["plate_scale"]
    if abs(used.value / scale - 1) <= stated.value:
        return replace(metadata, plate_scale_err=stated)
    return replace(metadata, plate_scale_err=None).warn(
        f"the plate scale of {used.value:.9g} arcsec/pixel ({used.source}) has no stated error: "
        f"{stated.value:g} ({stated.source}) is that of {scale:.9g} arcsec/pixel"
    )
