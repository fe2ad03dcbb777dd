"""Streaks that have shrunk to the tip of their cone, where the likelihood has a kink and no slope."""

from __future__ import annotations

import numpy as np

from jitterkit.loci import Locus, Product, Streak

__all__ = ["at_the_tip"]

_SIGMAS = 3.0
"""Standard errors from the tip below which a streak's length cannot be told from zero."""


def at_the_tip(locus: Locus, names: tuple[str, ...], covariance: np.ndarray) -> set[str]:
    """Names of the coordinates of streaks whose length cannot be told from zero.

    Parameters
    ----------
    locus : Locus
        A streak, or a product with streaks among its parts.
    names : tuple of str
        Of the free parameters.
    covariance : (p, p) array
        Of the free parameters.
    """
    variance = dict(zip(names, np.diag(covariance), strict=True))
    tips: set[str] = set()
    for part in _streaks(locus):
        square, spread = sum(c**2 for c in part.values()), max(variance.get(name, 0.0) for name in part)
        tips |= set(part) if square < _SIGMAS**2 * spread else set()
    return tips


def _streaks(locus: Locus) -> list[dict[str, float]]:
    """The coordinates of every streak in a locus, by name."""
    parts, names = locus.factors() if isinstance(locus, Product) else (locus,), iter(locus.names)
    every = [(part, {next(names): float(c) for c in part.coords}) for part in parts]
    return [coords for part, coords in every if isinstance(part, Streak)]
