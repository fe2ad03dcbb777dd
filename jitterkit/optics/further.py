"""What may vary of the optics beside the modes of the wavefront: shifts, shadings, the wavefront of B."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.optics.colours import WAVELENGTH
from jitterkit.optics.otf import OTF, PLATE_SCALE
from jitterkit.precision import array_module, real


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

    Modes of the transmission and the wavefront of B are expanded at their own states, as the wavefront is.
    The shifts of wavelength and plate scale are small, and expanded about zero: to second and to first order.
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

    def split(self, aberrations, modes: int) -> tuple[Any, Any]:
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
        every, wavefront = real(aberrations), modes - self.shadings
        if every.shape == (wavefront,):
            every = array_module(every).concatenate([every, np.zeros(len(self.sigmas))])
        if every.shape != (wavefront + len(self.sigmas),):
            problem = f"Expected {wavefront} aberrations, got shape {every.shape}."
            raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
        return every[:modes], every[len(every) - len(self.of_b) :]

    @property
    def directions(self) -> list[tuple[float, float]]:
        """Changes of all wavelengths [nm] and of the grid's pitch, by a share, for one unit of each shift."""
        shifts = ((1.0, 0.0), self.wavelength_sigma), ((0.0, 1.0), self.plate_scale_sigma)
        return [direction for direction, sigma in shifts if sigma]


def with_further(otf: OTF, further: Further, slopes: Float[Array, "c s 2 my mx"], bend, beside, of_b) -> OTF:
    """Return the optics with the further parameters of an instrument.

    Parameters
    ----------
    otf : OTF
        With the modes of the pupil.
    further : Further
    slopes : (1 or 2, s, 2, My, Mx//2 + 1) array
        Parts of the derivatives by the shifts of the wavelength and of the plate scale, those there are; and
        then those of the derivative by the spectral index, where there is one.
    bend : (My, Mx//2 + 1) array or None
        Second derivative by the shift of the wavelength, where there is one.
    beside : (d,) array
        By how much the modes of B differ, nm.
    of_b : (My, Mx//2 + 1) array or None
        Transfer function of B.
    """
    return replace(
        otf,
        tints=None if otf.tints is None else jnp.concatenate([otf.tints, slopes[1]]),
        slopes=jnp.concatenate([otf.slopes, slopes[0]]),
        state=jnp.concatenate([otf.state, jnp.zeros(slopes.shape[1]), beside]),
        names=(*otf.names, *further.names),
        sigmas=further.sigmas,
        bend=bend,
        of_b=tuple(otf.names.index(mode) for mode in further.of_b),
        difference=None if of_b is None else of_b - otf.value,
    )
