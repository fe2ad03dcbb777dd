"""The stored record of each frame of a sequence: numbers on disk, text only where a frame is not ok.

What a run keeps of every frame would fill the memory after a night, and it is needed in order only: a
:class:`RecordFile` keeps records of one size on disk in the order they came, to be read from either end.
"""

from __future__ import annotations

import math
import tempfile
import weakref
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from jitterkit.forward import GRADIENT
from jitterkit.frames import Frame
from jitterkit.loci.base import moments_of
from jitterkit.refit.result import FitResult, Status

_BLOCK = 512
"""Records read or written at once."""


class RecordFile:
    """A file of float64 records that is deleted with its owner.

    Parameters
    ----------
    width : int
        Numbers in a record.
    """

    def __init__(self, width: int) -> None:
        self.width = width
        self._file = tempfile.TemporaryFile(prefix="jitterkit-")  # noqa: SIM115 (closed below)
        self.close = weakref.finalize(self, self._file.close)
        self._waiting: list[np.ndarray] = []
        self._written = 0

    def __len__(self) -> int:
        return self._written + len(self._waiting)

    def append(self, *parts) -> None:
        """Add a record, given in pieces of any shape."""
        record = np.concatenate([np.ravel(np.asarray(part, float)) for part in parts])
        if record.size != self.width:
            raise ValueError(f"A record of {record.size} numbers does not fit a file of {self.width}.")
        self._waiting.append(record)
        if len(self._waiting) == _BLOCK:
            self._flush()

    def __iter__(self) -> Iterator[np.ndarray]:
        for first in range(0, len(self), _BLOCK):
            yield from self._read(first)

    def __reversed__(self) -> Iterator[np.ndarray]:
        for first in reversed(range(0, len(self), _BLOCK)):
            yield from self._read(first)[::-1]

    def _flush(self) -> None:
        if self._waiting:
            self._file.seek(self._written * self.width * 8)
            self._file.write(np.array(self._waiting).tobytes())
            self._written += len(self._waiting)
            self._waiting = []

    def _read(self, first: int) -> np.ndarray:
        self._flush()
        self._file.seek(first * self.width * 8)
        count = min(_BLOCK, len(self) - first)
        return np.frombuffer(self._file.read(count * self.width * 8)).reshape(count, self.width)


STATED = ("plate_scale_err", "va_factor", "orbit_change")
"""Metadata of a frame that affect the interpretation of its separation, and that no fit uses."""

_STATUS = tuple(Status)


@dataclass(frozen=True)
class FrameRecord:
    """Hold one frame of a sequence and its own parameters.

    Attributes
    ----------
    name : str
    time : float
        Middle of the exposure, s.
    status : Status
    message : str
    flags : tuple of str
    values, errors : (m,) arrays
        Of its own parameters, in the order of :attr:`Records.own`; the errors are those with the shared ones
        known.
    moments, moment_errors : (3,) arrays
        Of the jitter, arcsec².
    chi2_dof : float
    position : (2,) array
        Of the pair on the whole detector, arcsec from its first pixel's part of the sky.
    velocity : (2,) array
        Of the image during the exposure, arcsec/s; NaN where unknown.
    stated : (s,) array
        Numbers of the frame's metadata, in the order of :data:`STATED`; NaN where unknown.
    has_summary : bool
        Whether it has a likelihood summary of the shared parameters.
    reason : str
        Value of the error code of a frame that is not ok; empty for one that is.
    dof : float
        Degrees of freedom of chi-squared.
    exposure : float
        s; NaN where unknown.
    """

    name: str
    time: float
    status: Status
    message: str = ""
    flags: tuple[str, ...] = ()
    values: np.ndarray = field(default_factory=lambda: np.zeros(0))
    errors: np.ndarray = field(default_factory=lambda: np.zeros(0))
    moments: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    moment_errors: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    chi2_dof: float = float("nan")
    position: np.ndarray = field(default_factory=lambda: np.full(2, np.nan))
    velocity: np.ndarray = field(default_factory=lambda: np.full(2, np.nan))
    stated: np.ndarray = field(default_factory=lambda: np.full(len(STATED), np.nan))
    has_summary: bool = False
    reason: str = ""
    dof: float = float("nan")
    exposure: float = float("nan")

    @classmethod
    def of(cls, name: str, time: float, fit: FitResult, own: tuple[str, ...], **more) -> FrameRecord:
        """Make the record of a fit of a frame's own parameters."""
        record = cls(name, time, fit.status, fit.message, fit.flags, reason=fit.reason, **more)
        if fit.parameters is None:
            return record
        scene, locus = fit.parameters.scene, fit.parameters.locus
        known = {n: float(getattr(scene, n)) for n in ("x", "y", "flux")}
        known |= dict(zip(locus.names, np.asarray(locus.coords), strict=True))
        known["background"] = float(fit.parameters.background)
        known |= dict(zip(GRADIENT, map(float, fit.parameters.gradient), strict=True))
        moments, covariance = moments_of(locus, fit.names, fit.covariance)
        values = np.array([known[n] for n in own])
        with np.errstate(invalid="ignore"):
            errors, spread = np.array([fit.error(n) for n in own]), np.sqrt(np.diag(covariance))
        record = replace(record, values=values, errors=errors, chi2_dof=fit.chi2_dof, dof=fit.dof)
        return replace(record, moments=np.asarray(moments), moment_errors=spread)


class Records:
    """The records of a run, in order.

    Parameters
    ----------
    own : tuple of str
        Names of a frame's own parameters.
    """

    def __init__(self, own: tuple[str, ...]) -> None:
        self.own = own
        sizes: dict[str, Any] = dict.fromkeys(
            ("time", "status", "has_summary", "chi2_dof", "dof", "exposure"), ()
        )
        sizes |= {"values": len(own), "errors": len(own), "moments": 3, "moment_errors": 3}
        sizes |= {"position": 2, "velocity": 2, "stated": len(STATED)}
        self._columns, self._layout = tuple(sizes), np.dtype([(n, float, sizes[n]) for n in sizes])
        self._numbers = RecordFile(self._layout.itemsize // 8)
        self._names: list[str] = []
        self._words: dict[int, tuple[str, tuple[str, ...], str]] = {}

    def __len__(self) -> int:
        return len(self._numbers)

    def append(self, record: FrameRecord) -> None:
        """Add the next frame's record."""
        numbers = {name: getattr(record, name) for name in self._columns}
        numbers["status"] = _STATUS.index(record.status)
        if not len(record.values):
            numbers |= dict.fromkeys(("values", "errors"), np.nan)
        if record.status is not Status.OK or record.flags:
            self._words[len(self)] = (record.message, record.flags, record.reason)
        self._numbers.append(np.array([tuple(numbers.values())], self._layout).view(float))
        self._names.append(record.name)

    def __iter__(self) -> Iterator[FrameRecord]:
        for index, numbers in enumerate(self._numbers):
            known = dict(zip(self._columns, numbers.view(self._layout)[0].item(), strict=True))
            known |= {"status": _STATUS[int(known["status"])], "has_summary": bool(known["has_summary"])}
            plain = (f"{Status.OK.value}: chi²/dof is {known['chi2_dof']:.4g}.", (), "")
            message, flags, reason = self._words.get(index, plain)
            yield FrameRecord(self._names[index], message=message, flags=flags, reason=reason, **known)


class Exposure(NamedTuple):
    """Hold one frame of a sequence.

    Attributes
    ----------
    name : str
    time : float
        Middle of the exposure, s from the beginning of the first; ascending.
    frame : Frame or None
        None where it cannot be used.
    problem : FitResult or None
        The reason, where there is no frame.
    """

    name: str
    time: float
    frame: Frame | None
    problem: FitResult | None = None


def reason_of(exposure: Exposure) -> FitResult:
    """Return the reason for which there is no frame."""
    return exposure.problem or FitResult(Status.NO_DATA, f"{Status.NO_DATA.value}.")


def record_of(
    exposure: Exposure, fit: FitResult, own: tuple[str, ...], *, of_all: tuple[str, ...] = (), **more
) -> FrameRecord:
    """Make the record of a frame, with the flags of its calibration.

    In a frame's own fit aberrations are held because all frames share them; ``of_all`` are the flags of what
    they share.
    """
    frame = exposure.frame
    if frame is None:
        return FrameRecord.of(exposure.name, exposure.time, fit, own)
    remark = frame.metadata.remark
    own_flags = (flag for flag in fit.flags if flag != "aberrations_held")
    flags = dict.fromkeys((*frame.flags, *own_flags, *of_all, *["header_odd"] * bool(remark)))
    fit = replace(fit, flags=tuple(flags), message=f"{fit.message} {remark}".rstrip())
    more["stated"] = np.array([frame.metadata.value(name, math.nan) for name in STATED])
    more["exposure"] = frame.exposure or math.nan
    if fit.parameters is not None and frame.plate_scale:
        scene, corner = fit.parameters.scene, np.array(frame.origin) * frame.plate_scale
        more["position"] = corner + np.array([float(scene.x), float(scene.y)])
    return FrameRecord.of(exposure.name, exposure.time, fit, own, **more)
