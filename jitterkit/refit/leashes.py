"""What keeps a fit from running off along what an image does not show of a locus."""

from __future__ import annotations

import numpy as np

from jitterkit.loci import Locus, PartialShm, Path, Shaped

__all__ = ["leashes"]


def leashes(locus: Locus) -> dict[str, tuple[float, float]]:
    """Weak priors, mean and sigma by name, on what a small blur does not show of a locus.

    Without them a fit would run off along a direction in which the image does not change.

    Parameters
    ----------
    locus : Locus
        Where the fit starts.

    Returns
    -------
    leashes : dict
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
