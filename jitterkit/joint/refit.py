"""Many frames fitted together: what they share once, what is a frame's own frame by frame.

Reach for :func:`refit_sequence`.  It goes over the frames several times.  The first time each frame is looked
at with the shared parameters as the frames before it have them; later with those of all frames, and with the
motion between frames in the rolling shutter.  From every frame a message about the shared parameters remains
(:mod:`jitterkit.joint.message`), and the messages are combined exactly (:mod:`jitterkit.joint.combine`): a
Gauss-Newton climb of the joint likelihood.  Its cost is linear in the frames, its memory that of one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from jitterkit.errors import ConfigurationError, JitterkitError
from jitterkit.forward import Parameters
from jitterkit.frames import Frame
from jitterkit.joint.combine import Combined, combine
from jitterkit.joint.filter import Filter, Model
from jitterkit.joint.laws import Constant, Law, Wander
from jitterkit.joint.look import Looker, Nearby
from jitterkit.joint.message import Message, Messages
from jitterkit.joint.records import FrameRecord, Records
from jitterkit.joint.result import Rows, SequenceFit
from jitterkit.joint.velocity import (
    motion_unknown,
    smear_allowed,
    velocity_between_frames,
    velocity_from_trace,
)
from jitterkit.joint.wander import measure_wander
from jitterkit.refit import FitResult, Status
from jitterkit.shutter import Drifting, with_enough_nodes

__all__ = ["Exposure", "SequenceOptions", "refit_sequence"]

_SETTLED = 1.0
"""Joint standard errors by which the last pass may have moved a shared parameter; where it moved one by 0.16,
the next moved it by 0.0002."""

_PASSES = 5

_STEP = 3.0
"""Errors of one frame by which what changes may change from frame to frame, until all have been seen."""

_FORGETS = 1e3
"""Frames over which that adds up."""

_FEW = 8
"""Frames below which nothing is said of how much they wander."""

_ANYWHERE = (300.0, 1e-3)
"""Errors of a frame, and exposures, of a wander that may be anywhere in every frame."""


class Exposure(NamedTuple):
    """One frame of a sequence.

    Attributes
    ----------
    name : str
    time : float
        Middle of the exposure, s from the beginning of the first; ascending.
    frame : Frame or None
        None where it cannot be used.
    problem : FitResult or None
        Then why.
    """

    name: str
    time: float
    frame: Frame | None
    problem: FitResult | None = None


@dataclass(frozen=True)
class SequenceOptions:
    """How the frames of a sequence hang together.

    Attributes
    ----------
    laws : mapping
        How shared parameters change with time, by name; ``"aberrations"`` stands for all of them.  None is a
        wander whose numbers the frames are to say.  What is not named is constant, but aberrations wander.
    rolling : bool
        Whether the rows of a rolling shutter are modelled, where the frames say that they have one.
    telemetry : ((m,), (m,), (m,)) arrays or None
        Pointing measured otherwise: s from the beginning of the first exposure, and arcsec.
    """

    laws: Mapping[str, Law | None] = field(default_factory=dict)
    rolling: bool = True
    telemetry: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None


def refit_sequence(
    exposures: Iterable[Exposure],
    looker: Looker,
    options: SequenceOptions | None = None,
    watch: Callable[[int, str], None] | None = None,
) -> SequenceFit:
    """Fit the frames of a sequence together.

    Parameters
    ----------
    exposures : iterable of Exposure
        Gone over several times: a list, or anything that begins anew each time.
    looker : Looker
        Optics, locus, and what is held.
    options : SequenceOptions, optional
    watch : callable, optional
        Called with the number of the pass and the frame's name, frame by frame.

    Returns
    -------
    fit : SequenceFit

    Raises
    ------
    JitterkitError
        If no frame can be fitted.
    ConfigurationError
        If a law names nothing that is shared, or the times do not ascend.

    Notes
    -----
    *Fails when* a single frame is far from telling the shared parameters to first order: its message is the
    quadratic form at the point where all frames put them, not at its own best.
    """
    return _Run(exposures, looker, options or SequenceOptions(), watch).fit()


class _Run:
    """One joint fit."""

    def __init__(self, exposures, looker: Looker, options: SequenceOptions, watch) -> None:
        self.exposures, self.looker, self.options = exposures, looker, options
        self.watch = watch or (lambda number, name: None)
        self.template: Parameters | None = None
        self.nodes, self.line_time, self.exposure = 2, 0.0, 0.0
        self.doubted = np.zeros((0, 2))
        unknown = [name for name in options.laws if name not in (*looker.shared, "aberrations")]
        if unknown:
            raise ConfigurationError(
                f"{unknown[0]!r} is not shared by the frames; there are {', '.join(looker.shared)}, and "
                "'aberrations' for all of those."
            )

    def fit(self) -> SequenceFit:
        began = time.perf_counter()
        messages, records = self._first_pass()
        laws = self._laws(messages)
        combined, moves = combine(messages, laws), [math.inf]
        while len(moves) < _PASSES and not moves[-1] < _SETTLED:
            before = combined
            messages, records = self._later_pass(len(moves) + 1, combined, records)
            laws = self._laws(messages)
            combined = combine(messages, laws)
            moves.append(_moved(before, combined))
        seconds = time.perf_counter() - began
        return SequenceFit(
            combined, messages, records, laws, self.looker.locus, tuple(moves), seconds, self._rows(records)
        )

    # -- passes over the frames --------------------------------------------------------------------

    def _first_pass(self) -> tuple[Messages, Records]:
        """Each frame with the shared parameters as the frames before it have them."""
        looker, messages, records = self.looker, Messages(self.looker.shared), Records(self.looker.own)
        run: Filter | None = None
        here: FitResult | None = None
        nearby = Nearby(looker.optics)
        for exposure in self._frames(1):
            if exposure.frame is None:
                records.append(_record(exposure, _why(exposure), looker.own))
                continue
            if run is None or here is None or here.parameters is None:
                fit, otf = looker.first(exposure.frame, self._shutter(exposure.frame, np.zeros(2)))
            else:
                run.move(exposure.time)
                known = dict(zip(looker.shared, run.shared(), strict=True))
                start = looker.at(here.parameters, known)
                fit, otf = looker.anew(exposure.frame, start, here.image, nearby.at(start))
                if not fit.status.usable:  # lost: what is shared, or the pair, has moved too far
                    shutter = self._shutter(exposure.frame, np.zeros(2))
                    fit, otf = looker.first(exposure.frame, shutter, known)
            message = looker.told(exposure.frame, fit, otf, exposure.time)
            records.append(_record(exposure, fit, looker.own, told=message is not None))
            if message is None:
                continue
            messages.append(message)
            here = fit
            if run is None:
                self.template = fit.parameters
                run = Filter(Model(looker.shared, self._loose(message), message, (0.0, 1.0)))
                run.move(exposure.time)
            run.hear(message)
        return _told(messages, records)

    def _later_pass(self, number: int, combined: Combined, before: Records) -> tuple[Messages, Records]:
        """Each frame with the shared parameters of all, from where the pass before left it."""
        looker, messages, records = self.looker, Messages(self.looker.shared), Records(self.looker.own)
        shared, velocities = combined.shared(), self._velocities(before)
        nearby = Nearby(looker.optics)
        for exposure, old, velocity in zip(self._frames(number), before, velocities, strict=True):
            if not old.told or exposure.frame is None:
                records.append(old)
                continue
            values = dict(zip(looker.shared, next(shared).values, strict=True))
            values |= dict(zip(looker.own, old.values, strict=True))
            assert self.template is not None
            start = _shuttered(looker.at(self.template, values), self._shutter(exposure.frame, velocity))
            fit, otf = looker.again(exposure.frame, start, nearby.at(start))
            if (
                not fit.status.usable
            ):  # what the others say does not suit it: it speaks for itself, and is judged
                fit, otf = looker.first(exposure.frame, start.shutter, values)
            message = looker.told(exposure.frame, fit, otf, exposure.time)
            records.append(_record(exposure, fit, looker.own, velocity=velocity, told=message is not None))
            if message is not None:
                messages.append(message)
        return _told(messages, records)

    def _frames(self, number: int) -> Iterator[Exposure]:
        """The frames, watched, in the order of time."""
        last = -math.inf
        for exposure in self.exposures:
            if exposure.frame is not None:
                if not exposure.time > last:
                    raise ConfigurationError(
                        f"{exposure.name} was taken at {exposure.time:g} s, not after the frame before it "
                        f"({last:g} s); give the frames in the order of time, each once, or their cadence."
                    )
                last = exposure.time
            yield exposure
            self.watch(number, exposure.name)

    # -- motion ------------------------------------------------------------------------------------

    def _velocities(self, records: Records) -> np.ndarray:
        """Velocity of the image in every frame (n, 2), arcsec/s; zero where nothing says."""
        times = np.array([record.time for record in records])
        if self.options.telemetry is not None:
            velocities = velocity_from_trace(self.options.telemetry, times, self.exposure)
        else:
            places = np.array([record.place for record in records])
            velocities = np.nan_to_num(velocity_between_frames(times, places))
            room = [
                smear_allowed(r.moments, r.moment_errors, v) for r, v in zip(records, velocities, strict=True)
            ]
            self.doubted = velocities[np.hypot(*velocities.T) * self.exposure > room]
            velocities = np.where((np.hypot(*velocities.T) * self.exposure > room)[:, None], 0.0, velocities)
        if self.line_time and self.options.rolling:
            fastest = velocities[np.argmax(np.hypot(*velocities.T))]
            grid = self.looker.optics.nominal.grid
            drift = Drifting(self.line_time, fastest, self.nodes)
            self.nodes = with_enough_nodes(drift, grid.shape[0], grid.nyquist).nodes
        return velocities

    def _rows(self, records: Records) -> Rows | None:
        """What the rolling shutter does to the separation, and how well it is undone."""
        if not self.line_time or self.template is None:
            return None
        scale = self.looker.optics.nominal.grid.plate_scale
        leverage = abs(self.line_time * float(self.template.binary.separation)) / scale
        known = self.options.telemetry is not None or not self.options.rolling
        bends = [(record.time, record.place) for record in records]
        error = 0.0 if known else motion_unknown([t for t, _ in bends], [place for _, place in bends])
        if not known and len(self.doubted):  # moved between the exposures, but not so fast within them
            share = len(self.doubted) / len(bends)
            error = max(error, float(np.sqrt(share * np.mean(self.doubted**2))))
        return Rows(self.line_time, self.options.rolling, leverage, error)

    def _shutter(self, frame: Frame, velocity: np.ndarray) -> Drifting | None:
        """The rolling shutter of a frame, where it has one and is to be modelled."""
        self.line_time, self.exposure = frame.metadata.value("line_time", 0.0), frame.exposure or 0.0
        return (
            Drifting(self.line_time, velocity, self.nodes)
            if self.line_time and self.options.rolling
            else None
        )

    # -- laws --------------------------------------------------------------------------------------

    def _laws(self, messages: Messages) -> dict[str, Law]:
        """The law of everything shared; wanders that nobody gave are measured."""
        given = self._given()
        laws = {name: law for name, law in given.items() if law is not None}
        open_ = [name for name in given if given[name] is None]
        aberrations = [name for name in open_ if name in self.looker.optics.nominal.names]
        for group in [aberrations, *[[name] for name in open_ if name not in aberrations]]:
            if group:
                laws |= self._wandering(messages, group, laws)
        return laws

    def _wandering(self, messages: Messages, group: list[str], laws: Mapping[str, Law]) -> dict[str, Law]:
        """The wander that a group has in common; of few frames each may be anywhere."""
        if len(messages) < _FEW:
            told = dict(zip(messages.names, np.diag(next(iter(messages)).information), strict=True))
            short = _ANYWHERE[1] * (self.exposure or 1.0)
            return {name: Wander(_ANYWHERE[0] / math.sqrt(max(told[name], 1e-300)), short) for name in group}
        return dict.fromkeys(group, measure_wander(messages, group, laws))

    def _given(self) -> dict[str, Law | None]:
        """The law of every shared parameter as the user has it, or by default."""
        laws: dict[str, Law | None] = dict(self.options.laws)
        common = laws.pop("aberrations", None)
        default = dict.fromkeys(self.looker.optics.nominal.names, common)
        return {name: laws.get(name, default.get(name, Constant())) for name in self.looker.shared}

    def _loose(self, message: Message) -> dict[str, Law]:
        """Laws for the first pass: what may change may change quickly."""
        told = np.diag(message.information)
        errors = 1 / np.sqrt(np.where(told > 0, told, 1.0))
        cadence = self.exposure or 1.0
        wanders = [Wander(_STEP * error * math.sqrt(_FORGETS / 2), _FORGETS * cadence) for error in errors]
        given = self._given().items()
        return {
            name: law if isinstance(law, Constant) else wander
            for (name, law), wander in zip(given, wanders, strict=True)
        }


def _told(messages: Messages, records: Records) -> tuple[Messages, Records]:
    """Both, if any frame has told anything."""
    if not len(messages):
        why = next((f": {record.message}" for record in records), ".")
        raise JitterkitError(f"No frame of the sequence can be fitted{why}")
    return messages, records


def _moved(before: Combined, after: Combined) -> float:
    """Errors by which what is shared has moved at most."""
    errors = np.sqrt(np.diag(after.covariance))
    known = np.isfinite(errors)
    return float(np.max(np.abs(after.values - before.values)[known] / errors[known], initial=0.0))


def _why(exposure: Exposure) -> FitResult:
    """Why there is no frame."""
    return exposure.problem or FitResult(Status.NO_DATA, f"{Status.NO_DATA.value}.")


def _record(exposure: Exposure, fit: FitResult, own: tuple[str, ...], **more) -> FrameRecord:
    """The record of a frame, with the remarks of its calibration."""
    frame = exposure.frame
    if frame is None:
        return FrameRecord.of(exposure.name, exposure.time, fit, own)
    flags = dict.fromkeys(flag for flag in (*frame.flags, *fit.flags) if flag != "aberrations_held")
    fit = replace(fit, flags=tuple(flags))
    if fit.parameters is not None and frame.plate_scale:
        scene, corner = fit.parameters.scene, np.array(frame.origin) * frame.plate_scale
        more["place"] = corner + np.array([float(scene.x), float(scene.y)])
    return FrameRecord.of(exposure.name, exposure.time, fit, own, **more)


def _shuttered(p: Parameters, shutter: Drifting | None) -> Parameters:
    return Parameters(p.scene, p.locus, p.aberrations, p.background, diffusion=p.diffusion, shutter=shutter)
