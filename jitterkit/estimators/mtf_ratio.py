"""The blur from the ratio of two power spectra: the frame's, and its template's without jitter.

    y(f) = ln[ (|D|² - N0) / |T|² ] = a - w + k w²/12 - k² w³/(18 (3 - k)),    w = 4 pi² f'Σf

The logarithm of a blur's transfer function by powers of its moments Σ, to the third, as its excess kurtosis
k decides them (see ``Shaped``; for positive k there is a closed form).  While k does not matter it is a
straight line in Σ: no starting value, and no iteration but of the weights; two to three milliseconds a
frame.  It attains 1.6 times the Cramér-Rao bound, because the noise is taken for even over the frame and
phases are not used.  The template's separation, angle and contrast must be right (its position too, where
pixels are masked); aberrations it lacks are taken for jitter.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy import fft
from scipy.signal.windows import hann

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.estimators.shape import DECISIVE, inflate_covariance
from jitterkit.forward import Parameters, expected_image
from jitterkit.kernel_estimate import KernelEstimate, is_detected
from jitterkit.likelihood import Data
from jitterkit.loci import Locus, Mvn, Shaped, Stable
from jitterkit.optics.otf import OTF

_BAND = (0.02, 0.7)
"""Frequencies used, in units of the detector's Nyquist frequency: below, the window leaks; above,
TOLIMAN's optics pass too little."""

_PASSES = 20
"""At most, where pixels are masked: until their fill has settled."""

_STEPS = 3
"""Of a fit: a normal's is linear, and its weights alone follow it.  Three more move it by 0.05 errors at
most, at 1e5 photons."""

_LEAST_SNR = 10.0
"""Power over noise power below which a frequency is left out, judged on the template, not the data:
the logarithm of a noisy power is biased, and a choice by the data would bias it again."""

_WIDEST = 2.0
"""Of w: a streak's series is off by 4 % of y there, and by 30 % at twice that."""

_HEAVY = 0.01
"""Excess kurtosis from which the closed form has digits; below, the series differs by less."""

_SMALLEST = 32
"""Pixels a side: of a smaller frame the window leaves too little."""

_LIGHTEST = -1.5
"""Excess kurtosis, the least of an elliptical density: that of the ellipse run round."""

_FEWEST = 10
"""Frequencies that a fit of five numbers needs."""


def estimate_mtf_ratio(
    data: Data, template: Parameters, otf: OTF, *, hold: Collection[str] = (), shape: float | None = None
) -> KernelEstimate:
    """Estimate second moments and shape from the ratio of power spectra.

    Parameters
    ----------
    data : Data
    template : Parameters
        Scene and aberrations; its locus is ignored.
    otf : OTF
    hold : collection of str
        For the sake of a common signature: everything but the blur is held at the template's values.
    shape : float, optional
        Excess kurtosis, where the kind of motion is known, as for
        :func:`~jitterkit.estimators.score.estimate_score`.

    Returns
    -------
    estimate : KernelEstimate
        With a shape given, its ``locus`` has that shape.  Otherwise ``shape`` is NaN where no blur is
        detected.  While it says little (an error above 1.2), the moments
        are fitted without it, and their errors hold what it might do to them; beyond, with it, and the locus
        has it.  Unbiased for a drift as wide as the resolution (0.75 arcsec on TOLIMAN).

    Raises
    ------
    UndeterminedError
        If fewer than ten frequencies rise above the noise, the frame has less than 32 pixels a side, or the
        ratio is that of no blur.
    ConfigurationError
        If no density has the shape given.

    Notes
    -----
    Hann-windowed images; ``N0`` the windowed sum of the pixel variances; weights
    ``P²/(N0 (2P + N0))``, the inverse variance of a log power.  Masked pixels are filled with the
    template, blurred by the estimate so far, and carry no noise.

    *Fails when* the blur is wider than the optics' resolution (a drift of 1 arcsec on TOLIMAN at 4e7 photons
    is 3 of its errors off, one of 1.5 arcsec 5); where the brightest pixels are masked and the shape
    matters; in frames of less than 48 pixels a side.
    """
    if shape is not None:
        Shaped.of(0.0, kurtosis=shape)  # refuses what no density has
    used = np.asarray(data.used)
    if min(used.shape) < _SMALLEST:
        raise UndeterminedError(
            ErrorCode.TOO_FEW,
            f"The MTF ratio needs a frame of {_SMALLEST} pixels a side, and this one has {min(used.shape)}; "
            "use the score estimator.",
        )
    sharp = _image(template, Stable.of(), otf)
    fill, before = sharp, np.full(3, np.inf)
    for _ in range(_PASSES):
        counts = np.where(used, np.asarray(data.electrons), fill)
        variance = np.where(used, (np.clip(counts, 0, None) + data.offset) / data.weight, 0.0)
        ratio = _Ratio.of(counts, variance, sharp, otf.grid.plate_scale)
        estimate = _estimate(ratio) if shape is None else _of_known_shape(ratio, shape)
        settled = np.all(np.abs(estimate.moments - before) < 0.05 * estimate.errors)
        if settled or used.all():
            break
        fill, before = _image(template, Mvn.near(estimate.moments), otf), estimate.moments
    return estimate


def _image(template: Parameters, locus: Locus, otf: OTF) -> np.ndarray:
    return np.asarray(expected_image(template.with_locus(locus), otf))


class _Ratio(NamedTuple):
    """Power spectra on the ``n`` frequencies of the band that can be used, and what their noise is made of.

    Attributes
    ----------
    log_ratio : (n,) array
        Logarithm of the frame's power, less its noise, over the template's.
    transform : (n,) complex array
        Of the template.
    noise : float
        Power of the noise.
    variance : (ny, nx) array
        Of the windowed pixels.
    squares : (3, n) array
        ``w`` is their product with the moments.
    indices : (n,) int array
        Where the frequencies lie among those of ``rfft2``.
    """

    log_ratio: np.ndarray
    transform: np.ndarray
    noise: float
    variance: np.ndarray
    squares: np.ndarray
    indices: np.ndarray

    @classmethod
    def of(cls, counts, variance, sharp, plate_scale: float) -> _Ratio:
        """Compute the ratio from a frame, its variance and its sharp template, all (ny, nx)."""
        window, squares, indices = _geometry(counts.shape, plate_scale)
        variance = variance * window**2
        noise = float(variance.sum())
        frame, template = (fft.rfft2(image * window).ravel()[indices] for image in (counts, sharp))
        power, reference = np.abs(frame) ** 2 - noise, np.abs(template) ** 2
        # a blur only takes power away; a factor of two is left for the flux
        some = np.flatnonzero((power > 0) & (2 * reference > _LEAST_SNR * noise))
        log_ratio = np.log(power[some] / reference[some])
        return cls(log_ratio, template[some], noise, variance, squares[:, some], indices[some])


@lru_cache(maxsize=4)
def _geometry(shape: tuple[int, int], plate_scale: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Window (ny, nx), derivatives of w (3, n) and the indices (n,) of the band: the same for every frame."""
    axes = fft.fftfreq(shape[0], plate_scale), fft.rfftfreq(shape[1], plate_scale)
    fy, fx = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    radius = np.hypot(fx, fy) * 2 * plate_scale
    indices = np.flatnonzero((radius > _BAND[0]) & (radius < _BAND[1]))
    fx, fy = fx[indices], fy[indices]
    squares = 4 * np.pi**2 * np.stack([fx**2, 2 * fx * fy, fy**2])
    return np.outer(*(hann(n, sym=False) for n in shape)), squares, indices


def _estimate(ratio: _Ratio) -> KernelEstimate:
    """Return the moments with a normal's shape, or with their own where the spectra tell it."""
    normal, pull, _ = _fit(ratio, np.zeros(4), _STEPS)
    covariance = _propagate(pull, ratio)
    if not is_detected(normal[1:], covariance):
        return KernelEstimate(normal[1:], covariance, "mtf")
    solution, pull, metric = _fit(ratio, np.append(normal, 0.0), 1)
    shape, error = float(solution[4]), float(np.sqrt(_propagate(pull[3:], ratio)[0, 0]))
    if not error < DECISIVE:
        covariance = inflate_covariance(covariance, -metric[1:4, 4] / metric[4, 4])
        return KernelEstimate(normal[1:], covariance, "mtf", shape=shape, shape_err=error)
    solution, pull, _ = _fit(ratio, solution, _STEPS)
    covariance = _propagate(pull, ratio)
    shape, error = float(solution[4]), float(np.sqrt(covariance[3, 3]))
    if not shape > _LIGHTEST - 3 * error:
        raise UndeterminedError(
            ErrorCode.IMPLAUSIBLE,
            f"The power spectra are in a ratio of no blur (an excess kurtosis of {shape:.2g}): it is too "
            "wide, or the template is another scene's. Use the score estimator.",
        )
    locus = Shaped(jnp.asarray(solution[1:]))
    return KernelEstimate(solution[1:4], covariance[:3, :3], "mtf", shape=shape, shape_err=error, locus=locus)


def _of_known_shape(ratio: _Ratio, shape: float) -> KernelEstimate:
    """Return the moments with a shape that is given."""
    normal, *_ = _fit(ratio, np.zeros(4), _STEPS)
    solution, pull, _ = _fit(ratio, normal, _STEPS, shape)
    locus = Shaped(jnp.append(jnp.asarray(solution[1:]), shape))
    return KernelEstimate(solution[1:], _propagate(pull, ratio), "mtf", locus=locus)


def _fit(
    ratio: _Ratio, solution: np.ndarray, steps: int, shape: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit ``(a, Σ)`` with a shape, or ``(a, Σ, k)``, from a start.

    Returns
    -------
    solution : (4 or 5,) array
    pull : (3 or 4, n) complex array
        Of the frame's spectrum on all of them but ``a``; zero where a frequency was not used.
    metric : (4 or 5, 4 or 5) array
        Inverse of the weighted squares of the slopes.
    """
    reference = np.abs(ratio.transform) ** 2
    for _ in range(steps):  # the weights follow the blurred template
        w = solution[1:4] @ ratio.squares
        model, slopes = _model(solution, w, ratio.squares, shape)
        expected = reference * np.exp(np.clip(model, -60, 60))
        chosen = (expected > _LEAST_SNR * ratio.noise) & (w < _WIDEST)
        if (count := np.count_nonzero(chosen)) < _FEWEST:
            problem = f"Only {count} frequencies rise above the noise"
            remedy = f"the MTF ratio needs {_FEWEST}. Use the score estimator, which uses every pixel"
            raise UndeterminedError(ErrorCode.NO_SIGNAL, f"{problem}; {remedy}.")
        weights = np.where(chosen, expected**2 / (ratio.noise * (2 * expected + ratio.noise)), 0.0)
        weighted = slopes * weights
        metric = np.linalg.inv(weighted @ slopes.T)
        # ln of a noisy power lies below the ln of its mean by half its relative variance
        residual = np.where(chosen, ratio.log_ratio - model, 0.0)
        solution = solution + metric @ (weighted @ residual + slopes @ (0.5 * chosen))
    pull = metric[1:] @ weighted / (ratio.transform * np.sqrt(expected / reference))
    return solution, pull, metric


def _model(
    solution: np.ndarray, w: np.ndarray, squares: np.ndarray, shape: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return ``y`` (n,) and its derivatives (4 or 5, n) by the parameters, the shape among them or given."""
    shape = float(solution[4]) if len(solution) > 4 else shape
    if shape > _HEAVY:
        z = np.maximum(1 + shape * w / 6, 0.5)
        y, by_w = -6 / shape * np.log(z), -1 / z
        by_shape = 6 / shape**2 * np.log(z) - w / (shape * z)
    else:
        sixth = -(shape**2) / (18 * (3 - shape))
        y, by_w = -w + shape * w**2 / 12 + sixth * w**3, -1 + shape * w / 6 + 3 * sixth * w**2
        by_shape = w**2 / 12 - shape * (6 - shape) / (18 * (3 - shape) ** 2) * w**3
    slopes = np.empty((len(solution), w.size))
    slopes[0], slopes[1:4], slopes[4:] = 1.0, squares * by_w, by_shape
    return solution[0] + y, slopes


def _propagate(pull: np.ndarray, ratio: _Ratio) -> np.ndarray:
    """Return the covariance of the estimate from the variance of each windowed pixel.

    To first order ``dy = 2 Re(dD/D)``, so the estimate is a linear function of the pixels, and its
    weight on each of them is a Fourier transform of the pull of the frequencies.  Unlike the fit's
    own covariance this knows that the window ties neighbouring frequencies together.
    """
    ny, nx = ratio.variance.shape
    half = np.zeros((len(pull), ny * (nx // 2 + 1)), np.complex64)  # an error needs no sixteen digits
    half[:, ratio.indices] = pull.conj()
    half = half.reshape(len(pull), ny, -1)
    # irfft2 adds the mirror image of every frequency but of those that are their own
    half[:, :, 0] += _mirrored(half[:, :, 0])
    weights = fft.irfft2(half, s=(ny, nx)).reshape(len(pull), -1).astype(float) * (ny * nx)
    return (weights * ratio.variance.ravel()) @ weights.T


def _mirrored(column: np.ndarray) -> np.ndarray:
    """Conjugates at the opposite frequencies of a column (..., ny) of ``rfft2``."""
    return np.roll(column[..., ::-1], 1, axis=-1).conj()
