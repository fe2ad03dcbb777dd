"""Inner products of a frame with the image of a star, at every pixel by one Fourier transform."""

from __future__ import annotations

import numpy as np
from scipy import fft

from jitterkit.loci.base import Locus
from jitterkit.optics.grid import Grid
from jitterkit.optics.otf import OTF


def resolution(otf: OTF) -> float:
    """Return the finest detail that the optics pass [arcsec].

    It is one over the highest frequency that keeps a hundredth of its contrast.
    """
    fy, fx = otf.grid.frequencies
    passed = np.abs(np.asarray(otf.value)) > 0.01
    return float(1 / max(np.hypot(fy, fx)[passed].max(), 1 / (otf.grid.plate_scale * max(otf.grid.shape))))


def spectrum_of_star(otf: OTF, jitter: Locus | None) -> np.ndarray:
    """Return the transfer function of a star on the frame's pixels (my, mx//2 + 1)."""
    fy, fx = otf.grid.frequencies
    optics = np.asarray(otf.value) * otf.grid.refine**2
    if not otf.pixel_included:
        optics = optics * np.sinc(otf.grid.plate_scale * fx) * np.sinc(otf.grid.plate_scale * fy)
    return optics if jitter is None else optics * np.asarray(jitter.transfer(fx, fy))


def star_at(position: tuple[float, float], spectrum: np.ndarray, grid: Grid) -> np.ndarray:
    """Return the image of a star at ``(x, y)`` from the frame's centre [arcsec], on the fine array."""
    fy, fx = grid.frequencies
    cy, cx = grid.centre
    ramp = np.exp(-2j * np.pi * fx * (position[0] + cx)) * np.exp(-2j * np.pi * fy * (position[1] + cy))
    return fft.irfft2(spectrum * ramp, s=grid.fine_shape)


def embed(frame: np.ndarray, grid: Grid) -> np.ndarray:
    """Put a frame (ny, nx) on the fine array, zero outside and between its pixels."""
    fine = np.zeros(grid.fine_shape)
    grid.crop(fine)[...] = frame
    return fine


def correlate(fine: np.ndarray, spectrum: np.ndarray, grid: Grid) -> np.ndarray:
    """Return the inner products (ny, nx) of an array with a pattern centred on each pixel of the frame."""
    return grid.crop(fft.irfft2(fft.rfft2(fine) * np.conj(spectrum), s=grid.fine_shape))


def ratio(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    """Divide; zero where the denominator is not positive."""
    positive = denominator > 0
    return np.where(positive, numerator / np.where(positive, denominator, 1.0), 0.0)


def vertex(values: np.ndarray, i: int) -> float:
    """Return the offset of a parabola's vertex from sample ``i``, within half a sample."""
    if not 0 < i < len(values) - 1:
        return 0.0
    left, middle, right = values[i - 1 : i + 2]
    bend = left - 2 * middle + right
    if bend >= 0 or min(left, right) <= 0:
        return 0.0
    return float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5))
