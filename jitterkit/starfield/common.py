"""What all stars of a field have in common, and how far they scatter about it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.starfield.moments import Moments

__all__ = ["Common", "common_moments"]

_OUTLIER = 25.0
"""Squared distance, of three degrees of freedom, beyond which a star is a blend: 2e-5 by chance."""

_PASSES = 20

_LEAST = 3
"""Stars from which a scatter can be told, and one told from the rest."""


class Common(NamedTuple):
    """Mean of the moments of a field.

    Attributes
    ----------
    moments : (3,) array
        [pixels²]
    covariance : (3, 3) array
        Of the mean; noise and scatter [pixels⁴].
    scatter : (3, 3) array
        Covariance from star to star beyond the noise [pixels⁴].
    used : (n,) bool array
        Stars that agree; the rest are blends, galaxies and worse.
    chi2 : float
        Of equal moments, noise alone; its expectation is ``dof`` if they are.
    dof : int
    """

    moments: np.ndarray
    covariance: np.ndarray
    scatter: np.ndarray
    used: np.ndarray
    chi2: float
    dof: int


def common_moments(moments: Moments) -> Common:
    """Average the moments of a field.

    Parameters
    ----------
    moments : Moments

    Returns
    -------
    common : Common
        Weights are inverse variances, of noise plus scatter, so that a few bright stars do not speak
        for a field that varies.

    Raises
    ------
    UndeterminedError
        If no star is sound.
    """
    values, noise, used = moments.moments, moments.covariance, moments.sound.copy()
    if not used.any():
        raise UndeterminedError(
            ErrorCode.TOO_FEW_STARS,
            "No isolated star has a measurable shape; expose longer or give a larger frame.",
        )
    mean, scatter = np.median(values[used], axis=0), np.zeros((3, 3))
    several = used.sum() >= _LEAST
    if several:
        scatter = np.diag((1.4826 * np.median(np.abs(values[used] - mean), axis=0)) ** 2)
    sized = used
    for _ in range(_PASSES):
        weight = np.linalg.inv(np.where(sized[:, None, None], noise, np.eye(3)) + scatter)
        if several:
            distance = np.einsum("na,nab,nb->n", values - mean, weight, values - mean)
            used = sized & (distance < _OUTLIER)
        covariance = np.linalg.inv(weight[used].sum(0))
        mean = covariance @ np.einsum("nab,nb->a", weight[used], values[used])
        if several:
            scatter = _scatter(values[used] - mean, noise[used], scatter)
    residual = values[used] - mean
    chi2 = float(np.einsum("na,nab,nb->", residual, np.linalg.inv(noise[used]), residual))
    return Common(mean, covariance, scatter, used, chi2, 3 * (int(used.sum()) - 1))


def _scatter(residual: np.ndarray, noise: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Covariance of residuals (n, 3) beyond their noise, without its negative part."""
    n = len(residual)
    share = 1 / (np.trace(noise, axis1=1, axis2=2) + np.trace(before)) ** 2
    outer = residual[:, :, None] * residual[:, None, :] * n / max(n - 1, 1)
    excess = np.einsum("n,nab->ab", share / share.sum(), outer - noise)
    size, axes = np.linalg.eigh(excess)
    return (axes * np.clip(size, 0, None)) @ axes.T
