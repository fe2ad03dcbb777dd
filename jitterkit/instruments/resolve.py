"""Whose word counts about a frame: the one place where all sources meet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from jitterkit.detectors.knowledge import supplement
from jitterkit.frames.frame import RawFrame
from jitterkit.instruments.instrument import Instrument


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
        header > preset > assumed.

    Raises
    ------
    ConfigurationError
        If an override is unknown or unbelievable.
    """
    metadata = raw.metadata.apply("command line", **(overrides or {}))
    for name in ("plate_scale", "exposure"):
        metadata = supplement(metadata, name, getattr(instrument, name), instrument.source(name))
    return raw.with_metadata(instrument.detector.inform(metadata))
