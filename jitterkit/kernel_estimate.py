"""The record in which estimators and the refit meet."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import chi2

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.loci.base import Locus, axis_variances, covariance_on_axis, principal_axes

_DETECTED = float(chi2.isf(1e-3, 3))
"""Chi-squared of three moments that no jitter at all exceeds in one frame of a thousand."""

_BLURRIER = 5.0
"""Standard errors of a negative variance from which a reference is blurrier than the frame."""


@dataclass(frozen=True)
class KernelEstimate:
    """Hold the blur that was estimated from an image.

    Attributes
    ----------
    moments : (3,) array
        Second moments ``(Sxx, Sxy, Syy)`` of the pointing, arcsec².  Noise may make them indefinite.
    covariance : (3, 3) array
        Of the moments, arcsec⁴.
    method : str
        Name of the estimator.
    source : str
        The data it was made from.  A fit to the *same* data may start from it, but must not use it
        as a prior: that would count the photons twice.
    shape : float
        Excess kurtosis along the major axis (linear -1.2, SHM -1.5, normal 0); NaN if not estimated.
    shape_err : float
        Its standard error.
    kernel : (ny, nx) array or None
        Kernel on the frame's pixels, where the method gives one: odd sides, its centre the middle one.
    locus : Locus or None
        The locus itself, where the method fits or assumes one.
    length_err : float
        Standard error of the locus's length, arcsec; NaN where the covariance gives it or there is none.
    digest : str
        Of the raw frame it was made from, ``RawFrame.digest``.  Where it is known it tells the same data;
        where it is empty the source does.
    undetermined : str
        A sentence that says why the blur is not known to be the pointing's (worse seeing, say), with which
        the estimate has no significance; empty where it is known.

    Notes
    -----
    Where an image has no known plate scale, one pixel stands for one arcsec: whoever made the estimate
    knows, and labels its table accordingly.
    """

    moments: np.ndarray
    covariance: np.ndarray
    method: str
    source: str = ""
    shape: float = float("nan")
    shape_err: float = float("nan")
    kernel: np.ndarray | None = None
    locus: Locus | None = None
    length_err: float = float("nan")
    digest: str = ""
    undetermined: str = ""

    @property
    def errors(self) -> np.ndarray:
        """Return the standard errors of the moments, arcsec²."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def axes(self) -> tuple[float, float, float]:
        """Return ``(major, minor, angle)``: 1 sigma per axis [arcsec] and degrees."""
        return principal_axes(self.moments)

    @cached_property
    def significance(self) -> float:
        """Chi-squared (3 degrees of freedom) against no jitter at all; NaN where that cannot be said."""
        return float("nan") if self.undetermined else significance(self.moments, self.covariance)

    @property
    def is_undetected(self) -> bool:
        """Return whether no jitter would give such moments once in a thousand frames, or more often."""
        return self.significance <= _DETECTED


def is_detected(moments: np.ndarray, covariance: np.ndarray) -> bool:
    """Return whether moments (3,) with their covariance (3, 3) are inconsistent with no jitter."""
    return significance(moments, covariance) > _DETECTED


def significance(moments: np.ndarray, covariance: np.ndarray) -> float:
    """Return chi-squared (3 degrees of freedom) of second moments against no jitter at all.

    Parameters
    ----------
    moments : (3,) array
    covariance : (3, 3) array

    Returns
    -------
    chi2 : float
        NaN where the covariance is singular to rounding: it then says nothing about some direction.
    """
    scale = np.sqrt(np.diag(covariance))
    if not np.all(scale > 0) or not np.all(np.isfinite(covariance)):
        return float("nan")
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    if values[0] < 1e-9 * values[-1]:
        return float("nan")
    return float(np.sum((vectors.T @ (moments / scale)) ** 2 / values))


def refuse_blurrier(excess: np.ndarray, covariance: np.ndarray, *, tolerated: float) -> None:
    """Refuse a reference that is blurrier than the frame.

    Parameters
    ----------
    excess, covariance : (3,) and (3, 3) array
        Moments of the frame's blur less those of the reference's [pixels²], and their covariance.
    tolerated : float
        Share of the larger variance that may be missing along the other axis, as a method's errors allow for.

    Raises
    ------
    UndeterminedError
        If a variance is negative beyond its error and beyond what is tolerated.
    """
    major, minor, axis = axis_variances(excess)
    own = covariance_on_axis(covariance, axis)
    across = (axis + 90) % 180
    if minor > -_BLURRIER * np.sqrt(own[2, 2]) or -minor < tolerated * major:
        return
    if major > _BLURRIER * np.sqrt(own[0, 0]):
        raise UndeterminedError(
            ErrorCode.BAD_REFERENCE,
            f"The reference is blurrier than the frame along {across:.0f} degrees (by {-minor:.3g} pixel² of "
            f"variance) and sharper along {axis:.0f} degrees; give one that is sharper all round.",
        )
    # a trail widens adaptive moments a little across it too: some deficit there is not all round
    all_round = major < -_BLURRIER * np.sqrt(own[0, 0]) and minor > 2 * major
    where = "all round" if all_round else f"along {across:.0f} degrees"
    problem = f"The reference is blurrier than the frame, {where} (by {-minor:.3g} pixel² of variance)"
    raise UndeterminedError(ErrorCode.BAD_REFERENCE, f"{problem}; exchange them?")
