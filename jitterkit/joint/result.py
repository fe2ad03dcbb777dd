"""What a joint fit returns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jitterkit.joint.combine import Combined, Shared, combine
from jitterkit.joint.laws import Law, Polynomial
from jitterkit.joint.message import Messages
from jitterkit.joint.records import FrameRecord, Records

__all__ = ["Rows", "SequenceFit", "SequenceFrame", "Slope"]


class SequenceFrame(NamedTuple):
    """One frame of a sequence, with what the others make of it.

    Attributes
    ----------
    record : FrameRecord
        Its own parameters.
    shared : Shared or None
        The shared parameters at its time; None where it has no message.
    kept : bool
        Whether it counts.
    separation, separation_err : float
        arcsec: what this frame alone says, all other shared parameters known.  Where the separation is
        constant, the mean of these weighted by their errors is the joint one exactly.
    """

    record: FrameRecord
    shared: Shared | None
    kept: bool
    separation: float
    separation_err: float


class Slope(NamedTuple):
    """A linear change of the separation over a run.

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
    """A rolling shutter over a sequence.

    Attributes
    ----------
    line_time : float
        s.
    modelled : bool
        Whether the rows were taken as exposed one after the other.
    leverage : float
        Change of the separation by a velocity along the pair, at worst, s: arcsec per arcsec/s.
    unknown : float
        Standard error of the velocity within the frames, arcsec/s; NaN where nothing says.
    """

    line_time: float
    modelled: bool
    leverage: float
    unknown: float


@dataclass(frozen=True, eq=False)
class SequenceFit:
    """A sequence of frames, fitted together.

    Attributes
    ----------
    combined : Combined
        The shared parameters.
    messages : Messages
        What each frame says about them.
    records : Records
        The frames' own parameters.
    laws : mapping
        How what is shared changes, by name.
    locus : str
    moves : tuple of float
        By how many joint errors each pass moved a shared parameter at most; infinite for the first.
    seconds : float
    rows : Rows or None
        Where the frames say that they have a rolling shutter.
    """

    combined: Combined
    messages: Messages
    records: Records
    laws: Mapping[str, Law]
    locus: str
    moves: tuple[float, ...]
    seconds: float
    rows: Rows | None = None

    @property
    def separation(self) -> tuple[float, float]:
        """Joint separation and its error, arcsec: the Cramér-Rao bound of all frames together."""
        return self.combined.value("separation"), self.combined.error("separation")

    @property
    def passes(self) -> int:
        """Times that the frames were gone over."""
        return len(self.moves)

    def slope(self) -> Slope:
        """Linear change of the separation, all else shared as in the fit; of the frames that count.

        NaN of one frame.
        """
        if np.sum(self.combined.kept) < 2:
            return Slope(np.nan, np.nan, 0.0)
        slot = self.combined.names.index("separation")
        laws = {**self.laws, "separation": Polynomial(1)}
        with_slope = combine(self.messages, laws, kept=self.combined.kept)
        slope, error = with_slope.slopes[slot], with_slope.slope_errors[slot]
        times = [message.time for message in (next(iter(self.messages)), next(iter(reversed(self.messages))))]
        half = max((times[1] - times[0]) / 2, np.finfo(float).tiny)
        return Slope(float(slope / half), float(error / half), float((slope / error) ** 2))

    def frames(self) -> Iterator[SequenceFrame]:
        """Every frame, in order."""
        slot = self.combined.names.index("separation")
        told = zip(self.messages, self.combined.shared(), self.combined.kept, strict=True)
        for record in self.records:
            if not record.told:
                yield SequenceFrame(record, None, False, np.nan, np.nan)
                continue
            message, shared, kept = next(told)
            information = message.information[slot, slot]
            slope = (message.score - message.information @ (shared.values - message.at))[slot]
            known = information > 0
            yield SequenceFrame(
                record,
                shared,
                bool(kept),
                float(shared.values[slot] + slope / information) if known else np.nan,
                float(1 / np.sqrt(information)) if known else np.nan,
            )
