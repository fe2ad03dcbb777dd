"""The blur from the ratio of two power spectra: the frame's, and its template's without jitter.

    y(f) = ln[ (|D|² - N0) / |T|² ] = a - w + k w²/12,    w = 4 pi² f'Σf

A straight line in Σ while the excess kurtosis k does not matter: no starting value, and no iteration but
of the weights; two milliseconds a frame.  It attains about twice the Cramér-Rao bound, because windowing
discards light and phases are not used.  The template's separation, angle and contrast must be right (its
place too, where pixels are masked); aberrations it lacks are taken for jitter.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import cache
from typing import NamedTuple

import equinox as eqx
import numpy as np
from scipy import fft
from scipy.signal.windows import hann

from jitterkit.errors import UndeterminedError
from jitterkit.estimators.shape import is_decisive, is_detected
from jitterkit.forward import Parameters, expected_image
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.likelihood import Data
from jitterkit.loci import Locus, Mvn, Stable
from jitterkit.optics.otf import OTF

__all__ = ["estimate_mtf_ratio"]

_BAND = (0.04, 0.6)
"""Frequencies used, in units of the detector's Nyquist frequency: below, the window leaks; above,
the optics pass too little."""

_PASSES = 20
"""At most, where pixels are masked: until their fill has settled."""

_STEPS = 3
"""Of a fit: a normal's is linear, and its weights alone follow it."""

_LEAST_SNR = 10.0
"""Power over noise power below which a frequency is left out, judged on the template, not the data:
the logarithm of a noisy power is biased, and a choice by the data would bias it again."""

_FEWEST = 10
"""Frequencies that a fit of five numbers needs."""


def estimate_mtf_ratio(
    data: Data, template: Parameters, otf: OTF, *, hold: Collection[str] = ()
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

    Returns
    -------
    estimate : KernelEstimate
        ``shape`` is NaN where no blur is detected.  While it says little (an error above 1.2), the moments
        are fitted without it and unbiased for a small blur (a linear smear of 0.225 arcsec on TOLIMAN);
        beyond, with it.

    Raises
    ------
    UndeterminedError
        If fewer than ten frequencies rise above the noise.

    Notes
    -----
    Hann-windowed images; ``N0`` the windowed sum of the pixel variances; weights
    ``P²/(N0 (2P + N0))``, the inverse variance of a log power.  Masked pixels are filled with the
    template, blurred by the estimate so far, and carry no noise.
    """
    used = np.asarray(data.used)
    sharp = _image(template, Stable.of(), otf)
    fill, before = sharp, np.full(3, np.inf)
    for _ in range(_PASSES):
        counts = np.where(used, np.asarray(data.electrons), fill)
        variance = np.where(used, np.clip(counts, 0, None) + np.asarray(data.read_variance), 0.0)
        ratio = _Ratio.of(counts, variance, sharp, otf.grid.plate_scale)
        estimate = _estimate(ratio)
        settled = np.all(np.abs(estimate.moments - before) < 0.05 * estimate.errors)
        if settled or used.all():
            break
        fill, before = _image(template, Mvn.near(estimate.moments), otf), estimate.moments
    return estimate


def _image(template: Parameters, locus: Locus, otf: OTF) -> np.ndarray:
    return np.asarray(expected_image(eqx.tree_at(lambda p: p.locus, template, locus), otf))


class _Ratio(NamedTuple):
    """Power spectra on the ``n`` frequencies of the band, and what their noise is made of.

    Attributes
    ----------
    power : (n,) array
        Of the frame, less its noise.
    transform : (n,) complex array
        Of the template.
    noise : float
        Power of the noise.
    variance : (ny, nx) array
        Of the windowed pixels.
    squares : (3, n) array
        ``w`` is their product with the moments.
    slots : (n,) int array
        Where the frequencies lie among those of ``rfft2``.
    """

    power: np.ndarray
    transform: np.ndarray
    noise: float
    variance: np.ndarray
    squares: np.ndarray
    slots: np.ndarray

    @classmethod
    def of(cls, counts, variance, sharp, plate_scale: float) -> _Ratio:
        """From a frame, its variance and its sharp template, all (ny, nx)."""
        window, squares, slots = _geometry(counts.shape, plate_scale)
        variance = variance * window**2
        noise = float(variance.sum())
        frame, template = (fft.rfft2(image * window).ravel()[slots] for image in (counts, sharp))
        return cls(np.abs(frame) ** 2 - noise, template, noise, variance, squares, slots)


@cache
def _geometry(shape: tuple[int, int], plate_scale: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Window (ny, nx), derivatives of w (3, n) and the slots (n,) of the band: the same for every frame."""
    axes = fft.fftfreq(shape[0], plate_scale), fft.rfftfreq(shape[1], plate_scale)
    fy, fx = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    radius = np.hypot(fx, fy) * 2 * plate_scale
    slots = np.flatnonzero((radius > _BAND[0]) & (radius < _BAND[1]))
    fx, fy = fx[slots], fy[slots]
    squares = 4 * np.pi**2 * np.stack([fx**2, 2 * fx * fy, fy**2])
    return np.outer(*(hann(n, sym=False) for n in shape)), squares, slots


def _estimate(ratio: _Ratio) -> KernelEstimate:
    """Moments with a normal's shape, or with their own where the spectra tell it."""
    solution, covariance = _fit(ratio, np.zeros(4), _STEPS)
    normal = KernelEstimate(solution[1:], covariance, "mtf")
    if not is_detected(normal.moments, normal.covariance):
        return normal
    solution, covariance = _fit(ratio, np.append(solution, 0.0), 1)
    free = is_decisive(np.sqrt(covariance[3, 3]))
    if free:
        solution, covariance = _fit(ratio, solution, _STEPS)
    return KernelEstimate(
        solution[1:4] if free else normal.moments,
        covariance[:3, :3] if free else normal.covariance,
        "mtf",
        shape=float(solution[4]),
        shape_err=float(np.sqrt(covariance[3, 3])),
    )


def _fit(ratio: _Ratio, solution: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Fit ``(a, Σ)`` or ``(a, Σ, k)`` from a start; the solution, and the covariance of all but ``a``."""
    reference = np.abs(ratio.transform) ** 2
    for _ in range(steps):  # the weights follow the blurred template
        model, slopes = _model(solution, ratio.squares)
        expected = reference * np.exp(np.clip(model, -60, 60))
        chosen = np.flatnonzero((expected > _LEAST_SNR * ratio.noise) & (ratio.power > 0))
        if len(chosen) < _FEWEST:
            raise UndeterminedError(
                f"Only {len(chosen)} frequencies rise above the noise; the MTF ratio needs {_FEWEST}. "
                "Use the score estimator, which uses every pixel."
            )
        p, matrix = expected[chosen], slopes[:, chosen]
        weights = p**2 / (ratio.noise * (2 * p + ratio.noise))
        weighted = matrix * weights
        inverse = np.linalg.inv(weighted @ matrix.T)
        # ln of a noisy power lies below the ln of its mean by half its relative variance
        residual = np.log(ratio.power[chosen] / reference[chosen]) + 0.5 / weights - model[chosen]
        solution = solution + inverse @ (weighted @ residual)
    gains = inverse[1:] @ weighted / (ratio.transform[chosen] * np.sqrt(p / reference[chosen]))
    return solution, _propagate(gains, ratio.slots[chosen], ratio.variance)


def _model(solution: np.ndarray, squares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``y`` (n,) and its derivatives (4 or 5, n) by the parameters."""
    w, shape = solution[1:4] @ squares, solution[4] if len(solution) > 4 else 0.0
    slopes = [np.ones_like(w), *(-squares * (1 - shape * w / 6)), w**2 / 12]
    return solution[0] - w + shape * w**2 / 12, np.stack(slopes[: len(solution)])


def _propagate(gains: np.ndarray, slots: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Covariance of the estimate from the variance of each windowed pixel.

    To first order ``dy = 2 Re(dD/D)``, so the estimate is a linear function of the pixels, and its
    weight on each of them is a Fourier transform of its gains over frequency.  Unlike the fit's
    own covariance this knows that the window ties neighbouring frequencies together.
    """
    ny, nx = variance.shape
    half = np.zeros((len(gains), ny * (nx // 2 + 1)), complex)
    half[:, slots] = gains.conj()
    half = half.reshape(len(gains), ny, -1)
    # irfft2 adds the mirror image of every frequency but of those that are their own
    half[:, :, 0] += _mirrored(half[:, :, 0])
    weights = fft.irfft2(half, s=variance.shape).reshape(len(gains), -1) * variance.size
    return (weights * variance.ravel()) @ weights.T


def _mirrored(column: np.ndarray) -> np.ndarray:
    """Conjugates at the opposite frequencies of a column (..., ny) of ``rfft2``."""
    return np.roll(column[..., ::-1], 1, axis=-1).conj()
