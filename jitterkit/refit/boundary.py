"""Loci whose likelihood has no regular maximum: no slope, or a kink at zero length."""

from __future__ import annotations

import numpy as np

from jitterkit.loci import Locus, PartialShm, Path, Product, Shaped, Streak

_SIGMAS = 3.0
"""Standard errors from zero below which a streak's length cannot be distinguished from zero."""


def at_zero_length(locus: Locus, names: tuple[str, ...], covariance: np.ndarray) -> set[str]:
    """Return the names of the coordinates of streaks whose length cannot be distinguished from zero.

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
    found: set[str] = set()
    of_parts = iter(locus.names)
    for part in locus.factors() if isinstance(locus, Product) else (locus,):
        own = [next(of_parts) for _ in part.coords]
        if isinstance(part, Streak):
            square, spread = float(np.sum(np.square(part.coords))), max(variance.get(n, 0.0) for n in own)
            found |= set(own) if square < _SIGMAS**2 * spread else set()
    return found


def regularizing_priors(locus: Locus) -> dict[str, tuple[float, float]]:
    """Return weak priors, mean and sigma by name, on what a small blur does not show of a locus.

    Without them a fit would run off along a direction in which the image does not change.

    Parameters
    ----------
    locus : Locus
        Where the fit starts.

    Returns
    -------
    priors : dict
        For a partial vibration the square of its cycles, 1 ± 2, and its even share, 0 ± 0.6; for a shaped
        blur its kurtosis, 0 ± 2; for a path its steps, 0 ± 1.5 times the rms of the whole.  Empty for all
        other loci.
    """
    if isinstance(locus, Path):
        sxx, _, syy = np.asarray(locus.moments())
        return dict.fromkeys(locus.names, (0.0, 1.5 * float(np.sqrt(sxx + syy))))
    if isinstance(locus, PartialShm):
        return dict(zip(locus.names[2:], ((1.0, 2.0), (0.0, 0.6)), strict=True))
    return {locus.names[3]: (0.0, 2.0)} if isinstance(locus, Shaped) else {}
