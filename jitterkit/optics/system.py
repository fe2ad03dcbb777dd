"""The optics of an instrument on one frame's grid, ready to be asked for a transfer function."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import jax.numpy as jnp
import numpy as np

from jitterkit.optics.colours import Colours
from jitterkit.optics.expansion import expand
from jitterkit.optics.grid import Grid
from jitterkit.optics.otf import OTF
from jitterkit.optics.pupil import Pupil
from jitterkit.optics.spectrum import Spectrum

__all__ = ["FixedOptics", "OpticalSystem", "Optics"]


class Optics(Protocol):
    """What a fit asks of a telescope's optics on one grid."""

    @property
    def nominal(self) -> OTF:
        """Transfer function to start from."""
        ...

    def phase(self, aberrations) -> float:
        """Rms phase [rad] of a wavefront error [nm]."""
        ...

    def otf(self, aberrations, *, derivatives: bool = True) -> OTF:
        """Transfer function about ``aberrations`` [nm]."""
        ...

    def near(self, aberrations, slopes: OTF) -> OTF:
        """Transfer function, exact at ``aberrations`` [nm], with the derivatives of an expansion nearby."""
        ...


@dataclass(frozen=True)
class OpticalSystem:
    """A pupil, a spectrum and a grid, and the detector's charge diffusion; its aberrations can be changed.

    Parameters
    ----------
    pupil : Pupil
    spectrum : Spectrum
    grid : Grid
    diffusion : float
        How far charge wanders before it is collected: 1 sigma along each axis, arcsec.
    colours : Colours, optional
        What is known of the spectra of the stars; without, every source has the spectrum given.
    """

    pupil: Pupil
    spectrum: Spectrum
    grid: Grid
    diffusion: float = 0.0
    colours: Colours | None = None

    @cached_property
    def nominal(self) -> OTF:
        """Transfer function without aberrations, computed once."""
        return self.otf(None)

    @cached_property
    def _gram(self) -> np.ndarray:
        """Mean products (k, k) of the aberration modes over the lit pupil."""
        light = np.asarray(self.pupil.transmission)
        basis = np.asarray(self.pupil.basis)
        return np.einsum("iyx,jyx,yx->ij", basis, basis, light, optimize=True) / light.sum()

    def phase(self, aberrations) -> float:
        """Rms phase [rad] of a wavefront error [nm] over the lit pupil, at the shortest wavelength."""
        change = np.asarray(aberrations)[: len(self.pupil.names)]
        return float(2 * np.pi / min(self.spectrum.wavelengths) * np.sqrt(change @ self._gram @ change))

    def otf(self, aberrations, *, derivatives: bool = True) -> OTF:
        """Transfer function, exact at ``aberrations`` [nm], with its derivatives unless not wanted."""
        otf = expand(
            self.pupil,
            self.spectrum,
            self.grid,
            aberrations,
            derivatives=derivatives,
            colours=self.colours,
        )
        return otf.diffused(self.diffusion) if self.diffusion else otf

    def near(self, aberrations, slopes: OTF) -> OTF:
        """Transfer function, exact at ``aberrations`` [nm], with the derivatives of an expansion nearby.

        Without derivatives it is a tenth of the work; those of a state off by a phase of rms ``q`` are off by
        about ``q`` of themselves.
        """
        exact, chromatic = self.otf(aberrations, derivatives=False), slopes.chromatic
        if chromatic is not None and exact.chromatic is not None:
            chromatic = chromatic.at[0].set(exact.chromatic[0])
        state = jnp.asarray(aberrations, float)
        state = state.at[-1].set(0.0) if slopes.shifts else state
        return replace(slopes, value=exact.value, state=state, chromatic=chromatic)


@dataclass(frozen=True)
class FixedOptics:
    """A transfer function that is what it is: an empirical PSF, which holds the detector's diffusion too."""

    nominal: OTF

    def phase(self, aberrations) -> float:
        """Zero: there are no aberrations to change."""
        return 0.0

    def otf(self, aberrations, *, derivatives: bool = True) -> OTF:
        """The same whatever is asked for."""
        return self.nominal

    def near(self, aberrations, slopes: OTF) -> OTF:
        """Likewise."""
        return self.nominal
