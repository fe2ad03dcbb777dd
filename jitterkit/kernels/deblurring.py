"""An image with the blur taken out, to look at: the right kernel makes stars round and edges single.

A check and a picture, not a measurement: deconvolution makes noise into structure.  What is to be measured
is fitted to the blurred frame (:mod:`jitterkit.refit`).  The algorithms are scikit-image's; here they get
what they silently expect (a scale, space at the borders, no holes) and the answer is put back on the
image's own scale.  Reach for ``richardson-lucy`` for stars, ``wiener`` for the ground.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable

import numpy as np
from scipy.ndimage import convolve, distance_transform_edt
from scipy.signal import fftconvolve
from skimage import restoration

from jitterkit.errors import ConfigurationError, ErrorCode, one_of

METHODS = ("richardson-lucy", "wiener", "unsupervised-wiener")

_ITERATIONS = (5, 10, 20, 40, 80, 160)
"""Iterations tried one after the other until what is left looks like noise."""

_BALANCE = np.geomspace(1e-9, 1e3, 37)
"""Weights of smoothness tried, three a decade; the image's scale does not enter."""

_LAPLACE = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]]) / 6
"""Blind to planes, with noise as large after it as before (Immerkaer 1996)."""


def deblur(
    image: np.ndarray,
    kernel: np.ndarray,
    *,
    method: str = "richardson-lucy",
    variance: np.ndarray | float | None = None,
    mask: np.ndarray | None = None,
    iterations: int | None = None,
    balance: float | None = None,
    rng: np.random.Generator | None = None,
) -> np.ndarray:
    """Take a known blur out of an image.

    Parameters
    ----------
    image : (ny, nx) array
        In any unit; NaN is taken as masked.
    kernel : (my, mx) array
        Odd sides, on the image's pixels: from :func:`jitterkit.kernels.kernel_image`.
    method : {"richardson-lucy", "wiener", "unsupervised-wiener"}
    variance : (ny, nx) array or float, optional
        Of the noise, in the image's unit squared: ``Frame.variance`` for electrons.  By default one number,
        estimated from the image.
    mask : (ny, nx) bool array, optional
        True where a pixel is unusable: it is filled with its nearest neighbour.
    iterations : int, optional
        Of Richardson and Lucy's algorithm.  By default 5, 10, 20, ... up to 160, until the image, blurred
        again, differs from the data by the noise.
    balance : float, optional
        Of the Wiener filter: weight of smoothness.  By default the largest that leaves the noise.
    rng : numpy.random.Generator, optional
        Needed by the unsupervised filter, which draws samples.

    Returns
    -------
    sharp : (ny, nx) array
        In the image's unit; its sum is the image's, but for what the borders and filled pixels make of it.

    Raises
    ------
    ConfigurationError
        If the method is another, the kernel has even sides or no positive sum, no pixel is usable, shapes
        disagree, or the unsupervised filter gets no generator.

    Notes
    -----
    Richardson and Lucy's algorithm takes counts: an image with negative pixels is lifted above zero for it,
    and a kernel's negative fringes are cut off, which for a streak thinner than a pixel widens it a little.
    *Fails when* the kernel is wrong: the residual never comes down to the noise, and the image rings.
    """
    image, kernel = np.asarray(image, float), _checked(kernel, method, rng)
    for name, given in (("variance", variance), ("mask", mask)):
        if isinstance(given, np.ndarray) and given.shape not in ((), image.shape):
            problem = f"The {name} has shape {given.shape} and the image {image.shape}."
            raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    usable = np.isfinite(image) & ~(np.zeros(image.shape, bool) if mask is None else np.asarray(mask, bool))
    if image.ndim != 2:
        problem = f"An image to deblur has two axes, (ny, nx); got shape {image.shape}."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    if not usable.any():
        problem = f"None of the {image.size} pixels of the image is usable"
        raise ConfigurationError(ErrorCode.NO_DATA, f"{problem}; mask fewer, or give finite values.")
    filled = fill_masked(image, usable)
    noise = _noise(filled) ** 2 if variance is None else variance
    noise = np.maximum(np.broadcast_to(np.asarray(noise, float), image.shape), np.finfo(float).tiny)

    def misfit(sharp: np.ndarray) -> float:
        blurred = fftconvolve(sharp, kernel, mode="same")
        return float(np.mean(((filled - _inner(blurred, image.shape)) ** 2 / noise)[usable]))

    padded = _padded(filled, max(kernel.shape))
    if method == "richardson-lucy":
        sharp = _richardson_lucy(padded, kernel, iterations, misfit)
    elif method == "wiener":
        sharp = _wiener(padded, kernel, balance, misfit)
    else:
        scale = np.abs(padded).max() or 1.0
        sharp, _ = restoration.unsupervised_wiener(padded / scale, kernel, clip=False, rng=rng)
        sharp = sharp * scale
    return _inner(sharp, image.shape)


def _checked(kernel, method: str, rng) -> np.ndarray:
    kernel = np.asarray(kernel, float)
    one_of("deblurring method", method, METHODS)
    odd = kernel.ndim == 2 and kernel.shape[0] % 2 == 1 and kernel.shape[1] % 2 == 1
    if not odd or not kernel.sum() > 0:
        code = ErrorCode.OUT_OF_RANGE if odd else ErrorCode.WRONG_SHAPE
        got = f"got shape {kernel.shape} and {kernel.sum():.3g}"
        raise ConfigurationError(code, f"A kernel has odd sides and a positive sum, {got}.")
    if method == "unsupervised-wiener" and rng is None:
        problem = "The unsupervised Wiener filter draws samples: give it a generator as rng."
        raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
    return kernel / kernel.sum()


def fill_masked(image: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Fill every unusable pixel with the value of the nearest usable one."""
    nearest = distance_transform_edt(~usable, return_distances=False, return_indices=True)
    return image[tuple(nearest)]


def _noise(image: np.ndarray) -> float:
    """Return the standard deviation of white noise in an image that is smooth over most of its area."""
    return 1.4826 * float(np.median(np.abs(convolve(image, _LAPLACE, mode="reflect"))))


def _padded(image: np.ndarray, width: int) -> np.ndarray:
    """Room for the blur to come from, then a slope to one level, so that opposite sides meet."""
    border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
    near = np.pad(image, width, mode="edge")
    return np.pad(near, width, mode="linear_ramp", end_values=float(np.median(border)))


def _inner(padded: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    top, left = ((m - n) // 2 for m, n in zip(padded.shape, shape, strict=True))
    return padded[top : top + shape[0], left : left + shape[1]]


def _richardson_lucy(image, kernel, iterations: int | None, misfit: Callable) -> np.ndarray:
    floor = min(float(image.min()), 0.0)
    scale = float(image.max()) - floor or 1.0
    density = np.maximum(kernel, 0) / np.maximum(kernel, 0).sum()
    sharp = image
    for steps in _ITERATIONS if iterations is None else (iterations,):
        lifted = restoration.richardson_lucy((image - floor) / scale, density, steps, clip=False)
        sharp = lifted * scale + floor
        if misfit(sharp) <= 1:
            break
    return sharp


def _wiener(image, kernel, balance: float | None, misfit: Callable) -> np.ndarray:
    def filtered(weight: float) -> np.ndarray:
        return restoration.wiener(image, kernel, weight, clip=False)

    if balance is not None:
        return filtered(balance)
    # the misfit rises with the weight
    above = bisect_right(_BALANCE, 1.0, lo=1, key=lambda weight: misfit(filtered(weight)))
    return filtered(_BALANCE[above - 1])
