"""Whether all stars of a field have the same blur, as a fit takes for granted.

The residual of each star is read for a second moment of its own.  Moments that differ from star to star say
that the point-spread function changes over the field; those that grow as a turn of the field makes them say
by how much it rolled.
"""

from __future__ import annotations

import numpy as np
import scipy.stats
from scipy import fft

from jitterkit.forward import Parameters
from jitterkit.likelihood import Data
from jitterkit.locate.matched_filter import spectrum_of_star
from jitterkit.optics.otf import OTF

_FALSE = 1e-4
"""Chance of such differences below which they are none of noise."""

_ROLLED, _ALL = 5.0, 0.9
"""Standard errors from which a roll is one, and the share of the differences that it must explain."""


def star_moments(parameters: Parameters, otf: OTF, image, data: Data) -> tuple[np.ndarray, np.ndarray]:
    """Measure the second moments that each star has beyond those of the fit, by one scoring step.

    Parameters
    ----------
    parameters : Parameters
        Fitted.
    otf : OTF
        About its aberrations.
    image : (ny, nx) array
        Expected electrons.
    data : Data

    Returns
    -------
    moments : (n, 3) array
        ``(Sxx, Sxy, Syy)``, arcsec²; position and flux of each star are free beside them.
    information : (n, 3, 3) array
        Inverse covariances, arcsec⁻⁴.
    """
    grid, (fy, fx) = otf.grid, otf.grid.frequencies
    cy, cx = grid.centre
    counts = np.maximum(np.asarray(image) + np.asarray(data.offset), np.finfo(float).tiny)
    weight = np.where(data.used, np.asarray(data.weight) / counts, 0.0).ravel()
    left = (np.asarray(data.electrons) - np.asarray(image)).ravel()
    one, turn = spectrum_of_star(otf, parameters.locus), 2 * np.pi
    changes = [1.0, -1j * turn * fx, -1j * turn * fy]
    changes += [-0.5 * turn**2 * fx**2, -(turn**2) * fx * fy, -0.5 * turn**2 * fy**2]
    moments, known = [], []
    for x, y, flux in zip(*map(np.asarray, parameters.scene.sources()), strict=True):
        star = flux * one * np.exp(-1j * turn * (fx * (x + cx) + fy * (y + cy)))
        slopes = np.array(
            [grid.crop(fft.irfft2(star * change, s=grid.fine_shape)).ravel() for change in changes]
        )
        weighted = slopes * weight
        information, score = weighted @ slopes.T, weighted @ left
        beside = np.linalg.pinv(information[:3, :3])  # position and flux take what they can
        cross = information[3:, :3] @ beside
        own = information[3:, 3:] - cross @ information[:3, 3:]
        known.append(own)
        moments.append(np.linalg.pinv(own) @ (score[3:] - cross @ score[:3]))
    return np.array(moments), np.array(known)


def describe_field_variation(parameters: Parameters, otf: OTF, image, data: Data) -> str:
    """Say in a sentence that the blur differs from star to star; empty where that cannot be determined.

    Parameters
    ----------
    parameters, otf, image, data
        As for :func:`star_moments`.
    """
    x, y, _ = (np.asarray(part) for part in parameters.scene.sources())
    if len(x) < 3:
        return ""
    moments, known = star_moments(parameters, otf, image, data)
    same = np.tile(np.eye(3), (len(x), 1, 1))
    left, _, _ = _fitted(same, moments, known)
    if scipy.stats.chi2.sf(left, 3 * len(x) - 3) > _FALSE:
        return ""
    rest, values, covariance = _fitted(_of_a_roll(x, y), moments, known)
    turned, error = values[0], np.sqrt(covariance[0, 0])
    excess = left - (3 * len(x) - 3)
    if turned > _ROLLED * error and left - rest > _ALL * excess:
        roll = np.degrees(np.sqrt(12 * turned))
        uncertain = roll * error / (2 * turned)
        return f"The field rolled by {roll:.3g} ± {uncertain:.1g} degrees during the exposure."
    parts = same, moments, known
    alone = [_fitted(*(np.delete(part, i, axis=0) for part in parts))[0] for i in range(len(x))]
    odd = int(np.argmin(alone))
    if scipy.stats.chi2.sf(alone[odd], 3 * len(x) - 6) > _FALSE:
        where = f"star {odd + 1}, at ({x[odd]:.3g}, {y[odd]:.3g}) arcsec"
        return f"The blur of {where}, is not that of the others: it may be two stars."
    return f"The blur differs from star to star (chi² {left:.4g} of {3 * len(x) - 3}): the PSF is not one."


def _of_a_roll(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return slopes (n, 3, 6) of the moments by roll²/12, by that times its axis, and by a common blur.

    A star at (x, y) moves by roll times (-(y - y0), x - x0) from one end of a uniform turn to the other.
    """
    slopes, none = np.zeros((len(x), 3, 6)), np.zeros_like(x)
    slopes[:, :, 0] = np.stack([y**2, -x * y, x**2], axis=1)
    slopes[:, :, 1] = np.stack([none, y, -2 * x], axis=1)
    slopes[:, :, 2] = np.stack([-2 * y, x, none], axis=1)
    slopes[:, :, 3:] = np.eye(3)
    return slopes


def _fitted(
    slopes: np.ndarray, moments: np.ndarray, known: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Chi-squared that a linear law of the moments leaves, its coefficients and their covariance."""
    weighted = np.einsum("nji,njk->nik", slopes, known)
    covariance = np.linalg.pinv(np.einsum("nij,njk->ik", weighted, slopes))
    values = covariance @ np.einsum("nij,nj->i", weighted, moments)
    off = moments - slopes @ values
    return float(np.einsum("ni,nij,nj->", off, known, off)), values, covariance
