"""What may vary of an instrument beside its wavefront.

Modes of the transmission and the wavefront of B are expanded at their own states, as the wavefront is.  The
shifts of wavelength and plate scale are small, and expanded about zero: to second and to first order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.optics.colours import WAVELENGTH

PLATE_SCALE = "plate_scale_shift"
"""Name of the relative shift of the plate scale: positions and the image of a star in pixels shrink by it."""


@dataclass(frozen=True)
class Further:
    """Hold the further parameters of the optics that may vary, and their prior errors.

    Parameters
    ----------
    shadings : int
        Modes of the pupil's transmission, the last ones of the pupil.
    wavelength_sigma : float
        Standard deviation of the shift of the wavelengths [nm]; zero where it does not vary.
    plate_scale_sigma : float
        Likewise of the relative shift of the plate scale.
    of_b : tuple of str
        Modes of the pupil in which the wavefronts of B and A may differ.
    """

    shadings: int = 0
    wavelength_sigma: float = 0.0
    plate_scale_sigma: float = 0.0
    of_b: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of those parameters that are no modes of the pupil."""
        shifts = ((WAVELENGTH, self.wavelength_sigma), (PLATE_SCALE, self.plate_scale_sigma))
        return (*(name for name, sigma in shifts if sigma), *(f"{mode}_b" for mode in self.of_b))

    @property
    def sigmas(self) -> tuple[float, ...]:
        """Standard deviation of each about zero, modes of the transmission first; infinite if unknown."""
        shifts = [sigma for sigma in (self.wavelength_sigma, self.plate_scale_sigma) if sigma]
        return (*[np.inf] * self.shadings, *shifts, *[np.inf] * len(self.of_b))

    def split(self, aberrations, modes: int) -> tuple[np.ndarray, np.ndarray]:
        """Split aberrations into those of the pupil's modes and the differences of B, zero where lacking.

        Parameters
        ----------
        aberrations : (k,) array
            Of the wavefront; or with all that may vary beside it, the shifts of which are left out.
        modes : int
            Of the pupil.

        Raises
        ------
        ConfigurationError
            If they are neither so many nor all.
        """
        every = np.asarray(aberrations, float)
        wavefront = modes - self.shadings
        if every.shape == (wavefront,):
            every = np.concatenate([every, np.zeros(len(self.sigmas))])
        if every.shape != (wavefront + len(self.sigmas),):
            raise ConfigurationError(
                ErrorCode.WRONG_SHAPE, f"Expected {wavefront} aberrations, got shape {every.shape}."
            )
        return every[:modes], every[len(every) - len(self.of_b) :]

    @property
    def directions(self) -> list[tuple[float, float]]:
        """Changes of all wavelengths [nm] and of the grid's pitch, by a share, for one unit of each shift."""
        shifts = ((1.0, 0.0), self.wavelength_sigma), ((0.0, 1.0), self.plate_scale_sigma)
        return [direction for direction, sigma in shifts if sigma]
