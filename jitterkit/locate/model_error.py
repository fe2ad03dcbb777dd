"""Errors of the model of the optics, as a variance of pixels in proportion to the light that they expect.

Optics that are imperfectly known leave two kinds of error in the image of stars of light s.  A sampled or
interpolated PSF, or a flat, is off by a share of s: its variance is ``a s²``.  A wavefront that the model
lacks scatters light, which interferes with the star's own: speckles of the variance ``b s h``, where h is s
smoothed over several resolution elements.  A speckle is as large as a resolution element, whose pixels
together say no more than one of them.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.optimize import nnls

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.forward import Parameters, background_of
from jitterkit.likelihood import Data
from jitterkit.locate.matched_filter import resolution
from jitterkit.locate.residual import Residual
from jitterkit.optics.otf import OTF

AUTO = "auto"
"""In place of a model error: as large as a frame shows."""

ModelError = float | Literal["auto"]

_HALO = 8.0
"""Full width of the smoothing of h, in resolutions: of 1, 3, 8 and the whole frame the most probable for
random wavefronts of 3 to 20 nm on TOLIMAN and on a plain telescope."""

_FWHM = 2 * math.sqrt(2 * math.log(2))

_SEEN = 4.0
"""Standard errors of a variance from which there is a model error."""

_CLIPPED, _KEPT = 9.0, 0.995
"""Squared residual [sigma²] beyond which more of it counts no more, since a star or a ray that the model
lacks is no error of the optics; and the mean of a normal residual that is clipped so."""

_STAR, _STARS = 0.3, 3
"""Share of chi-squared's excess that one star explains which the model lacks, and how many are looked for."""

_MOST = 0.1
"""Largest model error that is estimated: the model does not describe frames that show a larger one."""

_STEPS, _CONVERGED = 50, 1e-3

_FEW = 30.0
"""Resolution elements with a model error from which their pixels tell how alike they are."""


def check_model_error(error: ModelError) -> None:
    """Refuse what is no model error.

    Raises
    ------
    ConfigurationError
        Unless it is ``"auto"`` or a number from 0 to 1.
    """
    if error == AUTO or (isinstance(error, int | float) and 0 <= error < 1):
        return
    raise ConfigurationError(
        ErrorCode.OUT_OF_RANGE,
        f"A model error of {error!r} is impossible; give a share of the light, such as 0.02, or auto.",
    )


def relative_error(data: Data, image, background) -> float:
    """Return the model error that data allow for: rms share of the light, weighted by its square.

    Parameters
    ----------
    data : Data
    image : (ny, nx) array
        Expected electrons.
    background : (ny, nx) array
        Those of these that are not the stars'.
    """
    if data.model_variance is None:
        return 0.0
    light = float(np.sum(_light(image, background)[data.used] ** 2))
    variance = data.model_variance / np.square(data.weight)
    return math.sqrt(float(np.sum(variance[data.used])) / light) if light > 0 else 0.0


def allow_for_model(data: Data, parameters: Parameters, image, otf: OTF, error: ModelError) -> Data:
    """Return data with a variance for errors of the model.

    Parameters
    ----------
    data : Data
        Any such variance of theirs is replaced.
    parameters : Parameters
        That fit them.
    image : (ny, nx) array
        Expected electrons there.
    otf : OTF
    error : float or "auto"
        Share of the stars' light in each pixel, 1 sigma; or as large as the residual shows.

    Returns
    -------
    data : Data
        Without a variance where the error is zero.

    Notes
    -----
    A given error is taken to be alike over a resolution element.  An estimated one has both kinds of error,
    by squared residuals clipped at three sigmas, and what a star explains that the model lacks is taken away
    first.  Smoothed residuals tell over how many pixels it is alike.

    The variance does not change while a likelihood is maximised: one that follows the model favours faint
    stars.

    *Fails when* an error is common to the whole image: light that is lost by scattering looks like jitter.
    """
    data, image = data if data.model_variance is None else data.allowing(None), np.asarray(image)
    if error == 0 or not np.any(data.used):
        return data
    light, pixels = _light(image, background_of(parameters, otf.grid)), resolution(otf) / otf.grid.plate_scale
    most, shot = max(pixels**2, 1.0), np.square(data.weight)
    if error != AUTO:
        return data.allowing((float(error) * light) ** 2 * shot, most)
    width = pixels / _FWHM
    shapes = np.stack([light**2, light * gaussian_filter(light, _HALO * width)])
    left = _without_missing_stars(Residual(data, image, otf, parameters.locus))
    noise = np.asarray((np.maximum(image, 0.0) + data.offset) / data.weight)
    used = np.asarray(data.used) & (noise > 0)
    amounts = _amounts(left[used] ** 2, noise[used], shapes[:, used])
    if not amounts.any():
        return data
    variance = np.tensordot(amounts, shapes, 1)
    variance *= min(1.0, _MOST**2 * np.sum(shapes[0][used]) / np.sum(variance[used]))
    return data.allowing(variance * shot, _alike(np.where(used, left, 0.0), noise, variance, width, most))


def _light(image, background) -> np.ndarray:
    return np.maximum(np.asarray(image) - np.asarray(background), 0.0)


def _without_missing_stars(residual: Residual) -> np.ndarray:
    """Return a residual [electrons] without stars that explain much of it."""
    for _ in range(_STARS):
        star, gain = residual.star()
        excess = float(np.sum(residual.sigmas**2)) - np.count_nonzero(residual.data.used)
        if not gain > max(_STAR * excess, 4 * _CLIPPED):
            break
        residual = residual.without(star)
    return np.asarray(residual.data.electrons) - residual.image


def _amounts(squares: np.ndarray, noise: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Return how much of each shape (k, n) squared residuals (n,) hold beside noise, none negative."""
    clipped, weighted = np.minimum(squares, _CLIPPED * noise) / _KEPT, shapes / noise
    score = weighted @ (clipped / noise - 1)
    if not np.any(score > _SEEN * np.sqrt(2 * np.sum(weighted**2, axis=1))):
        return np.zeros(len(shapes))
    scale = np.sqrt(np.mean(shapes**2, axis=1, keepdims=True))
    amounts = np.zeros(len(shapes))
    for _ in range(_STEPS):
        variance = noise + amounts @ (shapes / scale)
        clipped = np.minimum(squares, _CLIPPED * variance) / _KEPT
        new, _ = nnls((shapes / scale / variance).T, (clipped - noise) / variance)
        done = np.all(np.abs(new - amounts) <= _CONVERGED * new.sum())
        amounts = new
        if done:
            break
    return amounts / scale[:, 0]


def _alike(left: np.ndarray, noise: np.ndarray, variance: np.ndarray, width: float, most: float) -> float:
    """Return the pixels that have the same model error, 1 to ``most``, by residuals smoothed over so many."""
    total = np.maximum(noise + variance, np.finfo(float).tiny)
    share = variance / total
    if not np.sum(share) > _FEW * most:
        return most
    clip = math.sqrt(_CLIPPED)
    smooth = gaussian_filter(np.clip(left / np.sqrt(total), -clip, clip), width)
    squares = 4 * math.pi * width**2 * smooth**2  # one, of pixels that are not alike
    found = np.sum(share * (squares - 1 + share)) / np.sum(share**2)
    return float(np.clip(found, 1.0, most))
