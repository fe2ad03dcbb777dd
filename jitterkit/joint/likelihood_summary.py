"""The likelihood of one frame, as a quadratic form in the parameters that all frames share.

A frame's own parameters (position, flux, jitter) are eliminated at their maximum: what remains is a quadratic
form in the shared ones, a few dozen numbers however many pixels there are.  Such summaries add up.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from jitterkit.joint.records import RecordFile


class LikelihoodSummary(NamedTuple):
    """Hold a frame's log-likelihood near a point: ``score (c - at) - (c - at)' information (c - at)/2``.

    Attributes
    ----------
    time : float
        s, of the middle of the exposure.
    at : (k,) array
        Shared parameters at which the frame was fitted.
    score : (k,) array
    information : (k, k) array
        Expected Fisher information of the frame on the shared parameters, its own being free.
    """

    time: float
    at: np.ndarray
    score: np.ndarray
    information: np.ndarray

    @property
    def errors(self) -> np.ndarray:
        """Return the errors (k,) of the shared parameters, all else known; one without information."""
        information = np.diag(self.information)
        return 1 / np.sqrt(np.where(information > 0, information, 1.0))


class LikelihoodSummaries:
    """Keep the summaries of a run on disk, in the order of time.

    Parameters
    ----------
    names : tuple of str
        Of the shared parameters.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        k = len(self.names)
        self._upper = np.triu_indices(k)
        self._file = RecordFile(1 + 2 * k + len(self._upper[0]))

    def __len__(self) -> int:
        return len(self._file)

    def append(self, summary: LikelihoodSummary) -> None:
        """Add the next frame's summary."""
        self._file.append(summary.time, summary.at, summary.score, summary.information[self._upper])

    def __iter__(self) -> Iterator[LikelihoodSummary]:
        return map(self._unpacked, self._file)

    def __reversed__(self) -> Iterator[LikelihoodSummary]:
        return map(self._unpacked, reversed(self._file))

    def _unpacked(self, record: np.ndarray) -> LikelihoodSummary:
        k = len(self.names)
        half = np.zeros((k, k))
        half[self._upper] = record[1 + 2 * k :]
        information = half + half.T - np.diag(np.diag(half))
        return LikelihoodSummary(float(record[0]), record[1 : 1 + k], record[1 + k : 1 + 2 * k], information)


def eliminate(score, information, shared: list[int], own: list[int], covariance) -> tuple:
    """Eliminate a frame's own parameters from its normal equations.

    Parameters
    ----------
    score : (p,) array
    information : (p, p) array
    shared, own : lists of int
        Indices of either kind; together all.
    covariance : (m, m) array
        Of the own while the shared are held: the inverse of their block, with what priors add to it.

    Returns
    -------
    score : (k,) array
        Of the shared ones.
    information : (k, k) array
        Schur's complement.
    """
    score, information = np.asarray(score), np.asarray(information)
    cross = information[np.ix_(own, shared)]
    gain = covariance @ cross
    return score[shared] - gain.T @ score[own], information[np.ix_(shared, shared)] - cross.T @ gain
