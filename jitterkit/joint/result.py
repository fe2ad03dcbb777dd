"""The result of a joint fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jitterkit.joint.combine import Combined, Shared, combine
from jitterkit.joint.likelihood_summary import LikelihoodSummaries
from jitterkit.joint.records import FrameRecord, Records
from jitterkit.joint.time_models import Polynomial, TimeModel


class SequenceFrame(NamedTuple):
    """Hold one frame of a sequence, with the shared parameters at its time.

    Attributes
    ----------
    record : FrameRecord
        Its own parameters.
    shared : Shared or None
        The shared parameters at its time; None where it has no likelihood summary.
    kept : bool
        Whether it counts.
    separation, separation_err : float
        arcsec: of this frame alone, all other shared parameters known.  Where the separation is
        constant, the mean of these weighted by their errors is the joint one exactly.
    """

    record: FrameRecord
    shared: Shared | None
    kept: bool
    separation: float
    separation_err: float


class Slope(NamedTuple):
    """Hold a linear change of the separation over a run.

    Attributes
    ----------
    rate, error : float
        arcsec/s.
    chi2 : float
        By which it fits better than none; one degree of freedom.
    """

    rate: float
    error: float
    chi2: float


class Rows(NamedTuple):
    """Hold the effect of a rolling shutter on a sequence.

    Attributes
    ----------
    line_time : float
        s.
    modelled : bool
        Whether the rows were modelled as exposed one after the other.
    leverage : float
        Change of the separation by a velocity along the pair, at worst, s: arcsec per arcsec/s.
    unknown : float
        Standard error of the velocity within the frames, arcsec/s; NaN where unknown.
    by_telemetry : bool
        Whether the velocity comes from telemetry; ``unknown`` is then the rms difference between its motion
        from frame to frame and the image's.
    """

    line_time: float
    modelled: bool
    leverage: float
    unknown: float
    by_telemetry: bool = False


@dataclass(frozen=True, eq=False)
class SequenceFit:
    """Hold a sequence of frames, fitted together.

    Attributes
    ----------
    combined : Combined
        The shared parameters.
    summaries : LikelihoodSummaries
        Of each frame's likelihood of them.
    records : Records
        The frames' own parameters.
    time_models : mapping
        How the shared parameters change, by name.
    locus : str
    moves : tuple of float
        By how many joint errors each pass moved a shared parameter at most; infinite for the first.
    seconds : float
    rows : Rows or None
        Where the frames say that they have a rolling shutter.
    """

    combined: Combined
    summaries: LikelihoodSummaries
    records: Records
    time_models: Mapping[str, TimeModel]
    locus: str
    moves: tuple[float, ...]
    seconds: float
    rows: Rows | None = None

    @property
    def separation(self) -> tuple[float, float]:
        """Return the joint separation and its error, arcsec: the Cramér-Rao bound of all frames together."""
        return self.combined.value("separation"), self.combined.error("separation")

    @property
    def passes(self) -> int:
        """Return the number of passes over the frames."""
        return len(self.moves)

    def slope(self) -> Slope:
        """Fit a linear change of the separation, all else shared as in the fit, to the frames that count.

        NaN of one frame.
        """
        if np.sum(self.combined.kept) < 2:
            return Slope(np.nan, np.nan, 0.0)
        index = self.combined.names.index("separation")
        time_models = {**self.time_models, "separation": Polynomial(1)}
        with_slope = combine(self.summaries, time_models, kept=self.combined.kept)
        slope, error = with_slope.slopes[index], with_slope.slope_errors[index]
        first, last = next(iter(self.summaries)), next(iter(reversed(self.summaries)))
        half = max((last.time - first.time) / 2, np.finfo(float).tiny)
        return Slope(float(slope / half), float(error / half), float((slope / error) ** 2))

    def frames(self) -> Iterator[SequenceFrame]:
        """Yield every frame, in order."""
        index = self.combined.names.index("separation")
        informed = zip(self.summaries, self.combined.shared(), self.combined.kept, strict=True)
        for record in self.records:
            if not record.has_summary:
                yield SequenceFrame(record, None, False, np.nan, np.nan)
                continue
            summary, shared, kept = next(informed)
            information = summary.information[index, index]
            slope = (summary.score - summary.information @ (shared.values - summary.at))[index]
            known = information > 0
            separation = float(shared.values[index] + slope / information) if known else np.nan
            error = float(1 / np.sqrt(information)) if known else np.nan
            yield SequenceFrame(record, shared, bool(kept), separation, error)
