"""The grid on which a frame is modelled: the detector's pixels, padded, and refined where needed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.fft import next_fast_len

from jitterkit.conventions import offsets
from jitterkit.errors import ConfigurationError, ErrorCode

DEFAULT_PAD = 64
"""Fine samples of padding on each side, at least: of a star in the middle of each preset's frame, what wraps
around has a chi-squared below 1e-6 at 3.8e7 photons."""


@dataclass(frozen=True)
class Grid:
    """A padded, periodic sampling of the focal plane around a frame.

    The frame occupies the fine samples ``refine * (pad + i)``.  Padding keeps the light that leaves
    on one side from returning on the other; refining is needed only where the optics pass
    frequencies beyond the detector's Nyquist frequency.

    Parameters
    ----------
    shape : (int, int)
        Frame, ``(ny, nx)``.
    plate_scale : float
        Pixel pitch, arcsec.
    pad : int
        Pixels added on each side, at least.
    refine : int
        Fine samples per pixel along each axis.

    Raises
    ------
    ConfigurationError
        If one of them is impossible.
    """

    shape: tuple[int, int]
    plate_scale: float
    pad: int = DEFAULT_PAD
    refine: int = 1

    def __post_init__(self) -> None:
        if len(self.shape) != 2 or min(self.shape) < 1:
            problem = f"A grid needs a frame shape (ny, nx) of at least one pixel, got {self.shape}."
            raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
        if not (math.isfinite(self.plate_scale) and self.plate_scale > 0):
            problem = f"The plate scale must be positive, in arcsec per pixel; got {self.plate_scale}."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        if self.pad < 0 or self.refine < 1:
            problem = f"Need pad >= 0 and refine >= 1, got {self.pad} and {self.refine}."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)

    @property
    def pitch(self) -> float:
        """Fine sample pitch, arcsec."""
        return self.plate_scale / self.refine

    @property
    def fine_shape(self) -> tuple[int, int]:
        """Shape of the padded, refined array."""
        ny, nx = (next_fast_len(self.refine * (n + 2 * self.pad), real=True) for n in self.shape)
        return ny, nx

    @property
    def centre(self) -> tuple[float, float]:
        """Position ``(y, x)`` of the frame's centre on the fine array, in arcsec from its first sample."""
        y, x = (self.plate_scale * (self.pad + (n - 1) / 2) for n in self.shape)
        return y, x

    @property
    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Offsets ``y, x`` of the frame's pixels from its centre, arcsec."""
        y, x = (offsets(n, self.plate_scale) for n in self.shape)
        return y, x

    @property
    def frequencies(self) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies ``(fy[:, None], fx[None, :])`` in cycles/arcsec; the x axis is the half axis."""
        ny, nx = self.fine_shape
        return np.fft.fftfreq(ny, self.pitch)[:, None], np.fft.rfftfreq(nx, self.pitch)[None, :]

    @property
    def centring(self) -> np.ndarray:
        """Return the factor that centres a spectrum on the optical axis, about which the PSF is symmetric."""
        (fy, fx), (cy, cx) = self.frequencies, ((n - 1) / 2 * self.pitch for n in self.fine_shape)
        return np.exp(2j * np.pi * fy * cy) * np.exp(2j * np.pi * fx * cx)

    @property
    def nyquist(self) -> float:
        """Return the fine array's Nyquist frequency, cycles/arcsec."""
        return 0.5 / self.pitch

    def crop(self, fine):
        """Cut the frame's samples out of a fine array ``(..., My, Mx)``."""
        first, step = self.refine * self.pad, self.refine
        ny, nx = self.shape
        return fine[..., first : first + ny * step : step, first : first + nx * step : step]
