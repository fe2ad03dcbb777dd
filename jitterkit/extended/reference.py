"""The blur of one frame against a sharp one of the same scene.

With the scene known, nothing has to be guessed: the ratio of the two transforms is the blur's transfer
function, and small blurs show as well as long ones.  :func:`estimate_from_reference` fits a streak or a
normal to it together with the shift and the gain between the frames, each frequency by what both
frames' noise leaves of it; the kernel on pixels comes beside it, from the regularised ratio.
"""

from __future__ import annotations

import numpy as np
from scipy import fft
from scipy.optimize import least_squares
from scipy.signal.windows import hann

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.extended.registration import Drift, align, fill, left_over, standing_pixels, striped
from jitterkit.kernel_estimate import KernelEstimate, refuse_blurrier
from jitterkit.loci import Linear, Mvn
from jitterkit.loci.base import principal_axes
from jitterkit.vision import box_mean

_BAND = 0.45
"""Cycles/pixel; beyond, frames alias."""

_LEAST_ORDER = 4.0
"""Cycles in the frame: below, what moves through the borders counts."""

_STRIPES = 0.05
"""Cycles/pixel; below, a scene may have few strong frequencies, and blurs of pixels hardly show."""

_LEAST_FREQUENCIES = 50
"""That must rise above the noise in the sharp frame."""

_TOLERATED = 0.03
"""Share of the blur's larger variance that may be missing across it: a normal fitted to a streak on sharp
photographs leaves at most 0.018 of it."""

_LEFT_OVER, _LEAST_BLUR = 0.004, 0.03
"""Share of the power that may be no blur of the reference, by the blur's larger variance [pixel²], which is
taken to be at least the second: of blurs alone up to 0.001 are left, as they run out of the frame.  Patterns
that make the variance wrong by more than a quarter leave more, but for fringes, which are few frequencies."""

_SAMPLE = 3000
"""Frequencies on which the starts compete; the winner is fitted to all."""

_STARTS = -0.3, 0.05, 0.3, 1.0
"""Moments to start from, in units of the widest normal that the data show: nulls make local minima, and those
of a blurrier reference hide behind a positive one."""

_LENGTHS, _REFINED = np.geomspace(0.3, 150.0, 60), 3
"""Streaks [pixels] that are compared, a tenth apart, and how many of the best are refined: every null of the
transfer function makes a maximum of its own, and a tenth is less than half the distance of two."""


def estimate_from_reference(
    sharp: np.ndarray,
    blurred: np.ndarray,
    *,
    plate_scale: float = 1.0,
    variance: tuple[float, float] | None = None,
    mask: np.ndarray | None = None,
    kernel_side: int = 41,
) -> KernelEstimate:
    """Estimate the blur between two frames of the same scene.

    Parameters
    ----------
    sharp, blurred : (ny, nx) arrays
        In the same unit up to a factor; the blurred one may be shifted by a few pixels.
    plate_scale : float
        Arcsec/pixel; without one, a pixel counts as an arcsec.
    variance : (float, float), optional
        Noise variance of a pixel in either frame; without it, the power at the highest frequencies.
    mask : (ny, nx) bool array, optional
        True where a pixel of either frame is unusable; it is filled from its neighbours.
    kernel_side : int
        Of the pixel kernel; odd.

    Returns
    -------
    estimate : KernelEstimate
        Of the streak or the normal, whichever fits better (``locus``), with ``kernel``.

    Raises
    ------
    ConfigurationError
        If the frames are not two images of one shape with finite values.
    UndeterminedError
        If the frames have no scene in common, its spectrum does not rise above the noise, or the sharp
        frame is blurrier than the other along any axis; or the frames differ by more than a blur and a shift
        (code ``model_mismatch``), as by a pattern that stands still.

    Notes
    -----
    *Assumes* white noise and one blur all over the frame.  *Fails when* the scene changes between frames.
    Moments are of the blur *added* to the sharp frame's own; noise may make them indefinite.
    """
    if kernel_side % 2 == 0:
        problem = f"A kernel has a middle pixel; its side must be odd, got {kernel_side}."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    drift, _ = align(sharp, blurred, mask)  # a lopsided blur is no reason to refuse
    pair = [np.asarray(frame, float) for frame in (sharp, blurred)]
    bad = np.zeros(pair[0].shape, bool) if mask is None else np.asarray(mask, bool)
    bad = bad | standing_pixels(*(fill(frame, bad) for frame in pair))
    pair = [fill(frame, bad) for frame in pair]
    window = np.outer(*(hann(n + 2)[1:-1] for n in pair[0].shape))
    fy, fx = np.meshgrid(fft.fftfreq(window.shape[0]), fft.rfftfreq(window.shape[1]), indexing="ij")
    norm = np.sqrt((window**2).sum())
    one, two = (fft.rfft2((frame - np.average(frame, weights=window)) * window) / norm for frame in pair)
    radius = np.hypot(fx, fy)
    edge = radius > 0.47
    noise = variance or tuple(float(np.mean(np.abs(t[edge]) ** 2)) for t in (one, two))
    band = (radius < _BAND) & (np.hypot(fy * window.shape[0], fx * window.shape[1]) > _LEAST_ORDER)
    # chosen by the neighbourhood's power: by its own, a frequency would be chosen for its noise
    band &= box_mean(np.abs(one) ** 2, 7) > 4 * noise[0]
    band &= ~(striped(np.abs(one) ** 2, radius) & (radius > _STRIPES))
    if band.sum() < _LEAST_FREQUENCIES:
        raise UndeterminedError(
            ErrorCode.NO_SIGNAL,
            f"Only {int(band.sum())} frequencies of the sharp frame rise above its noise; the fit needs "
            f"{_LEAST_FREQUENCIES}.",
        )
    ties = window.size * (window**4).sum() / (window**2).sum() ** 2  # of neighbouring frequencies
    moments, covariance, streak = _fit(one[band], two[band], fx[band], fy[band], noise, drift, ties)
    _refuse_other_differences(sharp, blurred, mask, drift, moments)
    kernel = _kernel(one, two, fx, fy, noise, drift, kernel_side, window.shape)
    locus = Linear.near(moments * plate_scale**2) if streak else Mvn.near(moments * plate_scale**2)
    return KernelEstimate(
        moments * plate_scale**2, covariance * plate_scale**4, "reference", kernel=kernel, locus=locus
    )


def _refuse_other_differences(sharp, blurred, mask, drift: Drift, moments: np.ndarray) -> None:
    """Refuse frames of which more differs than a blur and a shift can explain: patterns that stand still."""
    share = left_over(sharp, blurred, mask, drift)
    largest = float(np.linalg.eigvalsh(moments[[0, 1, 1, 2]].reshape(2, 2))[-1])
    if share > _LEFT_OVER * max(largest, _LEAST_BLUR):
        found = f"No blur explains {share:.2g} of the power of the frame"
        reasons = "a pattern stands still, or the scene changed"
        remedy = "divide by the flat field, mask the pattern, or give another reference"
        raise UndeterminedError(ErrorCode.MODEL_MISMATCH, f"{found}: {reasons}; {remedy}.")


def _fit(one, two, fx, fy, noise, drift, ties) -> tuple[np.ndarray, np.ndarray, bool]:
    """Return the moments (3,), their covariance [pixels], and whether a streak fits better than a normal."""

    def normal(q, fx, fy):
        return np.exp(np.clip(-2 * np.pi**2 * (q[0] * fx**2 + 2 * q[1] * fx * fy + q[2] * fy**2), -60, 2))

    def streak(q, fx, fy):
        return np.sinc(q[0] * fx + q[1] * fy)

    def residuals(p, transfer, one, two, fx, fy):
        blur = np.exp(p[0]) * transfer(p[3:], fx, fy)
        model = one * blur * np.exp(-2j * np.pi * (p[1] * fx + p[2] * fy))
        scaled = (two - model) / np.sqrt(noise[1] + blur**2 * noise[0]) * np.sqrt(2 / ties)
        return np.concatenate([scaled.real, scaled.imag])

    def fitted(transfer, starts):
        few = [a[:: max(1, one.size // _SAMPLE)] for a in (one, two, fx, fy)]
        tries = [least_squares(residuals, p, args=(transfer, *few), x_scale="jac") for p in starts]
        best = min(tries, key=lambda fit: fit.cost)
        return least_squares(residuals, best.x, args=(transfer, one, two, fx, fy), x_scale="jac")

    share = np.sqrt((np.abs(two) ** 2).sum() / (np.abs(one) ** 2).sum())
    head = [np.log(max(share, 1e-6)) / 2, drift.x, drift.y]
    wide = 1 / (2 * np.pi**2 * np.average(fx**2 + fy**2, weights=np.abs(one) ** 2))
    best = fitted(normal, [[*head, s * wide, 0, s * wide] for s in _STARTS])
    # of a streak across the sharp frame's own blur the normal tells, though the streak may fit better
    refuse_blurrier(best.x[3:], _covariance(best)[3:, 3:], tolerated=_TOLERATED)
    angle = np.radians(principal_axes(best.x[3:])[2])
    axis = np.array([np.cos(angle), np.sin(angle)])
    grid = [[*best.x[:3], *(length * axis)] for length in _LENGTHS]
    grid.sort(key=lambda p: float(np.sum(residuals(p, streak, one, two, fx, fy) ** 2)))
    line = fitted(streak, grid[:_REFINED])
    if line.cost < best.cost - 2:
        x, y = line.x[3:]
        slopes = np.array([[2 * x, y, 0], [0, x, 2 * y]]) / 12
        covariance = slopes.T @ _covariance(line)[3:, 3:] @ slopes
        covariance += np.eye(3) * 1e-6 * max(np.trace(covariance), 1e-12)
        return np.array([x * x, x * y, y * y]) / 12, covariance, True
    return best.x[3:], _covariance(best)[3:, 3:], False


def _covariance(fit) -> np.ndarray:
    """Return the covariance of a fit's parameters; what the model does not describe counts as noise."""
    misfit = 2 * fit.cost / (len(fit.fun) - len(fit.x))
    return np.linalg.inv(fit.jac.T @ fit.jac) * max(misfit, 1.0)


def _kernel(one, two, fx, fy, noise, drift, side, shape) -> np.ndarray:
    """Kernel (side, side) from the regularised ratio of the transforms; sums to one."""
    ratio = two * one.conj() / (np.abs(one) ** 2 + 10 * (noise[0] + noise[1]))
    whole = fft.irfft2(ratio * np.exp(2j * np.pi * (drift.x * fx + drift.y * fy)), shape)
    half = side // 2
    cut = np.roll(whole, (half, half), axis=(0, 1))[:side, :side]
    return cut / cut.sum()
