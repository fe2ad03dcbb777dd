"""Fisher information by the names of its parameters, so that several frames can be added.

Reach for :class:`Information`: its sum is that of independent data, and :meth:`Information.about` says what
is left for some parameters when the others are not known.  Unlike an inverse, that works where the data do
not determine everything: an error is then infinite.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

_NULL = 1e-10
"""Eigenvalue of the scaled information below which it is zero: what is exactly degenerate leaves 1e-13."""

_SIDE = 1e-6
"""Share of a combination in a null direction from which it counts as undetermined."""


@dataclass(frozen=True)
class Information:
    """Information of data about named parameters.

    Attributes
    ----------
    names : tuple of str
    matrix : (p, p) array
        Expected Fisher information, in the parameters' own units.
    """

    names: tuple[str, ...]
    matrix: np.ndarray

    @classmethod
    def prior(cls, errors: dict[str, float]) -> Information:
        """Independent knowledge of some parameters, from its standard errors."""
        return cls(tuple(errors), np.diag([error**-2.0 for error in errors.values()]))

    def __add__(self, other: Information) -> Information:
        """Return the information of both data together."""
        names = tuple(dict.fromkeys((*self.names, *other.names)))
        return Information(names, self._spread(names) + other._spread(names))

    def times(self, n: float) -> Information:
        """Return the information of ``n`` such data."""
        return Information(self.names, n * self.matrix)

    def knowing(self, known: Collection[str]) -> Information:
        """Return the information about the others, where some parameters are known."""
        return self.padded([name for name in self.names if name not in known])

    def about(self, names: Sequence[str]) -> Information:
        """Return the information about some parameters, where all others are unknown (Schur's complement).

        A name that is not among the parameters has no information.
        """
        drop = [name for name in self.names if name not in names]
        size = self._size()
        unit = self.matrix / np.outer(size, size)
        kept = [name for name in names if name in self.names]
        k, d = ([self.names.index(name) for name in part] for part in (kept, drop))
        values, vectors = np.linalg.eigh(unit[np.ix_(d, d)])
        crossed = unit[np.ix_(k, d)] @ vectors[:, values > _NULL]
        left = unit[np.ix_(k, k)] - (crossed / values[values > _NULL]) @ crossed.T
        return Information(tuple(kept), left * np.outer(size[k], size[k])).padded(names)

    def padded(self, names: Sequence[str]) -> Information:
        """Return the information in another order, with rows of zeros for names without information."""
        return Information(tuple(names), self._spread(names))

    def changed(self, old: Sequence[str], new: Sequence[str], slope: np.ndarray) -> Information:
        """Return the information in other coordinates: the ``new`` are ``slope`` (n, n) times the ``old``."""
        indices = [self.names.index(name) for name in old]
        back = np.eye(len(self.names))
        back[np.ix_(indices, indices)] = np.linalg.inv(slope)
        names = list(self.names)
        for index, name in zip(indices, new, strict=True):
            names[index] = name
        return Information(tuple(names), back.T @ self.matrix @ back)

    @property
    def alone(self) -> np.ndarray:
        """Return the error (p,) of each parameter if all others were known; infinite where undetermined."""
        diagonal = np.diag(self.matrix).clip(0)
        return np.where(diagonal > 0, 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)), np.inf)

    @property
    def errors(self) -> np.ndarray:
        """Return the error (p,) of each parameter if all are unknown; infinite where undetermined."""
        return np.array([self.error_of(row) for row in np.eye(len(self.names))])

    @property
    def likeness(self) -> np.ndarray:
        """Cosines (p, p) between what the parameters do to the data: 1 where two do the same."""
        size = self._size()
        return self.matrix / np.outer(size, size)

    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Eigenvalues (p,), ascending, and eigenvectors (p, p), by columns, of :attr:`likeness`.

        Those that are zero to rounding are zero.
        """
        values, vectors = np.linalg.eigh(self.likeness)
        return np.where(values > _NULL, values, 0.0), vectors

    def error_of(self, weights: np.ndarray) -> float:
        """Return the error of a sum of the parameters with weights (p,), infinite where undetermined."""
        values, vectors = self.modes()
        parts = (np.asarray(weights) / self._size()) @ vectors
        null = values == 0
        if np.any(np.abs(parts[null]) > _SIDE * np.linalg.norm(parts)):
            return float("inf")
        return float(np.sqrt(np.sum(parts[~null] ** 2 / values[~null])))

    def _size(self) -> np.ndarray:
        diagonal = np.diag(self.matrix)
        return np.sqrt(np.where(diagonal > 0, diagonal, 1.0))

    def _spread(self, names: Sequence[str]) -> np.ndarray:
        pick = np.zeros((len(names), len(self.names)))
        for row, name in enumerate(names):
            if name in self.names:
                pick[row, self.names.index(name)] = 1.0
        return pick @ self.matrix @ pick.T
