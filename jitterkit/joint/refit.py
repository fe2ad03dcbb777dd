"""Fit many frames together: shared parameters once, a frame's own parameters frame by frame.

Reach for :func:`refit_sequence`.  It passes over the frames several times.  The first time each frame is
fitted with the shared parameters as the frames before it give them; later with those of all frames, and with
the motion between frames in the rolling shutter.  From every frame a summary of its likelihood remains
(:mod:`jitterkit.joint.likelihood_summary`), and the summaries are combined exactly
(:mod:`jitterkit.joint.combine`): a Gauss-Newton maximisation of the joint likelihood.  Its cost is linear in
the frames, its memory that of one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, JitterkitError
from jitterkit.forward import Parameters
from jitterkit.frames import Frame
from jitterkit.joint.combine import Combined, combine
from jitterkit.joint.filter import Filter, Model
from jitterkit.joint.frame_fitter import FrameFitter
from jitterkit.joint.likelihood_summary import LikelihoodSummaries, LikelihoodSummary
from jitterkit.joint.ornstein_uhlenbeck import complete_time_models, initial_time_models
from jitterkit.joint.records import Exposure, Records, reason_of, record_of
from jitterkit.joint.result import SequenceFit
from jitterkit.joint.time_models import Constant, TimeModel
from jitterkit.joint.velocity import Shutters
from jitterkit.linearisation import NearbyOptics
from jitterkit.optics.otf import OTF
from jitterkit.refit import FitResult

_CONVERGED = 1.0
"""Largest change of a shared parameter by the last pass, in joint standard errors; where it was 0.16, that of
the next pass was 0.0002."""

_PASSES = 5


@dataclass(frozen=True)
class SequenceOptions:
    """Hold how the frames of a sequence are related.

    Attributes
    ----------
    time_models : mapping
        How shared parameters change with time, by name; ``"aberrations"`` stands for all of them.  None is an
        Ornstein-Uhlenbeck process whose numbers are estimated.  Parameters not named are constant, except
        that aberrations follow such a process.
    rolling : bool
        Whether the rows of a rolling shutter are modelled, where the frames say that they have one.
    telemetry : ((m,), (m,), (m,)) arrays or None
        Pointing measured otherwise: s from the beginning of the first exposure, and arcsec.
    """

    time_models: Mapping[str, TimeModel | None] = field(default_factory=dict)
    rolling: bool = True
    telemetry: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None


def refit_sequence(
    exposures: Iterable[Exposure],
    fitter: FrameFitter,
    options: SequenceOptions | None = None,
    watch: Callable[[int, str], None] | None = None,
    keep: Callable[[int, Frame, FitResult], None] | None = None,
) -> SequenceFit:
    """Fit the frames of a sequence together.

    Parameters
    ----------
    exposures : iterable of Exposure
        Read several times: a list, or anything that can be iterated again.
    fitter : FrameFitter
        Optics, locus, and what is held.
    options : SequenceOptions, optional
    watch : callable, optional
        Called with the number of the pass and the frame's name, frame by frame.
    keep : callable, optional
        Called with the number of the pass, the frame and its fit, for each frame that could be fitted.

    Returns
    -------
    fit : SequenceFit

    Raises
    ------
    JitterkitError
        If no frame can be fitted.
    ConfigurationError
        If a time model names nothing that is shared, or the times do not ascend.

    Notes
    -----
    *Fails when* a single frame is far from linear in the shared parameters: its summary is the
    quadratic form at the joint maximum, not at its own.
    """
    fitter = fitter.seeing(exposure.frame for exposure in exposures if exposure.frame is not None)
    return _Run(exposures, fitter, options or SequenceOptions(), watch, keep).fit()


class _Run:
    """Run one joint fit."""

    def __init__(self, exposures, fitter: FrameFitter, options: SequenceOptions, watch, keep) -> None:
        self.exposures, self.fitter, self.options = exposures, fitter, options
        self.watch = watch or (lambda number, name: None)
        self.keep = keep or (lambda number, frame, fit: None)
        self.template: Parameters | None = None
        self.left_out: dict[int, np.ndarray] = {}  # by the frame's index: flat indices of outlier pixels
        self.shutters = Shutters(fitter.optics.nominal.grid, options.rolling, options.telemetry)
        common = options.time_models.get("aberrations")
        nominal = fitter.optics.nominal
        time_models = dict.fromkeys(nominal.names, common) | dict.fromkeys(nominal.further, Constant())
        time_models |= dict(options.time_models)
        self.given = {name: time_models.get(name, Constant()) for name in fitter.shared}
        unknown = [name for name in options.time_models if name not in (*fitter.shared, "aberrations")]
        if unknown:
            problem = f"{unknown[0]!r} is not shared by the frames"
            remedy = f"there are {', '.join(fitter.shared)}, and 'aberrations' for all of those"
            raise ConfigurationError(ErrorCode.UNKNOWN_NAME, f"{problem}; {remedy}.")

    def fit(self) -> SequenceFit:
        began = time.perf_counter()
        summaries, records = self._first_pass()
        time_models = self._time_models(summaries)
        combined, moves = combine(summaries, time_models), [math.inf]
        while len(moves) < _PASSES and not moves[-1] < _CONVERGED:
            before = combined
            summaries, records = self._later_pass(len(moves) + 1, combined, records)
            time_models = self._time_models(summaries)
            combined = combine(summaries, time_models)
            moves.append(_moved(before, combined))
        return SequenceFit(
            combined=combined,
            summaries=summaries,
            records=records,
            time_models=time_models,
            locus=self.fitter.locus,
            moves=tuple(moves),
            seconds=time.perf_counter() - began,
            rows=self.shutters.rows(records, combined.value("separation")),
        )

    def _time_models(self, summaries: LikelihoodSummaries) -> dict[str, TimeModel]:
        names = self.fitter.optics.nominal.names
        return complete_time_models(self.given, summaries, names, self.shutters.exposure or 1.0)

    def _first_pass(self) -> tuple[LikelihoodSummaries, Records]:
        """Fit each frame with the shared parameters as the frames before it give them."""
        fitter = self.fitter
        summaries, records = LikelihoodSummaries(fitter.shared), Records(fitter.own)
        run: Filter | None = None
        here: FitResult | None = None
        nearby = NearbyOptics(fitter.optics)
        for exposure in self._frames(1):
            if exposure.frame is None:
                records.append(record_of(exposure, reason_of(exposure), fitter.own))
                continue
            shutter, known = self.shutters.of(exposure.frame), None
            if run is not None:
                run.predict(exposure.time)
                known = dict(zip(fitter.shared, run.shared(), strict=True))

            def fit_frame(frame: Frame, here=here, known=known, shutter=shutter) -> tuple[FitResult, OTF]:
                if known is not None and here is not None and here.parameters is not None:
                    start = fitter.at(here.parameters, known)
                    fit, otf = fitter.fit_cold(frame, start, here.image, nearby.at(start))
                    if fit.status.usable:
                        return fit, otf
                # the first, or lost: what is shared, or the pair, has moved too far
                return fitter.fit_first(frame, shutter, known)

            fit, summary = self._add(1, exposure, fit_frame, summaries, records)
            if summary is None:
                continue
            here = fit
            if run is None:
                self.template = fit.parameters
                loose = initial_time_models(self.given, summary, self.shutters.exposure or 1.0)
                run = Filter(Model(fitter.shared, loose, summary, (0.0, 1.0)))
                run.predict(exposure.time)
            run.update(summary)
        return _require_fitted(summaries, records)

    def _later_pass(
        self, number: int, combined: Combined, before: Records
    ) -> tuple[LikelihoodSummaries, Records]:
        """Fit each frame with the shared parameters of all, from its fit in the pass before."""
        fitter = self.fitter
        summaries, records = LikelihoodSummaries(fitter.shared), Records(fitter.own)
        shared, velocities = combined.shared(), self.shutters.velocities(before)
        nearby = NearbyOptics(fitter.optics)
        for exposure, old, velocity in zip(self._frames(number), before, velocities, strict=True):
            if not old.has_summary or exposure.frame is None:
                records.append(old)
                continue
            values = dict(zip(fitter.shared, next(shared).values, strict=True))
            values |= dict(zip(fitter.own, old.values, strict=True))
            assert self.template is not None
            shutter = self.shutters.of(exposure.frame, velocity)
            start = replace(fitter.at(self.template, values), shutter=shutter)

            def fit_frame(frame: Frame, start=start, shutter=shutter, values=values) -> tuple[FitResult, OTF]:
                fit, otf = fitter.refit(frame, start, nearby.at(start))
                # the shared parameters may not suit it: then fit it alone, and test it against the others
                return (fit, otf) if fit.status.usable else fitter.fit_first(frame, shutter, values)

            self._add(number, exposure, fit_frame, summaries, records, velocity=velocity)
        return _require_fitted(summaries, records)

    def _add(
        self,
        number: int,
        exposure: Exposure,
        fit: Callable[[Frame], tuple[FitResult, OTF]],
        summaries: LikelihoodSummaries,
        records: Records,
        **more,
    ) -> tuple[FitResult, LikelihoodSummary | None]:
        """Fit a frame without outlier pixels, those of the passes before included; add what a run keeps."""
        fitter, index, whole = self.fitter, len(records), exposure.frame
        assert whole is not None
        known = np.isin(np.arange(whole.mask.size), self.left_out.get(index, [])).reshape(whole.shape)
        frame, fitted = fitter.without_outliers(whole, fit, known)
        if (found := np.flatnonzero(frame.mask & ~whole.mask)).size:
            self.left_out[index] = found
        result, exposure = fitted.result, exposure._replace(frame=frame)
        first = not len(summaries)
        summary = fitter.likelihood_summary(frame, result, fitted.otf, exposure.time, first=first)
        more["has_summary"] = summary is not None
        records.append(record_of(exposure, result, fitter.own, of_all=fitter.flags, **more))
        if summary is not None:
            summaries.append(summary)
            self.keep(number, frame, result)
        return result, summary

    def _frames(self, number: int) -> Iterator[Exposure]:
        """Yield the frames in the order of time, and report each."""
        before, last = "", -math.inf
        for exposure in self.exposures:
            if exposure.frame is not None:
                if not exposure.time > last:
                    earlier = last - exposure.time > (exposure.frame.exposure or 0.0) / 2
                    remedy = (
                        "if the clock of the headers is too coarse, give the --cadence"
                        if not earlier
                        else "write the images of a file in the order of their times, or each to its own file"
                    )
                    problem = f"{exposure.name} was taken at {exposure.time:.9g} s, not after {before} "
                    problem += f"({last:.9g} s), which precedes it"
                    raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; {remedy}.")
                before, last = exposure.name, exposure.time
            yield exposure
            self.watch(number, exposure.name)


def _require_fitted(summaries: LikelihoodSummaries, records: Records) -> tuple[LikelihoodSummaries, Records]:
    """Return summaries and records; raise if no frame could be fitted."""
    if not len(summaries):
        first = next(iter(records), None)
        why = "." if first is None else f": {first.message}"
        code = ErrorCode.NO_DATA
        if first is not None:  # a fitted frame has no reason: its covariance is infinite
            code = ErrorCode(first.reason or ErrorCode.NOT_CONSTRAINED)
        problem = f"No frame of the sequence can be fitted{why} If they are of another telescope"
        raise JitterkitError(code, f"{problem}, give its instrument.")
    return summaries, records


def _moved(before: Combined, after: Combined) -> float:
    """Return the largest change of a shared parameter, in standard errors."""
    errors = np.sqrt(np.diag(after.covariance))
    known = np.isfinite(errors)
    return float(np.max(np.abs(after.values - before.values)[known] / errors[known], initial=0.0))
