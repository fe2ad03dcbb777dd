"""Many frames fitted together: what they share once, what is a frame's own frame by frame.

Reach for :func:`refit_sequence`.  It goes over the frames several times.  The first time each frame is looked
at with the shared parameters as the frames before it have them; later with those of all frames, and with the
motion between frames in the rolling shutter.  From every frame a message about the shared parameters remains
(:mod:`jitterkit.joint.message`), and the messages are combined exactly (:mod:`jitterkit.joint.combine`): a
Gauss-Newton maximisation of the joint likelihood.  Its cost is linear in the frames, its memory that of one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, JitterkitError
from jitterkit.forward import Parameters
from jitterkit.frames import Frame
from jitterkit.joint.combine import Combined, combine
from jitterkit.joint.filter import Filter, Model
from jitterkit.joint.laws import Constant, Law
from jitterkit.joint.look import Looker, Nearby
from jitterkit.joint.message import Messages
from jitterkit.joint.records import STATED, FrameRecord, Records
from jitterkit.joint.result import SequenceFit
from jitterkit.joint.shutters import Shutters
from jitterkit.joint.wander import loose_laws, settle_laws
from jitterkit.optics.otf import OTF
from jitterkit.refit import FitResult, Status
from jitterkit.refit.outliers import Fitted, fit_without_outliers
from jitterkit.shutter import Shutter

__all__ = ["Exposure", "SequenceOptions", "refit_sequence"]

_SETTLED = 1.0
"""Joint standard errors by which the last pass may have moved a shared parameter; where it moved one by 0.16,
the next moved it by 0.0002."""

_PASSES = 5


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
        self.left_out: dict[int, np.ndarray] = {}  # by the frame's place, flat: pixels that do not belong
        self.shutters = Shutters(looker.optics.nominal.grid, options.rolling, options.telemetry)
        common = options.laws.get("aberrations")
        nominal = looker.optics.nominal
        laws = dict.fromkeys(nominal.names, common) | dict.fromkeys(nominal.further, Constant())
        laws |= dict(options.laws)
        self.given = {name: laws.get(name, Constant()) for name in looker.shared}
        unknown = [name for name in options.laws if name not in (*looker.shared, "aberrations")]
        if unknown:
            raise ConfigurationError(
                ErrorCode.UNKNOWN_NAME,
                f"{unknown[0]!r} is not shared by the frames; there are {', '.join(looker.shared)}, and "
                "'aberrations' for all of those.",
            )

    def fit(self) -> SequenceFit:
        began = time.perf_counter()
        messages, records = self._first_pass()
        laws = self._settled_laws(messages)
        combined, moves = combine(messages, laws), [math.inf]
        while len(moves) < _PASSES and not moves[-1] < _SETTLED:
            before = combined
            messages, records = self._later_pass(len(moves) + 1, combined, records)
            laws = self._settled_laws(messages)
            combined = combine(messages, laws)
            moves.append(_moved(before, combined))
        return SequenceFit(
            combined=combined,
            messages=messages,
            records=records,
            laws=laws,
            locus=self.looker.locus,
            moves=tuple(moves),
            seconds=time.perf_counter() - began,
            rows=self.shutters.rows(records, combined.value("separation")),
        )

    def _settled_laws(self, messages: Messages) -> dict[str, Law]:
        names = self.looker.optics.nominal.names
        return settle_laws(self.given, messages, names, self.shutters.exposure or 1.0)

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
            shutter, known = self.shutters.of(exposure.frame), None
            if run is not None:
                run.move(exposure.time)
                known = dict(zip(looker.shared, run.shared(), strict=True))

            def looked(frame: Frame, here=here, known=known, shutter=shutter) -> tuple[FitResult, OTF]:
                if known is not None and here is not None and here.parameters is not None:
                    start = looker.at(here.parameters, known)
                    fit, otf = looker.anew(frame, start, here.image, nearby.at(start))
                    if fit.status.usable:
                        return fit, otf
                # the first, or lost: what is shared, or the pair, has moved too far
                return looker.first(frame, shutter, known)

            frame, fit, otf = self._without_outliers(len(records), exposure.frame, looked)
            exposure = exposure._replace(frame=frame)
            message = looker.told(frame, fit, otf, exposure.time, first=not len(messages))
            records.append(_record(exposure, fit, looker.own, told=message is not None))
            if message is None:
                continue
            messages.append(message)
            here = fit
            if run is None:
                self.template = fit.parameters
                loose = loose_laws(self.given, message, self.shutters.exposure or 1.0)
                run = Filter(Model(looker.shared, loose, message, (0.0, 1.0)))
                run.move(exposure.time)
            run.hear(message)
        return _told(messages, records)

    def _later_pass(self, number: int, combined: Combined, before: Records) -> tuple[Messages, Records]:
        """Each frame with the shared parameters of all, from where the pass before left it."""
        looker, messages, records = self.looker, Messages(self.looker.shared), Records(self.looker.own)
        shared, velocities = combined.shared(), self.shutters.velocities(before)
        nearby = Nearby(looker.optics)
        for exposure, old, velocity in zip(self._frames(number), before, velocities, strict=True):
            if not old.told or exposure.frame is None:
                records.append(old)
                continue
            values = dict(zip(looker.shared, next(shared).values, strict=True))
            values |= dict(zip(looker.own, old.values, strict=True))
            assert self.template is not None
            shutter = self.shutters.of(exposure.frame, velocity)
            start = _shuttered(looker.at(self.template, values), shutter)

            def looked(frame: Frame, start=start, shutter=shutter, values=values) -> tuple[FitResult, OTF]:
                fit, otf = looker.again(frame, start, nearby.at(start))
                # what the others say may not suit it: it speaks for itself then, and will be judged
                return (fit, otf) if fit.status.usable else looker.first(frame, shutter, values)

            frame, fit, otf = self._without_outliers(len(records), exposure.frame, looked)
            exposure = exposure._replace(frame=frame)
            message = looker.told(frame, fit, otf, exposure.time, first=not len(messages))
            records.append(_record(exposure, fit, looker.own, velocity=velocity, told=message is not None))
            if message is not None:
                messages.append(message)
        return _told(messages, records)

    def _without_outliers(
        self, place: int, whole: Frame, look: Callable[[Frame], tuple[FitResult, OTF]]
    ) -> tuple[Frame, FitResult, OTF]:
        """A frame without pixels that do not belong to it, in this pass or one before, and its fit."""
        known = np.isin(np.arange(whole.mask.size), self.left_out.get(place, [])).reshape(whole.shape)
        looker = self.looker
        frame, fitted = fit_without_outliers(
            whole,
            lambda frame: Fitted(*look(frame)),
            known=known,
            known_light=looker.known_light,
            model_error=looker.model_error,
        )
        if (found := np.flatnonzero(frame.mask & ~whole.mask)).size:
            self.left_out[place] = found
        return frame, fitted.result, fitted.otf

    def _frames(self, number: int) -> Iterator[Exposure]:
        """The frames, watched, in the order of time."""
        before, last = "", -math.inf
        for exposure in self.exposures:
            if exposure.frame is not None:
                if not exposure.time > last:
                    raise ConfigurationError(
                        ErrorCode.OUT_OF_RANGE,
                        f"{exposure.name} was taken at {exposure.time:.9g} s, not after {before} "
                        f"({last:.9g} s); if the clock of the headers is too coarse, give the --cadence.",
                    )
                before, last = exposure.name, exposure.time
            yield exposure
            self.watch(number, exposure.name)


def _told(messages: Messages, records: Records) -> tuple[Messages, Records]:
    """Both, if any frame has told anything."""
    if not len(messages):
        first = next(iter(records), None)
        why = "." if first is None else f": {first.message}"
        code = ErrorCode.NO_DATA
        if first is not None:  # a fitted frame has no reason: its covariance is infinite
            code = ErrorCode(first.reason or ErrorCode.NOT_CONSTRAINED)
        raise JitterkitError(
            code,
            f"No frame of the sequence can be fitted{why} If they are of another telescope, give its "
            "instrument.",
        )
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
    more["stated"] = np.array([frame.metadata.value(name, math.nan) for name in STATED])
    if fit.parameters is not None and frame.plate_scale:
        scene, corner = fit.parameters.scene, np.array(frame.origin) * frame.plate_scale
        more["place"] = corner + np.array([float(scene.x), float(scene.y)])
    return FrameRecord.of(exposure.name, exposure.time, fit, own, **more)


def _shuttered(p: Parameters, shutter: Shutter | None) -> Parameters:
    return replace(p, shutter=shutter)
